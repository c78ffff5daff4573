//! Responses of HTTP/1.1. Each closes its connection; none may be cached, framed or used by another site.

use std::borrow::Cow;

/// Headers of every response. The policy admits only the page's own files, and no inline script.
const HEADERS: &str = "Connection: close\r\n\
    Cache-Control: no-store\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; \
    base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Referrer-Policy: no-referrer\r\n\
    X-Content-Type-Options: nosniff\r\n\
    X-Frame-Options: DENY\r\n";

/// A response.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Response {
    /// Status code \[-\].
    pub status: u16,
    /// Media type of the body.
    pub kind: &'static str,
    /// Body.
    pub body: Cow<'static, str>,
}

impl Response {
    /// A successful response.
    pub fn ok(kind: &'static str, body: impl Into<Cow<'static, str>>) -> Self {
        Self { status: 200, kind, body: body.into() }
    }

    /// An answer in plain text: the reply to a command, or a refusal with its reason.
    pub fn text(status: u16, text: &str) -> Self {
        Self { status, kind: "text/plain; charset=utf-8", body: format!("{text}\n").into() }
    }

    /// The response as bytes; without its body for the method `HEAD`.
    pub fn to_bytes(&self, method: &str) -> Vec<u8> {
        let body = if method == "HEAD" { "" } else { &*self.body };
        format!(
            "{}Content-Type: {}\r\nContent-Length: {}\r\n\r\n{body}",
            begin(self.status),
            self.kind,
            self.body.len()
        )
        .into_bytes()
    }
}

/// Head of a stream that ends with its connection.
pub fn stream_head() -> String {
    format!("{}Content-Type: application/x-ndjson\r\n\r\n", begin(200))
}

fn begin(status: u16) -> String {
    let reason = match status {
        200 => "OK",
        400 => "Bad Request",
        401 => "Unauthorized",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        409 => "Conflict",
        411 => "Length Required",
        413 => "Content Too Large",
        431 => "Request Header Fields Too Large",
        _ => "Service Unavailable",
    };
    format!("HTTP/1.1 {status} {reason}\r\n{HEADERS}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_response_has_its_length_and_is_closed_to_other_sites() {
        let text = String::from_utf8(Response::ok("text/plain", "äb").to_bytes("GET")).unwrap();
        assert!(text.starts_with("HTTP/1.1 200 OK\r\n") && text.ends_with("\r\n\r\näb"), "{text}");
        assert!(text.contains("Content-Length: 3\r\n") && text.contains("nosniff\r\n"), "{text}");
        assert!(!text.contains("Access-Control"), "no other origin may read");
        assert!(Response::ok("text/plain", "ab").to_bytes("HEAD").ends_with(b"\r\n\r\n"));
    }
}
