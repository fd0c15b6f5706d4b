//! The CPU backend as a WebAssembly module, which answers the requests of the page of `surfel view` without a server.
//!
//! The host passes bytes through buffers in the module's memory:
//!
//! 1. [`make_room`] allocates `n` bytes in one of the buffers ([`MODEL`], [`REQUEST`]) and returns their address; the
//!    host writes there.
//! 2. [`open`] opens the file in [`MODEL`], with the name and options in [`REQUEST`]. Alternatively, `open_host` opens
//!    a file of which the host reads only the parts that are needed.
//! 3. [`answer`] answers the request in [`REQUEST`], a JSON object like a message to the server's WebSocket.
//! 4. These functions return the length of their reply; [`reply`] returns its address. The first byte is 0 for text, 1
//!    for a header with a file.
//!
//! All functions run on the host's thread, one at a time.

#[cfg_attr(not(target_family = "wasm"), allow(dead_code, reason = "the import exists in WebAssembly alone"))]
mod host;

use std::cell::RefCell;
use std::path::PathBuf;
use surfel_view::{Config, Message, Painter};

/// Number of the buffer that contains a file.
pub const MODEL: usize = 0;
/// Number of the buffer that contains a request, or the name and options of a file to open.
pub const REQUEST: usize = 1;

/// State of the module: the buffers and the open file.
#[derive(Default)]
struct Module {
    buffers: [Vec<u8>; 2],
    reply: Vec<u8>,
    painter: Option<Painter>,
}

thread_local! {
    static MODULE: RefCell<Module> = RefCell::default();
}

/// Allocates `bytes` bytes in a buffer, and returns their address. Returns 0 if there is no such buffer, or not enough
/// memory.
#[unsafe(no_mangle)]
pub extern "C" fn make_room(buffer: usize, bytes: usize) -> usize {
    MODULE.with_borrow_mut(|module| {
        let Some(buffer) = module.buffers.get_mut(buffer) else { return 0 };
        *buffer = Vec::new();
        if buffer.try_reserve_exact(bytes).is_err() {
            return 0;
        }
        buffer.resize(bytes, 0);
        buffer.as_ptr() as usize
    })
}

/// Opens the file in the buffer [`MODEL`]. The buffer [`REQUEST`] contains the file's name, then the names and texts of
/// options, each preceded by a line feed. The reply is the first message to the page, or an error. Returns the length
/// of the reply.
#[unsafe(no_mangle)]
pub extern "C" fn open() -> usize {
    MODULE.with_borrow_mut(|module| {
        let (name, flags) = module.name_and_flags();
        // The bytes are moved, so that the file isn't in memory twice.
        let bytes = std::mem::take(&mut module.buffers[MODEL]);
        let inputs = vec!["-".into()];
        module.open(Config { inputs, names: Some(vec![name]), stdin: Some(bytes.into()), flags, ..Config::default() })
    })
}

/// Opens a file of `file_bytes` bytes that the page's JavaScript (the host) reads, like [`open`]. The module reads
/// parts of the file by the function `read`, which it imports from the module `host`. Returns the length of the reply.
#[cfg(target_family = "wasm")]
#[unsafe(no_mangle)]
pub extern "C" fn open_host(file_bytes: f64) -> usize {
    #[link(wasm_import_module = "host")]
    unsafe extern "C" {
        /// Copies `count` bytes of the file, from byte offset `at`, to `address`. Returns 0 on success.
        fn read(at: f64, address: usize, count: usize) -> u32;
    }
    fn read_at(at: u64, out: &mut [u8]) -> std::io::Result<()> {
        // SAFETY: the host writes `out.len()` bytes to `out`, which nothing else refers to.
        let failed = unsafe { read(at as f64, out.as_mut_ptr() as usize, out.len()) };
        let problem = || std::io::Error::other("the server didn't send this part of the file");
        if failed == 0 { Ok(()) } else { Err(problem()) }
    }
    MODULE.with_borrow_mut(|module| {
        let (name, flags) = module.name_and_flags();
        let file = host::RangeFile::new(file_bytes as u64, read_at);
        surfel_io::set_host_file(Some((name.clone(), std::sync::Arc::new(file))));
        module.open(Config { inputs: vec![name], flags, ..Config::default() })
    })
}

/// Answers the request in the buffer [`REQUEST`]. Returns the length of the reply.
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> usize {
    MODULE.with_borrow_mut(|module| {
        let request = String::from_utf8_lossy(&module.buffers[REQUEST]).into_owned();
        let message = match &mut module.painter {
            Some(painter) => painter.answer(&request),
            None => Message::Text("{\"do\":\"error\",\"message\":\"no file is open\"}".to_owned()),
        };
        module.reply_with(message)
    })
}

/// Returns the address of the latest reply.
#[unsafe(no_mangle)]
pub extern "C" fn reply() -> usize {
    MODULE.with_borrow(|module| module.reply.as_ptr() as usize)
}

/// Returns the number of wrong results of the fused multiply-add in `count` random and hard cases; `count` if they
/// can't be tested. For the module's test.
#[cfg(target_family = "wasm")]
#[unsafe(no_mangle)]
pub extern "C" fn fused_errors(count: usize) -> usize {
    surfel_cpu::formulas::fused_errors(count).unwrap_or(count)
}

impl Module {
    /// Parses the buffer [`REQUEST`]: a file name, then the names and texts of options, each preceded by a line feed.
    fn name_and_flags(&self) -> (PathBuf, Vec<(String, String)>) {
        let words = String::from_utf8_lossy(&self.buffers[REQUEST]);
        let mut words = words.split('\n').map(str::to_owned);
        let name = PathBuf::from(words.next().unwrap_or_default());
        let mut flags = Vec::new();
        while let (Some(name), Some(text)) = (words.next(), words.next()) {
            flags.push((name, text));
        }
        (name, flags)
    }

    /// Opens a file and closes the previous one. The reply is the first message to the page, or an error.
    fn open(&mut self, config: Config) -> usize {
        self.painter = None;
        let message = match Painter::new(&Config { sends_pixels: true, threads: 1, ..config }) {
            Ok(painter) => {
                let welcome = painter.welcome();
                self.painter = Some(painter);
                Message::Text(welcome)
            }
            Err(problem) => Message::Text(format!("{{\"do\":\"error\",\"message\":{problem:?}}}")),
        };
        self.reply_with(message)
    }

    fn reply_with(&mut self, message: Message) -> usize {
        self.reply.clear();
        match message {
            Message::Text(text) => {
                self.reply.push(0);
                self.reply.extend_from_slice(text.as_bytes());
            }
            Message::Binary(bytes) => {
                self.reply.push(1);
                self.reply.extend_from_slice(&bytes);
            }
        }
        self.reply.len()
    }
}
