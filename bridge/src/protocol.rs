//! Interface to a vehicle's wire format: set-points to bytes, bytes to replies. One implementation per format. A protocol is
//! independent of the transport of its frames and of the rules that select set-points.

use std::fmt::Debug;

use oqtal_bus::code::{ControlHolder, EstimatorState, VehicleRefusal};
use oqtal_bus::lease::EncoderState;
use oqtal_bus::text::ShortText;
use oqtal_bus::time::{Span, Time};
use oqtal_control::quaternion::Attitude;

use crate::setpoint::VehicleSetpoint;

/// Longest frame of any protocol, including the overhead of any transport \[bytes\]: a signed MAVLink 2 packet of greatest length.
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
    pub fn of(bytes: &[u8]) -> Self {
        let mut frame = Self::EMPTY;
        if let Some(place) = frame.bytes.get_mut(..bytes.len()) {
            place.copy_from_slice(bytes);
            frame.length = bytes.len();
        }
        frame
    }

    /// The bytes of the frame.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// Motors as a vehicle reports them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportedMotors {
    /// The vehicle is disarmed.
    Off,
    /// The vehicle is armed and does not follow set-points yet; its motors are stopped like running ones.
    SpoolingUp,
    /// The motors follow set-points.
    Running,
}

impl ReportedMotors {
    /// State of the motors of a vehicle that follows set-points as soon as they run.
    pub fn of(run: bool) -> Self {
        if run { Self::Running } else { Self::Off }
    }

    /// Whether the motors run, or will once they have spooled up.
    pub fn are_armed(self) -> bool {
        self != Self::Off
    }
}

/// One piece of information in a valid message of the vehicle; a message can contain several.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VehicleReply {
    /// Answer to a request: to a set-point that is acknowledged, or to a periodic frame that is answered.
    Answer,
    /// Answer to a periodic frame, this time after the frame was sent.
    RoundTrip(Span),
    /// State of the motors.
    Motors(ReportedMotors),
    /// Battery voltage \[V\].
    Battery(f64),
    /// Holder of the control. Without a report, the bridge has control.
    Control(ControlHolder),
    /// Another vehicle with stopped motors answers in place of one that stopped answering: all earlier information is void.
    Replaced,
    /// The vehicle refuses the last request.
    Refused(VehicleRefusal),
    /// The vehicle is ready again: the reason of its last refusal has ended.
    Ready,
    /// Motion by the vehicle's own estimate.
    Estimate(VehicleEstimate),
    /// Body rate by the vehicle's gyroscope \[rad/s, body\].
    BodyRate([f64; 3]),
    /// Line of text for the operator.
    Text(VehicleText),
    /// Anything else.
    Other,
}

/// Motion of a vehicle by its own estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleEstimate {
    /// Whether the vehicle considers its estimate valid.
    pub state: EstimatorState,
    /// Position \[m, world\]; NaN if unknown.
    pub position: [f64; 3],
    /// Attitude \[body to world\], scalar last; zeros if unknown.
    pub attitude: [f64; 4],
}

impl VehicleEstimate {
    /// Estimate of a vehicle before its first report.
    pub const UNKNOWN: Self =
        Self { state: EstimatorState::Unknown, position: [f64::NAN; 3], attitude: [0.0; 4] };
}

/// Line of text of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VehicleText {
    /// Whether it reports a fault, which is shown until the motors run.
    pub is_trouble: bool,
    /// The text.
    pub text: ShortText,
}

/// Pose sent to a vehicle that estimates its own motion: finite, tracked by the cameras, and newer than the previous one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehiclePose {
    /// Capture time of the pose.
    pub captured_at: Time,
    /// Position \[m, world\].
    pub position: [f64; 3],
    /// Attitude \[body to world\].
    pub attitude: Attitude,
}

/// Frame that a protocol sends at its own rate: a status request, a heartbeat, a keep-alive.
#[derive(Clone, Copy, Debug)]
pub struct PeriodicFrame {
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
    /// Longest periodic frame; 0 without periodic frames.
    pub periodic: usize,
    /// Longest answer to a periodic frame; 0 for none.
    pub periodic_reply: usize,
}

impl FrameSizes {
    /// Lengths with `overhead` bytes added to every frame.
    pub fn with_overhead(self, overhead: usize) -> Self {
        let Self { setpoint, acknowledgement, periodic, periodic_reply } = self;
        let [setpoint, acknowledgement, periodic, periodic_reply] =
            [setpoint, acknowledgement, periodic, periodic_reply]
                .map(|bytes| if bytes == 0 { 0 } else { bytes + overhead });
        Self { setpoint, acknowledgement, periodic, periodic_reply }
    }

    /// Longest frame to the vehicle \[bytes\].
    pub fn longest_sent(&self) -> usize {
        self.setpoint.max(self.periodic)
    }
}

/// Wire format of a vehicle. No method allocates, and no input makes one panic.
pub trait VehicleProtocol: Debug + Send {
    /// Frame lengths.
    fn sizes(&self) -> FrameSizes;

    /// Encodes a set-point that is sent at `now`; empty if the vehicle is to be sent none. Starting and stopping the motors may take the
    /// protocol several frames: it is called with the same set-point until the vehicle reports the motors running or stopped, and returns
    /// the next frame of the sequence each time.
    fn setpoint(&mut self, now: Time, setpoint: &VehicleSetpoint) -> VehicleFrame;

    /// Whether the vehicle has not executed earlier set-points at `now`. If so, none is sent, because it would wait in the vehicle and
    /// become old.
    fn is_busy(&self, _now: Time) -> bool {
        false
    }

    /// Shortest time between two poses; `None` for a vehicle that takes none.
    fn pose_period(&self) -> Option<Span> {
        None
    }

    /// Encodes a pose that is sent at `now`. Called at most every [`VehicleProtocol::pose_period`], with poses that are not old.
    fn pose(&mut self, _now: Time, _pose: &VehiclePose) -> VehicleFrame {
        VehicleFrame::EMPTY
    }

    /// Most periodic frames and poses behind one set-point \[-\].
    fn periodic_count(&self) -> usize {
        1
    }

    /// Longest time between two reads of the port; `None` if the vehicle is read with every set-point.
    fn read_period(&self) -> Option<Span> {
        None
    }

    /// Returns the periodic frame that is due at `now`, if any. Called after a set-point whenever the transport has room for one
    /// more frame. While `is_status_urgent`, a motor sequence waits for the vehicle's state: a status request is then due
    /// independent of its period.
    fn periodic(&mut self, now: Time, is_status_urgent: bool) -> Option<PeriodicFrame>;

    /// Time without set-points after which the vehicle acts by itself: levels out, stops its motors, or changes its mode. `None` if it
    /// is not known.
    fn time_out(&self) -> Option<Span>;

    /// Whether all parameters and settings that a flight needs were read and set, as far as the vehicle answers.
    fn is_set_up(&self) -> bool {
        true
    }

    /// Encodes the command that stops the motors at once.
    fn emergency_stop(&mut self) -> VehicleFrame;

    /// Ends the flight of a bridge that ends while motors may run: its last zero set-points are encoded, then
    /// [`VehicleProtocol::final_stop`].
    fn end_flight(&mut self) {}

    /// Encodes the final frame of a bridge that ends while motors may run, sent after zero set-points: the emergency stop, unless the
    /// vehicle has a milder command.
    fn final_stop(&mut self) -> VehicleFrame {
        self.emergency_stop()
    }

    /// Decodes bytes received at `now` and passes the content of every complete message to `reply`. A stream may split messages
    /// anywhere.
    fn decode(&mut self, now: Time, bytes: &[u8], reply: &mut dyn FnMut(VehicleReply));

    /// State of the encoder of flight set-points, which the same protocol in another process can continue; `None` if it cannot, or if no
    /// set-points are encoded yet.
    fn encoder_state(&self) -> Option<EncoderState> {
        None
    }

    /// Continues with the encoder state of another process, which is already connected to the vehicle.
    fn continue_encoder(&mut self, _state: &EncoderState) {}

    /// Number of damaged frames received since the start.
    fn damaged(&self) -> u64;

    /// Discards partly received frames and restarts the periodic frames: a port was opened.
    fn reset(&mut self);
}

/// Timer of one periodic frame.
#[derive(Clone, Copy, Debug)]
pub struct PeriodicTimer {
    period: Span,
    last: Time,
}

impl PeriodicTimer {
    /// Timer that is due at once, and then every `period`.
    pub fn new(period: Span) -> Self {
        Self { period, last: Time::UNSET }
    }

    /// Whether the frame is due at `now`: a period has passed since it was last due, or `is_urgent`. Restarts the period if so.
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
