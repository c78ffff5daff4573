//! The cells of a row of `telemetry.csv`.

use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::message::{TelemetryV1, TruthV1};
use oqtal_bus::time::Time;
use oqtal_control::trajectory::Phase;

use super::column::FieldCell;
use crate::flight::{AppliedCommand, FlightSample};
use crate::latency::{HOPS, hops, sensor_to_actuator};

/// Sources of a row.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// The tick.
    pub sample: &'a FlightSample,
    /// Command of the tick that reached the vehicle; `None` if none did.
    pub applied: Option<&'a AppliedCommand>,
    /// Zero of the time axis.
    pub origin: Time,
}

/// Cells, added in groups.
#[derive(Default)]
struct Cells(Vec<FieldCell>);

impl Cells {
    fn numbers<const N: usize>(&mut self, values: [f64; N]) {
        self.0.extend(values.map(FieldCell::Number));
    }

    fn counts<const N: usize>(&mut self, values: [u64; N]) {
        self.0.extend(values.map(FieldCell::Count));
    }

    fn word(&mut self, word: Option<impl ToString>) {
        let text = word.map_or_else(String::new, |word| word.to_string());
        self.0.push(FieldCell::Text(text));
    }
}

impl Row<'_> {
    /// The cells of the row, in the order of the columns.
    pub fn cells(&self) -> Vec<FieldCell> {
        let mut cells = Cells::default();
        self.tick(&mut cells);
        self.motion(&mut cells);
        self.command(&mut cells);
        self.filter(&mut cells);
        self.applied(&mut cells);
        cells.0
    }

    fn telemetry(&self) -> &TelemetryV1 {
        &self.sample.telemetry
    }

    /// Time of an instant on the time axis \[s\]; NaN if it is not set.
    fn seconds(&self, at: Time) -> f64 {
        if at.is_set() { at.since(self.origin).seconds() } else { f64::NAN }
    }

    fn tick(&self, cells: &mut Cells) {
        let t = self.telemetry();
        cells.numbers([self.seconds(t.time)]);
        cells.word(Mode::from_code(t.mode));
        cells.word(SafetyState::from_code(t.state));
        cells.word(Cause::from_code(t.cause));
        cells.word(Phase::from_number(t.phase));
        cells.numbers([t.pose_captured_at, t.pose_published_at].map(|at| self.seconds(at)));
        cells.counts([t.tick]);
        cells.numbers([t.mission_s, t.planned_landing_s]);
        cells.counts([t.scored, t.fresh, t.saturated].map(u64::from));
    }

    fn motion(&self, cells: &mut Cells) {
        let t = self.telemetry();
        cells.numbers(t.position);
        cells.numbers(t.velocity);
        cells.numbers(t.attitude);
        cells.numbers(t.rate);
        let unknown = TruthV1 {
            position: [f64::NAN; 3],
            velocity: [f64::NAN; 3],
            attitude: [f64::NAN; 4],
            rate: [f64::NAN; 3],
            ..TruthV1::default()
        };
        let truth = self.sample.truth.unwrap_or(unknown);
        cells.numbers(truth.position);
        cells.numbers(truth.velocity);
        cells.numbers(truth.attitude);
        cells.numbers(truth.rate);
        cells.numbers(t.reference_position);
        cells.numbers(t.reference_velocity);
        cells.numbers([t.reference_yaw]);
    }

    fn command(&self, cells: &mut Cells) {
        let t = self.telemetry();
        cells.numbers(t.velocity_command);
        cells.numbers(t.attitude_command);
        cells.numbers(t.sticks);
        cells.numbers(t.torque);
        cells.numbers(t.attitude_sent);
        cells.numbers(t.proportional_term);
        cells.numbers(t.integral_term);
        cells.numbers(t.feed_forward_term);
        cells.numbers(t.disturbance_term);
        cells.numbers([t.thrust, t.pose_age_s * 1e3, t.wakeup_lateness_ns as f64 * 1e-3]);
        cells.counts([t.riccati_solves, t.riccati_failures, t.deadline_misses]);
        cells.counts([t.poses_lost, t.poses_superseded, t.poses_refused]);
        cells.counts([t.command_sequence]);
    }

    fn filter(&self, cells: &mut Cells) {
        let t = self.telemetry();
        cells.numbers(t.pose_position);
        cells.numbers(t.pose_attitude);
        cells.counts([t.pose_sequence]);
        cells.numbers([t.pose_residual_m * 1e3]);
        cells.numbers(t.filter_position);
        cells.numbers(t.filter_velocity);
        cells.numbers(t.filter_attitude);
        cells.numbers(t.filter_rate);
        cells.numbers(t.innovation_position);
        cells.numbers(t.innovation_attitude);
        cells.numbers(t.nis);
        cells.numbers([t.pose_noise_m * 1e3, t.pose_noise_rad.to_degrees()]);
        cells.numbers(t.pose_evidence);
        let fell_back = if t.adapted_rate_lag_s.is_nan() { f64::NAN } else { t.fell_back.into() };
        cells.numbers(t.adapted_rate_gain);
        cells.numbers([t.adapted_rate_lag_s * 1e3, t.adapted_delay_s * 1e3]);
        cells.numbers([t.adapted_thrust_gain, t.adapted_thrust_lag_s * 1e3, fell_back]);
    }

    /// Adds the hops of the command and their sum \[us\], and the battery voltage \[V\].
    fn applied(&self, cells: &mut Cells) {
        let mut spans_us = [f64::NAN; HOPS.len() + 1];
        if let Some((command, spans)) = self.applied.and_then(|c| Some((c, hops(&c.stamps)?))) {
            let whole = sensor_to_actuator(&command.stamps, command.onward);
            let spans = spans.into_iter().chain([whole]);
            spans_us.iter_mut().zip(spans).for_each(|(us, span)| *us = span.nanos() as f64 * 1e-3);
        }
        cells.numbers(spans_us);
        cells.numbers([self.applied.map_or(f64::NAN, |command| command.battery_v)]);
    }
}
