//! The two input forms of a vehicle: torque and rate. A law is written once for both; they differ in the input matrix `B`, in the
//! range of the input, and in whether the body rate is a state.

use std::fmt;

use nalgebra::{Matrix3, Matrix6, Matrix6x3, Vector3};

use crate::options::{OptionError, Rule, check_options};
use crate::quantity::{BodyRate, StickCommand, Torque};
use crate::rigid_body::Inertia;
use crate::tracking_error::{AttitudeError, AttitudeReference};

/// The linear model `omega_dot = A omega + B u`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateModel {
    /// `A` \[1/s, body axes\].
    pub a: Matrix3<f64>,
    /// `B` \[rad/s^2 per unit of the input, body axes\].
    pub b: Matrix3<f64>,
}

/// Properties of the vehicle's input `u` for a law.
pub trait InputForm {
    /// The command message type that carries `u`; the default is zero torque or centred sticks.
    type Command: Copy + fmt::Debug + Default + PartialEq;

    /// The inertia of the body if `u` is a torque. `None` if the vehicle has its own rate loop: the rate is then not a state of
    /// the law's model ("nullified", Section VII.C).
    fn inertia(&self) -> Option<&Inertia>;

    /// The input matrix `B` for a model with the state `[rate; attitude]` and the state matrix `a`.
    fn input_matrix(&self, a: &Matrix6<f64>) -> Matrix6x3<f64>;

    /// The `u` that produces `demand`: an angular acceleration \[rad/s^2\] if `u` is a torque, a rate \[rad/s\] if `u` commands a
    /// rate.
    fn input_for(&self, demand: &Vector3<f64>) -> Vector3<f64>;

    /// The demand that `u` produces: the inverse of [`input_for`](Self::input_for).
    fn demand_of(&self, u: &Vector3<f64>) -> Vector3<f64>;

    /// The model of the rate after cancellation of the gyroscopic torque; `None` if the rate follows `u` at once.
    fn rate_model(&self) -> Option<RateModel>;

    /// Angular deceleration available about any axis \[rad/s^2\]; infinite if the vehicle's own loop stops the
    /// rotation.
    fn braking(&self) -> f64 {
        f64::INFINITY
    }

    /// Feed-forward `u`, with which a body without error follows its reference.
    fn feed_forward(
        &self,
        error: &AttitudeError,
        omega_e: &Vector3<f64>,
        reference: &AttitudeReference,
    ) -> Vector3<f64>;

    /// `u` limited to the vehicle's range; zero if `u` is not finite.
    fn saturate(&self, u: &Vector3<f64>) -> Vector3<f64>;

    /// Converts `u` to a command.
    fn command_from(u: Vector3<f64>) -> Self::Command;

    /// Converts a command to `u`.
    fn u_from(command: Self::Command) -> Vector3<f64>;

    /// Sets the lag of the rate behind `u` in the feed-forward \[s\]; without effect for a vehicle without this lag.
    fn set_rate_lag(&mut self, _lag_s: f64, _period_s: f64) {}

    /// `omega x J omega`, the gyroscopic torque that `u` must cancel \[N m, body axes\]; zero in rate form.
    fn gyroscopic(&self, omega: BodyRate) -> Vector3<f64> {
        self.inertia().map_or_else(Vector3::zeros, |inertia| inertia.gyroscopic_torque(omega).0)
    }
}

/// Torque input \[N m, body axes\], as for the spacecraft, Eq. (3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueInput {
    inertia: Inertia,
    max_torque: f64,
}

impl TorqueInput {
    /// A body with this inertia and a maximum torque of `max_torque` about each axis \[N m\].
    ///
    /// # Errors
    /// If `max_torque` is not positive and finite.
    pub fn new(inertia: Inertia, max_torque: f64) -> Result<Self, OptionError> {
        check_options([("max-torque-n-m", max_torque, Rule::Positive)])?;
        Ok(Self { inertia, max_torque })
    }
}

impl InputForm for TorqueInput {
    type Command = Torque;

    fn inertia(&self) -> Option<&Inertia> {
        Some(&self.inertia)
    }

    fn input_matrix(&self, _: &Matrix6<f64>) -> Matrix6x3<f64> {
        let mut b = Matrix6x3::zeros();
        // Eqs. (4), (31), (47), (48)
        b.fixed_view_mut::<3, 3>(0, 0).copy_from(self.inertia.inverse());
        b
    }

    fn input_for(&self, demand: &Vector3<f64>) -> Vector3<f64> {
        self.inertia.matrix() * demand
    }

    fn demand_of(&self, u: &Vector3<f64>) -> Vector3<f64> {
        self.inertia.inverse() * u
    }

    fn rate_model(&self) -> Option<RateModel> {
        Some(RateModel { a: Matrix3::zeros(), b: *self.inertia.inverse() })
    }

    fn braking(&self) -> f64 {
        // About the axis of greatest inertia. Half of the torque is left for other demands.
        0.5 * self.max_torque / self.inertia.matrix().symmetric_eigenvalues().max()
    }

    fn feed_forward(
        &self,
        error: &AttitudeError,
        omega_e: &Vector3<f64>,
        reference: &AttitudeReference,
    ) -> Vector3<f64> {
        // Eq. (40), erratum E-40: J (C omega_d_dot - omega_e x C omega_d)
        self.input_for(&error.reference_acceleration(omega_e, reference).0)
    }

    #[inline]
    fn saturate(&self, u: &Vector3<f64>) -> Vector3<f64> {
        if !is_finite(u) {
            return Vector3::zeros();
        }
        // Eq. (19), erratum E-19. Dividing first keeps rounding from exceeding the limit.
        let largest = u.amax();
        if largest <= self.max_torque { *u } else { u / largest * self.max_torque }
    }

    fn command_from(u: Vector3<f64>) -> Torque {
        Torque(u)
    }

    fn u_from(command: Torque) -> Vector3<f64> {
        command.0
    }
}

/// Stick input \[-1..1\]: the vehicle's own loop makes the body rate proportional to the sticks, as for the Hummingbird, Eq.
/// (61).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateInput {
    rate_authority: Vector3<f64>,
    lag_s: f64,
    /// Lead time with which a change of the rate is commanded \[s\].
    lead_s: f64,
}

impl RateInput {
    /// A vehicle that turns at `rate_authority` at full stick: `[K_phi, K_theta, K_psi]` \[rad/s, body axes\].
    ///
    /// # Errors
    /// If one of them is not positive and finite.
    pub fn new(rate_authority: Vector3<f64>) -> Result<Self, OptionError> {
        for authority in &rate_authority {
            check_options([("rate-authority-rad-s", *authority, Rule::Positive)])?;
        }
        Ok(Self { rate_authority, lag_s: 0.0, lead_s: 0.0 })
    }

    /// The same input for a law whose model includes the lag of the rate, with time constant `lag_s` \[s\], and commands held for
    /// `period_s` \[s\]. The models of the paper's laws do not include it.
    ///
    /// # Errors
    /// If one of them is not positive and finite.
    pub fn with_lag(self, lag_s: f64, period_s: f64) -> Result<Self, OptionError> {
        check_options([
            ("rate-lag-s", lag_s, Rule::Positive),
            ("period-s", period_s, Rule::Positive),
        ])?;
        Ok(Self { lag_s, lead_s: lead_s(lag_s, period_s), ..self })
    }
}

/// Lead time for a rate that follows with `lag_s` under commands held for `period_s` \[s\].
fn lead_s(lag_s: f64, period_s: f64) -> f64 {
    // A held command moves the rate by (1 - e^(-T/lag)) (u - omega): for omega_d to grow by T
    // omega_d_dot it must be ahead by T / (1 - e^(-T/lag)), which is the lag and half a period.
    period_s / -(-period_s / lag_s).exp_m1()
}

impl InputForm for RateInput {
    type Command = StickCommand;

    fn inertia(&self) -> Option<&Inertia> {
        None
    }

    fn input_matrix(&self, a: &Matrix6<f64>) -> Matrix6x3<f64> {
        let mut b = Matrix6x3::zeros();
        // Eq. (61), erratum E-61, put for the rate in the lower left block of A: B = A_eps_omega
        // K_delta
        let k_delta = Matrix3::from_diagonal(&self.rate_authority);
        b.fixed_view_mut::<3, 3>(3, 0).copy_from(&(a.fixed_view::<3, 3>(3, 0) * k_delta));
        b
    }

    fn input_for(&self, demand: &Vector3<f64>) -> Vector3<f64> {
        // Eq. (61), erratum E-61
        demand.component_div(&self.rate_authority)
    }

    fn demand_of(&self, u: &Vector3<f64>) -> Vector3<f64> {
        u.component_mul(&self.rate_authority)
    }

    fn rate_model(&self) -> Option<RateModel> {
        let k_delta = Matrix3::from_diagonal(&self.rate_authority);
        // Eq. (61), erratum E-61, with the lag of the vehicle's own loop
        (self.lag_s > 0.0).then(|| RateModel {
            a: Matrix3::from_diagonal_element(-1.0 / self.lag_s),
            b: k_delta / self.lag_s,
        })
    }

    fn feed_forward(
        &self,
        error: &AttitudeError,
        omega_e: &Vector3<f64>,
        reference: &AttitudeReference,
    ) -> Vector3<f64> {
        // The lag takes the place of the inertia: acceleration times lag is the additional rate to be commanded.
        let acceleration = error.reference_acceleration(omega_e, reference).0;
        self.input_for(&(error.rotation() * reference.rate.0 + acceleration * self.lead_s))
    }

    #[inline]
    fn saturate(&self, u: &Vector3<f64>) -> Vector3<f64> {
        // Each stick is limited separately: a saturated yaw does not reduce roll and pitch.
        if is_finite(u) { u.map(|stick| stick.clamp(-1.0, 1.0)) } else { Vector3::zeros() }
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        if self.lag_s > 0.0 && lag_s > 0.0 {
            self.lead_s = lead_s(lag_s, period_s);
        }
    }

    fn command_from(u: Vector3<f64>) -> StickCommand {
        StickCommand(u)
    }

    fn u_from(command: StickCommand) -> Vector3<f64> {
        command.0
    }
}

fn is_finite(u: &Vector3<f64>) -> bool {
    u.iter().all(|component| component.is_finite())
}
