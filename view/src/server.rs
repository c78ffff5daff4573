//! Sockets with their time-outs. One thread accepts; each connection has a separate thread, so that no connection delays another
//! one or the feed.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use oqtal_bus::time::{Span, Time};
use rustix::net::sockopt::set_socket_send_buffer_size;

use crate::hub::Hub;
use crate::places::{ConnectionClass, ConnectionPlace};
use crate::request::{MOST_BODY_BYTES, MOST_HEAD_BYTES, Parsed, Request};
use crate::response::{Response, stream_head};
use crate::site::{Reply, Site};

/// Time within which a request must be complete.
const REQUEST_TIMEOUT: Span = Span::from_millis(5000);
/// Time within which the client must read a response.
const RESPONSE_TIMEOUT: Span = Span::from_millis(30_000);
/// Time within which the client must read an update.
const UPDATE_TIMEOUT: Span = Span::from_millis(2000);
/// Size of the kernel's buffer for unread updates \[bytes\].
const SEND_BUFFER_BYTES: usize = 64 * 1024;
/// Pause after the operating system refused a connection.
const REFUSED_PAUSE: Duration = Duration::from_millis(50);

/// Accepts connections until the process ends.
pub fn serve(listener: &TcpListener, site: &Arc<Site>) {
    let places = Arc::default();
    loop {
        let Ok((stream, _)) = listener.accept() else {
            std::thread::sleep(REFUSED_PAUSE);
            continue;
        };
        let place = ConnectionPlace::take(&places, stream);
        let site = Arc::clone(site);
        let thread = std::thread::Builder::new().name("page".to_owned());
        // If a thread cannot be started, its connection is closed.
        let _ = thread.spawn(move || {
            let mut connection = Connection { place };
            // A failed connection does not affect the others.
            let _ = connection.serve(&site);
            let _ = connection.place.stream().shutdown(Shutdown::Both);
        });
    }
}

struct Connection {
    place: ConnectionPlace,
}

impl Connection {
    fn serve(&mut self, site: &Site) -> io::Result<()> {
        self.place.stream().set_nodelay(true)?;
        let request = match self.read(Time::now() + REQUEST_TIMEOUT)? {
            Ok(request) => request,
            Err(refusal) => return self.send(&refusal, "GET"),
        };
        self.place.enter(match site.is_token_holder(&request) {
            true => ConnectionClass::TokenHolder,
            false => ConnectionClass::Anonymous,
        });
        match site.answer(&request) {
            Reply::Whole(response) => self.send(&response, &request.method),
            Reply::Updates(hub) => self.follow(hub),
        }
    }

    /// Reads a request that is complete before `deadline`.
    fn read(&mut self, deadline: Time) -> io::Result<Result<Request, Response>> {
        let mut bytes = Vec::new();
        let mut part = [0; 2048];
        loop {
            match Request::parse(&bytes) {
                Parsed::Complete(request) => return Ok(Ok(request)),
                Parsed::Refused(response) => return Ok(Err(response)),
                Parsed::Incomplete if bytes.len() > MOST_HEAD_BYTES + MOST_BODY_BYTES => {
                    return Ok(Err(Response::error(413, "the request is too long")));
                }
                Parsed::Incomplete => {}
            }
            let Some(rest) = until(deadline) else {
                return Ok(Err(Response::error(408, "the request came too slowly")));
            };
            self.place.stream().set_read_timeout(Some(rest))?;
            match self.place.stream().read(&mut part) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(length) => bytes.extend_from_slice(&part[..length]),
                Err(error) if is_timeout(&error) => {}
                Err(error) => return Err(error),
            }
        }
    }

    fn send(&mut self, response: &Response, method: &str) -> io::Result<()> {
        self.write(&response.to_bytes(method), RESPONSE_TIMEOUT)
    }

    /// Sends the history, then every update, until the page is closed or too slow.
    fn follow(&mut self, hub: &Hub) -> io::Result<()> {
        set_socket_send_buffer_size(self.place.stream(), SEND_BUFFER_BYTES)?;
        self.write(stream_head().as_bytes(), UPDATE_TIMEOUT)?;
        let (past, updates) = hub.subscribe();
        self.write(past.as_bytes(), RESPONSE_TIMEOUT)?;
        for update in updates {
            self.write(update.as_bytes(), UPDATE_TIMEOUT)?;
        }
        Ok(())
    }

    /// Writes everything within `timeout`.
    fn write(&mut self, mut bytes: &[u8], timeout: Span) -> io::Result<()> {
        let deadline = Time::now() + timeout;
        while !bytes.is_empty() {
            let rest = until(deadline).ok_or(io::ErrorKind::TimedOut)?;
            self.place.stream().set_write_timeout(Some(rest))?;
            match self.place.stream().write(bytes) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(length) => bytes = &bytes[length..],
                Err(error) if is_timeout(&error) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Time until `deadline`; `None` if it has passed.
fn until(deadline: Time) -> Option<Duration> {
    let rest = deadline.since(Time::now()).nanos();
    (rest > 0).then(|| Duration::from_nanos(rest.unsigned_abs()))
}

fn is_timeout(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    [WouldBlock, TimedOut, Interrupted].contains(&error.kind())
}
