//! What the user sees on stderr.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use surfel::Progress;

/// Longest line of an error message, in characters.
const MAX_LINE: usize = 400;

/// How much is said.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Console {
    quiet: bool,
    verbose: bool,
}

impl Console {
    pub(crate) fn new(quiet: bool, verbose: bool) -> Self {
        Self { quiet, verbose }
    }

    /// Something the user should know.
    pub(crate) fn note(&self, text: &str) {
        if !self.quiet {
            to_stderr(&format!("note: {text}\n"));
        }
    }

    /// Something that only `-v` shows.
    pub(crate) fn detail(&self, text: &str) {
        if self.verbose && !self.quiet {
            to_stderr(&format!("{text}\n"));
        }
    }

    /// A progress bar: on a terminal only, and not with `-q`.
    pub(crate) fn progress(&self) -> Bar {
        let visible = !self.quiet && std::io::stderr().is_terminal();
        Bar { visible, current: Mutex::new(None) }
    }
}

/// Shows how far a conversion has come.
pub(crate) struct Bar {
    visible: bool,
    current: Mutex<Option<ProgressBar>>,
}

impl Bar {
    fn with(&self, f: impl FnOnce(&mut Option<ProgressBar>)) {
        if self.visible {
            f(&mut self.current.lock().unwrap_or_else(std::sync::PoisonError::into_inner));
        }
    }

    /// Takes the bar away: its lines and notes don't mix.
    pub(crate) fn clear(&self) {
        self.with(|current| {
            if let Some(bar) = current.take() {
                bar.finish_and_clear();
            }
        });
    }
}

impl Progress for Bar {
    fn stage(&self, name: &str, total: u64) {
        self.with(|current| {
            if let Some(bar) = current.take() {
                bar.finish_and_clear();
            }
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
            if let Ok(style) = ProgressStyle::with_template("{msg:>20} {wide_bar} {percent:>3} %") {
                bar.set_style(style);
            }
            bar.set_message(name.to_owned());
            *current = Some(bar);
        });
    }

    fn advance(&self, steps: u64) {
        self.with(|current| {
            if let Some(bar) = current {
                bar.inc(steps);
            }
        });
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.clear();
    }
}

/// Prints an error: `error:` and at most four lines.
pub(crate) fn error(message: &str) {
    let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
    let label = if color { "\x1b[1;31merror:\x1b[0m " } else { "error: " };
    let mut text = String::from(label);
    for (i, line) in message.lines().filter(|l| !l.trim().is_empty()).take(4).enumerate() {
        if i > 0 {
            text.push('\n');
        }
        // File names may hold anything; a terminal must not obey it.
        text.extend(line.chars().take(MAX_LINE).map(|c| if c.is_control() { '?' } else { c }));
        if line.chars().nth(MAX_LINE).is_some() {
            text.push('…');
        }
    }
    text.push('\n');
    to_stderr(&text);
}

fn to_stderr(text: &str) {
    // Nobody is left to tell where stderr is closed.
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}
