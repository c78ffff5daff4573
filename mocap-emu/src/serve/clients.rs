//! Clients of a server over TCP: one loop accepts, reads, executes, sends and removes. No call blocks; the queue of bytes for a client
//! is bounded.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

use rustix::event::{PollFd, PollFlags};

/// Maximum number of clients of one server \[-\].
const MAX_CLIENTS: usize = 10;
/// High-water mark of the send queue \[bytes\]; above it the client is disconnected.
const MAX_QUEUED: usize = 1 << 20;
/// Maximum number of bytes read from a client at a time \[bytes\], so that a client that sends endlessly does not delay the
/// others.
const MAX_READ: usize = 1 << 14;

/// Session of one client.
pub trait ClientSession {
    /// Whether the client's bytes are read when they arrive; otherwise they stay in the socket.
    fn is_ready(&self) -> bool {
        true
    }
}

/// Clients with their connections and sessions.
#[derive(Debug)]
pub struct ClientTable<S> {
    clients: Vec<(Connection, S)>,
    input: Vec<u8>,
}

impl<S: ClientSession> ClientTable<S> {
    /// Empty table.
    pub fn new() -> Self {
        Self { clients: Vec::new(), input: vec![0; MAX_READ] }
    }

    /// Number of clients \[-\].
    pub fn len(&self) -> usize {
        self.clients.len()
    }

    /// The sessions of all clients.
    pub fn sessions(&self) -> impl Iterator<Item = &S> {
        self.clients.iter().map(|(_, session)| session)
    }

    /// Accepts the clients that wait at `listener`: see [`ClientTable::add`].
    pub fn accept(
        &mut self,
        listener: &TcpListener,
        mut open: impl FnMut(SocketAddr, bool, &mut Vec<u8>) -> Option<S>,
    ) {
        while let Ok((stream, from)) = listener.accept() {
            self.add(stream, |has_room, queue| open(from, has_room, queue));
        }
    }

    /// Adds a client. `open` receives whether a place is free, appends the first bytes for the client, and returns the session, or `None`
    /// to refuse the client.
    pub fn add(&mut self, stream: TcpStream, open: impl FnOnce(bool, &mut Vec<u8>) -> Option<S>) {
        let Some(mut connection) = Connection::new(stream) else { return };
        match open(self.clients.len() < MAX_CLIENTS, &mut connection.queue) {
            Some(session) => self.clients.push((connection, session)),
            None => connection.flush(),
        }
    }

    /// Reads from every client and passes the bytes to `execute`, which appends the reply and returns whether the client stays
    /// connected.
    pub fn read(&mut self, mut execute: impl FnMut(&mut S, &[u8], &mut Vec<u8>) -> bool) {
        let Self { clients, input } = self;
        for (connection, session) in clients {
            let bytes = if session.is_ready() { connection.read(input) } else { &[] };
            connection.is_broken |= !execute(session, bytes, &mut connection.queue);
        }
    }

    /// Appends bytes by `write` to the queue of every client, and sends as many as the socket accepts.
    pub fn send(&mut self, mut write: impl FnMut(&mut S, &mut Vec<u8>)) {
        for (connection, session) in &mut self.clients {
            write(session, &mut connection.queue);
            connection.flush();
        }
    }

    /// Removes clients whose connection is broken, and passes their sessions to `removed`.
    pub fn remove_broken(&mut self, mut removed: impl FnMut(S)) {
        let broken = self.clients.extract_if(.., |(connection, _)| connection.is_broken);
        broken.for_each(|(_, session)| removed(session));
    }

    /// Adds the sockets of all clients to the polled sockets.
    pub fn add_sockets<'a>(&'a self, sockets: &mut Vec<PollFd<'a>>) {
        for (connection, session) in &self.clients {
            let mut flags = PollFlags::empty();
            flags.set(PollFlags::IN, session.is_ready());
            flags.set(PollFlags::OUT, connection.sent < connection.queue.len());
            sockets.push(PollFd::new(&connection.stream, flags));
        }
    }
}

/// Connection of a client.
#[derive(Debug)]
struct Connection {
    stream: TcpStream,
    /// Send queue.
    queue: Vec<u8>,
    /// Number of bytes at the beginning of the queue that were sent.
    sent: usize,
    /// Whether the connection has failed or is to be closed.
    is_broken: bool,
}

impl Connection {
    /// Makes a stream non-blocking; `None` if the system refuses.
    fn new(stream: TcpStream) -> Option<Self> {
        stream.set_nonblocking(true).ok()?;
        stream.set_nodelay(true).ok()?;
        Some(Self { stream, queue: Vec::new(), sent: 0, is_broken: false })
    }

    /// Reads bytes from the client; empty if there are none.
    fn read<'a>(&mut self, buffer: &'a mut [u8]) -> &'a [u8] {
        match self.stream.read(buffer) {
            Ok(0) => self.is_broken = true,
            Ok(length) => return &buffer[..length],
            Err(error) => {
                let is_transient = [ErrorKind::WouldBlock, ErrorKind::Interrupted];
                self.is_broken |= !is_transient.contains(&error.kind());
            }
        }
        &[]
    }

    /// Sends as many queued bytes as the socket accepts. A client whose queue is too long is disconnected.
    fn flush(&mut self) {
        while self.sent < self.queue.len() && !self.is_broken {
            match self.stream.write(&self.queue[self.sent..]) {
                Ok(0) => self.is_broken = true,
                Ok(length) => self.sent += length,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => self.is_broken = true,
            }
        }
        if self.sent == self.queue.len() || self.sent > MAX_QUEUED / 2 {
            self.queue.drain(..self.sent);
            self.sent = 0;
        }
        self.is_broken |= self.queue.len() - self.sent > MAX_QUEUED;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_that_never_reads_is_disconnected_and_its_queue_is_bounded_until_then() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let _silent = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let mut connection = Connection::new(listener.accept().unwrap().0).unwrap();
        // More than the buffers of any socket and the queue together hold.
        for _ in 0..1 << 14 {
            connection.queue.extend_from_slice(&[0; 4096]);
            connection.flush();
            assert!(connection.queue.len() <= 2 * MAX_QUEUED);
            if connection.is_broken {
                return;
            }
        }
        panic!("64 MiB were queued for a client that does not read");
    }
}
