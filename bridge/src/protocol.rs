//! Interface to a vehicle's wire format: set-points to bytes, bytes to replies. One implementation per format. A protocol knows
//! neither the transport that carries its frames nor the rules by which set-points are chosen.

use std::fmt::Debug;

use oqtal_bus::time::{Span, Time};

use crate::setpoint::VehicleSetpoint;

/// Longest frame of any protocol, and of any transport that carries it \[bytes\]: a signed MAVLink 2 packet of greatest length.
pub const MAX_FRAME: usize = 280;

/// Bytes of one frame to the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct VehicleFrame {
    bytes: [u8; MAX_FRAME],
    length: usize,
}

impl VehicleFrame {
    /// Frame without bytes: nothing is sent.
    pub const EMPTY: Self = Self { bytes: [0; MAX_FRAME], length: 0 };

    /// Frame of `bytes`; empty if there are more than [`MAX_FRAME`].
    #[must_use]
    pub fn of(bytes: &[u8]) -> Self {
        let mut frame = Self::EMPTY;
        if let Some(place) = frame.bytes.get_mut(..bytes.len()) {
            place.copy_from_slice(bytes);
            frame.length = bytes.len();
        }
        frame
    }

    /// The bytes of the frame.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// Message of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VehicleReply {
    /// Acknowledgement of a set-point.
    Acknowledged,
    /// State of the vehicle.
    Status {
        /// Battery voltage \[V\].
        battery_v: f64,
        /// Whether the motors run.
        motors_run: bool,
    },
    /// Any other valid message.
    Other,
}

/// Frame that a protocol sends at its own rate: a status request, a heartbeat, a keep-alive.
#[derive(Clone, Copy, Debug)]
pub struct PeriodicWord {
    /// The frame.
    pub frame: VehicleFrame,
    /// Whether the vehicle answers it; unanswered ones lower the link quality.
    pub is_answered: bool,
}

/// Frame lengths of a protocol \[bytes\], without what a transport adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameSizes {
    /// Set-point.
    pub setpoint: usize,
    /// Answer to a set-point; 0 for none.
    pub acknowledgement: usize,
    /// Longest periodic word; 0 for none.
    pub periodic: usize,
    /// Longest answer to a periodic word; 0 for none.
    pub periodic_reply: usize,
}

impl FrameSizes {
    /// Lengths with `overhead` bytes added to every frame.
    #[must_use]
    pub fn with_overhead(self, overhead: usize) -> Self {
        let Self { setpoint, acknowledgement, periodic, periodic_reply } = self;
        let [setpoint, acknowledgement, periodic, periodic_reply] =
            [setpoint, acknowledgement, periodic, periodic_reply]
                .map(|bytes| if bytes == 0 { 0 } else { bytes + overhead });
        Self { setpoint, acknowledgement, periodic, periodic_reply }
    }

    /// Longest frame to the vehicle \[bytes\].
    #[must_use]
    pub fn longest_sent(&self) -> usize {
        self.setpoint.max(self.periodic)
    }
}

/// Wire format of a vehicle. No method allocates, and no input makes one panic.
pub trait VehicleProtocol: Debug + Send {
    /// Frame lengths.
    fn sizes(&self) -> FrameSizes;

    /// Encodes a set-point.
    fn setpoint(&mut self, setpoint: &VehicleSetpoint) -> VehicleFrame;

    /// Returns the periodic word that is due at `now`, if any. Called after a set-point whenever the transport has room for one
    /// more frame. While `is_status_urgent`, a motor sequence waits for the vehicle's state: a status request is then due
    /// whatever its period.
    fn periodic(&mut self, now: Time, is_status_urgent: bool) -> Option<PeriodicWord>;

    /// Encodes the command that stops the motors at once.
    fn emergency_stop(&mut self) -> VehicleFrame;

    /// Decodes received bytes and passes every complete message to `reply`. A stream may cut messages anywhere.
    fn decode(&mut self, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply));

    /// Number of damaged frames received since the start.
    fn damaged(&self) -> u64;

    /// Discards partly received frames and restarts the periodic words: a port was opened.
    fn reset(&mut self);
}

/// Timer of one periodic word.
#[derive(Clone, Copy, Debug)]
pub struct PeriodicTimer {
    period: Span,
    last: Time,
}

impl PeriodicTimer {
    /// Timer that is due at once, and then every `period`.
    #[must_use]
    pub fn new(period: Span) -> Self {
        Self { period, last: Time::UNSET }
    }

    /// Whether the word is due at `now`: a period has passed since it was last due, or `is_urgent`. Restarts the period if so.
    pub fn is_due(&mut self, now: Time, is_urgent: bool) -> bool {
        let due = is_urgent || now >= self.last + self.period;
        if due {
            self.last = now;
        }
        due
    }

    /// Makes the timer due at once.
    pub fn restart(&mut self) {
        self.last = Time::UNSET;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_timer_keeps_its_period_unless_urgent() {
        let mut timer = PeriodicTimer::new(Span::from_millis(125));
        let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
        assert!(timer.is_due(at(0), false));
        assert!(!timer.is_due(at(17), false));
        assert!(timer.is_due(at(17), true), "urgent");
        assert!(!timer.is_due(at(130), false), "a period after the urgent one");
        assert!(timer.is_due(at(142), false));
        timer.restart();
        assert!(timer.is_due(at(143), false));
    }

    #[test]
    fn a_frame_of_280_bytes_is_kept_and_a_longer_one_is_empty() {
        assert_eq!(VehicleFrame::of(&[7; MAX_FRAME]).bytes(), [7; MAX_FRAME]);
        assert!(VehicleFrame::of(&[7; MAX_FRAME + 1]).bytes().is_empty());
    }
}
