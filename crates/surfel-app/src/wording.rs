//! Wording of options in messages, as flags or as Python's keywords.
//!
//! Packages below this one contain neither flags nor keywords. Their messages write an option as a code span, such as
//! `` `max_points` `` or `` `classes=all` ``. A span has the option's name with underscores, and a value if that helps.
//! Programs replace the spans by flags or keywords. `xtask/tests/wording.rs` tests that no package below has a flag in
//! its messages, and that each span is an option.

use crate::options::{Row, table};
use serde_json::Value;
use std::borrow::Cow;

/// Replaces the options in a message by flags: `` `classes=all` `` becomes `--classes all`.
pub fn as_flags(message: &str) -> Cow<'_, str> {
    worded(message, |row, value| match value {
        None => format!("--{}", row.name),
        Some(value) if row.missing.is_some() => format!("--{}={value}", row.name),
        Some(value) => format!("--{} {value}", row.name),
    })
}

/// Replaces the options in the `notes` of a JSON object by flags.
pub fn notes_as_flags(object: &mut Value) {
    for note in object.get_mut("notes").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(text) = note.as_str() {
            *note = as_flags(text).into_owned().into();
        }
    }
}

/// Replaces the options in a message by Python's keywords: `` `classes=all` `` becomes `classes="all"`, and a switch
/// becomes `repair=True`. Numbers and placeholders in capitals aren't quoted.
pub fn as_keywords(message: &str) -> Cow<'_, str> {
    worded(message, |row, value| {
        let name = row.name.replace('-', "_");
        match value {
            None if row.is_switch() => format!("{name}=True"),
            None => name,
            Some(value) if value.parse::<f64>().is_ok() || value.starts_with(char::is_uppercase) => {
                format!("{name}={value}")
            }
            Some(value) => format!("{name}=\"{value}\""),
        }
    })
}

/// Replaces each code span that names an option by the text that `word` returns for the option and its value.
fn worded(message: &str, word: impl Fn(&Row, Option<&str>) -> String) -> Cow<'_, str> {
    let mut text = String::new();
    let mut rest = message;
    while let Some(start) = rest.find('`') {
        let after = &rest[start + 1..];
        let Some(length) = after.find('`') else { break };
        match option(&after[..length]) {
            Some((row, value)) => {
                text.push_str(&rest[..start]);
                text.push_str(&word(row, value));
                rest = &after[length + 1..];
            }
            // This span isn't an option. Its second backquote may begin another span.
            None => {
                text.push_str(&rest[..=start]);
                rest = after;
            }
        }
    }
    if text.is_empty() { message.into() } else { (text + rest).into() }
}

/// Returns the option that a code span names, and its value, if there is one.
fn option(span: &str) -> Option<(&'static Row, Option<&str>)> {
    let (name, value) = span.split_once('=').map_or((span, None), |(name, value)| (name, Some(value)));
    let is_row = |row: &&Row| row.name.len() == name.len() && row.name.replace('-', "_") == name;
    Some((table().rows().find(is_row)?, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_become_flags_and_keywords() {
        for (message, flags, keywords) in [
            ("no option", "no option", "no option"),
            (
                "left out (`all_points` keeps them)",
                "left out (--all-points keeps them)",
                "left out (all_points=True keeps them)",
            ),
            ("`classes=all`, or `max_points`", "--classes all, or --max-points", "classes=\"all\", or max_points"),
            ("`edge_aa=off` and `size=WxH`", "--edge-aa=off and --size WxH", "edge_aa=\"off\" and size=WxH"),
            (
                "`storage=16`: `surfel convert` `repair` `",
                "--storage 16: `surfel convert` --repair `",
                "storage=16: `surfel convert` repair=True `",
            ),
        ] {
            assert_eq!((as_flags(message).as_ref(), as_keywords(message).as_ref()), (flags, keywords));
        }
    }
}
