//! Input `-`: a file of any format on stdin.

use crate::failure::Failure;
use std::cell::OnceCell;
use std::io::{IsTerminal, Read};
use std::sync::Arc;
pub(crate) use surfel_load::paths::{display, is_stdin};

/// Largest accepted number of bytes from stdin, since a stream may never end.
const MAX_BYTES: u64 = 8 << 30;

/// Content of stdin, read on first use.
#[derive(Debug, Default)]
pub(crate) struct Stdin(OnceCell<Arc<[u8]>>);

impl Stdin {
    /// Returns the whole content. Reads stdin on the first call.
    pub(crate) fn bytes(&self) -> Result<Arc<[u8]>, Failure> {
        if let Some(bytes) = self.0.get() {
            return Ok(bytes.clone());
        }
        let mut input = std::io::stdin().lock();
        if input.is_terminal() {
            return Err(Failure::usage(
                "-: reads stdin, which is a terminal, expected a file: as in surfel - < scan.ply",
            ));
        }
        let mut bytes = Vec::new();
        let read = input.by_ref().take(MAX_BYTES + 1).read_to_end(&mut bytes);
        read.map_err(|e| Failure::input(format!("stdin: cannot read it: {e}")))?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(Failure::input(format!("stdin: holds more than {MAX_BYTES} bytes: give the file by its name")));
        }
        Ok(self.0.get_or_init(|| bytes.into()).clone())
    }
}
