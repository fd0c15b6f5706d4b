//! Suppression of libwayland's error message about `XDG_RUNTIME_DIR`.
//!
//! wgpu asks Vulkan for window surfaces, even if no window is opened. Mesa's device-select layer then looks for the GPU
//! of a Wayland display. If libwayland can't build the socket's path, as in containers and under cron, it prints
//! "error: XDG_RUNTIME_DIR is invalid or not set in the environment". An absolute `WAYLAND_DISPLAY` makes the folder
//! unnecessary. A process can't change its own environment without unsafe code, so the program replaces itself.

use std::ffi::OsStr;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::Command;

const RUNTIME_DIR: &str = "XDG_RUNTIME_DIR";
const DISPLAY: &str = "WAYLAND_DISPLAY";

/// Path of a socket that doesn't exist, as the value of `WAYLAND_DISPLAY`.
const NO_DISPLAY: &str = "/nonexistent/wayland";

/// Restarts the program with the same process id, arguments and open files, if libwayland would print the error.
/// Returns if a restart isn't necessary or possible. Must be called before anything is read or written.
pub(crate) fn silence() {
    if !complains(std::env::var_os(RUNTIME_DIR).as_deref(), std::env::var_os(DISPLAY).as_deref()) {
        return;
    }
    let Ok(program) = std::env::current_exe() else { return };
    let mut arguments = std::env::args_os();
    let mut again = Command::new(program);
    if let Some(name) = arguments.next() {
        again.arg0(name);
    }
    // If the restart fails, the program continues, and libwayland prints its line.
    let _ = again.args(arguments).env(DISPLAY, NO_DISPLAY).exec();
}

/// True if libwayland would print an error when asked for the default display.
fn complains(runtime_dir: Option<&OsStr>, display: Option<&OsStr>) -> bool {
    let is_absolute = |path: Option<&OsStr>| path.is_some_and(|path| Path::new(path).is_absolute());
    !is_absolute(runtime_dir) && !is_absolute(display)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_environment_without_a_socket_path_is_changed() {
        let with = |runtime_dir: Option<&str>, display: Option<&str>| {
            complains(runtime_dir.map(OsStr::new), display.map(OsStr::new))
        };
        for (runtime_dir, display) in [(None, None), (Some(""), None), (Some("run"), Some("wayland-1"))] {
            assert!(with(runtime_dir, display), "{runtime_dir:?} {display:?}");
            // A restarted program never restarts again.
            assert!(!with(runtime_dir, Some(NO_DISPLAY)));
        }
        assert!(!with(Some("/run/user/1000"), None));
        assert!(!with(Some("/run/user/1000"), Some("wayland-0")));
        assert!(!with(None, Some("/run/user/1000/wayland-0")));
    }
}
