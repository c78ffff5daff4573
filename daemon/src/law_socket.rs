//! An external law in another process, behind a Unix socket of packets (SOCK_SEQPACKET): one packet for a question, one for its
//! answer. The packets are described in docs/your-own-law.md.
//!
//! The background thread accepts a connection of the same user and passes it to the loop. The loop sends the question, waits for the
//! answer until its deadline, and discards answers to earlier questions and those that came before the question; all memory is on the
//! stack. In virtual time the clock stands still meanwhile: the loop waits for the first connection, and up to ten seconds for an answer.

use std::os::fd::OwnedFd;
use std::path::PathBuf;

use crossbeam_channel::{Receiver, Sender, bounded};
use oqtal_bus::code::HandoverCause;
use oqtal_bus::message::{ExternalV1, Message, StateV1};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::packet_socket::{PacketListener, is_connected};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::stop::StopFlag;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, Shutdown, UCred, recv, send, shutdown};

use crate::external::{ExternalLaw, reason_of, without_answer};

/// Beginning of a question, and of an answer.
const QUESTION: [u8; 8] = *b"OQTALST1";
const ANSWER: [u8; 8] = *b"OQTALEX1";
/// Length of the part of an answer that the law sends, up to the thrust \[bytes\].
const ANSWERED: usize = 8 * (1 + 3 + 3 + 4 + 1);
/// Most packets that are read before a question \[-\]. If more wait, as after a pause of the law, the question has no answer, and the rest is
/// read before the next ones.
const MOST_WAITING: usize = 64;
/// Longest wait after which the stop flag is checked.
const STOP_CHECK: Span = Span::from_millis(20);
/// Longest time for an answer in virtual time, by the clock of the machine. It is halved after each missing answer, and restored by
/// an answer to the present question.
const VIRTUAL_TIMEOUT: Span = Span::from_millis(10_000);
/// Shortest time for an answer in virtual time.
const LEAST_VIRTUAL_TIMEOUT: Span = Span::from_millis(100);

/// The hand-over of connections to the loop, for the background thread.
#[derive(Debug)]
pub(crate) struct ConnectionSlot {
    sender: Sender<OwnedFd>,
    receiver: Receiver<OwnedFd>,
}

/// Both ends of the hand-over of connections.
pub(crate) fn connections() -> (ConnectionSlot, Receiver<OwnedFd>) {
    let (sender, receiver) = bounded(1);
    (ConnectionSlot { sender, receiver: receiver.clone() }, receiver)
}

impl ConnectionSlot {
    /// Passes `connection` to the loop, and replaces one that the loop has not taken: it takes connections only in flight, when it asks a
    /// law.
    fn put(&self, connection: OwnedFd) {
        // Only this thread fills the place.
        let _ = self.receiver.try_recv();
        let _ = self.sender.try_send(connection);
    }
}

/// A law behind a socket, for the loop.
#[derive(Debug)]
pub(crate) struct SocketLaw {
    connections: Receiver<OwnedFd>,
    connection: Option<OwnedFd>,
    /// Whether a law has been connected.
    was_connected: bool,
    /// Time for an answer in virtual time.
    virtual_timeout: Span,
    stop: StopFlag,
}

impl SocketLaw {
    /// An external law whose connections arrive through `connections`; waiting for one ends when `stop` is set.
    pub(crate) fn new(connections: Receiver<OwnedFd>, stop: StopFlag) -> Self {
        let virtual_timeout = VIRTUAL_TIMEOUT;
        Self { connections, connection: None, was_connected: false, virtual_timeout, stop }
    }

    /// Takes a new connection; waits for the first one if `is_virtual`.
    fn connect(&mut self, is_virtual: bool) {
        let wait = std::time::Duration::from_nanos(STOP_CHECK.nanos().unsigned_abs());
        while is_virtual && !self.was_connected && !self.stop.is_set() {
            self.connection = self.connections.recv_timeout(wait).ok().filter(is_connected);
            self.was_connected = self.connection.is_some();
        }
        // A law may have ended before the loop asks one.
        if let Some(connection) = self.connections.try_recv().ok().filter(is_connected) {
            (self.connection, self.was_connected) = (Some(connection), true);
            self.virtual_timeout = VIRTUAL_TIMEOUT;
        }
    }

    /// Shuts a failed connection down in both directions, so that the listener, which has a duplicate of it, detects the failure too: the
    /// law may have closed only one direction.
    fn disconnect(&mut self) {
        if let Some(connection) = self.connection.take() {
            let _ = shutdown(connection, Shutdown::Both);
        }
    }

    /// The next packet, with the instant of its receipt; `None` if none has arrived, or if the law has ended, which is then disconnected.
    fn arrived(&mut self) -> Option<ExternalV1> {
        let mut bytes = [0; ANSWER.len() + ANSWERED + 1];
        let connection = self.connection.as_ref()?;
        match recv(connection, &mut bytes, RecvFlags::DONTWAIT) {
            // An empty packet is received like the end of the connection.
            Ok((_, length)) if length > 0 || is_connected(connection) => {
                Some(ExternalV1 { answered_at: Time::now(), ..decoded(&bytes[..length]) })
            }
            Err(Errno::AGAIN | Errno::INTR) => None,
            Ok(_) | Err(_) => {
                self.disconnect();
                None
            }
        }
    }

    /// The newest packet that arrived before the question `sequence`, and whether all of them were read. An answer to a question that was
    /// not asked yet gets the sequence 0.
    fn early(&mut self, sequence: u64) -> (Option<ExternalV1>, bool) {
        let mut newest = None;
        for _ in 0..MOST_WAITING {
            let Some(answer) = self.arrived() else { return (newest, true) };
            let is_late = answer.sequence < sequence;
            newest =
                Some(ExternalV1 { sequence: if is_late { answer.sequence } else { 0 }, ..answer });
        }
        (newest, false)
    }

    /// The answer to the question `sequence`, or a malformed packet, as soon as it arrives; at `until` the newest other answer, or `early`;
    /// the reason in place of an answer if the law ends first.
    fn receive(
        &mut self,
        sequence: u64,
        until: Time,
        early: Option<ExternalV1>,
    ) -> Option<ExternalV1> {
        let mut other = early;
        while !self.stop.is_set() {
            let received = self.arrived();
            let is_found = received
                .is_some_and(|answer| answer.sequence == sequence || reason_of(&answer).is_some());
            let now = Time::now();
            other = received.or(other);
            match self.connection.as_ref() {
                _ if is_found => break,
                None => return other.or(Some(without_answer(HandoverCause::Ended))),
                _ if now >= until => break,
                Some(connection) if received.is_none() => {
                    wait_readable(connection, until.since(now));
                }
                Some(_) => {}
            }
        }
        other
    }
}

impl ExternalLaw for SocketLaw {
    /// The number of the flight in the next question tells the law.
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let is_virtual = !state.answer_by.is_set();
        self.connect(is_virtual);
        if self.connection.is_none() {
            return Some(without_answer(HandoverCause::Absent));
        }
        let (early, is_read) = self.early(state.sequence);
        let mut bytes = [0; QUESTION.len() + StateV1::SIZE];
        bytes[..QUESTION.len()].copy_from_slice(&QUESTION);
        state.encode(&mut bytes[QUESTION.len()..]);
        let asked_at = Time::now();
        // A law that does not read leaves its buffer full: it gets no further question.
        let flags = SendFlags::DONTWAIT | SendFlags::NOSIGNAL;
        match self.connection.as_ref().map(|connection| send(connection, &bytes, flags)) {
            Some(Ok(_) | Err(Errno::AGAIN)) => {}
            Some(Err(_)) | None => self.disconnect(),
        }
        let until = if is_virtual { asked_at + self.virtual_timeout } else { state.answer_by };
        let answer = match is_read {
            true => self.receive(state.sequence, until, early),
            false => early,
        };
        if !is_virtual {
            return answer.map(|answer| ExternalV1 { asked_at, ..answer });
        }
        self.virtual_timeout = match answer.is_some_and(|it| it.sequence == state.sequence) {
            true => VIRTUAL_TIMEOUT,
            false => self.virtual_timeout.scaled(0.5).max(LEAST_VIRTUAL_TIMEOUT),
        };
        // The clock stands still meanwhile; a reason in place of an answer has no time.
        answer.map(|answer| match answer.answered_at.is_set() {
            true => ExternalV1 { answered_at: state.time, ..answer },
            false => answer,
        })
    }
}

/// The answer in a packet; for a packet of another form, an answer to no question with that verdict.
fn decoded(packet: &[u8]) -> ExternalV1 {
    let body = packet.strip_prefix(&ANSWER).filter(|body| body.len() == ANSWERED);
    let Some(body) = body else {
        return without_answer(HandoverCause::Malformed);
    };
    let mut bytes = [0; ExternalV1::SIZE];
    bytes[..ANSWERED].copy_from_slice(body);
    ExternalV1::decode(&bytes)
}

fn wait_readable(connection: &OwnedFd, longest: Span) {
    let nanos = longest.min(STOP_CHECK).max(Span::ZERO).nanos();
    let timeout = Timespec { tv_sec: nanos / 1_000_000_000, tv_nsec: nanos % 1_000_000_000 };
    // Every result is followed by another attempt to receive.
    let _ = poll(&mut [PollFd::new(connection, PollFlags::IN)], Some(&timeout));
}

/// The socket on which an external law connects, for the background thread.
#[derive(Debug)]
pub(crate) struct LawListener {
    listener: PacketListener,
    connections: ConnectionSlot,
    /// A second descriptor of the connection in use.
    present: Option<OwnedFd>,
}

impl LawListener {
    /// Listens at `path`, for this user alone.
    ///
    /// # Errors
    /// The socket cannot be made (exit code 71).
    pub(crate) fn open(path: PathBuf, connections: ConnectionSlot) -> Result<Self, Failure> {
        let shown = path.display().to_string();
        let listener = PacketListener::open(path).map_err(|error| {
            Failure::new(Exit::System, format!("socket {shown} of the external law: {error}"))
        })?;
        tracing::info!("an external law connects at {shown}");
        Ok(Self { listener, connections, present: None })
    }

    /// Whether a law is connected, as of the last poll.
    pub(crate) fn has_law(&self) -> bool {
        self.present.is_some()
    }

    /// Detects the end of the connected law, and accepts a waiting one. While one is connected, others are refused.
    pub(crate) fn poll(&mut self) {
        if self.present.as_ref().is_some_and(|present| !is_connected(present)) {
            tracing::warn!("external law disconnected: no law is connected");
            self.present = None;
        }
        let Some((connection, UCred { pid, .. })) = self.listener.accept() else { return };
        if self.present.is_some() {
            tracing::warn!(?pid, "external law refused: another one is connected");
            return;
        }
        match connection.try_clone() {
            Ok(present) => {
                self.connections.put(connection);
                tracing::info!(?pid, "external law connected");
                self.present = Some(present);
            }
            Err(error) => tracing::warn!(?pid, "external law refused: {error}"),
        }
    }
}

#[cfg(test)]
mod tests;
