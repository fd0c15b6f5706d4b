//! A viewer of surfel scenes: a page in the browser, and the server that draws for it.
//!
//! [`Viewer::bind`] opens a server on this machine's own addresses. [`Viewer::run`] loads the scene and draws the
//! images that pages request, until the program ends. Images at rest equal those of `surfel render` to the byte.
//!
//! ```no_run
//! use surfel_view::{Config, Viewer};
//! let config = Config { inputs: vec!["scan.ply".into()], ..Config::default() };
//! let viewer = Viewer::bind(config)?;
//! println!("open {}", viewer.url());
//! viewer.run(&mut |note| println!("{note}"))?;
//! # Ok::<(), String>(())
//! ```
//!
//! # Parts
//! - `request_handler` answers the requests of pages with a [`surfel_app::session::Session`] per backend and inputs,
//!   which `sessions` stores;
//! - [`Painter`] is a request handler for a single page without a server, in a notebook or in a page that draws by
//!   WebAssembly;
//! - `server` serves the page's files over HTTP, and one WebSocket per page; `http` limits the size of requests, and
//!   `guard` controls access;
//! - `hub` queues the newest request of each page and the newest image for it, so that memory is bounded;
//! - `drawing_thread` is the thread that draws the images for all pages of a server;
//! - `export` writes a page that draws by WebAssembly, as one file (Cargo feature `export`);
//! - `state` maps the page's state, an object of options, to the options table, and to commands;
//! - `mcp` offers the functions of the page as tools for other programs, on stdin and stdout (Cargo feature `mcp`);
//! - `page/` has the page: HTML, CSS and JavaScript, without a build step.
//!
//! # Layer
//! The crate lies between `surfel-app`, whose sessions load and draw, and `surfel-cli`, whose commands `view` and `mcp`
//! it implements.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

#[cfg(feature = "server")]
mod drawing_thread;
#[cfg(feature = "export")]
mod export;
#[cfg(feature = "server")]
mod guard;
#[cfg(feature = "server")]
mod http;
#[cfg(feature = "server")]
mod hub;
#[cfg(feature = "mcp")]
pub mod mcp;
#[cfg(any(feature = "export", feature = "widget"))]
mod page;
mod painter;
mod request_handler;
#[cfg(feature = "server")]
mod server;
mod sessions;
mod state;
#[cfg(feature = "server")]
mod viewer;

#[cfg(feature = "export")]
pub use export::{export, export_folder};
pub use painter::{Message, Painter};
use std::path::PathBuf;
use std::sync::Arc;
#[cfg(feature = "server")]
pub use viewer::Viewer;

/// Returns the HTML of the page for a notebook's frame. The page sends its requests as messages to the surrounding
/// window.
///
/// # Errors
/// A message if the page's HTML lacks a place for its style, script or icon, which is a defect of Surfel.
#[cfg(feature = "widget")]
pub fn page_in_frame() -> Result<String, String> {
    const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src blob: \
                          data:; base-uri 'none'; form-action 'none'";
    page::with(POLICY, &page::script(include_str!("../page/frame.js")))
}

/// Configuration of a page: the scene and its options, and the server.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// One scene file, or files of splats, points and meshes.
    pub inputs: Vec<PathBuf>,
    /// Names of the inputs for display and for copied commands; `None` if they are the paths.
    pub names: Option<Vec<PathBuf>>,
    /// Content of stdin, for the input named `-`; `None` if no input has this name.
    pub stdin: Option<Arc<[u8]>>,
    /// Options as pairs of long name and text. The page can change the options that open no file.
    pub flags: Vec<(String, String)>,
    /// True if images are sent as raw pixels, 8-bit sRGB with alpha, instead of PNG and JPEG.
    pub sends_pixels: bool,
    /// Name or address of this machine that the server listens on; `None` for 127.0.0.1.
    pub host: Option<String>,
    /// Port that the server listens on; `None` for any free port.
    pub port: Option<u16>,
    /// Number of drawing threads; 0 for one per CPU.
    pub threads: usize,
}
