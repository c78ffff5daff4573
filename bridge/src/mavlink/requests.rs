//! Messages besides set-points and poses: heartbeats, message rates, the origin of the world, exchanges of clocks, the time-out of
//! the vehicle.

use oqtal_bus::time::{Span, Time};
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{
    AutopilotFirmware, CommandKind, MavlinkContent, MavlinkHeartbeat, ParameterName,
    ParameterValue, Timesync, VehicleCommandLong,
};

use super::vehicle::AutopilotState;
use super::wanted::time_out_parameter;
use crate::protocol::{PeriodicTimer, VehicleReply};

/// Period of the bridge's own heartbeat, by which autopilots detect a companion computer.
const HEARTBEAT: Span = Span::from_millis(500);
/// Period of the world's origin, which is sent until the vehicle has a position.
const ORIGIN: Span = Span::from_millis(1000);
/// Period of the request for the vehicle's time-out, which another ground station may change.
const TIME_OUT: Span = Span::from_millis(500);
/// Time-out of the acknowledgement of a message rate.
const RATE_WITHIN: Span = Span::from_millis(200);
/// Number of requests for each message rate \[-\].
const RATE_TRIES: u8 = 3;
/// Time without a heartbeat after which the rates are requested again: unrequested heartbeats arrive once per second.
const HEARTBEATS_RARE: Span = Span::from_millis(400);
/// Pause before the rates are requested again.
const RATES_AGAIN: Span = Span::from_millis(3000);
/// Age of a heartbeat at which a single one is requested: PX4 refuses every rate except one a second.
const HEARTBEAT_AGE: Span = Span::from_millis(60);
const HEARTBEAT_MESSAGE: u32 = 0;
/// Longest time between a request and its answer.
const SYNC_WITHIN: Span = Span::from_millis(100);

/// Messages whose rates are requested, and their period \[us\]. The heartbeat reports mode and motors, and therefore the actions of a
/// pilot; the attitude contains the body rate, against which poses are checked.
const RATES: [(u32, u32); 4] = [(0, 50_000), (1, 500_000), (32, 50_000), (31, 20_000)];
/// Flags of the estimator: EKF_STATUS_REPORT and ESTIMATOR_STATUS.
const ESTIMATOR: [(AutopilotKind, u32); 2] =
    [(AutopilotKind::ArduPilot, 193), (AutopilotKind::Px4, 230)];
const ESTIMATOR_US: u32 = 200_000;

/// Requests for message rates, one at a time.
#[derive(Clone, Debug, Default)]
struct RateRequests {
    next: usize,
    tries: u8,
    asked_at: Option<Time>,
    done_at: Option<Time>,
}

/// Messages that are due besides set-points and poses.
#[derive(Clone, Debug)]
pub(super) struct PeriodicRequests {
    heartbeat: PeriodicTimer,
    origin: PeriodicTimer,
    sync: PeriodicTimer,
    poll: PeriodicTimer,
    parameter: PeriodicTimer,
    /// Time-out of the vehicle; `None` before it is reported, or if the vehicle has none.
    time_out: Option<Span>,
    rates: RateRequests,
    /// Request of the vehicle that has not been answered yet.
    answer: Option<Timesync>,
    /// Instant of the bridge's last request.
    asked: Option<Time>,
}

impl PeriodicRequests {
    /// Requests with an exchange of clocks every `sync`.
    pub(super) fn new(sync: Span) -> Self {
        Self {
            heartbeat: PeriodicTimer::new(HEARTBEAT),
            origin: PeriodicTimer::new(ORIGIN),
            sync: PeriodicTimer::new(sync),
            poll: PeriodicTimer::new(HEARTBEAT_AGE),
            parameter: PeriodicTimer::new(TIME_OUT),
            time_out: None,
            rates: RateRequests::default(),
            answer: None,
            asked: None,
        }
    }

    /// Restarts all timers: a port was opened, or the vehicle was restarted.
    pub(super) fn restart(&mut self) {
        self.heartbeat.restart();
        self.origin.restart();
        self.sync.restart();
        self.parameter.restart();
        self.time_out = None;
        (self.rates, self.answer, self.asked) = (RateRequests::default(), None, None);
    }

    /// The message that is due at `now`, and whether the vehicle answers it as a request.
    pub(super) fn next(
        &mut self,
        now: Time,
        vehicle: &AutopilotState,
    ) -> Option<(MavlinkContent, bool)> {
        if let Some(asked) = self.answer.take() {
            let answered = own_clock(now);
            return Some((MavlinkContent::Timesync(Timesync { answered, ..asked }), false));
        }
        if self.heartbeat.is_due(now, false) {
            return Some((MavlinkContent::Heartbeat(OWN_HEARTBEAT), false));
        }
        let (target, kind) = vehicle.known()?;
        if self.sync.is_due(now, false) {
            self.asked = Some(now);
            let request = Timesync { answered: 0, asked: own_clock(now) };
            return Some((MavlinkContent::Timesync(request), true));
        }
        let command =
            |kind| MavlinkContent::Command(VehicleCommandLong { target, kind, confirmation: 0 });
        let is_old = vehicle.heartbeat_at().is_none_or(|at| now.since(at) >= HEARTBEAT_AGE);
        if is_old && self.poll.is_due(now, false) {
            return Some((
                command(CommandKind::RequestMessage { message: HEARTBEAT_MESSAGE }),
                false,
            ));
        }
        let is_heartbeat_recent =
            vehicle.heartbeat_at().is_some_and(|at| now.since(at) <= HEARTBEATS_RARE);
        if let Some(kind) = self.rates.next(now, kind, is_heartbeat_recent) {
            return Some((command(kind), false));
        }
        let needs_origin = kind == AutopilotKind::ArduPilot && !vehicle.has_position();
        if needs_origin && self.origin.is_due(now, false) {
            return Some((MavlinkContent::GlobalOrigin { system: target.system }, false));
        }
        let name = ParameterName::new(time_out_parameter(kind))?;
        let is_due = self.parameter.is_due(now, false);
        is_due.then_some((MavlinkContent::ParameterRequest { target, name }, false))
    }

    /// Time without set-points after which the vehicle acts by itself; `None` if it is not known.
    pub(super) fn time_out(&self) -> Option<Span> {
        self.time_out
    }

    /// Whether the vehicle has reported its time-out, or was asked for all messages without reporting it.
    pub(super) fn are_answered(&self) -> bool {
        self.time_out.is_some() || self.rates.done_at.is_some()
    }

    /// Takes the parameter `name` of `vehicle`, requested here or by another ground station.
    pub(super) fn receive_parameter(
        &mut self,
        vehicle: &AutopilotState,
        name: &ParameterName,
        value: &ParameterValue,
    ) {
        let Some((_, kind)) = vehicle.known() else { return };
        if name.as_str() == time_out_parameter(kind) {
            let seconds = value.number(kind.sends_integers_as_bits());
            // Comparisons with NaN are false.
            self.time_out = (seconds > 0.0).then(|| Span::from_seconds(seconds));
        }
    }

    /// Takes an exchange of clocks: a request is answered with the next message.
    pub(super) fn receive(
        &mut self,
        now: Time,
        sync: Timesync,
        reply: &mut dyn FnMut(VehicleReply),
    ) {
        if sync.answered == 0 {
            self.answer = Some(sync);
        } else if let Some(asked) = self.asked.filter(|asked| own_clock(*asked) == sync.asked) {
            self.asked = None;
            let round_trip = now.since(asked);
            if round_trip <= SYNC_WITHIN {
                reply(VehicleReply::RoundTrip(round_trip));
            }
        }
    }

    /// Takes the acknowledgement of a command.
    pub(super) fn acknowledged(&mut self, command: u16) {
        if command == CommandKind::MESSAGE_INTERVAL {
            self.rates.advance();
        }
    }
}

/// Heartbeat of this computer.
pub(crate) const OWN_HEARTBEAT: MavlinkHeartbeat = MavlinkHeartbeat {
    autopilot: AutopilotFirmware::None,
    custom_mode: 0,
    is_armed: false,
    is_simulated: false,
};

/// Clock by which poses are dated \[ns\].
fn own_clock(now: Time) -> i64 {
    now.nanos().cast_signed()
}

impl RateRequests {
    fn next(
        &mut self,
        now: Time,
        kind: AutopilotKind,
        is_heartbeat_recent: bool,
    ) -> Option<CommandKind> {
        let (message, interval_us) = match RATES.get(self.next) {
            Some(rate) => *rate,
            None if self.next == RATES.len() => {
                let (_, message) = ESTIMATOR.iter().find(|(known, _)| *known == kind)?;
                (*message, ESTIMATOR_US)
            }
            None => {
                let done_at = *self.done_at.get_or_insert(now);
                if !is_heartbeat_recent && now.since(done_at) > RATES_AGAIN {
                    *self = Self::default();
                }
                return None;
            }
        };
        if self.asked_at.is_some_and(|at| now.since(at) < RATE_WITHIN) {
            return None;
        }
        if self.tries >= RATE_TRIES {
            self.advance();
            return None;
        }
        (self.asked_at, self.tries) = (Some(now), self.tries + 1);
        Some(CommandKind::MessageInterval { message, interval_us })
    }

    fn advance(&mut self) {
        if self.next <= RATES.len() {
            (self.next, self.tries, self.asked_at) = (self.next + 1, 0, None);
        }
    }
}
