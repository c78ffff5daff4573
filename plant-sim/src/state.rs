//! The state of a vehicle, and its integration.

use std::ops::{Add, Mul};

use nalgebra::{Quaternion, Vector3, Vector4};

/// State of motion of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Position of the centre of mass \[m, world\].
    pub position: Vector3<f64>,
    /// Velocity \[m/s, world\].
    pub velocity: Vector3<f64>,
    /// Attitude \[body to world\]; of unit norm between steps.
    pub attitude: Quaternion<f64>,
    /// Body rate \[rad/s, body\].
    pub rate: Vector3<f64>,
    /// State of the actuators: `[thrust \[N\], 0, 0, 0]`, or four rotor speeds \[rad/s\].
    pub actuators: Vector4<f64>,
}

/// The time derivative of a [`State`], field by field, per second.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Derivative {
    /// \[m/s, world\].
    pub position: Vector3<f64>,
    /// \[m/s^2, world\].
    pub velocity: Vector3<f64>,
    /// \[1/s\].
    pub attitude: Quaternion<f64>,
    /// \[rad/s^2, body\].
    pub rate: Vector3<f64>,
    /// \[N/s\] or \[rad/s^2\].
    pub actuators: Vector4<f64>,
}

/// Equations of motion during an integration step. An implementation marked `#[inline(always)]` is expanded at each of the four
/// stages of a step, where the compiler computes common subexpressions once; a closure would be called four times.
pub trait EquationsOfMotion {
    /// Time derivative of `state`.
    fn derivative(&self, state: &State) -> Derivative;
}

impl State {
    /// At rest on the floor at the origin, level.
    pub fn on_floor() -> Self {
        Self {
            position: Vector3::zeros(),
            velocity: Vector3::zeros(),
            attitude: Quaternion::identity(),
            rate: Vector3::zeros(),
            actuators: Vector4::zeros(),
        }
    }

    /// Direction of the thrust, the body's z axis \[-, world\].
    #[inline]
    pub fn thrust_axis(&self) -> Vector3<f64> {
        let (x, y, z, w) = (self.attitude.i, self.attitude.j, self.attitude.k, self.attitude.w);
        Vector3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    }

    /// Rate of change of the attitude: `q_dot = q (x) [omega; 0] / 2`, Eq. (7), erratum E-07. The product is written out without
    /// the terms of the zero.
    #[inline]
    pub fn attitude_rate(&self) -> Quaternion<f64> {
        let [x, y, z, w] = self.attitude.coords.into();
        let [p, q, r] = self.rate.into();
        Quaternion::new(
            -x * p - y * q - z * r,
            w * p + y * r - z * q,
            w * q - x * r + z * p,
            w * r + x * q - y * p,
        ) * 0.5
    }

    /// Advances the state by `h` seconds, by one classic Runge-Kutta step of fourth order.
    #[inline(always)]
    pub fn advance(&mut self, h: f64, motion: &impl EquationsOfMotion) {
        let first = motion.derivative(self);
        let second = motion.derivative(&(*self + first * (h / 2.0)));
        let third = motion.derivative(&(*self + second * (h / 2.0)));
        let fourth = motion.derivative(&(*self + third * h));
        *self = *self + (first + second * 2.0 + third * 2.0 + fourth) * (h / 6.0);
        self.attitude *= self.attitude.norm().recip();
    }
}

impl Add<Derivative> for State {
    type Output = Self;

    #[inline]
    fn add(self, change: Derivative) -> Self {
        Self {
            position: self.position + change.position,
            velocity: self.velocity + change.velocity,
            attitude: self.attitude + change.attitude,
            rate: self.rate + change.rate,
            actuators: self.actuators + change.actuators,
        }
    }
}

impl Add for Derivative {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            position: self.position + other.position,
            velocity: self.velocity + other.velocity,
            attitude: self.attitude + other.attitude,
            rate: self.rate + other.rate,
            actuators: self.actuators + other.actuators,
        }
    }
}

impl Mul<f64> for Derivative {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f64) -> Self {
        Self {
            position: self.position * factor,
            velocity: self.velocity * factor,
            attitude: self.attitude * factor,
            rate: self.rate * factor,
            actuators: self.actuators * factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A body on a spring that spins.
    struct SpinningOscillator;

    impl EquationsOfMotion for SpinningOscillator {
        fn derivative(&self, state: &State) -> Derivative {
            Derivative {
                position: state.velocity,
                velocity: -state.position,
                attitude: state.attitude_rate(),
                rate: Vector3::zeros(),
                actuators: Vector4::zeros(),
            }
        }
    }

    /// A body that spins about z and swings on a spring has a closed form.
    #[test]
    fn a_step_is_of_fourth_order() {
        let error = |steps: u32| {
            let mut state =
                State { position: Vector3::x(), rate: Vector3::z() * 2.0, ..State::on_floor() };
            for _ in 0..steps {
                state.advance(1.0 / f64::from(steps), &SpinningOscillator);
            }
            let turned = Quaternion::new(1f64.cos(), 0.0, 0.0, 1f64.sin());
            (state.position.x - 1f64.cos()).abs() + (state.attitude - turned).norm()
        };
        let ratio = error(20) / error(40);
        assert!((14.0..18.0).contains(&ratio), "halving the step divided the error by {ratio}");
    }

    #[test]
    fn the_thrust_axis_is_the_rotated_z_axis() {
        let attitude = nalgebra::UnitQuaternion::from_euler_angles(0.3, -0.2, 1.1);
        let state = State { attitude: *attitude.quaternion(), ..State::on_floor() };
        assert!((state.thrust_axis() - attitude * Vector3::z()).norm() < 1e-15);
    }
}
