//! `surfel backends`: lists the backends available on this machine.

use crate::failure::Failure;
use crate::stdout;
use serde_json::json;
use std::fmt::Write;

pub(crate) fn run(as_json: bool) -> Result<(), Failure> {
    let backends = surfel_backend::backends();
    if as_json {
        let entry = |b: &surfel_backend::BackendInfo| match &b.state {
            Ok(info) => json!({
                "name": b.name, "available": true, "adapter": info.adapter, "driver": info.driver,
                "threads": info.threads, "reason": null,
            }),
            Err(reason) => json!({
                "name": b.name, "available": false, "adapter": null, "driver": null, "threads": null, "reason": reason,
            }),
        };
        return stdout::json_result(&backends.iter().map(entry).collect());
    }
    let mut text = String::new();
    for backend in &backends {
        let line = match &backend.state {
            Ok(info) => {
                let threads = if info.threads > 0 { format!(", {} threads", info.threads) } else { String::new() };
                format!("{} ({}){threads}", info.adapter, info.driver)
            }
            Err(reason) => format!("not available: {reason}"),
        };
        // Writing to a string can't fail.
        let _ = writeln!(text, "{:<10} {line}", backend.name);
    }
    stdout::result(text.as_bytes())
}
