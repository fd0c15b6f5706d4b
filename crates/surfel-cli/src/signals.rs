//! Handling of termination signals: ends child processes and removes temporary files before the program ends.

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use std::ffi::c_int;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Starts a thread that waits for termination signals. It kills encoders, removes temporary files, and ends the program
/// as the signal would have. If the thread can't start, the next run removes the files. Signals that the parent ignored
/// (`nohup`) stay ignored.
pub(crate) fn watch() {
    // With a handler, a write beyond `ulimit -f` fails with an error instead of killing the program.
    let _ = signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)));
    let ignored = ignored();
    let watched = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| !contains(ignored, *signal));
    let Ok(mut signals) = Signals::new(watched) else { return };
    let wait = move || {
        if let Some(signal) = signals.forever().next() {
            surfel_io::programs::kill_all();
            surfel_io::atomic::remove_temporary_files();
            let _ = signal_hook::low_level::emulate_default_handler(signal);
            std::process::exit(128 + signal);
        }
    };
    let _ = std::thread::Builder::new().name("signals".to_owned()).spawn(wait);
}

/// Returns the set of ignored signals as a bit mask, which Linux lists in `/proc`; 0 elsewhere.
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

fn contains(mask: u64, signal: c_int) -> bool {
    mask >> (signal - 1) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_count_signals_from_one() {
        // Status in /proc of a program started by nohup: it ignores SIGHUP, and SIGPIPE by Rust's runtime.
        let mask = 0x1001;
        let all = [SIGHUP, SIGINT, signal_hook::consts::SIGPIPE, SIGTERM];
        assert_eq!(all.map(|signal| contains(mask, signal)), [true, false, true, false]);
    }
}
