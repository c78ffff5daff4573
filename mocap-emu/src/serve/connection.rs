//! A client's connection: reads and writes that never block, with a bounded queue of bytes.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;

use rustix::event::{PollFd, PollFlags};

/// Greatest number of bytes queued for a client that does not read; beyond it the client is cut off.
const MAX_QUEUED: usize = 1 << 20;
/// Greatest number of bytes read from a client at a time, so that one that sends without end delays nobody.
const MAX_READ: usize = 1 << 14;

/// Connection of a client.
#[derive(Debug)]
pub struct Connection {
    stream: TcpStream,
    queued: Vec<u8>,
    /// Bytes at the beginning of the queue that are sent.
    sent: usize,
    broken: bool,
}

impl Connection {
    /// Takes over a connection; `None` if the system refuses to.
    pub fn new(stream: TcpStream) -> Option<Self> {
        stream.set_nonblocking(true).ok()?;
        stream.set_nodelay(true).ok()?;
        Some(Self { stream, queued: Vec::new(), sent: 0, broken: false })
    }

    /// Reads what the client has sent; empty if nothing.
    pub fn read<'a>(&mut self, buffer: &'a mut [u8]) -> &'a [u8] {
        let limit = buffer.len().min(MAX_READ);
        match self.stream.read(&mut buffer[..limit]) {
            Ok(0) => self.broken = true,
            Ok(length) => return &buffer[..length],
            Err(error) if is_transient(error.kind()) => {}
            Err(_) => self.broken = true,
        }
        &[]
    }

    /// The queue of bytes for the client, to append to.
    pub fn queue(&mut self) -> &mut Vec<u8> {
        &mut self.queued
    }

    /// Sends as many queued bytes as the client takes. A client whose queue is too long is cut off.
    pub fn flush(&mut self) {
        while self.sent < self.queued.len() && !self.broken {
            match self.stream.write(&self.queued[self.sent..]) {
                Ok(0) => self.broken = true,
                Ok(length) => self.sent += length,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => self.broken = true,
            }
        }
        if self.sent == self.queued.len() || self.sent > MAX_QUEUED / 2 {
            self.queued.drain(..self.sent);
            self.sent = 0;
        }
        self.broken |= self.queued.len() - self.sent > MAX_QUEUED;
    }

    /// Closes the connection with the next removal of broken ones.
    pub fn close(&mut self) {
        self.broken = true;
    }

    /// Whether the connection is of no use any more.
    pub fn is_broken(&self) -> bool {
        self.broken
    }

    /// What to wait for; `reads` says whether the client's bytes are read when they come.
    pub fn poll_fd(&self, reads: bool) -> PollFd<'_> {
        let mut flags = PollFlags::empty();
        flags.set(PollFlags::IN, reads);
        flags.set(PollFlags::OUT, self.sent < self.queued.len());
        PollFd::new(&self.stream, flags)
    }
}

fn is_transient(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    #[test]
    fn a_client_that_never_reads_is_cut_off_and_held_in_bounds_until_then() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let _silent = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let mut connection = Connection::new(listener.accept().unwrap().0).unwrap();
        // More than any socket's own buffers and the queue.
        for _ in 0..1 << 14 {
            connection.queue().extend_from_slice(&[0; 4096]);
            connection.flush();
            assert!(connection.queued.len() <= 2 * MAX_QUEUED);
            if connection.is_broken() {
                return;
            }
        }
        panic!("64 MiB were queued for a client that does not read");
    }
}
