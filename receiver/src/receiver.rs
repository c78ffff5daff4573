//! The receiver between network and bus: from frames to the poses that are published. Pure.
//!
//! Of each body only the newest pose is kept until it is taken: one pose is published however many frames arrive at once.

use oqtal_bus::message::{PoseV1, Stamps};
use oqtal_bus::time::Time;
use oqtal_config::ReceiverOptions;
use oqtal_runtime::pose_source::Delivery;

use crate::clock::ClockState;
use crate::gate::{DatedFrame, FrameCounts, FrameGate, FrameStamp};
use crate::stream::{FrameSink, MeasuredBody};
use crate::transform::PoseTransform;

/// A gate, and the frame that arrived last, if it was accepted.
#[derive(Clone, Debug)]
struct GateState {
    gate: FrameGate,
    current: Option<(DatedFrame, Time)>,
}

/// State of one body.
#[derive(Clone, Copy, Debug, Default)]
struct BodyTrack {
    /// The newest pose that was not taken yet.
    pending: Option<Delivery>,
    tracked: bool,
    /// Arrival of its last frame.
    seen_at: Time,
    superseded: u64,
}

/// Converts frames of a camera system to poses.
#[derive(Clone, Debug)]
pub struct PoseReceiver {
    gates: Vec<GateState>,
    bodies: Vec<BodyTrack>,
    transform: PoseTransform,
    damaged: u64,
    arrived_at: Time,
}

impl PoseReceiver {
    /// Receiver of this number of bodies.
    pub fn new(options: &ReceiverOptions, bodies: usize) -> Self {
        // A protocol has one gate, or one for each body.
        let state = GateState { gate: FrameGate::new(options), current: None };
        Self {
            gates: vec![state; bodies.max(1)],
            bodies: vec![BodyTrack::default(); bodies],
            transform: PoseTransform::new(options),
            damaged: 0,
            arrived_at: Time::UNSET,
        }
    }

    /// Discards everything known of the server, as for a new connection: its clock, its frame count, its visible bodies.
    pub fn forget(&mut self) {
        for state in &mut self.gates {
            state.gate.forget();
            state.current = None;
        }
        for body in &mut self.bodies {
            body.tracked = false;
        }
    }

    /// The newest pose of a body that was not taken before.
    pub fn take(&mut self, route: usize) -> Option<Delivery> {
        self.bodies[route].pending.take()
    }

    /// Whether the cameras saw a body in its last frame.
    pub fn is_tracked(&self, route: usize) -> bool {
        self.bodies[route].tracked
    }

    /// Arrival of the last frame with this body; [`Time::UNSET`] before the first.
    pub fn seen_at(&self, route: usize) -> Time {
        self.bodies[route].seen_at
    }

    /// Arrival of the last frame; [`Time::UNSET`] before the first.
    pub fn arrived_at(&self) -> Time {
        self.arrived_at
    }

    /// The frames at a gate, by outcome.
    pub fn counts(&self, gate: usize) -> FrameCounts {
        self.gates[gate].gate.counts()
    }

    /// State of the server's clock at a gate.
    pub fn clock(&self, gate: usize) -> ClockState {
        self.gates[gate].gate.clock()
    }

    /// Datagrams and messages that could not be read \[-\].
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    /// Poses that a newer one overtook before they were taken \[-\].
    pub fn superseded(&self) -> u64 {
        self.bodies.iter().map(|body| body.superseded).sum()
    }
}

impl FrameSink for PoseReceiver {
    fn frame(&mut self, gate: usize, stamp: FrameStamp, arrival: Time) {
        self.arrived_at = arrival;
        if let Some(state) = self.gates.get_mut(gate) {
            let checked = state.gate.check(stamp, arrival);
            state.current = checked.ok().map(|dated| (dated, arrival));
        }
    }

    fn body(&mut self, gate: usize, route: usize, body: MeasuredBody) {
        let (Some(state), Some(track)) = (self.gates.get(gate), self.bodies.get_mut(route)) else {
            return;
        };
        track.tracked = body.pose.is_some();
        track.seen_at = self.arrived_at;
        let Some((DatedFrame { frame, captured }, arrival)) = state.current else { return };
        let (position, attitude) = match &body.pose {
            Some(pose) => self.transform.apply(pose),
            None => ([0.0; 3], [0.0, 0.0, 0.0, 1.0]),
        };
        let pose = PoseV1 {
            position,
            attitude,
            residual_m: body.residual_m,
            capture_uncertainty_s: captured.uncertainty.seconds(),
            body: body.number,
            tracked: u8::from(body.pose.is_some()),
            // Measured by cameras, as far as the protocol shows.
            simulated: 0,
        };
        let stamps = Stamps {
            captured_at: captured.captured_at,
            pose_received_at: arrival,
            ..Stamps::default()
        };
        track.superseded += u64::from(track.pending.is_some());
        track.pending = Some(Delivery { frame, stamps, pose });
    }

    fn damaged(&mut self) {
        self.damaged += 1;
    }
}
