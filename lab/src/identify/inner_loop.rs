//! The on-board rate loop about one axis, solved exactly for a constant demand.
//!
//! The loop is of first order, as in the model that `oqtal-dt` predicts with. Where the actuators lag too, the loop is closed
//! around them and of second order: `lag a w'' + lag w' + w = demand`, with `a` the lag of the actuators.

/// Actuator lag below which the loop counts as one of first order \[s\].
const NEGLIGIBLE_S: f64 = 1e-4;

/// Time constants of the loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateLoopLags {
    /// Time constant of the loop \[s\], positive.
    pub lag_s: f64,
    /// Lag of the actuators inside the loop \[s\]; 0 for none.
    pub actuator_s: f64,
}

/// The solution of the loop over a time: what remains of a deviation of rate and acceleration from the demand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopStep {
    h_s: f64,
    lags: RateLoopLags,
    /// Transition of (rate minus demand \[rad/s\], acceleration \[rad/s^2\]).
    transition: [[f64; 2]; 2],
}

impl RateLoopLags {
    /// The solution over `h_s` \[s\].
    #[must_use]
    pub fn over(&self, h_s: f64) -> LoopStep {
        let lag_s = self.lag_s.max(NEGLIGIBLE_S);
        let lags = Self { lag_s, ..*self };
        if self.actuator_s < NEGLIGIBLE_S {
            let keep = (-h_s / lag_s).exp();
            return LoopStep { h_s, lags, transition: [[keep, 0.0], [-keep / lag_s, 0.0]] };
        }
        // The exponential of a matrix of two rows with half the trace m and the discriminant d: real or complex poles.
        let (a, b) = (1.0 / (lag_s * self.actuator_s), 1.0 / self.actuator_s);
        let m = -b / 2.0;
        let d = m * m - a;
        let root = d.abs().sqrt();
        let (cos, sin) = match root * h_s {
            // The limit of both branches.
            x if x < 1e-9 => (1.0, h_s),
            x if d > 0.0 => (x.cosh(), x.sinh() / root),
            x => (x.cos(), x.sin() / root),
        };
        let fading = (m * h_s).exp();
        let transition = [
            [fading * (cos - m * sin), fading * sin],
            [-fading * a * sin, fading * (cos - (b + m) * sin)],
        ];
        LoopStep { h_s, lags, transition }
    }
}

impl LoopStep {
    /// Advances rate \[rad/s\] and acceleration \[rad/s^2\] under a constant demand \[rad/s\]; returns the angle turned \[rad\].
    #[inline]
    pub fn advance(&self, rate: &mut f64, acceleration: &mut f64, demand: f64) -> f64 {
        let [[a, b], [c, d]] = self.transition;
        let (before, was) = (*rate - demand, *acceleration);
        let (after, now) = (a * before + b * was, c * before + d * was);
        (*rate, *acceleration) = (demand + after, now);
        let RateLoopLags { lag_s, actuator_s } = self.lags;
        let of_actuators = if actuator_s < NEGLIGIBLE_S { 0.0 } else { actuator_s * (now - was) };
        demand * self.h_s - lag_s * (after - before + of_actuators)
    }

    /// What remains of a deviation of the rate \[-\], and the angle that it turns meanwhile \[s\].
    #[must_use]
    pub fn of_rate(&self) -> (f64, f64) {
        let (mut rate, mut acceleration) = (1.0, 0.0);
        let turned = self.advance(&mut rate, &mut acceleration, 0.0);
        (rate, turned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both orders against small steps of the differential equation.
    #[test]
    fn the_solution_is_that_of_the_differential_equation() {
        for actuator_s in [0.0, 5e-3, 12.5e-3, 50e-3] {
            let lags = RateLoopLags { lag_s: 50e-3, actuator_s };
            let (mut rate, mut acceleration) = (0.3, 0.0);
            let turned = lags.over(20e-3).advance(&mut rate, &mut acceleration, 1.5);
            let (mut w, mut dw, mut angle) = (0.3, 0.0, 0.0);
            let h = 1e-7;
            for _ in 0..200_000 {
                let was = w;
                if actuator_s == 0.0 {
                    w += h * (1.5 - w) / lags.lag_s;
                } else {
                    dw += h * ((1.5 - w) / lags.lag_s - dw) / actuator_s;
                    w += h * dw;
                }
                angle += h * 0.5 * (w + was);
            }
            assert!((rate - w).abs() < 1e-5, "{actuator_s}: {rate} is not {w}");
            assert!((turned - angle).abs() < 1e-6, "{actuator_s}: {turned} is not {angle}");
        }
    }
}
