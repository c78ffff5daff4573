//! Requests of HTTP/1.1, of bounded size.

use httparse::{EMPTY_HEADER, Status};

use crate::response::Response;

/// Greatest size of request line and headers \[bytes\].
pub const MOST_HEAD_BYTES: usize = 8 * 1024;
/// Greatest size of a body \[bytes\].
pub const MOST_BODY_BYTES: usize = 1024;
/// Greatest number of headers \[-\].
const MOST_HEADERS: usize = 64;

/// A request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// Method, as in `GET`.
    pub method: String,
    /// Path without the query.
    pub path: String,
    headers: Vec<(String, String)>,
    /// Body.
    pub body: Vec<u8>,
}

/// Result of parsing the bytes of a connection.
#[derive(Debug)]
pub enum Parsed {
    /// The beginning of a request.
    Incomplete,
    /// A request.
    Complete(Request),
    /// Bytes that are not a request, or a request that is refused.
    Refused(Response),
}

impl Request {
    /// Parses the bytes that a connection has sent so far.
    pub fn parse(bytes: &[u8]) -> Parsed {
        let mut headers = [EMPTY_HEADER; MOST_HEADERS];
        let mut parser = httparse::Request::new(&mut headers);
        let head = match parser.parse(bytes) {
            Ok(Status::Complete(length)) if length <= MOST_HEAD_BYTES => length,
            Ok(Status::Partial) if bytes.len() < MOST_HEAD_BYTES => return Parsed::Incomplete,
            Ok(_) => return refuse(431, "the headers are too long"),
            Err(error) => {
                return refuse(400, &format!("this is not a request of HTTP/1.1: {error}"));
            }
        };
        let mut request = Self::of(&parser);
        let length = match request.body_length() {
            Ok(length) => length,
            Err(response) => return Parsed::Refused(response),
        };
        let Some(body) = bytes.get(head..head + length) else { return Parsed::Incomplete };
        request.body = body.to_vec();
        Parsed::Complete(request)
    }

    fn of(parser: &httparse::Request<'_, '_>) -> Self {
        let target = parser.path.unwrap_or_default();
        let header = |header: &httparse::Header<'_>| {
            let value = String::from_utf8_lossy(header.value).into_owned();
            (header.name.to_ascii_lowercase(), value)
        };
        Self {
            method: parser.method.unwrap_or_default().to_owned(),
            path: target.split('?').next().unwrap_or_default().to_owned(),
            headers: parser.headers.iter().map(header).collect(),
            body: Vec::new(),
        }
    }

    /// Length of the body; an error if it is missing or too large.
    fn body_length(&self) -> Result<usize, Response> {
        if self.header("transfer-encoding").is_some() {
            return Err(Response::text(411, "a body needs its content-length"));
        }
        let Some(text) = self.header("content-length") else { return Ok(0) };
        match text.parse() {
            Ok(length) if length <= MOST_BODY_BYTES => Ok(length),
            Ok(_) => Err(Response::text(413, "the body is too long")),
            Err(_) => Err(Response::text(400, "the content-length is not a number")),
        }
    }

    /// The header with this lower-case name. A header with several different values is returned as a text that no rule accepts.
    pub fn header(&self, name: &str) -> Option<&str> {
        let mut values = self.headers.iter().filter(|(known, _)| known == name).map(|(_, v)| v);
        let first = values.next()?;
        Some(if values.all(|other| other == first) { first } else { "\0" })
    }

    /// A request for tests.
    #[cfg(test)]
    pub fn made(method: &str, path: &str, headers: &[(&str, &str)]) -> Self {
        let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        let headers = headers.iter().map(owned).collect();
        Self { method: method.to_owned(), path: path.to_owned(), headers, body: Vec::new() }
    }
}

fn refuse(status: u16, text: &str) -> Parsed {
    Parsed::Refused(Response::text(status, text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn status(bytes: &[u8]) -> Option<u16> {
        match Request::parse(bytes) {
            Parsed::Refused(response) => Some(response.status),
            _ => None,
        }
    }

    #[test]
    fn a_request_is_parsed_when_it_is_complete() {
        let bytes = b"POST /control?x=1 HTTP/1.1\r\nHost: a:1\r\nContent-Length: 3\r\n\r\nabc";
        for length in 0..bytes.len() {
            assert!(matches!(Request::parse(&bytes[..length]), Parsed::Incomplete), "{length}");
        }
        let Parsed::Complete(request) = Request::parse(bytes) else { panic!("not complete") };
        assert_eq!((&*request.method, &*request.path), ("POST", "/control"));
        assert_eq!((request.header("host"), &*request.body), (Some("a:1"), &b"abc"[..]));
    }

    #[test]
    fn requests_that_are_too_long_or_malformed_are_refused() {
        assert_eq!(status(b"\x16\x03\x01\x02"), Some(400));
        assert_eq!(status(b"GET / HTTP/1.1\r\ncontent-length: 1025\r\n\r\n"), Some(413));
        assert_eq!(status(b"GET / HTTP/1.1\r\ncontent-length: -1\r\n\r\n"), Some(400));
        assert_eq!(status(b"GET / HTTP/1.1\r\ntransfer-encoding: chunked\r\n\r\n"), Some(411));
        let many = "a: b\r\n".repeat(MOST_HEADERS + 1);
        assert_eq!(status(format!("GET / HTTP/1.1\r\n{many}\r\n").as_bytes()), Some(400));
        let long = format!("GET /{} HTTP/1.1\r\n", "a".repeat(MOST_HEAD_BYTES));
        assert_eq!(status(long.as_bytes()), Some(431));
    }

    #[test]
    fn a_header_with_two_values_has_none_of_them() {
        let request = Request::made("GET", "/", &[("host", "localhost"), ("host", "elsewhere")]);
        assert_eq!(request.header("host"), Some("\0"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_bounded_work(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = Request::parse(&bytes);
        }
    }
}
