//! Frequency response of a loop, and its margins.

use std::f64::consts::{PI, TAU};

use nalgebra::Complex;

/// Number of parts of a segment between two frequencies; the distance from -1 is evaluated at their ends \[-\].
const PIECES: u32 = 32;

/// Frequency response of a loop, broken at the input of the plant; positive for negative feedback.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopResponse {
    /// Frequency \[Hz\] and loop gain \[-\], in order of increasing frequency.
    pub points: Vec<(f64, Complex<f64>)>,
}

/// Margins of a stable loop; infinite if there is no limit below the highest measured frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Margins {
    /// Least gain factor above 1 at which the loop oscillates \[-\].
    pub gain: f64,
    /// Least additional lag at which the loop oscillates \[deg\].
    pub phase_deg: f64,
    /// Least additional delay at which the loop oscillates \[ms\].
    pub delay_ms: f64,
    /// Disk margin `alpha` without skew: gain and phase may change simultaneously by any factor and lag within the disk \[-\] (P.
    /// Seiler, A. Packard and P. Gahinet, *IEEE Control Systems* 40 (2020) 78).
    pub disk: f64,
    /// Peak sensitivity: greatest amplification of a disturbance by the loop \[-\].
    pub sensitivity: f64,
}

impl Margins {
    /// Columns of the margins: key in JSON, and heading.
    pub const COLUMNS: [(&'static str, &'static str); 5] = [
        ("gain_margin_db", "gain margin [dB]"),
        ("phase_margin_deg", "phase margin [°]"),
        ("delay_margin_ms", "delay margin [ms]"),
        ("disk_margin", "disk margin"),
        ("peak_sensitivity", "greatest sensitivity"),
    ];
    /// Index of the disk margin in [`Self::COLUMNS`].
    pub const DISK: usize = 3;
    /// Index of the peak sensitivity, the only column whose greatest value is the worst.
    pub const PEAK: usize = 4;

    /// Values in the order of [`Self::COLUMNS`].
    pub fn numbers(&self) -> [f64; 5] {
        let gain_db = 20.0 * self.gain.log10();
        [gain_db, self.phase_deg, self.delay_ms, self.disk, self.sensitivity]
    }
}

impl LoopResponse {
    /// Whether the closed loop is stable by Nyquist's criterion: the response must not encircle -1. Assumes an open loop without
    /// unstable poles other than integrators.
    pub fn is_stable(&self) -> bool {
        let Some((_, first)) = self.points.first() else { return true };
        // Integrators turn the response by a quarter of a turn each before the first point.
        let lag = (-first.arg()).rem_euclid(TAU);
        let before = half_turns([0.0, lag]).count() as i64;
        let crossings = self.points.windows(2).map(|pair| {
            let Segment { log_gain, lag, .. } = Segment::between(pair[0], pair[1]);
            let beyond =
                |level: &f64| crossing(lag, *level).is_some_and(|share| mix(log_gain, share) > 0.0);
            let count = half_turns(lag).filter(beyond).count() as i64;
            if lag[1] > lag[0] { count } else { -count }
        });
        before + crossings.sum::<i64>() == 0
    }

    /// Margins of a stable loop with at least two points, between which phase and logarithm of the gain are interpolated linearly.
    pub fn margins(&self) -> Margins {
        let mut margins = Margins {
            gain: f64::INFINITY,
            phase_deg: f64::INFINITY,
            delay_ms: f64::INFINITY,
            disk: f64::INFINITY,
            sensitivity: 0.0,
        };
        for pair in self.points.windows(2) {
            let segment = Segment::between(pair[0], pair[1]);
            margins.narrow(segment);
            segment.near_critical().for_each(|gain| margins.approach(gain));
        }
        margins
    }
}

impl Margins {
    /// Includes the distance of the loop gain from -1 at one frequency.
    fn approach(&mut self, gain: Complex<f64>) {
        let distance = (gain + 1.0).norm();
        self.sensitivity = self.sensitivity.max(1.0 / distance);
        // 1 / |S - 1/2|.
        self.disk = self.disk.min(2.0 * distance / (gain - 1.0).norm());
    }

    /// Includes the crossings between two points.
    fn narrow(&mut self, segment: Segment) {
        let Segment { log_gain, lag, .. } = segment;
        if let Some(share) = crossing(log_gain, 0.0) {
            // Lag up to half a turn, modulo one turn.
            let left = (PI - mix(lag, share)).rem_euclid(TAU);
            let hertz = mix(segment.log_hertz, share).exp();
            self.phase_deg = self.phase_deg.min(left.to_degrees());
            self.delay_ms = self.delay_ms.min(1e3 * left / (TAU * hertz));
        }
        for level in half_turns(lag) {
            if let Some(share) = crossing(lag, level) {
                let gain = mix(log_gain, share).exp();
                if gain < 1.0 {
                    self.gain = self.gain.min(gain.recip());
                }
            }
        }
    }
}

/// Segment between two frequencies: logarithms of frequency and gain, and lag \[rad\], at both ends.
#[derive(Clone, Copy, Debug)]
struct Segment {
    log_hertz: [f64; 2],
    log_gain: [f64; 2],
    lag: [f64; 2],
}

impl Segment {
    fn between((f, a): (f64, Complex<f64>), (g, b): (f64, Complex<f64>)) -> Self {
        let first = -a.arg();
        Self {
            log_hertz: [f.ln(), g.ln()],
            log_gain: [a.norm().ln(), b.norm().ln()],
            // The smaller angle between the two ends.
            lag: [first, first - (b / a).arg()],
        }
    }

    /// Interpolated loop gains at which the distance from -1 is taken: evenly spaced, and those at the crossings, so that disk margin
    /// and sensitivity are never better than the gain and phase margins allow.
    fn near_critical(self) -> impl Iterator<Item = Complex<f64>> {
        let Self { log_gain, lag, .. } = self;
        let even = (0..=PIECES).map(|piece| f64::from(piece) / f64::from(PIECES));
        let at_phase = half_turns(lag).filter_map(move |level| crossing(lag, level));
        let shares = even.chain(crossing(log_gain, 0.0)).chain(at_phase);
        shares.map(move |share| Complex::from_polar(mix(log_gain, share).exp(), -mix(lag, share)))
    }
}

/// Odd multiples of half a turn between two lags \[rad\].
fn half_turns([a, b]: [f64; 2]) -> impl Iterator<Item = f64> {
    let first = ((a.min(b) / PI - 1.0) / 2.0).ceil() as i32;
    let last = ((a.max(b) / PI - 1.0) / 2.0).floor() as i32;
    (first..=last).map(|turn| PI * f64::from(2 * turn + 1))
}

fn mix([a, b]: [f64; 2], share: f64) -> f64 {
    a + (b - a) * share
}

/// Position at which a straight line between two values crosses `level` \[0..1\]; the second end belongs to the next segment.
fn crossing([a, b]: [f64; 2], level: f64) -> Option<f64> {
    ((a < level) != (b < level)).then(|| (level - a) / (b - a))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `k e^(-j w tau) / (j w)` with known margins: w_c = k, phase 90 deg - k tau, gain pi / (2 k tau).
    fn delayed_integrator(k: f64, tau: f64) -> LoopResponse {
        let at = |index: usize| {
            let hertz = 0.02 * 1.002_f64.powi(index as i32);
            let w = TAU * hertz;
            (hertz, Complex::from_polar(k / w, -w * tau - PI / 2.0))
        };
        LoopResponse { points: (0..3400).map(at).collect() }
    }

    #[test]
    fn the_margins_of_a_delayed_integrator_are_the_known_ones() {
        let margins = delayed_integrator(8.0, 0.035).margins();
        let gain = PI / (2.0 * 8.0 * 0.035);
        assert!((margins.gain / gain - 1.0).abs() < 1e-3, "{margins:?}");
        let phase = PI / 2.0 - 8.0 * 0.035;
        assert!((margins.phase_deg / phase.to_degrees() - 1.0).abs() < 1e-3, "{margins:?}");
        assert!((margins.delay_ms / (1e3 * phase / 8.0) - 1.0).abs() < 1e-3, "{margins:?}");
    }

    #[test]
    fn a_loop_is_stable_up_to_its_gain_margin_also_with_a_second_integrator() {
        for tau in [0.02, 0.035, 0.08] {
            let limit = PI / (2.0 * tau);
            for share in [0.2, 0.9, 0.99, 1.01, 1.5, 6.0, 20.0] {
                let response = delayed_integrator(share * limit, tau);
                assert_eq!(response.is_stable(), share < 1.0, "{tau}, {share}");
            }
        }
        // k (1 + 1 / (s t)) e^(-s tau) / s: stable if the zero is far enough below the crossover.
        let second = |k: f64, t_s: f64| {
            let mut response = delayed_integrator(k, 0.02);
            for (hertz, gain) in &mut response.points {
                *gain *= Complex::new(1.0, -1.0 / (TAU * *hertz * t_s));
            }
            response.is_stable()
        };
        assert!(second(20.0, 1.0) && !second(80.0, 1.0) && !second(20.0, 0.01));
    }

    /// Classic margins bound disk margin and sensitivity from both sides, at every density of points.
    #[test]
    fn disk_margin_and_sensitivity_agree_with_the_classic_margins() {
        for (k, every) in
            [2.0, 8.0, 20.0, 40.0].into_iter().flat_map(|k| [1, 17, 90].map(|n| (k, n)))
        {
            let mut response = delayed_integrator(k, 0.035);
            response.points = response.points.into_iter().step_by(every).collect();
            let margins = response.margins();
            let (half, phase) = (margins.disk / 2.0, margins.phase_deg.to_radians());
            assert!(margins.gain >= (1.0 + half) / (1.0 - half) - 1e-9, "{margins:?}");
            assert!(half <= (phase / 2.0).tan() + 1e-9, "{margins:?}");
            let least = [1.0 / (2.0 * (phase / 2.0).sin()), 1.0 / (1.0 - margins.gain.recip())];
            assert!(least.iter().all(|it| margins.sensitivity > it - 1e-9), "{margins:?}");
            // Within a tenth of a per cent of those of the dense response, as gain and phase margin are not with few points.
            if every == 17 {
                let dense = delayed_integrator(k, 0.035).margins();
                assert!((margins.disk / dense.disk - 1.0).abs() < 1e-3, "{margins:?}, {dense:?}");
            }
        }
    }

    #[test]
    fn a_loop_without_crossings_has_a_disk_margin_and_no_gain_or_phase_margin() {
        let response = LoopResponse {
            points: [1.0, 2.0].map(|hertz| (hertz, Complex::from(0.5 / hertz))).to_vec(),
        };
        let margins = response.margins();
        assert!(margins.gain.is_infinite() && margins.phase_deg.is_infinite(), "{margins:?}");
        assert!((margins.disk - 10.0 / 3.0).abs() < 1e-9, "{margins:?}");
        assert!((margins.sensitivity - 0.8).abs() < 1e-9, "{margins:?}");
    }
}
