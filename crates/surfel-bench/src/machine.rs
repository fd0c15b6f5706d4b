//! Description of the machine of a run.

use std::process::Command;

use serde::{Deserialize, Serialize};

/// Machine and source version of a run. Unknown fields are empty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Machine {
    pub cpu: String,
    /// Number of hardware threads that the system reports.
    pub threads: usize,
    /// Names of the operating system and of the processor architecture.
    pub system: String,
    /// Mean system load in the minute before the run. A value above 0 means that other processes were running.
    pub load: Option<f64>,
    /// Commit of the source, with a trailing `+` if the working tree has changes.
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

/// Returns the CPU time of this process, in milliseconds; `None` if the system doesn't report it.
///
/// On a shared machine, CPU time is a better measure of the cost of a frame than wall-clock time.
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

/// Returns the name of the CPU with its family and model, as Linux reports them; empty on other systems. The names of
/// virtual CPUs alone are ambiguous.
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
