//! Other programs that this process starts, such as encoders. They never outlive it.

use std::io;
use std::process::{Child, ChildStderr, ChildStdin, Command, ExitStatus};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Child processes that this process started and that are still running, for [`kill_all`].
static RUNNING: Mutex<Vec<Arc<Mutex<Child>>>> = Mutex::new(Vec::new());

/// Interval at which [`Program::wait`] checks if a program has ended.
const TICK: Duration = Duration::from_millis(2);

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn kill(child: &Mutex<Child>) {
    let mut child = lock(child);
    // Both fail if the program has ended.
    let _ = child.kill();
    let _ = child.wait();
}

/// Kills all running programs of this process and prevents new ones. Call it before exiting on a signal, and before
/// [`remove_temporary_files`](crate::atomic::remove_temporary_files), since programs may create files.
pub fn kill_all() {
    let mut running = lock(&RUNNING);
    running.drain(..).for_each(|child| kill(&child));
    // Starting a program needs this lock, and never gets it again.
    std::mem::forget(running);
}

/// A running program. It is killed when it is dropped, and by [`kill_all`].
#[derive(Debug)]
pub struct Program(Arc<Mutex<Child>>);

impl Program {
    /// Starts a program.
    ///
    /// # Errors
    /// [`io::Error`] if the program doesn't exist or can't be started.
    pub fn start(command: &mut Command) -> io::Result<Self> {
        let mut running = lock(&RUNNING);
        let child = Arc::new(Mutex::new(command.spawn()?));
        running.push(child.clone());
        Ok(Self(child))
    }

    /// Returns the pipe to the program's standard input. Returns `None` at the second call, or if the command requested
    /// no pipe.
    pub fn stdin(&self) -> Option<ChildStdin> {
        lock(&self.0).stdin.take()
    }

    /// Returns the pipe from the program's standard error. Returns `None` at the second call, or if the command
    /// requested no pipe.
    pub fn stderr(&self) -> Option<ChildStderr> {
        lock(&self.0).stderr.take()
    }

    /// Waits until the program has ended.
    ///
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn wait(&self) -> io::Result<ExitStatus> {
        // The lock is free in between, so that a signal can end the program.
        loop {
            if let Some(status) = lock(&self.0).try_wait()? {
                return Ok(status);
            }
            std::thread::sleep(TICK);
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        lock(&RUNNING).retain(|child| !Arc::ptr_eq(child, &self.0));
        kill(&self.0);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::process::Stdio;
    use std::time::Instant;

    #[test]
    fn programs_are_killed_when_they_are_dropped() {
        let started = Instant::now();
        let program = Program::start(Command::new("sleep").arg("60")).unwrap();
        let child = program.0.clone();
        drop(program);
        assert!(started.elapsed() < Duration::from_secs(30));
        assert!(!child.lock().unwrap().try_wait().unwrap().unwrap().success());
    }

    #[test]
    fn programs_are_waited_for_and_their_messages_are_read() {
        let program = Program::start(Command::new("sh").args(["-c", "echo no >&2; exit 7"]).stderr(Stdio::piped()));
        let program = program.unwrap();
        let messages = io::read_to_string(program.stderr().unwrap()).unwrap();
        assert_eq!((messages.as_str(), program.wait().unwrap().code()), ("no\n", Some(7)));
        assert!(program.stderr().is_none() && program.stdin().is_none());
        assert!(Program::start(&mut Command::new("surfel-no-such-program")).is_err());
    }
}
