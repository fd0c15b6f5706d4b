//! Results on stdout.

use crate::failure::Failure;
use std::io::Write;

/// Writes a result to stdout.
pub(crate) fn result(bytes: &[u8]) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    out.write_all(bytes).and_then(|()| out.flush()).map_err(|e| Failure::stdout(&e))
}

/// Writes a JSON result to stdout, indented.
pub(crate) fn json_result(value: &serde_json::Value) -> Result<(), Failure> {
    let mut text = serde_json::to_string_pretty(value).map_err(|e| Failure::other(e.to_string()))?;
    text.push('\n');
    result(text.as_bytes())
}
