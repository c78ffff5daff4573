//! Sockets with their time-outs. One thread accepts; each connection has a separate thread, so that no connection delays another
//! one or the feed.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
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
            // A failed connection does not affect the others.
            let _ = serve_connection(&place, &site);
            let _ = place.stream().shutdown(Shutdown::Both);
        });
    }
}

fn serve_connection(place: &ConnectionPlace, site: &Site) -> io::Result<()> {
    let stream = place.stream();
    stream.set_nodelay(true)?;
    let request = match read(stream, Time::now() + REQUEST_TIMEOUT)? {
        Ok(request) => request,
        Err(refusal) => return write(stream, &refusal.to_bytes("GET"), RESPONSE_TIMEOUT),
    };
    place.enter(match site.is_token_holder(&request) {
        true => ConnectionClass::TokenHolder,
        false => ConnectionClass::Anonymous,
    });
    match site.answer(&request) {
        Reply::Whole(response) => {
            write(stream, &response.to_bytes(&request.method), RESPONSE_TIMEOUT)
        }
        Reply::Updates(hub) => follow(stream, hub),
    }
}

/// Reads a request that is complete before `deadline`.
fn read(mut stream: &TcpStream, deadline: Time) -> io::Result<Result<Request, Response>> {
    let mut bytes = Vec::new();
    let mut part = [0; 2048];
    loop {
        match Request::parse(&bytes) {
            Parsed::Complete(request) => return Ok(Ok(request)),
            Parsed::Refused(response) => return Ok(Err(response)),
            Parsed::Incomplete if bytes.len() > MOST_HEAD_BYTES + MOST_BODY_BYTES => {
                return Ok(Err(Response::text(413, "the request is too long")));
            }
            Parsed::Incomplete => {}
        }
        let Some(rest) = until(deadline) else {
            return Ok(Err(Response::text(408, "the request came too slowly")));
        };
        stream.set_read_timeout(Some(rest))?;
        match stream.read(&mut part) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(length) => bytes.extend_from_slice(&part[..length]),
            Err(error) if is_timeout(&error) => {}
            Err(error) => return Err(error),
        }
    }
}

/// Sends the history, then every update, until the page is closed or too slow.
fn follow(stream: &TcpStream, hub: &Hub) -> io::Result<()> {
    set_socket_send_buffer_size(stream, SEND_BUFFER_BYTES)?;
    write(stream, stream_head().as_bytes(), UPDATE_TIMEOUT)?;
    let (past, updates) = hub.subscribe();
    write(stream, past.as_bytes(), RESPONSE_TIMEOUT)?;
    updates.iter().try_for_each(|update| write(stream, update.as_bytes(), UPDATE_TIMEOUT))
}

/// Writes everything within `timeout`.
fn write(mut stream: &TcpStream, mut bytes: &[u8], timeout: Span) -> io::Result<()> {
    let deadline = Time::now() + timeout;
    while !bytes.is_empty() {
        let rest = until(deadline).ok_or(io::ErrorKind::TimedOut)?;
        stream.set_write_timeout(Some(rest))?;
        match stream.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(length) => bytes = &bytes[length..],
            Err(error) if is_timeout(&error) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Time until `deadline`; `None` if it has passed.
fn until(deadline: Time) -> Option<Duration> {
    let rest = deadline.since(Time::now());
    (rest > Span::ZERO).then(|| rest.to_duration())
}

fn is_timeout(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    [WouldBlock, TimedOut, Interrupted].contains(&error.kind())
}
