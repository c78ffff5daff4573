//! Consistency of the poses with the vehicle: poses that do not follow the vehicle's rotation, or whose path does not follow its tilt
//! and thrust, are not poses of the vehicle, however plausible each of them is.
//!
//! The gate compares a pose with the motion predicted from the poses before it, and follows whatever changes slowly. Here the
//! rotation seen by the cameras is compared with that of the vehicle's own gyroscope where it is reported, else with that of the commands
//! sent, neither of which contains a pose:
//!
//! | test | compares | finds |
//! |---|---|---|
//! | [`response`] | rotations faster than a second, about each axis | frozen, mirrored or exchanged axes, with any noise |
//! | [`drift`] | angles over some seconds | a slow rotation of the cameras' body |
//! | [`direction`] | acceleration seen, and acceleration by tilt and thrust | a path turned against the attitude |
//! | [`standstill`] | motion seen, and acceleration by the thrust | frozen poses where the vehicle does not rotate |
//! | [`heading`] | rotation by a small oscillation of the heading reference | as response, in a hover too |
//!
//! Response and direction are cumulative sums that do not fall below zero (Page, *Continuous inspection schemes*, Biometrika 41,
//! 1954) of the difference between two squared residuals: of the hypothesis that the poses follow the vehicle, and of the hypothesis
//! that they do not (Basseville and Nikiforov, *Detection of Abrupt Changes*, 1993, section 2.2). Each sample is bounded, so that it needs
//! many of them (Huber, *Robust Statistics*, 1981), and normalised by the measured noise. Without rotation there is no evidence for
//! either.
//!
//! Only response, heading and standstill end a flight; the other evidence warns, since wind and a wrong model of the vehicle add to
//! it. For the same reason the response of a vehicle without rates has a higher limit.

mod commanded;
mod direction;
mod drift;
mod heading;
mod motion_observer;
mod pending;
mod response;
mod standstill;
mod vehicle_rates;
mod washout;

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_control::predictive::{MeasuredPose, MotionTracker};

use crate::delayed_mean::DelayedMean;
use crate::floor::{AIRBORNE_M, LANDED_M};
use crate::guard::seconds;
use crate::measured_noise::PoseDeviations;
use commanded::CommandedRotation;
use direction::DirectionTest;
use drift::{DriftLimit, DriftTest};
use heading::HeadingProbe;
use pending::{PendingRotations, SeenRotation};
use response::{ResponseLimit, ResponseTest};
use standstill::StandstillTest;
use vehicle_rates::VehicleRates;
use washout::WashOut;

/// Longest interval between two poses over which rotations are compared \[s\]; after a longer one the tests begin again.
const LONGEST_S: f64 = 0.3;
/// Longest such interval over which a standstill continues \[s\].
const LONGEST_STEP_S: f64 = 0.07;
/// Least deviation of rotations that agree \[rad\]: gyroscope and model are not exact.
const LEAST_DEVIATION_RAD: f64 = 0.002;
/// Least deviation of such rotations over the measured noise \[-\].
const NOISE_SHARE: f64 = 1.2;
/// Time constant of the deviation between rotations that agree \[s\].
const DEVIATION_S: f64 = 2.0;
/// Default of `safety.consistency-limit`, with which the limits of the standstill apply unscaled \[-\].
const DEFAULT_LIMIT: f64 = 12.0;
/// Limit of the response to commands over that to a gyroscope \[-\].
const COMMANDS_LIMIT: f64 = 2.5;
/// Time without a rotation that shows whether poses follow the gyroscope, after which the heading oscillates \[s\].
const UNCONFIRMED_S: f64 = 0.22;
/// Time for which a rotation that was not seen counts \[s\].
const UNSEEN_S: f64 = 1.0;
/// Time in the air after which rotations by commands are compared, and the deviation from those of a gyroscope is known \[s\].
const SETTLED_S: f64 = 2.5;
/// Factor of the limit before that time \[-\]: the noise of the poses is not measured yet, and may exceed the configured one.
const EARLY_LIMIT: f64 = 2.0;
/// Deviation between rotations that agree, over the told noise, until it is measured \[-\].
const TOLD_SHARE: f64 = 1.5;
/// Evidence, as a share of its limit, above which no noise is learned \[-\].
const QUIET: f64 = 0.5;

/// Evidence against the poses over its limit \[-\]: from 1 on it is reported.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseEvidence {
    /// Evidence that the rotation seen does not follow that of the vehicle, of all rotations or of the heading's oscillation \[-\].
    pub response: f64,
    /// Evidence that the path does not follow the tilt \[-\].
    pub direction: f64,
    /// Evidence that the path does not follow the thrust: it stands still \[-\].
    pub standstill: f64,
    /// Evidence that the attitude drifts away from the gyroscope \[-\].
    pub drift: f64,
}

impl PoseEvidence {
    /// The evidence that ends a flight from 1 on \[-\].
    pub fn ending(&self) -> f64 {
        self.response.max(self.standstill)
    }

    /// The greatest evidence of a test \[-\].
    pub fn greatest(&self) -> f64 {
        self.ending().max(self.direction).max(self.drift)
    }
}

/// Motion that is expected of the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Expectation {
    /// Whether it can follow its commands: it does not land, and its link is good.
    pub obeys: bool,
    /// Whether it is more than 10 cm from its reference, or takes off.
    pub is_away: bool,
    /// Whether the heading of the reference changes, from which its oscillation cannot be separated, or an attitude is prescribed, so that
    /// it does not oscillate.
    pub turns: bool,
}

/// The tests of the consistency of poses and vehicle.
#[derive(Clone, Debug)]
pub struct PoseConsistency {
    limit: f64,
    rates: VehicleRates,
    commanded: CommandedRotation,
    /// The last pose in the air, with its instant \[s\].
    last: Option<(f64, MeasuredPose)>,
    /// Whether rotations are compared with the gyroscope.
    by_gyroscope: bool,
    /// Rotations seen after the last report of the gyroscope.
    pending: PendingRotations,
    /// Time in the air with rotations of the same source \[s\].
    airborne_s: f64,
    /// Whether the vehicle has been in the air in this flight.
    has_flown: bool,
    seen: WashOut,
    driven: WashOut,
    /// Mean square of the difference of both \[rad^2\].
    deviation: DelayedMean,
    /// Rotation of the vehicle in the last second that was not seen \[rad, body axes\].
    unseen: Vector3<f64>,
    response: ResponseTest,
    drift: DriftTest,
    direction: DirectionTest,
    standstill: StandstillTest,
    heading: HeadingProbe,
    evidence: PoseEvidence,
    contradicts: bool,
    stays_on_floor: bool,
}

impl PoseConsistency {
    /// The tests of `config`, on the ground.
    pub fn new(config: &Config) -> Self {
        let told = config.control.predictive.filter.attitude_noise_deg.to_radians();
        let deviation = TOLD_SHARE * told + LEAST_DEVIATION_RAD;
        Self {
            limit: config.safety.consistency_limit,
            rates: VehicleRates::default(),
            commanded: CommandedRotation::default(),
            last: None,
            by_gyroscope: false,
            pending: PendingRotations::default(),
            airborne_s: 0.0,
            has_flown: false,
            seen: WashOut::default(),
            driven: WashOut::default(),
            deviation: DelayedMean::new(deviation * deviation, DEVIATION_S),
            unseen: Vector3::zeros(),
            response: ResponseTest::default(),
            drift: DriftTest::default(),
            direction: DirectionTest::default(),
            standstill: StandstillTest::default(),
            heading: HeadingProbe::new(config.safety.probe_yaw_deg.to_radians()),
            evidence: PoseEvidence::default(),
            contradicts: false,
            stays_on_floor: false,
        }
    }

    /// Restarts at the beginning or end of a flight.
    pub fn restart(&mut self) {
        self.clear();
        self.rates.restart();
        (self.contradicts, self.stays_on_floor, self.has_flown) = (false, false, false);
        (self.standstill, self.unseen) = (StandstillTest::default(), Vector3::zeros());
    }

    /// Takes a rate that the vehicle's gyroscope measured at `t_s` \[s\] \[rad/s, body\].
    pub fn receive_rate(&mut self, t_s: f64, rate: Vector3<f64>) {
        self.rates.receive(t_s, rate);
    }

    /// Offset of the heading reference at `now`, which shows whether poses follow the vehicle \[rad\].
    pub fn heading_offset_rad(&self, now: Time) -> f64 {
        self.heading.offset_rad(seconds(now))
    }

    /// Whether the poses of this flight do not follow the vehicle.
    pub fn contradicts(&self) -> bool {
        self.contradicts
    }

    /// Whether the vehicle is near the floor, although the thrust must have lifted it.
    pub fn stays_on_floor(&self) -> bool {
        self.stays_on_floor
    }

    /// Whether a test finds that the poses do not agree with the vehicle. Drift and direction find it in one of a hundred flights with
    /// right poses, too: they warn.
    pub fn disagrees(&self) -> bool {
        self.evidence.greatest() >= 1.0
    }

    /// Whether a test has evidence that the poses do not agree with the vehicle.
    pub fn is_disputed(&self) -> bool {
        self.contradicts || self.evidence.greatest() >= QUIET
    }

    /// The present evidence.
    pub fn evidence(&self) -> &PoseEvidence {
        &self.evidence
    }

    /// Whether no test of the rotation raises evidence, so that noise may be learned.
    pub fn is_quiet(&self) -> bool {
        self.evidence.response.max(self.evidence.drift) < QUIET
    }

    /// Takes an admitted pose measured at `t_s` \[s\], in flight with the motion of `tracker` corrected by it; `noise` is the measured
    /// noise.
    pub fn take(
        &mut self,
        tracker: &MotionTracker,
        (t_s, pose): (f64, &MeasuredPose),
        noise: &PoseDeviations,
        expected: &Expectation,
    ) {
        let is_airborne =
            tracker.track().is_some() && pose.position.z > tracker.floor_m() + AIRBORNE_M;
        self.has_flown |= is_airborne;
        if !is_airborne {
            self.airborne_s = 0.0;
            self.clear();
        }
        let Some((last_s, last)) = self.last.replace((t_s, *pose)) else { return };
        let dt_s = t_s - last_s;
        if dt_s > LONGEST_S {
            self.clear();
            self.begin_again();
            self.standstill.interrupt();
            return;
        }
        let turn = last.attitude.rotation_to(&pose.attitude);
        let seen = SeenRotation { from_s: last_s, to_s: t_s, turn, is_airborne };
        self.rates.update(t_s);
        let by_gyroscope = self.rates.are_trusted(t_s);
        if by_gyroscope != self.by_gyroscope {
            self.by_gyroscope = by_gyroscope;
            self.begin_again();
        }
        if by_gyroscope {
            self.pending.push(seen);
            self.compare_with_gyroscope(noise, is_airborne, expected.turns);
        } else if !expected.obeys {
            self.clear();
            self.begin_again();
        } else if is_airborne {
            let driven = self.commanded.turn(tracker, &last.attitude, (last_s, t_s));
            self.test_rotation(&seen, &driven, noise, expected.turns);
        }
        self.test_motion(tracker, (pose, noise), (dt_s, is_airborne), expected);
        self.contradicts |= self.evidence.ending() >= 1.0;
    }

    /// Compares the rotations that the reports of the gyroscope now cover.
    fn compare_with_gyroscope(&mut self, noise: &PoseDeviations, is_airborne: bool, turns: bool) {
        while let Some(mut seen) = self.pending.take_if(|to_s| self.rates.reach(to_s)) {
            let Some(driven) = self.rates.turn(seen.from_s, seen.to_s) else {
                self.rates.record_gap(seen.to_s);
                self.begin_again();
                return;
            };
            seen.is_airborne &= is_airborne;
            self.test_rotation(&seen, &driven, noise, turns);
        }
    }

    fn test_rotation(
        &mut self,
        &SeenRotation { from_s, to_s: t_s, turn: ref seen, is_airborne }: &SeenRotation,
        driven: &Vector3<f64>,
        noise: &PoseDeviations,
        turns: bool,
    ) {
        let dt_s = t_s - from_s;
        self.airborne_s += dt_s;
        if self.by_gyroscope {
            self.unseen += driven - seen - self.unseen * (dt_s / UNSEEN_S).min(1.0);
        }
        let (limit, response_limit) = match self.by_gyroscope {
            true => (DriftLimit::GYROSCOPE, ResponseLimit::GYROSCOPE),
            false => (DriftLimit::COMMANDS, ResponseLimit::COMMANDS),
        };
        let drift = self.drift.take((seen, driven), &limit, noise.attitude_rad, dt_s);
        let (seen, driven) = (self.seen.take(seen, dt_s), self.driven.take(driven, dt_s));
        self.deviation.take(t_s, (seen - driven).norm_squared() / 3.0);
        // The bias of the rate that the commands counteract is washed out first.
        if !is_airborne || !self.by_gyroscope && self.airborne_s < SETTLED_S {
            self.drift.restart();
            return;
        }
        self.evidence.drift = drift;
        let least = LEAST_DEVIATION_RAD.max(NOISE_SHARE * noise.attitude_rad);
        let variance = self.deviation.mean().max(least * least);
        let sum = self.response.take((&seen, &driven), &response_limit, variance, dt_s);
        let factor = match self.by_gyroscope {
            true if self.airborne_s < SETTLED_S => EARLY_LIMIT,
            true => 1.0,
            false => COMMANDS_LIMIT,
        };
        let needed = !self.by_gyroscope || self.response.unconfirmed_s() > UNCONFIRMED_S;
        let angles = (seen.z, driven.z);
        if turns {
            self.heading.end();
        }
        let heading = self.heading.take(needed && !turns, angles, noise.attitude_rad, (t_s, dt_s));
        self.evidence.response = heading.max(sum / (factor * self.limit));
        if self.evidence.response > QUIET {
            self.deviation.discard();
        }
    }

    /// Whether the vehicle may stand on the floor at `floor_m` \[m, world z\]: one that has flown may hover just above it.
    fn is_on_floor(&self, pose: &MeasuredPose, floor_m: f64) -> bool {
        pose.position.z <= floor_m + if self.has_flown { LANDED_M } else { AIRBORNE_M }
    }

    fn test_motion(
        &mut self,
        tracker: &MotionTracker,
        (pose, noise): (&MeasuredPose, &PoseDeviations),
        (dt_s, is_airborne): (f64, bool),
        expected: &Expectation,
    ) {
        (self.stays_on_floor, self.evidence.standstill) = (false, 0.0);
        let Some(track) = tracker.track() else { return };
        let attitude = &track.motion.attitude;
        let per_thrust = track.motion.thrust_n / tracker.model().mass_kg;
        let acceleration = attitude.to_world(&Vector3::z()) * per_thrust;
        let (position, deviation_m) = (&pose.position, noise.position_m);
        if !expected.obeys {
            // It may stand on something.
            self.standstill = StandstillTest::default();
        } else if dt_s > LONGEST_STEP_S {
            self.standstill.interrupt();
        } else if self.is_on_floor(pose, tracker.floor_m()) {
            let lift_m_s2 = acceleration.z - tracker.model().gravity_m_s2;
            let rise = self.standstill.take_near_floor(position, lift_m_s2, deviation_m, dt_s);
            self.stays_on_floor = rise * DEFAULT_LIMIT >= self.limit;
        } else {
            let turned = attitude.turned_by(self.unseen);
            let acceleration = turned.to_world(&Vector3::z()) * per_thrust;
            let moved = self.standstill.take(position, &acceleration, deviation_m, dt_s);
            if expected.is_away {
                self.evidence.standstill = moved * DEFAULT_LIMIT / self.limit;
            } else {
                self.standstill.discard_motion(position);
            }
        }
        if !is_airborne {
            return;
        }
        // A slow circle is tilted as much against drag as towards its centre.
        let drag = track.motion.velocity * tracker.model().drag_per_s;
        let sum = self.direction.take(position, &(acceleration - drag).xy(), deviation_m, dt_s);
        self.evidence.direction = sum / self.limit;
    }

    /// Discards the evidence.
    fn clear(&mut self) {
        (self.response, self.direction) = (ResponseTest::default(), DirectionTest::default());
        self.drift.restart();
        self.heading.end();
        self.evidence = PoseEvidence::default();
        self.deviation.discard();
    }

    /// Discards the rotations: they have a gap, are of another source, or the vehicle cannot follow its commands.
    fn begin_again(&mut self) {
        (self.airborne_s, self.unseen) = (0.0, Vector3::zeros());
        self.commanded = CommandedRotation::default();
        self.pending = PendingRotations::default();
        (self.seen, self.driven) = (WashOut::default(), WashOut::default());
        self.drift = DriftTest::default();
        self.heading.end();
    }
}

#[cfg(test)]
mod tests;
