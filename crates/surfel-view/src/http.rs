//! HTTP/1.1 server functions for the page: one GET request of limited size per connection.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Largest accepted size of a request's head, in bytes.
pub(crate) const MAX_HEAD: usize = 16 << 10;
/// Largest accepted number of headers of a request.
const MAX_HEADERS: usize = 64;
/// Largest accepted time in which a client sends a request's head, and in which it accepts a part of the response.
const HEAD_TIME: Duration = Duration::from_secs(5);

/// A request for a page or for a WebSocket.
#[derive(Debug, Default)]
pub(crate) struct Request {
    /// Path of the address, without the query.
    pub(crate) path: String,
    /// Query of the address: the text after `?`.
    pub(crate) query: String,
    /// Headers: names in lower case, and values.
    headers: Vec<(String, String)>,
    /// Bytes that were received after the head: the beginning of the WebSocket's messages.
    pub(crate) rest: Vec<u8>,
}

/// Reason for refusing a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The request isn't HTTP.
    Malformed,
    /// The method isn't GET.
    Method,
    /// The head has too many bytes or headers.
    TooLarge,
    /// The connection ended, or the head took too long.
    Gone,
}

impl Request {
    /// Returns the value of a header by its name in lower case; `None` if it is missing or given several times.
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        let mut values = self.headers.iter().filter(|(known, _)| known == name).map(|(_, value)| value.as_str());
        let first = values.next();
        if values.next().is_some() { None } else { first }
    }

    /// Returns the value of a cookie; `None` if the request doesn't have it.
    pub(crate) fn cookie(&self, name: &str) -> Option<&str> {
        let cookies = self.header("cookie")?.split(';').filter_map(|pair| pair.trim().split_once('='));
        cookies.into_iter().find(|(known, _)| *known == name).map(|(_, value)| value)
    }

    /// True if a header's comma-separated list contains a word, in upper or lower case.
    pub(crate) fn lists(&self, header: &str, word: &str) -> bool {
        self.header(header).is_some_and(|list| list.split(',').any(|item| item.trim().eq_ignore_ascii_case(word)))
    }
}

/// Reads a request's head, within limits of size and time.
pub(crate) fn read(stream: &mut TcpStream) -> Result<Request, Refusal> {
    let deadline = Instant::now() + HEAD_TIME;
    let mut bytes = Vec::new();
    let mut block = [0; 2048];
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return Err(Refusal::Gone);
        }
        match stream.read(&mut block) {
            Ok(0) | Err(_) => return Err(Refusal::Gone),
            Ok(count) => bytes.extend_from_slice(&block[..count]),
        }
        if let Some(request) = parse(&bytes)? {
            return Ok(request);
        }
        if bytes.len() >= MAX_HEAD {
            return Err(Refusal::TooLarge);
        }
    }
}

/// Parses a request; `None` if its head isn't complete yet.
fn parse(bytes: &[u8]) -> Result<Option<Request>, Refusal> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    let end = match parsed.parse(bytes) {
        Ok(httparse::Status::Complete(end)) => end,
        Ok(httparse::Status::Partial) => return Ok(None),
        Err(httparse::Error::TooManyHeaders) => return Err(Refusal::TooLarge),
        Err(_) => return Err(Refusal::Malformed),
    };
    if parsed.method != Some("GET") {
        return Err(Refusal::Method);
    }
    let target = parsed.path.unwrap_or_default();
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let header = |h: &httparse::Header<'_>| {
        // Cookies of other programs on this host may have any encoding.
        (h.name.to_ascii_lowercase(), String::from_utf8_lossy(h.value).trim().to_owned())
    };
    let headers = parsed.headers.iter().map(header).collect();
    let rest = bytes.get(end..).unwrap_or_default().to_vec();
    Ok(Some(Request { path: path.to_owned(), query: query.to_owned(), headers, rest }))
}

/// Headers of every response. They restrict the page to its own scripts, styles and images, and forbid other pages to
/// show it in a frame.
const SAFETY: &str = "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
                      Cross-Origin-Resource-Policy: same-origin\r\nCross-Origin-Opener-Policy: same-origin\r\n\
                      Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
                      img-src 'self' blob: data:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; \
                      form-action 'none'\r\n";

/// Writes a response, after which the caller closes the connection. `kind` is the body's media type, and `more` has
/// additional header lines.
pub(crate) fn respond(stream: &mut TcpStream, status: &str, kind: &str, more: &str, body: &[u8]) -> io::Result<()> {
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\
         {SAFETY}{more}\r\n"
    );
    stream.set_write_timeout(Some(HEAD_TIME))?;
    stream.write_all(head.as_bytes())?;
    stream.write_all(body)?;
    stream.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_have_a_path_a_query_and_headers() {
        let bytes = b"GET /a/b?token=1&x HTTP/1.1\r\nHost: localhost:1\r\nCookie: a=1; surfel-9=abc\r\n\r\nrest";
        let request = parse(bytes).unwrap().unwrap();
        assert_eq!((request.path.as_str(), request.query.as_str()), ("/a/b", "token=1&x"));
        assert_eq!((request.header("host"), request.header("origin")), (Some("localhost:1"), None));
        assert_eq!((request.cookie("surfel-9"), request.cookie("surfel")), (Some("abc"), None));
        assert_eq!(request.rest, b"rest");
        assert!(parse(&bytes[..40]).unwrap().is_none());
    }

    #[test]
    fn other_methods_malformed_and_repeated_headers_are_refused() {
        assert_eq!(parse(b"POST / HTTP/1.1\r\n\r\n").unwrap_err(), Refusal::Method);
        assert_eq!(parse(b"\x16\x03\x01\x02\r\n\r\n").unwrap_err(), Refusal::Malformed);
        let many = format!("GET / HTTP/1.1\r\n{}\r\n", "a: b\r\n".repeat(MAX_HEADERS + 1));
        assert_eq!(parse(many.as_bytes()).unwrap_err(), Refusal::TooLarge);
        let twice = parse(b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n").unwrap().unwrap();
        assert_eq!(twice.header("host"), None);
    }
}
