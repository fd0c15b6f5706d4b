//! `surfel view`: shows a scene on a page in the browser.

use crate::console::Console;
use crate::failure::Failure;
use surfel_app::options::Options;

/// Names of the options of `surfel view` that concern the server, not the scene. They aren't passed to the page.
#[cfg(feature = "view")]
const OF_SERVER: [&str; 5] = ["no-open", "port", "host", "export", "force"];

/// Serves the page until the program is ended, or exports it. `given` are the names and texts of the options that the
/// command line states.
#[cfg(feature = "view")]
pub(crate) fn run(
    args: &Options,
    given: Vec<(String, String)>,
    threads: usize,
    console: &Console,
) -> Result<(), Failure> {
    use crate::stdin::{Stdin, is_stdin};
    use crate::{resolve, stdout};
    use surfel_view::{Config, Viewer};
    args.render.check()?;
    let stdin = Stdin::default();
    // Missing files and broken scene files are reported before a browser opens.
    resolve::source(&args.inputs, &stdin)?;
    for path in args.inputs.iter().filter(|path| !is_stdin(path)) {
        if let Err(source) = path.metadata() {
            return Err(surfel_io::IoError::System { path: path.clone(), action: "read it", source }.into());
        }
    }
    let bytes = if args.inputs.iter().any(|path| is_stdin(path)) { Some(stdin.bytes()?) } else { None };
    let flags = given.into_iter().filter(|(name, _)| !OF_SERVER.contains(&name.as_str())).collect();
    let (inputs, host) = (args.inputs.clone(), args.host.clone());
    let config = Config { inputs, stdin: bytes, flags, host, port: args.port, threads, ..Config::default() };
    if let Some(path) = &args.export {
        return export(&config, path, args.force, console);
    }
    let viewer = Viewer::bind(config).map_err(Failure::other)?;
    let url = viewer.url();
    stdout::result(format!("{url}\n").as_bytes())?;
    if !args.no_open && !open(&viewer.url_for_once()) {
        console.note("no browser was opened: open the address above, through ssh -L if this is another machine");
    }
    console.note("the page is served until this program ends: Ctrl+C");
    viewer.run(&mut |text| console.note(text)).map_err(Failure::other)
}

/// Writes the page as an HTML file. If the path isn't that of an HTML file, writes a folder.
#[cfg(feature = "export")]
fn export(
    config: &surfel_view::Config,
    path: &std::path::Path,
    overwrite: bool,
    console: &Console,
) -> Result<(), Failure> {
    use surfel_io::ShowPath as _;
    if !path.extension().is_some_and(|end| end.eq_ignore_ascii_case("html") || end.eq_ignore_ascii_case("htm")) {
        let bytes = surfel_view::export_folder(config, path, overwrite).map_err(Failure::other)?;
        let megabytes = bytes as f64 / 1e6;
        console.note(&format!("{}: {megabytes:.1} MB: offer the folder by a web server", path.shown()));
        return Ok(());
    }
    let html = surfel_view::export(config).map_err(Failure::other)?;
    surfel_io::atomic::write(path, overwrite, |out| out.write_all(&html))?;
    let megabytes = html.len() as f64 / 1e6;
    console.note(&format!("{}: {megabytes:.1} MB: open it in a browser, from disk or from any server", path.shown()));
    Ok(())
}

/// Refuses the export, which isn't built into this program.
#[cfg(all(feature = "view", not(feature = "export")))]
fn export(_: &surfel_view::Config, _: &std::path::Path, _: bool, _: &Console) -> Result<(), Failure> {
    Err(Failure::other(
        "--export is not built into this program: build it with Cargo's feature 'export', after cargo xtask web\n  \
         help: surfel view INPUT serves the page",
    ))
}

/// Refuses the command, which isn't built into this program.
#[cfg(not(feature = "view"))]
pub(crate) fn run(_: &Options, _: Vec<(String, String)>, _: usize, _: &Console) -> Result<(), Failure> {
    Err(Failure::other(
        "view is not built into this program: build it with Cargo's feature 'view', as in cargo build --release \
         --features view\n  help: surfel INPUT -o OUT.png makes an image",
    ))
}

/// Opens an address in the user's browser. Returns false if no browser can be started.
#[cfg(feature = "view")]
fn open(url: &str) -> bool {
    use std::process::{Command, Stdio};
    let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    let mut command = if cfg!(target_os = "macos") {
        Command::new("open")
    } else if cfg!(windows) {
        Command::new("explorer")
    } else if has_screen {
        Command::new("xdg-open")
    } else {
        return false;
    };
    let quiet = command.arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    quiet.spawn().is_ok()
}
