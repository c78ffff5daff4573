//! The server's end of a connection.

use super::cookie::{COOKIE_BYTES, VrpnVersion};
use super::message::{VrpnMessage, VrpnStream, write_description, write_message};
use super::names::NameTable;
use super::tracker::TrackerPose;
use super::{PING_TYPE, PONG_TYPE, POSE_TYPE};
use crate::motion::MotionFrame;

/// Sender of messages that concern the connection.
const CONTROL: &str = "VRPN Control";
/// Our numbers of the types, in the order of their description.
const TYPES: [&str; 3] = [POSE_TYPE, PONG_TYPE, PING_TYPE];
const POSE: i32 = 0;
const PONG: i32 = 1;

/// Error: the bytes of a client are not VRPN. Close the connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the client does not use VRPN")]
pub struct NotVrpn;

/// Server side of a connection: bytes of the client in, bytes to the client out. Every body is a tracker with one sensor.
#[derive(Clone, Debug)]
pub struct VrpnSession {
    stream: VrpnStream,
    greeted: bool,
    senders: NameTable,
    types: NameTable,
    bodies: Vec<String>,
    sequence: u32,
}

impl VrpnSession {
    /// Opens the session of a new connection; appends our cookie to `out`.
    pub fn open(bodies: &[String], out: &mut Vec<u8>) -> Self {
        out.extend_from_slice(&VrpnVersion::OURS.to_cookie());
        Self {
            stream: VrpnStream::new(),
            greeted: false,
            senders: NameTable::default(),
            types: NameTable::default(),
            bodies: bodies.to_vec(),
            sequence: 0,
        }
    }

    /// Whether the client has sent its cookie, and so takes messages.
    pub fn is_greeted(&self) -> bool {
        self.greeted
    }

    /// Takes bytes of the client and appends the answers to `out`; returns whether the connection continues.
    ///
    /// # Errors
    /// The client does not use VRPN.
    pub fn receive(&mut self, bytes: &[u8], out: &mut Vec<u8>) -> Result<bool, NotVrpn> {
        self.stream.push(bytes);
        if !self.greeted {
            let Some(cookie) = self.stream.take_bytes::<COOKIE_BYTES>() else { return Ok(true) };
            VrpnVersion::from_cookie(&cookie).map_err(|_| NotVrpn)?;
            self.greeted = true;
            self.describe(out);
        }
        while let Some(message) = self.stream.take().map_err(|_| NotVrpn)? {
            match (message.kind, message.described_name()) {
                (VrpnMessage::SENDER_DESCRIPTION, Some(name)) => {
                    self.senders.set(message.sender, name);
                }
                (VrpnMessage::TYPE_DESCRIPTION, Some(name)) => {
                    self.types.set(message.sender, name);
                }
                (VrpnMessage::DISCONNECT, _) => return Ok(false),
                (kind, _) if self.types.get(kind) == Some(PING_TYPE) => {
                    // A ping to a body is answered by the body.
                    let name = self.senders.get(message.sender).unwrap_or(CONTROL);
                    let sender = self.bodies.iter().position(|body| body == name);
                    let sender = sender.map_or(0, |index| index as i32 + 1);
                    let VrpnMessage { seconds, micros, .. } = message;
                    let pong = VrpnMessage { seconds, micros, ..VrpnMessage::new(sender, PONG) };
                    self.send(&pong, out);
                }
                _ => {}
            }
        }
        Ok(true)
    }

    /// Appends the poses of the visible bodies to `out`.
    pub fn write_frame(&mut self, frame: &MotionFrame<'_>, out: &mut Vec<u8>) {
        let micros = frame.captured_ns / 1000;
        for (sender, body) in (1..).zip(frame.bodies) {
            let Some(pose) = &body.pose else { continue };
            let payload = TrackerPose::new(pose).to_payload();
            let message = VrpnMessage {
                seconds: (micros / 1_000_000) as u32,
                micros: (micros % 1_000_000) as u32,
                payload: &payload,
                ..VrpnMessage::new(sender, POSE)
            };
            self.send(&message, out);
        }
    }

    /// Appends the descriptions of our senders and types.
    fn describe(&mut self, out: &mut Vec<u8>) {
        let senders: Vec<String> =
            std::iter::once(CONTROL.to_owned()).chain(self.bodies.iter().cloned()).collect();
        for (number, name) in (0..).zip(&senders) {
            self.describe_one((number, VrpnMessage::SENDER_DESCRIPTION), name, out);
        }
        for (number, name) in (0..).zip(TYPES) {
            self.describe_one((number, VrpnMessage::TYPE_DESCRIPTION), name, out);
        }
    }

    fn describe_one(&mut self, (number, kind): (i32, i32), name: &str, out: &mut Vec<u8>) {
        write_description(out, (number, kind), name, self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
    }

    fn send(&mut self, message: &VrpnMessage<'_>, out: &mut Vec<u8>) {
        write_message(out, message, self.sequence);
        self.sequence = self.sequence.wrapping_add(1);
    }
}
