//! `surfel mcp`: serves tools that draw and inspect scenes to other programs, such as assistants and agents.

use crate::args::McpArgs;
use crate::console::Console;
use crate::failure::Failure;
use std::io::IsTerminal as _;

/// Answers the messages on stdin until the stream ends.
pub(crate) fn run(args: &McpArgs, threads: usize, console: &Console) -> Result<(), Failure> {
    let mut input = std::io::stdin().lock();
    if input.is_terminal() {
        console.note("messages of the Model Context Protocol are read from stdin, one a line; Ctrl+D ends");
    }
    let mut output = std::io::stdout().lock();
    surfel_view::mcp::serve(&args.roots, threads, &mut input, &mut output).map_err(Failure::input)
}
