//! Figures of a prescribed attitude: the error relative to it, and the settling after its steps.

use nalgebra::Vector3;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::{TrajectoryKind, TrajectoryOptions};

use crate::flight::Flight;
use crate::flight_sample::FlightSample;
use crate::settling::{CUT_OFF_S, StepEnd, StepSettling, settled};

/// Attitude error below which a step is settled \[deg\].
const SETTLED_DEG: f64 = 1.5;

/// Settling after the steps of an `attitude-doublet` to within 1.5 deg of the prescribed attitude; `None` for other flights, and if
/// nothing is scored.
pub fn attitude_steps(flight: &Flight) -> Option<StepSettling> {
    let options = &flight.config.trajectory;
    let is_doublet = options.kind == TrajectoryKind::AttitudeDoublet;
    let errors = if is_doublet { prescribed(flight) } else { Vec::new() };
    // A doublet without an angle has no steps.
    let step_deg = (0.5 * options.attitude_doublet.angle_deg.abs()).max(0.1);
    let change = |a: &Prescribed<'_>, b: &Prescribed<'_>| a.attitude.angle_to(&b.attitude);
    let mut steps = errors.chunk_by(|a, b| change(a, b).to_degrees() < step_deg).peekable();
    let ends_early = errors.last().is_some_and(|last| is_prescribed_after(last.sample, options));
    StepSettling::of(std::iter::from_fn(|| {
        let step = steps.next()?;
        let error = |at: &Prescribed<'_>| (at.sample.telemetry.time, at.error_deg);
        let errors: Vec<_> = step.iter().map(error).collect();
        let (first, after_s) = settled(&errors, SETTLED_DEG);
        let has_settled = first < step.len();
        Some((after_s, StepEnd::of(has_settled, ends_early && steps.peek().is_none())))
    }))
}

/// Whether an attitude is still prescribed some ticks after `sample`.
fn is_prescribed_after(sample: &FlightSample, options: &TrajectoryOptions) -> bool {
    let after_s = sample.telemetry.mission_s + CUT_OFF_S - options.start_s();
    let trajectory = options.trajectory(None);
    trajectory.is_some_and(|trajectory| trajectory.sample(after_s).attitude.is_some())
}

/// The settling time as text; if not every step settled, how many did.
pub fn settling_text(steps: &StepSettling) -> String {
    steps.text("1.5 deg")
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
    let start_s = options.start_s();
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
