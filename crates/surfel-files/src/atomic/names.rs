//! Names of temporary files: `.surfel-HOST-PROCESS-RANDOM.tmp`.

use std::path::Path;
use std::time::{Duration, SystemTime};

/// Prefix of the name of every temporary file.
const PREFIX: &str = ".surfel-";
/// Suffix of the name of every temporary file.
pub(super) const SUFFIX: &str = ".tmp";
/// Number of random letters and digits in the name of a temporary file.
pub(super) const RANDOM_CHARACTERS: usize = 6;
/// Age of a temporary file, since its last change, from which it may be removed as left over, whichever process wrote
/// it.
pub(super) const OLD: Duration = Duration::from_secs(30 * 24 * 3600);

/// Host and process that wrote a temporary file, as stated in the file's name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Name {
    host: u64,
    process: u32,
}

impl Name {
    /// Returns the prefix that all names of this process's temporary files share. It states the host and the process.
    pub(super) fn prefix_of_this_process() -> String {
        Self { host: this_host(), process: std::process::id() }.prefix()
    }

    fn prefix(self) -> String {
        format!("{PREFIX}{:016x}-{}-", self.host, self.process)
    }

    /// Parses the name of a temporary file; returns `None` for names of any other form.
    pub(super) fn parse(name: &str) -> Option<Self> {
        let mut parts = name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX)?.split('-');
        let (host, process, random) = (parts.next()?, parts.next()?, parts.next()?);
        let is_random = random.len() == RANDOM_CHARACTERS && random.bytes().all(|c| c.is_ascii_alphanumeric());
        let found = Self { host: u64::from_str_radix(host, 16).ok()?, process: process.parse().ok()? };
        // Other spellings of the same numbers are names of another program.
        let is_own = is_random && parts.next().is_none() && name.starts_with(&found.prefix());
        is_own.then_some(found)
    }

    /// True if a temporary file is left over and may be removed. Its writer has ended, or the file, last modified at
    /// `modified`, is older than [`OLD`].
    pub(super) fn is_left_over(self, modified: Option<SystemTime>) -> bool {
        let is_old = modified.is_some_and(|time| time.elapsed().is_ok_and(|age| age > OLD));
        is_old || (self.host == this_host() && has_ended(self.process))
    }
}

/// Returns a number that identifies this host in names of temporary files. It is a hash of the running kernel and the
/// process namespace on Linux, else of the host's name.
fn this_host() -> u64 {
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    let namespace = std::fs::read_link("/proc/self/ns/pid").unwrap_or_default();
    let name = if boot.is_empty() || namespace == Path::new("") { host_name() } else { String::new() };
    let text = format!("{boot}{}{name}", namespace.display());
    // FNV-1a, 64 bits.
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

#[cfg(unix)]
fn host_name() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

#[cfg(not(unix))]
fn host_name() -> String {
    std::env::var("COMPUTERNAME").unwrap_or_default()
}

/// True if this host has no process with the id `process`.
#[cfg(unix)]
fn has_ended(process: u32) -> bool {
    use rustix::process::{Pid, test_kill_process};
    let pid = i32::try_from(process).ok().and_then(Pid::from_raw);
    // A process of another user can't be signalled, but exists.
    pid.is_some_and(|pid| test_kill_process(pid) == Err(rustix::io::Errno::SRCH))
}

/// True unless `process` is this process: outside Unix, this program doesn't test whether a process runs. Running
/// writers are still safe, because locked files are never removed and locks on these systems are valid across hosts.
#[cfg(not(unix))]
fn has_ended(process: u32) -> bool {
    process != std::process::id()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Returns a file name of a process of this host.
    pub(crate) fn name_of(process: u32) -> String {
        format!("{}aB3xYz{SUFFIX}", Name { host: this_host(), process }.prefix())
    }

    /// Returns a file name of a process of another host.
    pub(crate) fn name_elsewhere() -> String {
        format!("{}aB3xYz{SUFFIX}", Name { host: !this_host(), process: 1 }.prefix())
    }

    #[test]
    fn names_are_parsed_and_those_of_users_are_not() {
        let name = name_of(1234);
        assert_eq!(Name::parse(&name), Some(Name { host: this_host(), process: 1234 }));
        for other in [
            ".surfel-mine.tmp",
            ".surfel-a-b-c.tmp",
            ".surfel-0-1-aB3xYz.tmp",
            ".surfel-00000000000000FF-1-aB3xYz.tmp",
            ".surfel-00000000000000ff-01-aB3xYz.tmp",
            ".surfel-00000000000000ff-1-aB3xY.tmp",
            ".surfel-00000000000000ff-1-aB3x.z.tmp",
            ".surfel-00000000000000ff-1-aB3xYz-.tmp",
            ".surfel-00000000000000ff-4294967296-aB3xYz.tmp",
        ] {
            assert_eq!(Name::parse(other), None, "{other}");
        }
    }

    #[test]
    fn running_processes_and_other_hosts_own_their_files() {
        let now = Some(SystemTime::now());
        let this = Name { host: this_host(), process: std::process::id() };
        assert!(!this.is_left_over(now) && !this.is_left_over(None));
        // No process can have this id.
        let ended = Name { process: i32::MAX as u32, ..this };
        assert!(ended.is_left_over(now));
        let elsewhere = Name { host: !ended.host, ..ended };
        assert!(!elsewhere.is_left_over(now));
        assert!(elsewhere.is_left_over(SystemTime::now().checked_sub(2 * OLD)));
    }
}
