//! Permission to read and to command. The threat is the browser: any page that a user visits can send requests to this machine,
//! and can read the replies if a host name resolves to this machine (DNS rebinding).

use std::net::{IpAddr, SocketAddr};

use crate::request::Request;
use crate::response::Response;

/// Access rules of one server.
#[derive(Clone, Debug)]
pub struct Access {
    /// Whether the server listens only on the loopback interface.
    pub is_loopback: bool,
    /// Whether reading also requires the token.
    pub guards_reading: bool,
    /// Whether commands are accepted, with the token.
    pub has_control: bool,
    /// The token; `None` if no access requires it.
    pub token: Option<String>,
}

impl Access {
    /// Rules of a server at `listen` that accepts commands if `has_control`. Reading requires the token if `guards_reading`, or
    /// from other machines. `None` if the address requires a token and there is none.
    pub fn new(
        listen: SocketAddr,
        has_control: bool,
        guards_reading: bool,
        token: Option<String>,
    ) -> Option<Self> {
        let is_loopback = listen.ip().is_loopback();
        let guards_reading = guards_reading || !is_loopback;
        let needs_token = guards_reading || has_control;
        (!needs_token || token.is_some()).then_some(Self {
            is_loopback,
            guards_reading,
            has_control,
            token,
        })
    }

    /// Refuses a request with the host name or from a page of another site.
    ///
    /// # Errors
    /// Refusal of the request.
    pub fn admit(&self, request: &Request) -> Result<(), Response> {
        let host = request.header("host").unwrap_or_default();
        if !self.is_own_name(host) {
            let text =
                "this server is reached by its IP address or as localhost, and by no other name";
            return Err(Response::text(403, text));
        }
        let origin = request.header("origin");
        let is_same = origin.is_none_or(|origin| origin.strip_prefix("http://") == Some(host));
        if is_same && is_same_site(request) {
            return Ok(());
        }
        Err(Response::text(403, "requests of other sites are refused"))
    }

    /// Whether a `Host` header names this server by an address. Any port is accepted, for tunnels.
    fn is_own_name(&self, host: &str) -> bool {
        let name = match host.rsplit_once(':') {
            Some((name, port)) if !port.contains(']') && port.parse::<u16>().is_ok() => name,
            _ => host,
        };
        if name.eq_ignore_ascii_case("localhost") {
            return true;
        }
        let name = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
        let address = name.parse::<IpAddr>();
        address.is_ok_and(|address| address.is_loopback() || !self.is_loopback)
    }

    /// Refuses reading without the token, if reading requires it.
    ///
    /// # Errors
    /// Refusal of the request.
    pub fn may_read(&self, request: &Request) -> Result<(), Response> {
        if self.guards_reading { self.demand_token(request) } else { Ok(()) }
    }

    /// Refuses a command without the token, or if commands are not accepted.
    ///
    /// # Errors
    /// Refusal of the request.
    pub fn may_control(&self, request: &Request) -> Result<(), Response> {
        if !self.has_control {
            return Err(Response::text(403, "read-only: start `oqtal view` with --control"));
        }
        self.demand_token(request)
    }

    fn demand_token(&self, request: &Request) -> Result<(), Response> {
        let refusal = || Response::text(401, "the token that `oqtal view` printed is needed");
        self.has_token(request).then_some(()).ok_or_else(refusal)
    }

    /// Whether `request` has the token.
    pub fn has_token(&self, request: &Request) -> bool {
        let shown = request.header("authorization").and_then(|text| text.strip_prefix("Bearer "));
        match (&self.token, shown) {
            (Some(token), Some(shown)) => equal(token.as_bytes(), shown.as_bytes()),
            _ => false,
        }
    }
}

/// Whether the request comes from a page of this site, if the browser reports it. The page itself may be opened by a link from
/// another site, but not framed.
fn is_same_site(request: &Request) -> bool {
    match request.header("sec-fetch-site") {
        None | Some("same-origin" | "none") => true,
        Some(_) => {
            let is_opened = request.header("sec-fetch-dest") == Some("document");
            request.method == "GET" && request.path == "/" && is_opened
        }
    }
}

/// Whether both are equal; compares in constant time.
fn equal(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn access(listen: &str) -> Access {
        let token = Some("secret".to_owned());
        Access::new(listen.parse().unwrap(), true, false, token).unwrap()
    }

    fn admits(listen: &str, headers: &[(&str, &str)]) -> bool {
        access(listen).admit(&Request::made("GET", "/live", headers)).is_ok()
    }

    #[test]
    fn a_server_is_reached_by_its_addresses_alone() {
        let local = "127.0.0.1:8600";
        for host in ["127.0.0.1:8600", "localhost:8600", "LOCALHOST", "[::1]:9000", "127.0.0.2"] {
            assert!(admits(local, &[("host", host)]), "{host}");
        }
        for host in ["", "evil.example:8600", "192.168.0.7:8600", "localhost.evil.example", "\0"] {
            assert!(!admits(local, &[("host", host)]), "{host}");
        }
        assert!(!admits(local, &[]));
        assert!(admits("0.0.0.0:8600", &[("host", "192.168.0.7:8600")]));
        assert!(!admits("0.0.0.0:8600", &[("host", "drone.example:8600")]));
    }

    #[test]
    fn pages_of_other_sites_are_refused() {
        let with = |name, value| admits("127.0.0.1:1", &[("host", "localhost:1"), (name, value)]);
        assert!(with("origin", "http://localhost:1"));
        for origin in ["http://localhost:2", "https://localhost:1", "null", "http://evil.example"] {
            assert!(!with("origin", origin), "{origin}");
        }
        assert!(with("sec-fetch-site", "same-origin") && with("sec-fetch-site", "none"));
        assert!(!with("sec-fetch-site", "cross-site") && !with("sec-fetch-site", "same-site"));
    }

    #[test]
    fn a_link_elsewhere_opens_the_page_and_a_frame_does_not() {
        let opens = |dest| {
            let site = ("sec-fetch-site", "cross-site");
            let headers = [("host", "localhost:1"), site, ("sec-fetch-dest", dest)];
            access("127.0.0.1:1").admit(&Request::made("GET", "/", &headers)).is_ok()
        };
        assert!(opens("document") && !opens("iframe"));
    }

    #[test]
    fn commands_need_the_token_and_so_does_reading_from_elsewhere() {
        let request = |text| Request::made("POST", "/control", &[("authorization", text)]);
        let local = access("127.0.0.1:1");
        assert!(local.may_control(&request("Bearer secret")).is_ok());
        for wrong in ["Bearer secreT", "Bearer secre", "Bearer ", "secret", "Basic secret"] {
            assert_eq!(local.may_control(&request(wrong)).unwrap_err().status, 401, "{wrong}");
        }
        assert!(local.may_read(&request("")).is_ok());
        assert_eq!(access("0.0.0.0:1").may_read(&request("")).unwrap_err().status, 401);
        let reading = Access { has_control: false, ..local };
        assert_eq!(reading.may_control(&request("Bearer secret")).unwrap_err().status, 403);
    }

    #[test]
    fn an_address_that_others_reach_needs_a_token() {
        let new = |listen: &str, control, token: Option<&str>| {
            Access::new(listen.parse().unwrap(), control, false, token.map(str::to_owned)).is_some()
        };
        assert!(new("127.0.0.1:1", false, None) && new("[::1]:1", false, None));
        assert!(!new("0.0.0.0:1", false, None) && !new("192.168.0.7:1", false, None));
        assert!(!new("127.0.0.1:1", true, None) && new("0.0.0.0:1", false, Some("secret")));
    }
}
