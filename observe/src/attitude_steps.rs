//! Figures of a prescribed attitude: the error relative to it, and the settling after its steps.

use nalgebra::Vector3;
use oqtal_control::euler::EulerAngles;
use oqtal_control::metrics::Statistics;
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::TrajectoryKind;
use serde::Serialize;

use crate::corners::settling;
use crate::flight::Flight;
use crate::flight_sample::FlightSample;

/// Attitude error below which a step is settled \[deg\].
const SETTLED_DEG: f64 = 1.5;
/// Change of the prescribed attitude in one tick that counts as a step \[deg\].
const STEP_DEG: f64 = 5.0;

/// Settling after the steps of a prescribed attitude.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AttitudeSteps {
    /// Number of steps in the scored window \[-\].
    pub count: u64,
    /// Number of steps after which the attitude error stays below 1.5 deg until the next step \[-\].
    pub settled: u64,
    /// Mean time from a step that settles to the last attitude error above 1.5 deg \[s\]; NaN if none settles.
    pub settle_s: f64,
    /// The same mean over all steps, with the time until the next step for one that does not settle \[s\].
    #[serde(skip)]
    pub least_settle_s: f64,
}

impl AttitudeSteps {
    /// The settling time as text; if not every step settled, how many did.
    pub fn settling(&self) -> String {
        settling("1.5 deg", [self.count, self.settled], self.settle_s)
    }

    /// Figures of the scored window; `None` for a flight that is not an `attitude-doublet`, or of which nothing is scored.
    pub fn of(flight: &Flight) -> Option<Self> {
        let is_doublet = flight.config.trajectory.kind == TrajectoryKind::AttitudeDoublet;
        let errors = if is_doublet { prescribed(flight) } else { Vec::new() };
        let (mut settle, mut least) = (Statistics::default(), Statistics::default());
        let change = |a: &Prescribed<'_>, b: &Prescribed<'_>| a.attitude.angle_to(&b.attitude);
        for step in errors.chunk_by(|a, b| change(a, b).to_degrees() < STEP_DEG) {
            let outside = step.iter().rposition(|at| at.error_deg > SETTLED_DEG);
            let since =
                |at: usize| step[at].sample.telemetry.time.since(step[0].sample.telemetry.time);
            let after_s = outside.map_or(0.0, |last| since(last).seconds());
            least.add(after_s);
            if outside.is_none_or(|last| last + 1 < step.len()) {
                settle.add(after_s);
            }
        }
        (least.count() > 0).then(|| Self {
            count: least.count(),
            settled: settle.count(),
            settle_s: if settle.count() > 0 { settle.mean() } else { f64::NAN },
            least_settle_s: least.mean(),
        })
    }
}

/// A scored tick with a prescribed attitude.
#[derive(Clone, Copy, Debug)]
pub struct Prescribed<'a> {
    sample: &'a FlightSample,
    attitude: Attitude,
    /// Angle of the true attitude from the prescribed one \[deg\].
    pub error_deg: f64,
}

/// The scored ticks for which the trajectory prescribes an attitude.
///
/// The trajectory prescribes it, also for a law that filters its command. A flight rotates its trajectory by the measured initial
/// heading of the vehicle.
pub fn prescribed<'a>(flight: &'a Flight) -> Vec<Prescribed<'a>> {
    let options = &flight.config.trajectory;
    let Some(trajectory) = options.trajectory(None) else { return Vec::new() };
    let start_s = options.take_off_s + options.settle_s;
    let begun = flight.scored().next();
    let commanded = begun.map_or(Attitude::LEVEL, FlightSample::attitude_command);
    let yaw_rad = EulerAngles::from_attitude(&commanded).yaw;
    let heading = Attitude::from_rotation_vector(Vector3::z() * yaw_rad);
    let at = |sample: &'a FlightSample| {
        let FlightSample { telemetry, .. } = sample;
        let prescribed = trajectory.sample(telemetry.mission_s - start_s).attitude?;
        let turned = heading.unit_quaternion() * prescribed.attitude.unit_quaternion();
        let attitude = Attitude::from_unit_quaternion(turned);
        let error_deg = sample.attitude().angle_to(&attitude).to_degrees();
        Some(Prescribed { sample, attitude, error_deg })
    };
    flight.scored().filter_map(at).collect()
}
