//! Public entry point of the server: opens a port and serves pages.

use crate::Config;
use crate::drawing_thread::DrawingThread;
use crate::guard::{self, Guard};
use crate::hub::Hub;
use crate::request_handler::RequestHandler;
use crate::server::{self, Shared};
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread;

/// Server that listens on a port, but doesn't load or draw before [`Viewer::run`].
pub struct Viewer {
    listener: TcpListener,
    address: SocketAddr,
    guard: Guard,
    handler: RequestHandler,
}

impl Viewer {
    /// Opens the port of the server.
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
        let handler = RequestHandler::new(&config)?;
        let guard = Guard::new(address.port())?;
        Ok(Self { listener, address, guard, handler })
    }

    /// Returns the address of the page, which contains the token.
    pub fn url(&self) -> String {
        self.address_with(self.guard.token())
    }

    /// Returns an address that opens the page only once. After it was used, this method returns an address without a
    /// token. It is meant for the browser's command line, which other users of this machine can read.
    pub fn url_for_once(&self) -> String {
        self.address_with(&self.guard.one_time_token().unwrap_or_default())
    }

    fn address_with(&self, token: &str) -> String {
        format!("http://{}/?token={token}", self.address)
    }

    /// Serves pages and draws on the current thread, until the program ends. `note` gets messages for the terminal.
    ///
    /// # Errors
    /// A message if the server's thread can't be started.
    pub fn run(self, note: &mut dyn FnMut(&str)) -> Result<(), String> {
        let hub = Arc::new(Hub::default());
        let welcome = self.handler.welcome().to_string();
        let shared = Arc::new(Shared::new(hub.clone(), self.guard, welcome));
        let listener = self.listener;
        let accepting = thread::Builder::new().name("server".to_owned());
        let started = accepting.spawn(move || server::accept(&listener, &shared));
        started.map_err(|e| format!("can't start the server's thread: {e}"))?;
        DrawingThread::new(hub, self.handler).run(note)
    }
}
