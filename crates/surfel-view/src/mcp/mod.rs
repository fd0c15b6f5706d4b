//! Tools for other programs that draw and inspect scenes: a server of the Model Context Protocol (MCP) on stdin and
//! stdout.
//!
//! A host, such as an assistant or an agent, starts the program and calls four tools: `inspect`, `render`, `pick` and
//! `compare`. Messages are JSON-RPC 2.0, one per line (specification of 2025-06-18, transport "stdio").
//!
//! - `protocol` reads messages and writes answers;
//! - `tools` describes the tools, reads their arguments, and draws by the same sessions as the page;
//! - `access` decides which files may be read.

mod access;
mod protocol;
mod tools;

use std::io::{BufRead, Write};
use std::path::PathBuf;
use surfel_backend::BackendOptions;
use surfel_io::lines::{Line, read_line};

/// Answers the messages of `input` until it ends. Tools read only `roots` and files below them; without roots, files
/// below the current folder. `threads` is the number of drawing threads; 0 for one per CPU.
///
/// # Errors
/// A message that names a root that can't be read, or says that the input or output failed.
pub fn serve(
    roots: &[PathBuf],
    threads: usize,
    input: &mut impl BufRead,
    output: &mut impl Write,
) -> Result<(), String> {
    let access = access::Access::new(roots)?;
    let mut tools = tools::Tools::new(access, BackendOptions::default().with_threads(threads));
    let mut line = Vec::new();
    loop {
        let read = read_line(input, &mut line, protocol::MAX_LINE).map_err(|e| format!("stdin: can't read it: {e}"))?;
        let answer = match read {
            Line::End => return Ok(()),
            Line::TooLong => Some(protocol::too_long()),
            Line::Whole => protocol::answer(&line, &mut tools),
        };
        if let Some(answer) = answer {
            let written = writeln!(output, "{answer}").and_then(|()| output.flush());
            written.map_err(|e| format!("stdout: can't write to it: {e}"))?;
        }
    }
}
