//! Rotation of the vehicle measured by its own gyroscope: the integral of the reported rates.
//!
//! A vehicle may turn into a tilt between two reports, if one of them is lost or late. Its rotation is known up to its last report only,
//! and is compared with poses once the next report has arrived.

use nalgebra::Vector3;

/// Number of reports that are kept \[-\]: longer than the age of a pose at 250 reports a second.
const KEPT: usize = 32;
/// Greatest time between two reports over which their rate is integrated \[s\].
const LONGEST_S: f64 = 0.15;
/// The same for a vehicle that reports often: after a gap of 0.14 s in 50 reports a second, the mean of the two reports beside it was 0.03 rad
/// off in a hover that oscillated with 4 Hz.
const LONGEST_OF_FREQUENT_S: f64 = 0.07;
/// Number of usual intervals up to which a longer one is not a gap \[-\].
const USUAL_INTERVALS: f64 = 3.0;
/// Weight of an interval in the usual one \[-\].
const INTERVAL_WEIGHT: f64 = 0.1;
/// Uncovered time from which on rotations are compared with the commands instead \[s\].
const LONGEST_UNCOVERED_S: f64 = 0.5;
/// Rate at which covered time reduces the uncovered time \[-\].
const REGAINED: f64 = 0.25;
/// Time for which the last reported rate is extrapolated \[s\]: the age of the newest report if the vehicle reports at the rate of the
/// cameras.
const CONTINUED_S: f64 = 0.04;

/// A report: its instant \[s\], its rate \[rad/s, body\], and the angles turned until then \[rad, body\].
type Report = (f64, Vector3<f64>, Vector3<f64>);

/// The last reports of the gyroscope.
#[derive(Clone, Copy, Debug)]
pub(super) struct VehicleRates {
    reports: [Report; KEPT],
    next: usize,
    /// Number of reports since the last gap \[-\].
    count: usize,
    /// Usual time between two reports \[s\].
    usual_s: f64,
    /// Time of this flight that no report covers, less what was regained \[s\].
    uncovered_s: f64,
}

impl Default for VehicleRates {
    /// Before the first report.
    fn default() -> Self {
        let void = (f64::NEG_INFINITY, Vector3::zeros(), Vector3::zeros());
        Self { reports: [void; KEPT], next: 0, count: 0, usual_s: LONGEST_S, uncovered_s: 0.0 }
    }
}

impl VehicleRates {
    /// Takes a report of `rate` \[rad/s, body\] at `t_s` \[s\]. One that is not later than the last, or not finite, is ignored.
    pub(super) fn receive(&mut self, t_s: f64, rate: Vector3<f64>) {
        let (last_s, last_rate, angle) = *self.back(1);
        let dt_s = t_s - last_s;
        // Comparisons with NaN are false.
        if !(dt_s > 0.0 && t_s.is_finite() && rate.iter().all(|axis| axis.abs() < 100.0)) {
            return;
        }
        let follows = dt_s <= self.longest_s();
        self.usual_s += INTERVAL_WEIGHT * (dt_s.min(LONGEST_S) - self.usual_s);
        let turned = if follows { (last_rate + rate) * (0.5 * dt_s) } else { Vector3::zeros() };
        self.count = if follows { (self.count + 1).min(KEPT) } else { 1 };
        self.reports[self.next] = (t_s, rate, angle + turned);
        self.next = (self.next + 1) % KEPT;
    }

    /// Greatest time between two reports that is not a gap \[s\].
    fn longest_s(&self) -> f64 {
        (USUAL_INTERVALS * self.usual_s).clamp(LONGEST_OF_FREQUENT_S, LONGEST_S)
    }

    /// Begins a flight: earlier gaps do not count.
    pub(super) fn restart(&mut self) {
        self.uncovered_s = 0.0;
    }

    /// Whether the reports cover most of the flight up to `now_s` \[s\].
    pub(super) fn are_trusted(&self, now_s: f64) -> bool {
        let waiting_s = (now_s - self.back(1).0 - self.longest_s()).max(0.0);
        self.count > 0 && self.uncovered_s + waiting_s < LONGEST_UNCOVERED_S
    }

    /// Whether no further report is needed for the rotation until `t_s` \[s\].
    pub(super) fn reach(&self, t_s: f64) -> bool {
        t_s - self.back(1).0 <= CONTINUED_S
    }

    /// Like [`Self::turn`], and counts whether the reports cover it.
    pub(super) fn covered_turn(&mut self, from_s: f64, to_s: f64) -> Option<Vector3<f64>> {
        let turn = self.turn(from_s, to_s);
        let gained_s = if turn.is_some() { -REGAINED } else { 1.0 } * (to_s - from_s);
        self.uncovered_s = (self.uncovered_s + gained_s).clamp(0.0, 2.0 * LONGEST_UNCOVERED_S);
        turn
    }

    /// Rotation from `from_s` to `to_s` \[s\] \[rad, body axes\]; `None` if the reports do not cover it.
    fn turn(&self, from_s: f64, to_s: f64) -> Option<Vector3<f64>> {
        Some(self.angle(to_s)? - self.angle(from_s)?)
    }

    /// Angles turned until `t_s` \[s\] \[rad, body\].
    fn angle(&self, t_s: f64) -> Option<Vector3<f64>> {
        let back = (1..=self.count).find(|back| self.back(*back).0 <= t_s)?;
        let (at_s, rate, angle) = *self.back(back);
        let dt_s = t_s - at_s;
        if back == 1 {
            return (dt_s <= CONTINUED_S).then(|| angle + rate * dt_s);
        }
        let (next_s, next_rate, _) = *self.back(back - 1);
        let slope = (next_rate - rate) / (next_s - at_s);
        Some(angle + rate * dt_s + slope * (0.5 * dt_s * dt_s))
    }

    /// The report `back` reports ago \[-\]; 1 for the newest.
    fn back(&self, back: usize) -> &Report {
        &self.reports[(self.next + KEPT - back) % KEPT]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_integrated_between_any_two_instants_that_reports_cover() {
        let mut rates = VehicleRates::default();
        assert!(rates.turn(0.0, 0.1).is_none());
        // Angle t^2 / 2, reported 50 times a second.
        (0..50)
            .for_each(|k| rates.receive(0.02 * f64::from(k), Vector3::x() * 0.02 * f64::from(k)));
        let turn = rates.turn(0.507, 0.773).unwrap();
        assert!((turn.x - 0.5 * (0.773 * 0.773 - 0.507 * 0.507)).abs() < 1e-12, "{turn}");
        assert!(rates.turn(0.1, 0.7).is_none(), "older than the reports kept");
        assert!(rates.turn(0.9, 1.01).is_some() && rates.turn(0.9, 1.1).is_none());
        assert!(rates.reach(1.01) && !rates.reach(1.1));
    }

    #[test]
    fn reports_that_leave_much_uncovered_are_not_trusted_until_they_cover_most() {
        let mut rates = VehicleRates::default();
        assert!(!rates.are_trusted(0.0), "there is none");
        // As [`VehicleRates::covered_turn`], after a report every `period_s` until `to_s`.
        let mut report = |from_s: f64, to_s: f64, period_s: f64| {
            let count = ((to_s - from_s) / period_s).round() as usize;
            for k in 1..=count {
                let now_s = from_s + period_s * k as f64;
                rates.receive(now_s, Vector3::zeros());
                rates.covered_turn(now_s - period_s, now_s);
            }
            rates
        };
        assert!(
            report(0.0, 5.0, 0.05).are_trusted(5.6) && !report(5.0, 5.05, 0.05).are_trusted(5.8)
        );
        assert!(report(5.05, 5.3, 0.25).are_trusted(5.3), "a gap");
        assert!(!report(5.3, 7.3, 0.25).are_trusted(7.3), "each report after a gap");
        assert!(
            !report(7.3, 9.2, 0.05).are_trusted(9.2) && report(9.2, 9.5, 0.05).are_trusted(9.5)
        );
        rates.restart();
        assert!(rates.are_trusted(9.5));
    }

    #[test]
    fn the_less_often_a_vehicle_reports_the_longer_may_a_gap_be() {
        let is_integrated = |period_s: f64, gap_s: f64| {
            let mut rates = VehicleRates::default();
            (-60..=0).for_each(|k| rates.receive(period_s * f64::from(k), Vector3::x()));
            rates.receive(gap_s, Vector3::x());
            rates.turn(0.0, gap_s).is_some()
        };
        assert!(is_integrated(0.02, 0.069) && !is_integrated(0.02, 0.075));
        assert!(is_integrated(0.125, 0.149) && !is_integrated(0.125, 0.151));
    }

    /// The rate of a Crazyflie in hover oscillates with 0.25 rad/s and 4 Hz. Its firmware, as a program, left out six reports of 50 a
    /// second: the mean of the reports beside such a gap is 0.03 rad off, thirty times the noise of poses.
    #[test]
    fn an_oscillation_between_reports_far_apart_is_not_a_rotation_by_their_mean() {
        let mut rates = VehicleRates::default();
        let rate = |t_s: f64| Vector3::x() * 0.25 * (25.0 * t_s).sin();
        let times = (0..100).filter(|k| !(40..46).contains(k)).map(|k| 0.02 * f64::from(k));
        for t_s in times {
            rates.receive(t_s, rate(t_s));
            if let Some(turn) = rates.turn(t_s - 0.08, t_s) {
                let integral = |t_s: f64| -0.01 * (25.0 * t_s).cos();
                let error = turn.x - (integral(t_s) - integral(t_s - 0.08));
                assert!(error.abs() < 1e-3, "{error} rad at {t_s} s");
            }
        }
    }

    #[test]
    fn a_gap_or_a_report_that_is_not_finite_is_not_integrated() {
        let mut rates = VehicleRates::default();
        for (t_s, rate) in [(0.0, 1.0), (0.1, f64::NAN), (0.1, f64::INFINITY), (0.05, 1.0)] {
            rates.receive(t_s, Vector3::repeat(rate));
        }
        assert!((rates.turn(0.0, 0.05).unwrap().x - 0.05).abs() < 1e-12);
        rates.receive(0.3, Vector3::repeat(1.0));
        assert!(rates.turn(0.05, 0.31).is_none());
        assert!(rates.turn(0.3, 0.33).is_some());
    }
}
