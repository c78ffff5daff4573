//! Set-points of the emulated autopilot, and what it does without them.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Interface};
use oqtal_control::options::OptionError;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{AttitudeTarget, SetpointKind, ThrustCurve};

/// Time without a set-point after which ArduCopter levels, GUID_TIMEOUT.
const GUIDED_TIMEOUT: Span = Span::from_millis(3000);
/// Time without a set-point after which PX4 leaves Offboard, COM_OF_LOSS_T.
pub(super) const OFFBOARD_TIMEOUT: Span = Span::from_millis(1000);
/// Height below which the vehicle may have landed \[m\], and for how long.
const FLOOR_M: f64 = 0.05;
const LANDED_AFTER: Span = Span::from_millis(1000);
/// Gain from tilt to rate of a vehicle that levels by itself \[1/s\].
const LEVELLING: f64 = 4.0;
/// Share of the weight with which PX4 sinks without a pilot's sticks \[-\].
const SINKING: f64 = 0.96;

/// Set-points, and their time-out.
#[derive(Debug)]
pub(super) struct SetpointFollower {
    kind: AutopilotKind,
    thrust: ThrustCurve,
    holds_attitude: bool,
    authority: [f64; 3],
    /// Share of greatest thrust that carries the vehicle \[-\].
    hover: f64,
    newest: Option<(Time, AttitudeTarget)>,
    low_since: Option<Time>,
}

impl SetpointFollower {
    /// Follower of the simulated vehicle of `config`.
    pub(super) fn new(config: &Config, kind: AutopilotKind) -> Result<Self, OptionError> {
        let plant = &config.plant;
        let thrust = ThrustCurve::new(&plant.wire.mavlink.thrust_table).map_err(|error| {
            OptionError::new("plant.wire.mavlink.thrust-table", "unusable", error.to_string())
        })?;
        Ok(Self {
            kind,
            thrust,
            holds_attitude: plant.interface == Interface::Attitude,
            authority: plant.rate_authority_rad_s,
            hover: plant.mass_kg * plant.gravity_m_s2 / plant.max_thrust_n,
            newest: None,
            low_since: None,
        })
    }

    /// Takes a set-point; ignores one that is no number.
    pub(super) fn take(&mut self, now: Time, target: &AttitudeTarget) {
        let numbers = match target.kind {
            SetpointKind::Rates(rates) => rates.iter().all(|rate| rate.is_finite()),
            SetpointKind::Attitude { attitude, .. } => Attitude::from_xyzw(attitude).is_some(),
        };
        if numbers && target.thrust.is_finite() {
            self.newest = Some((now, *target));
        }
    }

    /// Whether the newest set-point is at most `age` old.
    pub(super) fn flows(&self, now: Time, age: Span) -> bool {
        self.newest.is_some_and(|(at, _)| now.since(at) <= age)
    }

    /// Begins a flight at `now`: the vehicle does not know yet that it stands.
    pub(super) fn begin(&mut self, now: Time) {
        self.low_since = self.low_since.map(|_| now);
    }

    /// Watches the height, by which the vehicle knows that it has landed \[m, world z\].
    pub(super) fn watch_height(&mut self, now: Time, height_m: f64) {
        self.low_since = if height_m < FLOOR_M { self.low_since.or(Some(now)) } else { None };
    }

    /// Whether the vehicle knows that it stands.
    pub(super) fn has_landed(&self, now: Time) -> bool {
        self.low_since.is_some_and(|since| now.since(since) >= LANDED_AFTER)
    }

    /// The command that running motors follow; `follows` set-points, or a mode of the autopilot's own.
    pub(super) fn command(&self, now: Time, truth: &TruthV1, follows: bool) -> CommandV1 {
        let age = match self.kind {
            AutopilotKind::ArduPilot => GUIDED_TIMEOUT,
            AutopilotKind::Px4 => OFFBOARD_TIMEOUT,
        };
        match &self.newest {
            Some((_, target)) if follows && self.flows(now, age) => self.flight(target),
            // Armed and not flown yet: the rotors idle.
            None => self.level(truth, 0.0),
            Some(_) if self.has_landed(now) => self.level(truth, 0.0),
            Some(_) if self.kind == AutopilotKind::Px4 => self.level(truth, SINKING * self.hover),
            Some(_) => self.level(truth, self.hover),
        }
    }

    fn flight(&self, target: &AttitudeTarget) -> CommandV1 {
        let base = CommandV1 { thrust: self.thrust.delta(target.thrust), ..CommandV1::default() };
        match target.kind {
            SetpointKind::Rates(rates) if !self.holds_attitude => self.rates(rates, base),
            // A vehicle whose interface is the attitude takes rates as a wish to be level.
            SetpointKind::Rates(_) => attitude([0.0, 0.0, 0.0, 1.0], base),
            SetpointKind::Attitude { attitude: wanted, .. } => attitude(wanted, base),
        }
    }

    /// Level at this thrust.
    fn level(&self, truth: &TruthV1, thrust: f64) -> CommandV1 {
        let base = CommandV1 { thrust, ..CommandV1::default() };
        let [x, y, ..] = truth.attitude;
        match self.holds_attitude {
            true => attitude([0.0, 0.0, 0.0, 1.0], base),
            false => self.rates([-2.0 * LEVELLING * x, -2.0 * LEVELLING * y, 0.0], base),
        }
    }

    fn rates(&self, rates: [f64; 3], base: CommandV1) -> CommandV1 {
        let mut sticks = rates;
        for (stick, authority) in sticks.iter_mut().zip(self.authority) {
            *stick /= authority;
        }
        CommandV1 { actuation: Actuation::Sticks.code(), sticks, ..base }
    }
}

fn attitude(attitude: [f64; 4], base: CommandV1) -> CommandV1 {
    CommandV1 { actuation: Actuation::Attitude.code(), attitude, ..base }
}
