//! Interface to the connection that frames come over: one implementation per protocol.

use std::fmt::Debug;
use std::io;
use std::os::fd::BorrowedFd;

use oqtal_bus::time::Time;
use oqtal_wire::motion::RigidPose;

use crate::definitions::BodyDefinitions;
use crate::gate::FrameStamp;
use crate::routes::RefusedBody;

/// A body in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredBody {
    /// Number of the body in the camera system, from 1 \[-\].
    pub number: u32,
    /// Pose; `None` while the cameras do not see the body.
    pub pose: Option<RigidPose>,
    /// Mean distance of the markers from the body fitted to them \[m\]; NaN if unknown.
    pub residual_m: f64,
}

/// Consumer of the frames of a stream.
pub trait FrameSink {
    /// A frame has arrived. Frames with a common counter and clock have a common gate: all frames of a server, or those of one body.
    fn frame(&mut self, gate: usize, stamp: FrameStamp, arrival: Time);

    /// A body of the frame that arrived last at this gate.
    fn body(&mut self, gate: usize, route: usize, body: MeasuredBody);

    /// A datagram or message could not be read.
    fn damaged(&mut self);
}

/// The sockets of a stream, at most two.
pub type StreamSockets<'a> = [Option<BorrowedFd<'a>>; 2];

/// An open connection to a camera system. No method blocks; `receive` and `maintain` do not allocate unless the connection is lost.
pub trait CameraStream: Debug + Send {
    /// Sockets that become readable when something has arrived.
    fn sockets(&self) -> StreamSockets<'_>;

    /// Reads what has arrived, with bounded work; `now` reads the clock.
    ///
    /// # Errors
    /// The connection is lost.
    fn receive(&mut self, now: &dyn Fn() -> Time, sink: &mut dyn FrameSink) -> io::Result<()>;

    /// Sends the messages that are due, such as a keep-alive message.
    ///
    /// # Errors
    /// The connection is lost.
    fn maintain(&mut self, now: Time) -> io::Result<()>;

    /// Definitions of bodies that have arrived, to be read on another thread and given back.
    fn take_definitions(&mut self) -> Option<Box<BodyDefinitions>> {
        None
    }

    /// Puts definitions that were read into force. A protocol without definitions never hands any out.
    fn apply_definitions(&mut self, definitions: Box<BodyDefinitions>) {
        drop(definitions);
    }

    /// Whether the body of a route is known to the server.
    fn has(&self, route: usize) -> bool;

    /// A body that was refused because another has its name; each is reported once.
    fn take_refused(&mut self) -> Option<RefusedBody>;

    /// Whether every body has its own gate; otherwise there is one gate for all.
    fn gate_per_body(&self) -> bool {
        false
    }
}
