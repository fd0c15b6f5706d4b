//! Server of a page: answers requests for the page's files, and serves one WebSocket per client.

use crate::guard::{self, Guard};
use crate::http::{self, Refusal, Request};
use crate::hub::{Hub, Outbox, Outgoing};
use serde_json::{Value, json};
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use tungstenite::Message;
use tungstenite::protocol::{Role, WebSocket, WebSocketConfig};

/// Largest number of simultaneous connections; further ones are refused.
const MAX_CONNECTIONS: usize = 48;
/// Largest accepted size of a client's message, in bytes.
const MAX_MESSAGE: usize = 64 << 10;
/// Number of messages of one client per second above which the server waits before it reads more.
const MAX_MESSAGES: u32 = 240;
/// Number of connections per second above which the server waits before it accepts more.
const MAX_ACCEPTED: u32 = 2000;
/// Time that a client may take to read a message before it is disconnected.
const WRITE_TIME: Duration = Duration::from_secs(20);
/// Constant with which a WebSocket's key is hashed (RFC 6455, 1.3).
const WEBSOCKET_GUID: &[u8] = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11";

/// Files of the page: path, media type and content.
const FILES: [(&str, &str, &str); 4] = [
    ("/", "text/html; charset=utf-8", include_str!("../page/index.html")),
    ("/view.css", "text/css; charset=utf-8", include_str!("../page/view.css")),
    ("/view.js", "text/javascript; charset=utf-8", include_str!("../page/view.js")),
    ("/icon.svg", "image/svg+xml", include_str!("../page/icon.svg")),
];

/// Page that is sent to requests without the token.
const CLOSED: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Surfel</title>\
                      <h1>This address is closed</h1>\
                      <p>Open the address that <code>surfel view</code> printed last in the terminal, with its token. \
                      An address copied from the browser has no token.</p></html>";

/// State shared by all connections.
pub(crate) struct Shared {
    pub(crate) hub: Arc<Hub>,
    pub(crate) guard: Guard,
    /// First message to each page: the options and the initial state, in JSON.
    welcome: String,
    /// Number of open connections.
    connections: AtomicUsize,
}

impl Shared {
    pub(crate) fn new(hub: Arc<Hub>, guard: Guard, welcome: String) -> Self {
        Self { hub, guard, welcome, connections: AtomicUsize::new(0) }
    }
}

/// Rate limiter, which waits if there are more than `most` events in a second.
struct RateLimiter {
    most: u32,
    count: u32,
    since: Instant,
}

impl RateLimiter {
    fn new(most: u32) -> Self {
        Self { most, count: 0, since: Instant::now() }
    }

    fn wait(&mut self) {
        self.count += 1;
        if self.count > self.most {
            thread::sleep(Duration::from_secs(1).saturating_sub(self.since.elapsed()));
        }
        if self.since.elapsed() >= Duration::from_secs(1) {
            (self.count, self.since) = (0, Instant::now());
        }
    }
}

/// Accepts connections until the program ends. Each connection has its own thread. If a connection can't be accepted,
/// tries again after a pause.
pub(crate) fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    let mut pace = RateLimiter::new(MAX_ACCEPTED);
    loop {
        pace.wait();
        // An error here means that the client has given up, or that too many files are open.
        let Ok((mut stream, _)) = listener.accept() else {
            thread::sleep(Duration::from_millis(20));
            continue;
        };
        if shared.connections.fetch_add(1, Ordering::AcqRel) >= MAX_CONNECTIONS {
            shared.connections.fetch_sub(1, Ordering::AcqRel);
            let _ = http::respond(&mut stream, "503 Service Unavailable", "text/plain", "", b"too many connections\n");
            continue;
        }
        let own = shared.clone();
        let connection = move || {
            answer(stream, &own);
            own.connections.fetch_sub(1, Ordering::AcqRel);
        };
        if thread::Builder::new().name("connection".to_owned()).spawn(connection).is_err() {
            shared.connections.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

/// Reads one request from a connection, and answers it by a file of the page, a redirection, a WebSocket or an error.
fn answer(mut stream: TcpStream, shared: &Arc<Shared>) {
    let request = match http::read(&mut stream) {
        Ok(request) => request,
        Err(refusal) => {
            let status = match refusal {
                Refusal::Malformed => "400 Bad Request",
                Refusal::Method => "405 Method Not Allowed",
                Refusal::TooLarge => "431 Request Header Fields Too Large",
                Refusal::Gone => return,
            };
            let _ = http::respond(&mut stream, status, "text/plain", "", b"expected a GET request\n");
            return;
        }
    };
    let guard = &shared.guard;
    if !guard::has_own_host(&request) {
        let body = b"this server answers for localhost only\n";
        let _ = http::respond(&mut stream, "421 Misdirected Request", "text/plain", "", body);
    } else if request.path == "/" && guard.has_token(&request) {
        // The token moves from the address to a cookie, so that an address that the user shares doesn't contain it.
        let more = format!("{}Location: /\r\n", guard.set_cookie());
        let _ = http::respond(&mut stream, "303 See Other", "text/plain", &more, b"");
    } else if !guard.has_cookie(&request) {
        let _ = http::respond(&mut stream, "403 Forbidden", "text/html; charset=utf-8", "", CLOSED.as_bytes());
    } else if request.path == "/socket" {
        open_socket(stream, &request, shared);
    } else if let Some((_, kind, content)) = FILES.iter().find(|(path, ..)| *path == request.path) {
        let _ = http::respond(&mut stream, "200 OK", kind, "", content.as_bytes());
    } else {
        let _ = http::respond(&mut stream, "404 Not Found", "text/plain", "", b"there is no such page\n");
    }
}

/// Returns the response key that accepts a WebSocket (RFC 6455, 4.2.2); `None` if the request isn't for a WebSocket.
fn accept_key(request: &Request) -> Option<String> {
    use sha1::Digest as _;
    let is_asked = request.lists("connection", "upgrade")
        && request.lists("upgrade", "websocket")
        && request.header("sec-websocket-version") == Some("13");
    let key = request.header("sec-websocket-key").filter(|key| is_asked && key.len() == 24)?;
    let hash = sha1::Sha1::new_with_prefix(key.as_bytes()).chain_update(WEBSOCKET_GUID).finalize();
    Some(data_encoding::BASE64.encode(&hash))
}

/// Turns a connection into a WebSocket and serves it until it ends.
fn open_socket(mut stream: TcpStream, request: &Request, shared: &Arc<Shared>) {
    let refuse = |stream: &mut TcpStream, status: &str, why: &str| {
        let _ = http::respond(stream, status, "text/plain", "", why.as_bytes());
    };
    if !guard::has_own_origin(request) {
        return refuse(&mut stream, "403 Forbidden", "the socket is for this server's own page\n");
    }
    let Some(key) = accept_key(request) else {
        return refuse(&mut stream, "426 Upgrade Required", "expected a WebSocket\n");
    };
    let Some((id, outbox)) = shared.hub.join() else {
        return refuse(&mut stream, "503 Service Unavailable", "too many viewers\n");
    };
    let head = format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {key}\r\n\r\n"
    );
    if let Ok(writing) = stream.try_clone()
        && stream.write_all(head.as_bytes()).is_ok()
    {
        let _ = (stream.set_read_timeout(None), stream.set_write_timeout(Some(WRITE_TIME)), stream.set_nodelay(true));
        outbox.push(Outgoing::Text(shared.welcome.clone()));
        let sending = outbox.clone();
        let writer = thread::Builder::new().name("socket".to_owned()).spawn(move || write(writing, &sending));
        read(stream, request.rest.clone(), shared, (id, &outbox));
        shared.hub.leave(id);
        if let Ok(writer) = writer {
            let _ = writer.join();
        }
    }
    shared.hub.leave(id);
}

fn limits() -> WebSocketConfig {
    WebSocketConfig::default()
        .read_buffer_size(8 << 10)
        .write_buffer_size(0)
        .max_message_size(Some(MAX_MESSAGE))
        .max_frame_size(Some(MAX_MESSAGE))
}

/// Reading half of a connection. Answers to pings go through the outbox, so that they don't interrupt another message.
struct ReadHalf(TcpStream);

impl Read for ReadHalf {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }
}

impl Write for ReadHalf {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Reads a client's messages until the client disconnects or breaks a rule.
fn read(stream: TcpStream, rest: Vec<u8>, shared: &Shared, (id, outbox): (u64, &Outbox)) {
    let mut socket = WebSocket::from_partially_read(ReadHalf(stream), rest, Role::Server, Some(limits()));
    let mut pace = RateLimiter::new(MAX_MESSAGES);
    loop {
        pace.wait();
        let refuse =
            |problem: &str| outbox.push(Outgoing::Text(json!({ "do": "error", "message": problem }).to_string()));
        match socket.read() {
            Ok(Message::Text(text)) => match serde_json::from_str::<Value>(&text) {
                Ok(request) if request.is_object() => {
                    if !shared.hub.ask(id, request) {
                        refuse("too many requests wait: wait for their answers");
                    }
                }
                _ => refuse("the message is no JSON object"),
            },
            Ok(Message::Ping(data)) => outbox.push(Outgoing::Pong(data.to_vec())),
            Ok(Message::Pong(_) | Message::Frame(_)) => {}
            Ok(Message::Binary(_) | Message::Close(_)) | Err(_) => break,
        }
    }
    let _ = socket.get_ref().0.shutdown(Shutdown::Both);
}

/// Sends the messages of the outbox until the client is disconnected.
fn write(stream: TcpStream, outbox: &Outbox) {
    let mut socket = WebSocket::from_raw_socket(stream, Role::Server, Some(limits()));
    while let Some(message) = outbox.next() {
        let message = match message {
            Outgoing::Text(text) => Message::text(text),
            Outgoing::Binary(bytes) => Message::binary(bytes),
            Outgoing::Pong(data) => Message::Pong(data.into()),
        };
        if socket.send(message).is_err() {
            break;
        }
    }
    outbox.close();
    let _ = socket.get_ref().shutdown(Shutdown::Both);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paces_let_a_number_pass_at_once() {
        let start = Instant::now();
        let mut pace = RateLimiter::new(5);
        (0..5).for_each(|_| pace.wait());
        assert!(start.elapsed() < Duration::from_millis(500));
        pace.wait();
        assert!(start.elapsed() >= Duration::from_millis(990));
    }
}
