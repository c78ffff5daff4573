//! Figures at the corners of a path: the instants at which the reference position steps.

use nalgebra::Vector3;
use oqtal_control::metrics::Statistics;
use serde::Serialize;

use crate::flight::Flight;
use crate::flight_sample::FlightSample;

/// Position error below which a corner is settled \[m\].
const SETTLED_M: f64 = 0.05;
/// Change of the reference in one tick that counts as a step \[m\].
const STEP_M: f64 = 0.1;

/// Figures at the corners of a path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CornerFigures {
    /// Number of steps of the reference in the scored window \[-\].
    pub count: u64,
    /// Mean length of a step \[m\].
    pub step_m: f64,
    /// Number of steps after which the position error stays below 5 cm until the next step \[-\].
    pub settled: u64,
    /// Mean time from a step that settles to the last position error above 5 cm \[s\]; NaN if none settles.
    pub settle_s: f64,
    /// The same mean over all steps, with the time until the next step for one that does not settle \[s\].
    #[serde(skip)]
    pub least_settle_s: f64,
    /// Mean overshoot in the direction of the step \[m\].
    pub overshoot_m: f64,
    /// Mean position error, once settled, until the next step \[m\]; NaN if no corner settled.
    pub settled_error_m: f64,
    /// Share of the scored position error, integrated over time, between each step and its settling \[0..1\].
    pub approach_share: f64,
}

impl CornerFigures {
    /// The settling time as text; if not every corner settled, how many did.
    pub fn settling(&self) -> String {
        settling("5 cm", [self.count, self.settled], self.settle_s)
    }

    /// Figures of the scored window; `None` for a path without corners.
    pub fn of(flight: &Flight) -> Option<Self> {
        let samples: Vec<&FlightSample> = flight.scored().collect();
        let before = flight.armed().take_while(|sample| sample.telemetry.scored == 0).last();
        let mut from = before.map_or_else(Vector3::zeros, reference);
        let [mut step, mut settle, mut least, mut overshoot, mut rest] = [Statistics::default(); 5];
        let (mut approach, mut whole) = (0.0, 0.0);
        for corner in samples.chunk_by(|a, b| (reference(a) - reference(b)).norm() < STEP_M) {
            let error = |sample: &&FlightSample| sample.position_error().norm();
            whole += corner.iter().map(error).sum::<f64>();
            let to = reference(corner[0]);
            let length = (to - from).norm();
            let direction = (to - from).try_normalize(STEP_M);
            from = to;
            let Some(direction) = direction else { continue };
            let beyond = corner.iter().map(|sample| sample.position_error().dot(&direction));
            overshoot.add(beyond.fold(0.0, f64::max));
            let last = corner.iter().rposition(|sample| error(sample) > SETTLED_M);
            let (under_way, settled) = corner.split_at(last.map_or(0, |last| last + 1));
            let time = |sample: &FlightSample| sample.telemetry.time;
            let after_s = last.map_or(0.0, |k| time(corner[k]).since(time(corner[0])).seconds());
            least.add(after_s);
            if !settled.is_empty() {
                settle.add(after_s);
            }
            approach += under_way.iter().map(error).sum::<f64>();
            settled.iter().for_each(|sample| rest.add(error(sample)));
            step.add(length);
        }
        (step.count() > 0).then(|| Self {
            count: step.count(),
            step_m: step.mean(),
            settled: settle.count(),
            settle_s: if settle.count() > 0 { settle.mean() } else { f64::NAN },
            least_settle_s: least.mean(),
            overshoot_m: overshoot.mean(),
            settled_error_m: if rest.count() > 0 { rest.mean() } else { f64::NAN },
            approach_share: approach / whole,
        })
    }
}

/// The settling time of steps as text; if not every step settled to within `limit`, how many did.
pub(crate) fn settling(limit: &str, [count, settled]: [u64; 2], settle_s: f64) -> String {
    match settled {
        0 => format!("none within {limit} before the next"),
        all if all == count => format!("within {limit} after {settle_s:.2} s"),
        some => format!("{some} within {limit}, after {settle_s:.2} s"),
    }
}

fn reference(sample: &FlightSample) -> Vector3<f64> {
    Vector3::from(sample.telemetry.reference_position)
}
