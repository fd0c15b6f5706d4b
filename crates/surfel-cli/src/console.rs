//! Messages on stderr.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt;
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::Duration;
use surfel_app::wording::as_flags;
use surfel_io::is_obeyed;
use surfel_sample::Progress;

/// Largest length of a line of an error message, in characters. Longer lines are cut.
const MAX_LINE: usize = 400;

/// Printer of messages on stderr, with the verbosity of `-q` and `-v`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Console {
    quiet: bool,
    verbose: bool,
}

impl Console {
    pub(crate) fn new(quiet: bool, verbose: bool) -> Self {
        Self { quiet, verbose }
    }

    /// Prints a note for the user, unless `-q` is given.
    pub(crate) fn note(&self, text: &str) {
        if !self.quiet {
            to_stderr(&format!("note: {}\n", harmless(&as_flags(text))));
        }
    }

    /// Prints a detail if `-v` is given, and `-q` isn't.
    pub(crate) fn detail(&self, text: &str) {
        if self.verbose && !self.quiet {
            to_stderr(&format!("{}\n", harmless(&as_flags(text))));
        }
    }

    /// Returns a progress bar, which is visible only on a terminal and without `-q`.
    pub(crate) fn progress(&self) -> Bar {
        let visible = !self.quiet && std::io::stderr().is_terminal();
        Bar { visible, current: Mutex::new(None) }
    }
}

/// Progress bar, which is created with its first stage.
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

    /// Removes the bar from the terminal, so that notes don't mix with it.
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
            *current = Some(bar(name, total, ProgressDrawTarget::stderr()));
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

/// Smallest number of steps of a stage at which the progress bar shows a rate, instead of the elapsed time.
const MIN_STEPS: u64 = 2;
/// Interval at which a progress bar is redrawn even if nothing advances it.
const TICK: Duration = Duration::from_millis(250);

/// Creates a bar that shows the stage, the rate and the time left. For a stage with a single step, or an unknown number
/// of steps, the bar shows the elapsed time instead.
fn bar(name: &str, total: u64, target: ProgressDrawTarget) -> ProgressBar {
    let (length, template) = match total {
        0..MIN_STEPS => (None, "{msg:>20} {spinner} {lasted}"),
        _ => (Some(total), "{msg:>20} {wide_bar} {percent:>3} % {rate:>8} {left:>11}"),
    };
    let bar = ProgressBar::with_draw_target(length, target);
    if let Ok(style) = ProgressStyle::with_template(template) {
        type Out<'a> = &'a mut dyn fmt::Write;
        // A write error only means that the text isn't shown.
        let rate = |state: &ProgressState, out: Out<'_>| _ = out.write_str(&rate(state.per_sec()));
        let left = |state: &ProgressState, out: Out<'_>| _ = out.write_str(&left(state));
        let lasted = |state: &ProgressState, out: Out<'_>| _ = out.write_str(&clock(state.elapsed().as_secs()));
        bar.set_style(style.with_key("rate", rate).with_key("left", left).with_key("lasted", lasted));
    }
    bar.set_message(name.to_owned());
    bar.enable_steady_tick(TICK);
    bar
}

/// Formats a rate in steps per second with three significant digits.
fn rate(per_second: f64) -> String {
    let (scaled, unit) = match per_second {
        r if r >= 999.5e6 => (r / 1e9, " G/s"),
        r if r >= 999.5e3 => (r / 1e6, " M/s"),
        r if r >= 999.5 => (r / 1e3, " k/s"),
        r if r > 0.0 => (r, " /s"),
        _ => return String::new(),
    };
    let digits = usize::from(scaled < 99.95) + usize::from(scaled < 9.995);
    format!("{scaled:.digits$}{unit}")
}

/// Formats the time left; empty before the first step.
fn left(state: &ProgressState) -> String {
    if state.pos() == 0 { String::new() } else { format!("{} left", clock(state.eta().as_secs())) }
}

/// Formats a duration in seconds, such as 0:07 or 1:02:03.
fn clock(seconds: u64) -> String {
    let (hours, minutes, seconds) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    if hours > 0 { format!("{hours}:{minutes:02}:{seconds:02}") } else { format!("{minutes}:{seconds:02}") }
}

/// Prints an error message: `error:` and at most four lines.
pub(crate) fn error(message: &str) {
    let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
    let label = if color { "\x1b[1;31merror:\x1b[0m " } else { "error: " };
    let mut text = String::from(label);
    for (i, line) in message.lines().filter(|l| !l.trim().is_empty()).take(4).enumerate() {
        if i > 0 {
            text.push('\n');
        }
        let line = harmless(line);
        text.extend(line.chars().take(MAX_LINE));
        if line.chars().nth(MAX_LINE).is_some() {
            text.push('…');
        }
    }
    text.push('\n');
    to_stderr(&text);
}

/// Escapes control characters that a terminal would execute, except newlines. Names and files may contain any
/// characters.
fn harmless(text: &str) -> String {
    let mut harmless = String::with_capacity(text.len());
    for c in text.chars() {
        if c != '\n' && is_obeyed(c) { harmless.extend(c.escape_default()) } else { harmless.push(c) }
    }
    harmless
}

fn to_stderr(text: &str) {
    // If stderr is closed, the error can't be reported.
    let _ = std::io::stderr().lock().write_all(text.as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;
    use std::sync::Arc;

    /// A terminal that records everything written to it.
    #[derive(Clone, Debug, Default)]
    struct Terminal(Arc<Mutex<String>>);

    impl Terminal {
        fn push(&self, text: &str) -> io::Result<()> {
            self.0.lock().unwrap().push_str(text);
            Ok(())
        }

        fn text(&self) -> String {
            self.0.lock().unwrap().clone()
        }
    }

    impl indicatif::TermLike for Terminal {
        fn width(&self) -> u16 {
            80
        }
        fn move_cursor_up(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_down(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_right(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn move_cursor_left(&self, _: usize) -> io::Result<()> {
            Ok(())
        }
        fn write_line(&self, text: &str) -> io::Result<()> {
            self.push(&format!("{text}\n"))
        }
        fn write_str(&self, text: &str) -> io::Result<()> {
            self.push(text)
        }
        fn clear_line(&self) -> io::Result<()> {
            self.push("\n")
        }
        fn flush(&self) -> io::Result<()> {
            Ok(())
        }
    }

    /// Returns the terminal's content for a bar of `total` steps, half of which are done.
    fn shown(total: u64) -> String {
        let terminal = Terminal::default();
        let bar = bar("normals", total, ProgressDrawTarget::term_like_with_hz(Box::new(terminal.clone()), 255));
        for _ in 0..20 {
            std::thread::sleep(Duration::from_millis(20));
            bar.inc(total / 40);
        }
        bar.abandon();
        terminal.text()
    }

    #[test]
    fn bars_say_stage_rate_and_time_left() {
        let text = shown(4_000_000);
        let line = text.lines().rev().find(|line| line.contains(" M/s")).unwrap_or_else(|| panic!("{text}"));
        assert!(line.trim_start().starts_with("normals ") && line.contains("50 %"), "{line}");
        assert!(line.trim_end().ends_with("left") && line.contains("0:0"), "{line}");
        assert!(line.chars().count() <= 80, "{line}");
        let single = shown(1);
        assert!(single.contains("normals") && single.contains("0:00") && !single.contains("left"), "{single}");
    }

    #[test]
    fn rates_have_three_digits_and_times_are_clocks() {
        let rates = [0.0, 0.5, 9.994, 9.996, 99.96, 999.4, 999.6, 1_234.0, 999_600.0, 12.34e6, 2.5e9];
        let texts = ["", "0.50 /s", "9.99 /s", "10.0 /s", "100 /s", "999 /s", "1.00 k/s", "1.23 k/s", "1.00 M/s"];
        let texts = texts.into_iter().chain(["12.3 M/s", "2.50 G/s"]);
        assert!(rates.into_iter().map(rate).eq(texts), "{:?}", rates.map(rate));
        assert_eq!([0, 59, 60, 3599, 3600, 7384].map(clock), ["0:00", "0:59", "1:00", "59:59", "1:00:00", "2:03:04"]);
    }
}
