//! The gravity turn of a lander: constant thrust opposite to the velocity leads from horizontal flight to a hover.
//! Paper, Section V.B.
//!
//! [`GravityTurn`] is the ideal turn in closed form, [`Guidance`] commands the attitude of a lander that flies it.
//!
//! With `theta` the angle between the velocity and the vertical down, `n` the thrust over the weight and
//! `u = tan(theta/2)`, Eqs. (58) and (59) give `v = C u^(n-1) (1 + u^2)`; time and place follow by integration over `u`.

use nalgebra::Vector3;

use crate::options::{OptionError, Rule, check_options};
use crate::position::attitude_along;
use crate::quantity::{AngularAcceleration, BodyRate};
use crate::quaternion::Attitude;
use crate::tracking_error::AttitudeReference;

/// Greatest number of Newton steps for the angle at a time \[-\]; convergence takes fewer.
const NEWTON_STEPS: usize = 64;

/// A gravity turn with constant thrust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GravityTurn {
    /// `n`: thrust over weight \[-\].
    thrust_ratio: f64,
    /// `g` \[m/s^2\].
    gravity: f64,
    /// `C` \[m/s\].
    constant: f64,
    /// `u` at the start.
    start: f64,
}

/// State of a gravity turn at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnState {
    /// Time since the start \[s\].
    pub time_s: f64,
    /// `theta`: angle between velocity and vertical, 0 when falling straight down \[rad\].
    pub angle_rad: f64,
    /// Horizontal distance from the start \[m\].
    pub down_range_m: f64,
    /// Height lost since the start \[m\].
    pub drop_m: f64,
    /// Horizontal velocity \[m/s\].
    pub forward_m_s: f64,
    /// Vertical velocity, positive downwards \[m/s\].
    pub sink_m_s: f64,
}

impl GravityTurn {
    /// Turn of a lander with a thrust of `thrust_ratio` times its weight under `gravity` \[m/s^2\], which begins with `speed`
    /// \[m/s\] at `angle_rad` from the vertical \[rad\].
    ///
    /// # Errors
    /// The first argument for which the turn does not end in a hover.
    pub fn new(
        thrust_ratio: f64,
        gravity: f64,
        speed: f64,
        angle_rad: f64,
    ) -> Result<Self, OptionError> {
        check_options([
            ("thrust-ratio", thrust_ratio, Rule::Between(1.01, 100.0)),
            ("gravity-m-s2", gravity, Rule::Between(0.01, 1000.0)),
            ("speed-m-s", speed, Rule::Between(0.01, 1e5)),
            ("angle-rad", angle_rad, Rule::Between(1e-3, 3.0)),
        ])?;
        let start = (angle_rad / 2.0).tan();
        let constant = speed / (start.powf(thrust_ratio - 1.0) * (1.0 + start * start));
        Ok(Self { thrust_ratio, gravity, constant, start })
    }

    /// Time at which the lander hovers \[s\].
    pub fn hover_time_s(&self) -> f64 {
        self.at_angle(0.0).time_s
    }

    /// State at which the velocity is `angle_rad` from the vertical, between the initial angle and 0.
    pub fn at_angle(&self, angle_rad: f64) -> TurnState {
        let Self { thrust_ratio: n, gravity: g, constant: c, .. } = *self;
        let u = (angle_rad / 2.0).tan();
        // Eqs. (58), (59), errata E-58, E-59: dt = -(C/g) u^(n-2) (1 + u^2) du
        let time_s = c / g * (self.span(u, n - 1.0) + self.span(u, n + 1.0));
        let down_range_m =
            2.0 * c * c / g * (self.span(u, 2.0 * n - 1.0) + self.span(u, 2.0 * n + 1.0));
        let drop_m = c * c / g * (self.span(u, 2.0 * n - 2.0) - self.span(u, 2.0 * n + 2.0));
        let speed = c * u.powf(n - 1.0) * (1.0 + u * u);
        let (sin, cos) = angle_rad.sin_cos();
        let (forward_m_s, sink_m_s) = (speed * sin, speed * cos);
        TurnState { time_s, angle_rad, down_range_m, drop_m, forward_m_s, sink_m_s }
    }

    /// The state at `time_s` \[s\] after the start. After the hover the thrust accelerates the lander straight up.
    pub fn at_time(&self, time_s: f64) -> TurnState {
        let hover = self.at_angle(0.0);
        let after = time_s - hover.time_s;
        if after < 0.0 {
            return TurnState { time_s, ..self.at_angle(self.angle_at(time_s.max(0.0))) };
        }
        let lift = (self.thrust_ratio - 1.0) * self.gravity;
        TurnState {
            time_s,
            drop_m: hover.drop_m - lift * after * after / 2.0,
            sink_m_s: -lift * after,
            ..hover
        }
    }

    /// The angle \[rad\] at a time before the hover \[s\].
    ///
    /// As a function of `s = u^(n-1)` the time is decreasing and concave, so Newton's method converges to the root
    /// from the start of the turn.
    fn angle_at(&self, time_s: f64) -> f64 {
        let n = self.thrust_ratio;
        let power = (n + 1.0) / (n - 1.0);
        let wanted = time_s * self.gravity / self.constant;
        let time = |s: f64| s / (n - 1.0) + s.powf(power) / (n + 1.0);
        let slope = |s: f64| (1.0 + s.powf(power - 1.0)) / (n - 1.0);
        let start = self.start.powf(n - 1.0);
        let mut s = start;
        for _ in 0..NEWTON_STEPS {
            let next = (s + (time(start) - wanted - time(s)) / slope(s)).max(0.0);
            if next >= s {
                break;
            }
            s = next;
        }
        2.0 * s.powf(1.0 / (n - 1.0)).atan()
    }

    /// The integral of `x^(power-1)` from `u` to the start.
    fn span(&self, u: f64, power: f64) -> f64 {
        (self.start.powf(power) - u.powf(power)) / power
    }
}

/// Options of the guidance through a gravity turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidanceOptions {
    /// `n`: thrust over weight \[-\].
    pub thrust_ratio: f64,
    /// `g` \[m/s^2\].
    pub gravity_m_s2: f64,
    /// Speed below which the command is held \[m/s\], because the direction of a vanishing velocity is undefined.
    pub least_speed_m_s: f64,
    /// Whether `omega_d` and its derivative are commanded besides the attitude.
    pub rates: bool,
}

/// Guidance law: commands the attitude with the thrust opposite to the velocity, at zero yaw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guidance {
    options: GuidanceOptions,
    last: AttitudeReference,
    is_frozen: bool,
}

impl Guidance {
    /// A guidance without a previous command.
    pub fn new(options: GuidanceOptions) -> Self {
        Self { options, last: AttitudeReference::default(), is_frozen: false }
    }

    /// Command for a lander that moves at `velocity` \[m/s, world\] and thrusts along body z of `attitude`.
    ///
    /// Once the lander has been slower than `least_speed_m_s`, the last attitude is held permanently.
    pub fn command(&mut self, velocity: &Vector3<f64>, attitude: &Attitude) -> AttitudeReference {
        if self.is_frozen || velocity.norm() < self.options.least_speed_m_s {
            self.is_frozen = true;
            return AttitudeReference { attitude: self.last.attitude, ..Default::default() };
        }
        let desired = attitude_along(&-velocity, 0.0);
        let mut reference = AttitudeReference { attitude: desired, ..Default::default() };
        if self.options.rates {
            let (omega, omega_dot) = self.turn_of(velocity, attitude);
            reference.rate = BodyRate(desired.to_body(&omega));
            // The derivative of the components in turning axes is that of the vector: omega_d x omega_d = 0.
            reference.acceleration = AngularAcceleration(desired.to_body(&omega_dot));
        }
        self.last = reference;
        reference
    }

    /// Rate of rotation of the direction of the velocity \[rad/s, world\], and its derivative under a thrust opposite
    /// to the velocity \[rad/s^2, world\].
    fn turn_of(
        &self,
        velocity: &Vector3<f64>,
        attitude: &Attitude,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let gravity = -Vector3::z() * self.options.gravity_m_s2;
        let thrust = self.options.thrust_ratio * self.options.gravity_m_s2;
        let acceleration = gravity + attitude.to_world(&Vector3::z()) * thrust;
        let squared = velocity.norm_squared();
        let ideal = velocity.cross(&gravity) / squared;
        let along = velocity.dot(&acceleration) / squared;
        let omega = velocity.cross(&acceleration) / squared;
        (omega, acceleration.cross(&gravity) / squared - 2.0 * along * ideal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Table I.
    fn table_1() -> GravityTurn {
        GravityTurn::new(1.5, 3.7, 70.0, std::f64::consts::FRAC_PI_2).unwrap()
    }

    /// Eqs. (58), (59), errata E-58, E-59, with the distances: derivative of `[v, theta, x, drop]` by time.
    fn derivative(turn: &GravityTurn, [v, theta, _, _]: [f64; 4]) -> [f64; 4] {
        let (sin, cos) = theta.sin_cos();
        let (n, g) = (turn.thrust_ratio, turn.gravity);
        [g * (cos - n), -g * sin / v, v * sin, v * cos]
    }

    /// Classic Runge-Kutta of fourth order from the start to `time_s`.
    fn integrated(turn: &GravityTurn, time_s: f64, steps: u32) -> [f64; 4] {
        let first = turn.at_time(0.0);
        let h = time_s / f64::from(steps);
        let ahead = |y: [f64; 4], k: [f64; 4], h: f64| -> [f64; 4] {
            std::array::from_fn(|i| y[i] + h * k[i])
        };
        let mut y = [first.forward_m_s.hypot(first.sink_m_s), first.angle_rad, 0.0, 0.0];
        for _ in 0..steps {
            let k1 = derivative(turn, y);
            let k2 = derivative(turn, ahead(y, k1, h / 2.0));
            let k3 = derivative(turn, ahead(y, k2, h / 2.0));
            let k4 = derivative(turn, ahead(y, k3, h));
            y = std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
        y
    }

    #[test]
    fn the_closed_form_agrees_with_the_integrated_equations() {
        let turn = table_1();
        for time_s in [1.0, 5.0, 10.0, 15.0, 20.0, 22.0] {
            let [speed, angle, down_range, drop] = integrated(&turn, time_s, 40_000);
            let closed = turn.at_time(time_s);
            for (ours, integral) in [
                (closed.forward_m_s.hypot(closed.sink_m_s), speed),
                (closed.angle_rad, angle),
                (closed.down_range_m, down_range),
                (closed.drop_m, drop),
            ] {
                assert!((ours / integral - 1.0).abs() < 1e-9, "{ours} at {time_s} s: {integral}");
            }
        }
    }

    #[test]
    fn the_lander_of_table_1_hovers_where_and_when_it_must() {
        let hover = table_1().at_angle(0.0);
        assert!((hover.time_s - 22.7027).abs() < 5e-5, "{hover:?}");
        assert!((hover.drop_m - 264.865).abs() < 5e-4, "{hover:?}");
        assert!((hover.down_range_m - 496.622).abs() < 5e-4, "{hover:?}");
        assert_eq!((hover.forward_m_s, hover.sink_m_s), (0.0, 0.0));
    }

    #[test]
    fn after_the_hover_the_lander_rises() {
        let turn = table_1();
        let later = turn.at_time(turn.hover_time_s() + 0.2);
        assert!((later.sink_m_s + 0.5 * 3.7 * 0.2).abs() < 1e-12);
        assert!(later.drop_m < turn.at_angle(0.0).drop_m);
    }

    #[test]
    fn numbers_without_a_turn_are_refused() {
        for [n, g, v, angle] in
            [[1.0, 3.7, 70.0, 1.5], [1.5, 0.0, 70.0, 1.5], [1.5, 3.7, f64::NAN, 1.5]]
        {
            assert!(GravityTurn::new(n, g, v, angle).is_err());
        }
        assert!(GravityTurn::new(1.5, 3.7, 70.0, 0.0).is_err());
    }

    #[test]
    fn on_the_ideal_turn_the_guidance_commands_its_rate() {
        let turn = table_1();
        let options = GuidanceOptions {
            thrust_ratio: 1.5,
            gravity_m_s2: 3.7,
            least_speed_m_s: 1.0,
            rates: true,
        };
        let mut guidance = Guidance::new(options);
        let mut command = |time_s: f64| {
            let state = turn.at_time(time_s);
            let velocity = Vector3::new(state.forward_m_s, 0.0, -state.sink_m_s);
            guidance.command(&velocity, &attitude_along(&-velocity, 0.0))
        };
        for time_s in [1.0, 8.0, 15.0, 20.0] {
            let h = 1e-4;
            let (before, now, after) = (command(time_s - h), command(time_s), command(time_s + h));
            let turned = before.attitude.rotation_to(&after.attitude) / (2.0 * h);
            assert!((turned - now.rate.0).norm() < 1e-6, "{turned} for {:?}", now.rate);
            let changed = (after.rate.0 - before.rate.0) / (2.0 * h);
            assert!((changed - now.acceleration.0).norm() < 1e-6, "{changed} for {now:?}");
        }
    }

    #[test]
    fn below_the_least_speed_the_command_stands_still_for_good() {
        let options = GuidanceOptions {
            thrust_ratio: 1.5,
            gravity_m_s2: 3.7,
            least_speed_m_s: 1.0,
            rates: true,
        };
        let mut guidance = Guidance::new(options);
        let tilted = guidance.command(&Vector3::new(2.0, 0.0, -2.0), &Attitude::LEVEL);
        for velocity in [Vector3::new(0.0, 0.5, 0.0), Vector3::new(5.0, 0.0, 0.0)] {
            let held = guidance.command(&velocity, &Attitude::LEVEL);
            assert_eq!(held.attitude, tilted.attitude);
            assert_eq!(held.rate, BodyRate::default());
        }
    }

    proptest! {
        #[test]
        fn the_angle_at_a_time_is_found_for_any_turn(
            (n, g, speed, angle) in (1.05..4.0_f64, 1.0..20.0_f64, 1.0..500.0_f64, 0.05..2.5_f64),
            share in 0.0..0.999_f64,
        ) {
            let turn = GravityTurn::new(n, g, speed, angle).unwrap();
            let time_s = share * turn.hover_time_s();
            let found = turn.at_angle(turn.at_time(time_s).angle_rad).time_s;
            prop_assert!((found - time_s).abs() <= 1e-9 * turn.hover_time_s());
        }
    }
}
