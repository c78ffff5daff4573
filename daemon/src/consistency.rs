//! Consistency of the poses with the vehicle: poses that do not follow the vehicle's rotation, or whose path does not follow its tilt and
//! thrust, are wrong, however plausible each single pose is.
//!
//! The gate compares a pose with the motion predicted from earlier poses, and therefore follows slow errors. Here the rotation seen by the
//! cameras is compared with that of the vehicle's own gyroscope where it is reported, else with that of the commands sent, neither of which
//! contains a pose:
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
//! Only response, heading and standstill end a flight; the other evidence causes a warning, since wind and a wrong model of the vehicle add
//! to it. For the same reason the response of a vehicle without rates has a higher limit.

mod commanded;
mod direction;
mod drift;
mod heading;
mod motion_observer;
mod pending;
mod response;
mod rotation;
mod rotation_pair;
mod standstill;
mod vehicle_rates;
mod washout;

use nalgebra::Vector3;
use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_control::predictive::{MeasuredPose, MotionTracker};

use crate::floor::{AIRBORNE_M, LANDED_M};
use crate::measured_noise::PoseDeviations;
use commanded::CommandedRotation;
use direction::DirectionTest;
use heading::HeadingProbe;
use pending::{PendingRotations, SeenRotation};
use rotation::{Accuracy, DrivenRotation, LEAST_DEVIATION_RAD, QUIET, RotationTest, Source};
use rotation_pair::RotationPair;
use standstill::StandstillTest;
use vehicle_rates::VehicleRates;

/// Longest interval between two poses over which rotations are compared \[s\]; after a longer one the tests begin again.
const LONGEST_S: f64 = 0.3;
/// Longest such interval over which a standstill continues \[s\].
const LONGEST_STEP_S: f64 = 0.07;
/// Default of `safety.consistency-limit`, with which the limits of the standstill apply unscaled \[-\].
const DEFAULT_LIMIT: f64 = 12.0;
/// Time without a rotation that shows whether poses follow the gyroscope, after which the heading oscillates \[s\].
const UNCONFIRMED_S: f64 = 0.22;
/// Time for which a rotation that was not seen counts \[s\].
const UNSEEN_S: f64 = 1.0;
/// Deviation between rotations that agree, as a multiple of the configured noise, until it is measured \[-\].
const TOLD_SHARE: f64 = 1.5;

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
    /// Whether the heading cannot oscillate: the heading of the reference changes, which could not be separated from the oscillation, or an
    /// attitude is prescribed.
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
    /// Source of the rotations whose evidence counts.
    source: Source,
    /// Rotations seen after the last report of the gyroscope.
    pending: PendingRotations,
    /// Whether the vehicle has been in the air in this flight.
    has_flown: bool,
    gyroscope: RotationTest,
    commands: RotationTest,
    /// Rotation of the vehicle in the last second that was not seen \[rad, body axes\].
    unseen: Vector3<f64>,
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
        let (deviation, limit) =
            (TOLD_SHARE * told + LEAST_DEVIATION_RAD, config.safety.consistency_limit);
        Self {
            limit,
            rates: VehicleRates::default(),
            commanded: CommandedRotation::default(),
            last: None,
            source: Source::Commands,
            pending: PendingRotations::default(),
            has_flown: false,
            gyroscope: RotationTest::new(Accuracy::GYROSCOPE, limit, deviation),
            commands: RotationTest::new(Accuracy::COMMANDS, limit, deviation),
            unseen: Vector3::zeros(),
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
        self.pending = PendingRotations::default();
        (self.contradicts, self.stays_on_floor, self.has_flown) = (false, false, false);
        (self.standstill, self.unseen) = (StandstillTest::default(), Vector3::zeros());
    }

    /// Takes a rate that the vehicle's gyroscope measured at `t_s` \[s\] \[rad/s, body\].
    pub fn receive_rate(&mut self, t_s: f64, rate: Vector3<f64>) {
        self.rates.receive(t_s, rate);
    }

    /// Offset of the heading reference at `now`, which shows whether poses follow the vehicle \[rad\].
    pub fn heading_offset_rad(&self, now: Time) -> f64 {
        self.heading.offset_rad(now.seconds())
    }

    /// Whether the poses of this flight do not follow the vehicle.
    pub fn contradicts(&self) -> bool {
        self.contradicts
    }

    /// Whether the vehicle is near the floor, although the thrust must have lifted it.
    pub fn stays_on_floor(&self) -> bool {
        self.stays_on_floor
    }

    /// Whether a test finds that the poses disagree with the vehicle. Drift and direction also find this in one of a hundred flights with
    /// correct poses; therefore they only warn.
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
        let source = if self.rates.are_trusted(t_s) { Source::Gyroscope } else { Source::Commands };
        if source != self.source {
            (self.source, self.unseen) = (source, Vector3::zeros());
            self.heading.end();
        }
        self.pending.push(seen);
        self.compare_with_gyroscope(noise, is_airborne, expected.turns);
        if !expected.obeys {
            self.commands.clear();
            self.commands.begin_again();
            self.commanded = CommandedRotation::default();
            if source == Source::Commands {
                self.heading.end();
                self.evidence = PoseEvidence::default();
            }
        } else if is_airborne {
            let turn = self.commanded.turn(tracker, &last.attitude, (last_s, t_s));
            let driven = DrivenRotation { source: Source::Commands, turn };
            self.test_rotation(&seen, &driven, noise, expected.turns);
        }
        self.test_motion(tracker, (pose, noise), (dt_s, is_airborne), expected);
        self.contradicts |= self.evidence.ending() >= 1.0;
    }

    /// Compares the rotations that the reports of the gyroscope now cover, and leaves out those in a gap of the reports.
    fn compare_with_gyroscope(&mut self, noise: &PoseDeviations, is_airborne: bool, turns: bool) {
        while let Some(mut seen) = self.pending.take_if(|to_s| self.rates.reach(to_s)) {
            let Some(turn) = self.rates.covered_turn(seen.from_s, seen.to_s) else { continue };
            seen.is_airborne &= is_airborne;
            let driven = DrivenRotation { source: Source::Gyroscope, turn };
            self.test_rotation(&seen, &driven, noise, turns);
            if self.source == Source::Gyroscope {
                // Evidence from commands covers the time since the last report only.
                self.commands.discard_evidence();
            }
        }
    }

    /// Compares a rotation seen with that of the vehicle; the evidence is that of the source in use.
    fn test_rotation(
        &mut self,
        &SeenRotation { from_s, to_s: t_s, turn: seen, is_airborne }: &SeenRotation,
        &DrivenRotation { source, turn: driven }: &DrivenRotation,
        noise: &PoseDeviations,
        turns: bool,
    ) {
        let pair = RotationPair { seen, driven, t_s, dt_s: t_s - from_s };
        let test = match source {
            Source::Gyroscope => &mut self.gyroscope,
            Source::Commands => &mut self.commands,
        };
        let washed_out = test.take(&pair, noise.attitude_rad, is_airborne);
        if source != self.source {
            return;
        }
        if source == Source::Gyroscope {
            self.unseen += driven - seen - self.unseen * (pair.dt_s / UNSEEN_S).min(1.0);
        }
        let Some(washed_out) = washed_out else { return };
        let needed = source == Source::Commands || test.unconfirmed_s() > UNCONFIRMED_S;
        if turns {
            self.heading.end();
        }
        let heading = self.heading.take(needed && !turns, &washed_out, noise.attitude_rad);
        self.evidence.drift = test.drift_evidence;
        self.evidence.response = heading.max(test.response_evidence);
        if heading > QUIET {
            test.discard_deviations();
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
        self.gyroscope.clear();
        self.commands.clear();
        self.direction = DirectionTest::default();
        self.heading.end();
        self.evidence = PoseEvidence::default();
    }

    /// Discards the rotations: the poses have a gap.
    fn begin_again(&mut self) {
        self.gyroscope.begin_again();
        self.commands.begin_again();
        self.unseen = Vector3::zeros();
        self.commanded = CommandedRotation::default();
        self.pending = PendingRotations::default();
        self.heading.end();
    }
}

#[cfg(test)]
mod tests;
