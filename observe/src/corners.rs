//! Figures at the corners of a path: the instants at which the reference position steps.

use nalgebra::Vector3;
use oqtal_control::metrics::Statistics;
use oqtal_control::trajectory::TrajectoryOptions;
use serde::Serialize;

use crate::flight::Flight;
use crate::flight_sample::FlightSample;
use crate::settling::{CUT_OFF_S, StepEnd, StepSettling, mean, settled};

/// Position error below which a corner is settled \[m\].
const SETTLED_M: f64 = 0.05;
/// Change of the reference in one tick that counts as a step \[m\].
const STEP_M: f64 = 0.1;
/// Distance from the corner up to which the reference rests there \[m\].
const REST_M: f64 = 0.01;
/// Time for which the reference rests after a step to be a corner, if it moves on without another step \[s\].
const LEAST_REST_S: f64 = 0.5;

/// Figures at the corners of a path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CornerFigures {
    /// Settling of the position error to within 5 cm.
    #[serde(flatten)]
    pub settling: StepSettling,
    /// Mean length of a step that is evaluated \[m\]; NaN if none is.
    pub step_m: f64,
    /// Mean overshoot in the direction of such a step \[m\]; NaN if none is evaluated.
    pub overshoot_m: f64,
    /// Mean position error, once settled, until the next step \[m\]; NaN if no corner settled.
    pub settled_error_m: f64,
    /// Share of the scored position error, integrated over time, that is the distance to a corner not yet covered \[0..1\]: along the step,
    /// until the vehicle is first within 5 cm.
    pub approach_share: f64,
}

impl CornerFigures {
    /// The settling time as text; if not every corner settled, how many did.
    pub fn settling_text(&self) -> String {
        self.settling.text("5 cm")
    }

    /// Figures of the scored windows of all flights; `None` for paths without corners.
    pub fn of(flight: &Flight) -> Option<Self> {
        let mut sums = CornerSums::default();
        let options = &flight.config.trajectory;
        // The first reference of a record that begins in flight is not a step.
        let begins_at_rest =
            std::iter::once(!flight.begins_in_flight()).chain(std::iter::repeat(true));
        for (ticks, begins_at_rest) in flight.flights().zip(begins_at_rest) {
            sums.add(ticks, begins_at_rest, ends_early(ticks, options));
        }
        let CornerSums { steps, step, overshoot, rest, approach, whole } = sums;
        Some(Self {
            settling: StepSettling::of(steps)?,
            step_m: mean(&step),
            overshoot_m: mean(&overshoot),
            settled_error_m: mean(&rest),
            approach_share: approach / whole,
        })
    }
}

/// Sums over the corners of several flights.
#[derive(Debug, Default)]
struct CornerSums {
    /// Time until a step has settled \[s\], and its end.
    steps: Vec<(f64, StepEnd)>,
    step: Statistics,
    overshoot: Statistics,
    rest: Statistics,
    approach: f64,
    whole: f64,
}

impl CornerSums {
    /// Adds the corners of one flight. `ends_early`: its scored window ends before the trajectory. Without `begins_at_rest`, the first scored
    /// reference is not a step.
    fn add(&mut self, ticks: &[FlightSample], begins_at_rest: bool, ends_early: bool) {
        let samples: Vec<&FlightSample> = ticks.iter().filter(|tick| tick.is_scored()).collect();
        let before = ticks.iter().take_while(|sample| sample.telemetry.scored == 0).last();
        let first = samples.first().filter(|_| !begins_at_rest).copied();
        let mut from = before.or(first).map_or_else(Vector3::zeros, reference);
        // A reference that moved between ticks that were not recorded has not stepped.
        let follows = |a: &&FlightSample, b: &&FlightSample| {
            b.telemetry.tick > a.telemetry.tick + 1 || (reference(a) - reference(b)).norm() < STEP_M
        };
        let mut corners = samples.chunk_by(follows).peekable();
        while let Some(corner) = corners.next() {
            let error = |sample: &&FlightSample| sample.position_error().norm();
            self.whole += corner.iter().map(error).sum::<f64>();
            let to = reference(corner[0]);
            let length = (to - from).norm();
            let direction = (to - from).try_normalize(STEP_M);
            from = reference(corner[corner.len() - 1]);
            let Some(direction) = direction else { continue };
            let rests = |sample: &&&FlightSample| (reference(sample) - to).norm() < REST_M;
            let stay = &corner[..corner.iter().take_while(rests).count()];
            let errors: Vec<_> = stay.iter().map(|it| (it.telemetry.time, error(it))).collect();
            let (first, after_s) = settled(&errors, SETTLED_M);
            let rest = &stay[first..];
            let moves_on = stay.len() < corner.len();
            let ends = errors.first().zip(errors.last());
            let rest_s = ends.map_or(0.0, |(first, last)| last.0.since(first.0).seconds());
            // A reference that moves on at once begins a path with a jump.
            if moves_on && rest_s < LEAST_REST_S {
                continue;
            }
            let is_cut = ends_early && corners.peek().is_none() && !moves_on;
            let end = StepEnd::of(!rest.is_empty(), is_cut);
            self.steps.push((after_s, end));
            self.approach += approach(stay, &direction);
            rest.iter().for_each(|sample| self.rest.add(error(sample)));
            if end != StepEnd::CutOff {
                let beyond = stay.iter().map(|sample| sample.position_error().dot(&direction));
                self.overshoot.add(beyond.fold(0.0, f64::max));
                self.step.add(length);
            }
        }
    }
}

/// The distances to `corner` along the `direction` of its step that the vehicle has not yet covered, summed over the ticks until it is
/// first within 5 cm \[m\]. An error across the step, or away from the corner, is not part of the way.
fn approach(corner: &[&FlightSample], direction: &Vector3<f64>) -> f64 {
    let distances = corner.iter().map(|sample| -sample.position_error().dot(direction));
    let remaining = distances.scan(f64::INFINITY, |least, distance| {
        *least = least.min(distance);
        Some(*least)
    });
    remaining.take_while(|remaining| *remaining > SETTLED_M).sum()
}

/// Whether the scored window of a flight with these ticks ends before the trajectory does. The end of a path through waypoints is not
/// known here: without a set duration it is that of the planned flight; with one, the path counts as unfinished.
fn ends_early(ticks: &[FlightSample], options: &TrajectoryOptions) -> bool {
    let last = ticks.iter().rev().find(|tick| tick.is_scored()).map(|tick| tick.telemetry);
    let end_s = |planned_s: f64| match options.trajectory(None) {
        Some(trajectory) => options.start_s() + trajectory.duration_s(),
        None if options.duration_s.is_some() => f64::INFINITY,
        None => planned_s,
    };
    last.is_some_and(|last| last.mission_s + CUT_OFF_S < end_s(last.planned_landing_s))
}

fn reference(sample: &FlightSample) -> Vector3<f64> {
    Vector3::from(sample.telemetry.reference_position)
}

#[cfg(test)]
mod tests {
    use oqtal_bus::code::Mode;

    use super::*;
    use crate::flight::Outcome;
    use crate::report::tests::fixture;

    #[test]
    fn a_record_that_begins_in_flight_has_no_corner_and_no_arming_at_its_beginning() {
        let mut flight = Flight { outcome: Outcome::Unfinished, ..fixture::square() };
        let corners = |flight: &Flight| CornerFigures::of(flight).unwrap().settling.count;
        assert_eq!(corners(&flight), 4);
        assert!(flight.shortfall().unwrap().contains("after arming"));
        let is_before = |tick: &FlightSample| tick.telemetry.mission_s < 12.0;
        flight.samples.retain(|tick| !is_before(tick));
        assert_eq!(corners(&flight), 3);
        let reason = flight.shortfall().unwrap();
        assert!(reason.contains("another file") && !reason.contains("arming"), "{reason}");
    }

    #[test]
    fn a_reference_that_moved_in_a_gap_of_the_record_makes_no_corner() {
        let mut flight = fixture::square();
        let is_lost = |tick: &FlightSample| (12.0..16.0).contains(&tick.telemetry.mission_s);
        flight.samples.retain(|tick| !is_lost(tick));
        assert_eq!(CornerFigures::of(&flight).unwrap().settling.count, 3);
    }

    #[test]
    fn a_corner_that_the_end_of_the_flight_cuts_off_is_not_evaluated() {
        let mut flight = Flight { outcome: Outcome::Stopped, ..fixture::square() };
        let whole = CornerFigures::of(&flight).unwrap();
        assert_eq!((whole.settling.count, whole.settling.cut_off), (4, 0));
        let last = flight.samples.iter().rposition(|tick| {
            let reference = reference(tick);
            (reference - Vector3::new(0.0, 1.3, reference.z)).norm() < STEP_M
        });
        // Half a second on the way to the fourth corner, where a set duration may also have ended the flight as planned.
        flight.samples.truncate(last.unwrap() + 30);
        let end_s = flight.samples.last().unwrap().telemetry.mission_s;
        flight.samples.iter_mut().for_each(|tick| tick.telemetry.planned_landing_s = end_s);
        let cut = CornerFigures::of(&flight).unwrap();
        assert_eq!((cut.settling.count, cut.settling.cut_off), (3, 1));
        assert!(cut.settling_text().ends_with("1 cut off by the end of the flight"));
    }

    #[test]
    fn a_path_that_moves_on_after_a_jump_has_no_corner_there() {
        let mut flight = fixture::square();
        let corners = |flight: &Flight| CornerFigures::of(flight).map(|it| it.settling.count);
        assert_eq!(corners(&flight), Some(4));
        for (tick, sample) in flight.samples.iter_mut().enumerate() {
            sample.telemetry.reference_position[2] += 0.001 * tick as f64;
        }
        assert_eq!(corners(&flight), None);
    }

    #[test]
    fn a_height_that_is_not_held_is_not_part_of_the_way_to_a_corner() {
        let mut flight = fixture::square();
        let way = |flight: &Flight| CornerFigures::of(flight).unwrap().approach_share;
        let level = way(&flight);
        assert!(level > 0.9, "{level}");
        flight.samples.iter_mut().for_each(|tick| {
            if let Some(truth) = &mut tick.truth {
                truth.position[2] -= 0.4;
            }
        });
        let low = way(&flight);
        assert!(low < 0.7 * level, "{low} of {level}");
    }

    #[test]
    fn between_two_flights_of_a_recording_there_is_no_corner() {
        let mut flight = fixture::square();
        let one = CornerFigures::of(&flight).unwrap();
        let second = flight.samples.clone();
        let mut landed = second[second.len() - 1];
        landed.telemetry.mode = Mode::Disarmed.code();
        flight.samples.push(landed);
        flight.samples.extend(second);
        let both = CornerFigures::of(&flight).unwrap();
        assert_eq!(both.settling.count, 2 * one.settling.count);
        assert!((both.step_m - one.step_m).abs() < 1e-9, "{} {}", both.step_m, one.step_m);
    }
}
