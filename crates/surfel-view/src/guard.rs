//! Access control: who may open the page and its socket.

use crate::http::Request;
use std::net::IpAddr;

/// Secret and port of a server.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    token: String,
    cookie: String,
}

impl Guard {
    /// Creates a guard with a random token of 128 bits.
    pub(crate) fn new(port: u16) -> Result<Self, String> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes).map_err(|e| format!("can't get random numbers for the token: {e}"))?;
        // Cookies don't distinguish ports, so the name does.
        Ok(Self { token: data_encoding::HEXLOWER.encode(&bytes), cookie: format!("surfel-{port}") })
    }

    /// Returns the token.
    pub(crate) fn token(&self) -> &str {
        &self.token
    }

    /// Returns the header line that stores the token in the browser, out of reach of scripts and of requests from other
    /// sites. A link on another page may lead here: the socket checks its origin.
    pub(crate) fn set_cookie(&self) -> String {
        format!("Set-Cookie: {}={}; Path=/; HttpOnly; SameSite=Lax\r\n", self.cookie, self.token)
    }

    /// True if the request's address has the token.
    pub(crate) fn has_token(&self, request: &Request) -> bool {
        request.query.split('&').filter_map(|pair| pair.strip_prefix("token=")).any(|given| self.is_token(given))
    }

    /// True if the request's cookie has the token.
    pub(crate) fn has_cookie(&self, request: &Request) -> bool {
        request.cookie(&self.cookie).is_some_and(|given| self.is_token(given))
    }

    /// True if `given` is the token. The time of the comparison doesn't depend on the characters.
    fn is_token(&self, given: &str) -> bool {
        let differences = given.bytes().zip(self.token.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b));
        given.len() == self.token.len() && differences == 0
    }
}

/// True if the request names this machine as its host, so that no other site's name leads here.
pub(crate) fn has_own_host(request: &Request) -> bool {
    request.header("host").is_some_and(is_loopback_host)
}

/// True if the request comes from a page of the host that it names. Browsers state the origin of every WebSocket.
pub(crate) fn has_own_origin(request: &Request) -> bool {
    let (host, origin) = (request.header("host"), request.header("origin"));
    host.zip(origin).is_some_and(|(host, origin)| origin.strip_prefix("http://") == Some(host))
}

/// True for `localhost`, `127.0.0.1` and `[::1]`, with or without a port. The port may be that of a tunnel.
fn is_loopback_host(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
        Some(_) if !host.ends_with(']') => return false,
        _ => host,
    };
    name.eq_ignore_ascii_case("localhost")
        || loopback_address(name.trim_start_matches('[').trim_end_matches(']')).is_some()
}

/// Returns the address that a host's name means, if it is this machine's own.
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
}
