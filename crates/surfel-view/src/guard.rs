//! Access control of the page and its WebSocket, by tokens and by the request's host and origin.

use crate::http::Request;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};

/// Secrets by which a server recognises its own pages, and the name of its cookie.
#[derive(Debug)]
pub(crate) struct Guard {
    /// Permanent secret, which a request must have in its address or cookie.
    token: String,
    /// Secret that is accepted only once. It is in the address on the browser's command line, which other users of this
    /// machine can read. `None` after it was used.
    once: Mutex<Option<String>>,
    /// Name of the cookie with the permanent token, different for each port.
    cookie: String,
}

impl Guard {
    /// Creates a guard with random tokens.
    pub(crate) fn new(port: u16) -> Result<Self, String> {
        // Browsers send cookies to all ports of a host, so the cookie's name contains the port.
        Ok(Self { token: random_token()?, once: Mutex::new(Some(random_token()?)), cookie: format!("surfel-{port}") })
    }

    /// Returns the one-time token; `None` after it was used.
    pub(crate) fn one_time_token(&self) -> Option<String> {
        self.once.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns the permanent token of the server.
    pub(crate) fn token(&self) -> &str {
        &self.token
    }

    /// Returns the header line that stores the permanent token in a cookie of the browser. Scripts can't read the
    /// cookie, and browsers don't send it with requests from other sites, except for links to this page. The WebSocket
    /// therefore checks its origin.
    pub(crate) fn set_cookie(&self) -> String {
        format!("Set-Cookie: {}={}; Path=/; HttpOnly; SameSite=Lax\r\n", self.cookie, self.token)
    }

    /// True if the address of the request contains the permanent token, or the one-time token, which becomes invalid.
    pub(crate) fn has_token(&self, request: &Request) -> bool {
        let mut given = request.query.split('&').filter_map(|pair| pair.strip_prefix("token="));
        given.any(|given| self.is_token(given) || self.uses_once(given))
    }

    fn uses_once(&self, given: &str) -> bool {
        let mut once = self.once.lock().unwrap_or_else(PoisonError::into_inner);
        once.take_if(|token| are_equal(given, token)).is_some()
    }

    /// True if the request has a cookie with the token.
    pub(crate) fn has_cookie(&self, request: &Request) -> bool {
        request.cookie(&self.cookie).is_some_and(|given| self.is_token(given))
    }

    fn is_token(&self, given: &str) -> bool {
        are_equal(given, &self.token)
    }
}

/// Returns a random token of 128 bits, as hexadecimal text.
fn random_token() -> Result<String, String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|e| format!("can't get random numbers for the token: {e}"))?;
    Ok(data_encoding::HEXLOWER.encode(&bytes))
}

/// True if two texts are equal. The time of the comparison doesn't depend on the characters, so that it reveals nothing
/// about the token.
fn are_equal(given: &str, token: &str) -> bool {
    let differences = given.bytes().zip(token.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
    given.len() == token.len() && differences == 0
}

/// True if the request's `Host` header names this machine. A foreign host name that resolves to this machine is
/// refused, which prevents DNS rebinding.
pub(crate) fn has_own_host(request: &Request) -> bool {
    request.header("host").is_some_and(is_loopback_host)
}

/// True if the request comes from a page of the host that it names. Browsers send the origin of every WebSocket.
pub(crate) fn has_own_origin(request: &Request) -> bool {
    let (host, origin) = (request.header("host"), request.header("origin"));
    host.zip(origin).is_some_and(|(host, origin)| origin.strip_prefix("http://") == Some(host))
}

/// True for the host names of this machine (`localhost`, and loopback addresses such as `127.0.0.1` and `[::1]`), with
/// or without a port. The port needn't be the server's: it may be that of a tunnel.
fn is_loopback_host(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
        Some(_) if !host.ends_with(']') => return false,
        _ => host,
    };
    name.eq_ignore_ascii_case("localhost")
        || loopback_address(name.trim_start_matches('[').trim_end_matches(']')).is_some()
}

/// Returns the loopback address that `name` stands for; `None` for any other host.
pub(crate) fn loopback_address(name: &str) -> Option<IpAddr> {
    if name.eq_ignore_ascii_case("localhost") {
        return Some(IpAddr::from([127, 0, 0, 1]));
    }
    name.parse().ok().filter(IpAddr::is_loopback)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_of_this_machine_are_accepted_with_any_port() {
        for host in ["localhost", "LocalHost:1", "127.0.0.1:8080", "127.0.0.1", "[::1]", "[::1]:99"] {
            assert!(is_loopback_host(host), "{host}");
        }
        for host in
            ["", "evil.example", "127.0.0.1.evil.example:80", "localhost.evil", "10.0.0.1:80", "0.0.0.0", "::1:x"]
        {
            assert!(!is_loopback_host(host), "{host}");
        }
    }

    #[test]
    fn tokens_are_random_and_compared_as_a_whole() {
        let (a, b) = (Guard::new(1).unwrap(), Guard::new(1).unwrap());
        assert_ne!(a.token, b.token);
        assert_eq!(a.token.len(), 32);
        assert!(a.is_token(&a.token) && !a.is_token(&b.token) && !a.is_token("") && !a.is_token(&a.token[1..]));
        assert!(!a.is_token(&format!("{}0", a.token)));
    }

    #[test]
    fn the_browser_s_token_opens_the_page_once() {
        let guard = Guard::new(1).unwrap();
        let once = guard.one_time_token().unwrap();
        assert!(once != guard.token && !guard.is_token(&once) && !guard.uses_once("") && !guard.uses_once(&once[1..]));
        assert!(guard.uses_once(&once) && !guard.uses_once(&once));
        assert_eq!(guard.one_time_token(), None);
    }
}
