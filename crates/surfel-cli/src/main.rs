//! `surfel`: renders, converts, inspects and compares from the command line.
//!
//! Results go to stdout, everything else to stderr. Exit codes: 0 success, 1 failure, 2 usage error, 3 bad input, 4
//! backend not available, 5 comparison over a threshold.

mod again;
mod args;
mod backends;
mod compare;
mod config;
mod console;
mod convert;
mod failure;
mod figure;
mod film;
mod info;
mod jobs;
#[cfg(feature = "mcp")]
mod mcp;
mod ortho;
mod output;
mod pages;
mod parse;
mod pieces;
mod render;
mod resolve;
mod series;
mod serve;
#[cfg(unix)]
mod signals;
mod stats;
mod stdin;
mod stdout;
mod stitch;
mod values;
mod verify;
mod view;
#[cfg(all(target_os = "linux", feature = "wgpu"))]
mod wayland;

use args::Command;
use console::Console;
use failure::Failure;
use std::ffi::OsString;
use std::process::ExitCode;

/// Stack size, in bytes, of the thread that parses the arguments and executes the command. The grammar of all commands
/// needs most of 1 MiB.
const STACK_BYTES: usize = 8 << 20;

fn main() -> ExitCode {
    #[cfg(all(target_os = "linux", feature = "wgpu"))]
    wayland::silence();
    // A panic is a defect. It is reported in one line on stderr, with exit code 1.
    std::panic::set_hook(Box::new(|info| {
        let place = info.location().map(|l| format!(" ({}:{})", l.file(), l.line())).unwrap_or_default();
        console::error(&format!("this is a defect of surfel, not of your input{place}: please report it"));
    }));
    #[cfg(unix)]
    signals::watch();
    let arguments: Vec<OsString> = std::env::args_os().collect();
    let guarded = |arguments| std::panic::catch_unwind(move || run(arguments)).unwrap_or(ExitCode::from(1));
    // The work runs on a separate thread, since the main thread's stack may be as small as `ulimit -s` allows.
    let own = arguments.clone();
    match std::thread::Builder::new().stack_size(STACK_BYTES).spawn(move || guarded(own)) {
        Ok(thread) => thread.join().unwrap_or(ExitCode::from(1)),
        Err(_) => guarded(arguments),
    }
}

fn run(arguments: Vec<OsString>) -> ExitCode {
    let cli = match parse::parse(arguments) {
        Ok(parsed) => parsed,
        Err(code) => return ExitCode::from(code),
    };
    let console = Console::new(cli.program.quiet, cli.program.verbose);
    let threads = cli.program.threads.unwrap_or(0);
    // Conversions use as many threads as rendering.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let result = match pool {
        Ok(pool) => pool.install(|| execute(cli.command, threads, &console)),
        Err(error) => Err(Failure::other(format!("can't start {threads} threads: {error}"))),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            if !failure.message().is_empty() {
                console::error(failure.message());
            }
            ExitCode::from(failure.code())
        }
    }
}

fn execute(command: Command, threads: usize, console: &Console) -> Result<(), Failure> {
    match command {
        Command::Render(args) => render::run(&args, threads, console),
        Command::Again(args) => again::run(&args, threads, console),
        Command::Figure(args) => figure::run(&args, threads, console),
        Command::Convert(args) => convert::run(&args, console),
        Command::Ortho(args) => ortho::run(&args, threads, console),
        Command::Info(args) => info::run(&args, console),
        Command::Stitch(args) => stitch::run(&args, console),
        Command::Serve(args) => serve::run(&args, threads, console),
        Command::Jobs(args) => jobs::run(&args, console),
        Command::Compare(args) => compare::run(&args),
        Command::Backends(args) => backends::run(args.json),
        #[cfg(feature = "mcp")]
        Command::Mcp(args) => mcp::run(&args, threads, console),
        Command::View(args, given) => view::run(&args, given, threads, console),
        Command::Completions(args) => pages::completions(args.shell),
        Command::Man => pages::man(),
    }
}
