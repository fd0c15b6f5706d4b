//! A viewer of surfel scenes: a page in the browser, and the server that draws for it.
//!
//! [`Viewer::bind`] opens a server on this machine's own addresses. [`Viewer::run`] loads the scene and draws what
//! pages ask for, until the program ends. Images at rest equal those of `surfel render` to the byte.
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
//! - `server` answers connections: the page's files over HTTP, and one WebSocket per page; `http` and `guard` limit who
//!   and what is answered;
//! - `hub` holds the newest request of each page and the newest image for it, so that nothing grows without bound;
//! - `artist` draws on one thread, by a [`surfel::session::Session`] per backend, which `sessions` keeps;
//! - `state` maps the page's state, an object of options, to the options table, and to commands;
//! - `mcp` offers what the page does as tools for other programs, on stdin and stdout (Cargo feature `mcp`);
//! - `page/` has the page: HTML, CSS and JavaScript, without a build step.
//!
//! # Layer
//! The crate lies between `surfel`, which loads and draws, and `surfel-cli`, whose commands `view` and `mcp` it
//! implements.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod artist;
mod guard;
mod http;
mod hub;
#[cfg(feature = "mcp")]
pub mod mcp;
mod server;
mod sessions;
mod state;

use guard::Guard;
use hub::Hub;
use serde_json::{Map, Value};
use server::Shared;
use state::Fixed;
use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use surfel::options::{Commands, table};

/// Scene and server of a viewer.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// One scene file, or files of splats, points and meshes.
    pub inputs: Vec<PathBuf>,
    /// Content of the input `-`.
    pub stdin: Option<Arc<[u8]>>,
    /// Options by long name, with their text. The page can change those that open no file.
    pub flags: Vec<(String, String)>,
    /// Name or address of this machine; `None`: 127.0.0.1.
    pub host: Option<String>,
    /// Port; `None`: any that is free.
    pub port: Option<u16>,
    /// Number of drawing threads; 0: one per CPU.
    pub threads: usize,
}

/// A server that listens but doesn't draw yet.
pub struct Viewer {
    listener: TcpListener,
    address: SocketAddr,
    guard: Guard,
    fixed: Fixed,
    initial: Map<String, Value>,
    config: Config,
}

impl Viewer {
    /// Opens the server's port.
    ///
    /// # Errors
    /// A message that names a host other than this machine, a port in use, or a flag that isn't an option.
    pub fn bind(config: Config) -> Result<Self, String> {
        let host = config.host.as_deref().unwrap_or("127.0.0.1");
        let Some(ip) = guard::loopback_address(host) else {
            return Err(format!(
                "--host {host}: expected this machine's own address: localhost, 127.0.0.1 or ::1\n  help: to view from \
                 another machine, add --port 8080 here, run ssh -L 8080:127.0.0.1:8080 HOST there, and open the \
                 printed address there"
            ));
        };
        let wanted = SocketAddr::new(ip, config.port.unwrap_or(0));
        let failed = |e: std::io::Error| {
            format!("{wanted}: can't listen there: {e}\n  help: choose another port with --port, or omit --port")
        };
        let listener = TcpListener::bind(wanted).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let (mut initial, mut fixed) = (Map::new(), Fixed { inputs: config.inputs.clone(), flags: Vec::new() });
        for (name, text) in &config.flags {
            let row = table().find(Commands::VIEW, name).ok_or_else(|| format!("there is no option --{name}"))?;
            if name == "size" {
                continue;
            }
            let is_path = matches!(row.set, surfel::options::Setter::Path(_)) && !row.has_name(text);
            match state::is_for_clients(row) && !is_path {
                false => fixed.flags.push((name.clone(), text.clone())),
                true if row.is_repeated => {
                    let list = initial.entry(name.clone()).or_insert_with(|| Value::Array(Vec::new()));
                    list.as_array_mut().into_iter().for_each(|list| list.push(text.as_str().into()));
                }
                true => _ = initial.insert(name.clone(), text.as_str().into()),
            }
        }
        let guard = Guard::new(address.port())?;
        Ok(Self { listener, address, guard, fixed, initial, config })
    }

    /// Returns the page's address, with the token.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.guard.token())
    }

    /// Serves pages and draws on the current thread, until the program ends. `note` gets messages for the terminal.
    ///
    /// # Errors
    /// A message if the server's thread can't be started.
    pub fn run(self, note: &mut dyn FnMut(&str)) -> Result<(), String> {
        let hub = Arc::new(Hub::default());
        let welcome = state::welcome(&self.fixed, &self.initial).to_string();
        let shared = Arc::new(Shared::new(hub.clone(), self.guard, welcome));
        let listener = self.listener;
        let accepting = thread::Builder::new().name("server".to_owned());
        let started = accepting.spawn(move || server::accept(&listener, &shared));
        started.map_err(|e| format!("can't start the server's thread: {e}"))?;
        artist::Artist::new(hub, self.fixed, self.initial, &self.config).run(note)
    }
}
