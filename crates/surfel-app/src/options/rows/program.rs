//! Options for the backend and for the program itself.

use crate::options::row::{Commands, Group, Row, put, put_path};
use crate::values;

/// Names of the backends, which are the values of `--backend`.
const BACKENDS: [&str; 5] = ["auto", "cpu", "wgpu", "ash", "reference"];

const fn backend(row: Row) -> Row {
    row.of(Group::Backend, Commands::DRAWN).keyword(Commands::RENDER.and(Commands::FIGURE))
}

const fn backend_of(commands: Commands) -> Row {
    Row::text("backend", "BACKEND", |o, text| put(&mut o.backend, Ok(text.to_owned())))
        .of(Group::Backend, commands)
        .names(|| BACKENDS.to_vec())
        .drawn()
        .synonyms(&["renderer", "engine", "device", "gpu", "api"])
}

const fn program(row: Row) -> Row {
    row.of(Group::Program, Commands::ALL)
}

const fn view(row: Row) -> Row {
    row.of(Group::Program, Commands::VIEW)
}

pub(super) const ROWS: &[Row] = &[
    backend_of(Commands::DRAWN.and(Commands::ORTHO))
        .keyword(Commands::RENDER.and(Commands::ORTHO).and(Commands::FIGURE))
        .default_value("auto")
        .help("Rendering backend.", "")
        .everyday(),
    backend_of(Commands::AGAIN).help("Rendering backend, instead of the one that drew IMAGE.", "").everyday(),
    backend(Row::text("adapter", "NAME", |o, text| put(&mut o.adapter, Ok(text.to_owned()))))
        .help("Part of the adapter's name, in any case.", "")
        .python("str")
        .example("radeon")
        .synonyms(&["gpu-name", "card"]),
    backend(Row::text("storage", "BITS", |o, text| {
        o.quantised = match text {
            "32" => false,
            "16" => true,
            _ => return Err("expected 32 or 16".to_owned()),
        };
        Ok(())
    }))
    .names(|| vec!["32", "16"])
    .default_value("32")
    .drawn()
    .help("Bits per stored number: 16 takes about half the memory, with a small error.", "")
    .expert()
    .python(r#"Literal[16, 32, "16", "32"]"#)
    .synonyms(&["precision", "half", "quantize", "quantise"]),
    Row::switch("stdio", |_, _| {})
        .of(Group::Program, Commands::SERVE)
        .required(&[])
        .help(
            "Read a request from each line of stdin and answer with a line on stdout, both JSON; stop at the end of \
             stdin.",
            "",
        )
        .everyday(),
    view(Row::switch("no-open", |o, on| o.no_open = on))
        .help("Don't open a browser; print the page's address only.", "")
        .everyday()
        .synonyms(&["headless", "no-browser"]),
    view(Row::text("port", "PORT", |o, text| put(&mut o.port, values::port(text))))
        .help("Port of the page; by default one that is free.", "")
        .everyday()
        .example("8080"),
    view(Row::text("host", "HOST", |o, text| put(&mut o.host, Ok(text.to_owned()))))
        .help(
            "Address of this machine at which the page is served: 127.0.0.1 (default), localhost or ::1.",
            "From another machine, `ssh -L 8080:127.0.0.1:PORT HOST` opens a tunnel to the page.",
        )
        .example("localhost"),
    view(Row::path("export", "FILE|FOLDER", |o, path| put_path(&mut o.export, path)))
        .built(cfg!(feature = "export"))
        .help(
            "Write the page as one HTML file, or as a folder for a web server, instead of serving it.",
            "The page draws in the browser. Its images equal those of --backend cpu. An HTML file holds the input, and \
             opens from disk. A folder has the input beside the page; of a COPC file the page reads the parts that a \
             view needs.",
        )
        .everyday()
        .example("page.html")
        .synonyms(&["html", "save-html", "standalone"]),
    view(Row::switch("force", |o, on| o.force = on))
        .built(cfg!(feature = "export"))
        .letter('f')
        .help("Overwrite an existing file.", "")
        .everyday(),
    program(Row::switch("quiet", |o, on| o.quiet = on))
        .letter('q')
        .help("Print errors only.", "")
        .everyday()
        .synonyms(&["silent"]),
    program(Row::switch("verbose", |o, on| o.verbose = on))
        .letter('v')
        .help("Print additional information on stderr.", "")
        .everyday()
        .synonyms(&["debug", "log"]),
    program(Row::text("threads", "N", |o, text| {
        put(&mut o.threads, values::whole(text, 1..=1024).map(|count| count as usize))
    }))
    .keyword(Commands::RENDER.and(Commands::CONVERT).and(Commands::ORTHO).and(Commands::FIGURE))
    .help("Number of threads; by default one per CPU.", "")
    .python("int")
    .example("7")
    .synonyms(&["jobs", "cpus", "cores", "workers"]),
    program(Row::path("config", "FILE", |o, path| put_path(&mut o.config, path)))
        .help("TOML file with flags; its keys are long flag names.", "Flags on the command line take precedence.")
        .example("surfel.toml")
        .synonyms(&["settings", "options"]),
];
