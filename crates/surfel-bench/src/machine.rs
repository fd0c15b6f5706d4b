//! Facts about the machine of a run.

use std::process::Command;

use serde::{Deserialize, Serialize};

/// Machine and source of a run. Unknown fields are empty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Machine {
    pub cpu: String,
    /// Number of hardware threads that the system reports.
    pub threads: usize,
    pub system: String,
    /// System load of the last minute before the run; a value above 0 means that other processes were running.
    pub load: Option<f64>,
    /// Commit, with a trailing `+` if files differ from it.
    pub commit: String,
}

impl Machine {
    pub(crate) fn this() -> Self {
        Self {
            cpu: cpu(),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            load: load(),
            commit: commit(),
        }
    }
}

/// Returns the CPU time of this process, milliseconds; `None` if the system doesn't report it.
///
/// On a shared machine the CPU time, not the wall-clock time, is the cost of a frame.
#[cfg(unix)]
pub(crate) fn busy_ms() -> Option<f64> {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Some(time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6)
}

/// Returns `None`: this system doesn't report CPU times.
#[cfg(not(unix))]
pub(crate) fn busy_ms() -> Option<f64> {
    None
}

/// Returns Linux's name of the CPU, with family and model: names of virtual CPUs alone are ambiguous.
fn cpu() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let field = |name: &str| {
        let line = text.lines().find(|line| line.split(':').next().is_some_and(|key| key.trim() == name));
        line.and_then(|line| line.split_once(':')).map(|(_, value)| value.trim().to_owned())
    };
    match (field("model name"), field("cpu family"), field("model")) {
        (Some(name), Some(family), Some(model)) => format!("{name}, family {family} model {model}"),
        (Some(name), ..) => name,
        _ => String::new(),
    }
}

fn load() -> Option<f64> {
    std::fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

fn commit() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|o| o.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) else { return String::new() };
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|text| !text.is_empty());
    commit + if changed { "+" } else { "" }
}
