//! Model of the vehicle for prediction: a point mass under thrust, weight and drag, whose rate follows its command.
//! Not in the paper.
//!
//! One model serves all vehicles. The *demand* is the effect of an input on the rotation: the rate that the on-board loop
//! follows, Eq. (61), or the angular acceleration produced by a torque, Eq. (3). If the vehicle has its own attitude loop, that
//! loop produces the demanded rate. The [`Bias`] is a constant error of the demand and a constant external acceleration.

use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector3};

use crate::estimator::Estimate;
use crate::quantity::BodyRate;
use crate::quaternion::Attitude;
use crate::rigid_body::{Inertia, quaternion_rate};
use crate::tracking_error::AttitudeError;

/// Longest step of the fine integration \[s\]: with a lag of 50 ms its error is below `1e-7` of the change in that step.
const FINE_STEP_S: f64 = 5e-3;

/// Longest coarse step of the integration \[s\].
const COARSE_STEP_S: f64 = 20e-3;

/// Longest coarse step over the shortest time constant of the vehicle \[-\]: the error of a step is then below 3 % of the change
/// in that step.
const COARSE_SHARE: f64 = 0.4;

/// Shortest lag of the thrust \[s\]; shorter lags are replaced by it, without an effect on a flight.
pub(super) const SHORTEST_LAG_S: f64 = 1e-3;

/// `[position; velocity; attitude; rate]`.
type Vector13 = SVector<f64, 13>;

/// Dynamics of the rotation under a demand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rotation {
    /// The rate follows the demanded rate with this lag \[s\].
    RateLoop {
        /// Time constant \[s\], positive.
        lag_s: f64,
    },
    /// The rate follows, with a lag, the rate demanded by the on-board attitude loop.
    AttitudeLoop {
        /// Gain from the attitude error to the demanded rate \[1/s\], positive.
        gain_per_s: f64,
        /// Greatest demanded rate about each axis \[rad/s, body axes\].
        greatest_rate: Vector3<f64>,
        /// Time constant of the rate \[s\], positive.
        lag_s: f64,
    },
    /// The angular acceleration is the demand minus the gyroscopic term.
    RigidBody {
        /// The inertia of the body.
        inertia: Inertia,
    },
}

/// Integration method.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integration {
    /// The classic Runge-Kutta method of fourth order in short steps, for control.
    #[default]
    Fine,
    /// The midpoint method in long steps, for limits and the gate of poses, where an error of a hundredth of a motion over few
    /// periods is acceptable.
    Coarse,
}

/// A step of the integration, the same for every step of a motion.
struct IntegrationStep {
    /// Length \[s\].
    h: f64,
    /// Shares of the thrust's difference from the commanded one that remain after half the step and after all of it \[0..1\]: the
    /// thrust has a lag of its own, so that this is exact.
    decay: [f64; 2],
}

/// Parameters of the vehicle that the predictor uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleModel {
    /// Dynamics of the rotation.
    pub rotation: Rotation,
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Gravity \[m/s^2\], along -z of the world.
    pub gravity_m_s2: f64,
    /// Linear drag per mass \[1/s\].
    pub drag_per_s: f64,
    /// Time constant of the thrust \[s\]; 0 for none.
    pub thrust_lag_s: f64,
    /// Integration method.
    pub integration: Integration,
}

/// Input of the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModelInput {
    /// The demand: a rate \[rad/s, body axes\] or an angular acceleration \[rad/s^2, body axes\].
    pub demand: Vector3<f64>,
    /// Attitude to be held in place of the demand, body to world.
    pub attitude: Attitude,
    /// Thrust along body z \[N\].
    pub thrust_n: f64,
}

/// Disturbances in addition to the input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bias {
    /// Added to every demand \[rad/s or rad/s^2, body axes\].
    pub demand: Vector3<f64>,
    /// Added to the acceleration \[m/s^2, world\].
    pub acceleration: Vector3<f64>,
}

/// State of the model: motion and thrust.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Position \[m, world\].
    pub position: Vector3<f64>,
    /// Velocity \[m/s, world\].
    pub velocity: Vector3<f64>,
    /// Attitude, body to world.
    pub attitude: Attitude,
    /// Body rate \[rad/s, body axes\].
    pub rate: Vector3<f64>,
    /// Thrust along body z \[N\].
    pub thrust_n: f64,
}

impl ModelInput {
    /// The input between this one and `other` \[0..1\].
    pub fn towards(&self, other: &Self, share: f64) -> Self {
        Self {
            demand: self.demand.lerp(&other.demand, share),
            attitude: self.attitude.turned_by(self.attitude.rotation_to(&other.attitude) * share),
            thrust_n: self.thrust_n + (other.thrust_n - self.thrust_n) * share,
        }
    }
}

impl Motion {
    /// Motion of `estimate` with the thrust `thrust_n` \[N\].
    pub fn of(estimate: &Estimate, thrust_n: f64) -> Self {
        let Estimate { position, velocity, attitude, rate: BodyRate(rate) } = *estimate;
        Self { position, velocity, attitude, rate, thrust_n }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let vectors = [self.position, self.velocity, self.rate];
        vectors.iter().flatten().all(|number| number.is_finite())
            && self.attitude.is_finite()
            && self.thrust_n.is_finite()
    }

    #[inline]
    fn vector(&self) -> Vector13 {
        vector13(&self.position, &self.velocity, self.attitude.xyzw(), &self.rate)
    }

    #[inline]
    fn from_vector(x: &Vector13, thrust_n: f64) -> Self {
        let q = Quaternion::new(x[9], x[6], x[7], x[8]);
        Self {
            position: x.fixed_rows::<3>(0).into(),
            velocity: x.fixed_rows::<3>(3).into(),
            attitude: Attitude::from_unit_quaternion(UnitQuaternion::new_normalize(q)),
            rate: x.fixed_rows::<3>(10).into(),
            thrust_n,
        }
    }
}

impl VehicleModel {
    /// The motion `dt_s` \[s\] after `motion` under `input` and `bias`.
    pub fn advance(&self, motion: &Motion, input: &ModelInput, bias: &Bias, dt_s: f64) -> Motion {
        let steps = (dt_s / self.longest_step_s()).ceil().clamp(1.0, 1000.0);
        let h = dt_s / steps;
        let step = match self.integration {
            Integration::Fine => Self::classic_step,
            Integration::Coarse => Self::midpoint_step,
        };
        let lag_s = self.thrust_lag_s.max(SHORTEST_LAG_S);
        let of_step = IntegrationStep { h, decay: [h / 2.0, h].map(|t_s| (-t_s / lag_s).exp()) };
        (0..steps as u32).fold(*motion, |motion, _| step(self, &motion, (input, bias), &of_step))
    }

    fn longest_step_s(&self) -> f64 {
        let rotation_s = match &self.rotation {
            Rotation::RateLoop { lag_s } => *lag_s,
            Rotation::AttitudeLoop { gain_per_s, lag_s, .. } => lag_s.min(gain_per_s.recip()),
            Rotation::RigidBody { .. } => f64::INFINITY,
        };
        // Both steps are stable up to twice the lag.
        let fine_s = FINE_STEP_S.min(rotation_s);
        if self.integration == Integration::Fine {
            return fine_s;
        }
        let thrust_s = if self.thrust_lag_s > 0.0 { self.thrust_lag_s } else { f64::INFINITY };
        (COARSE_SHARE * rotation_s.min(thrust_s)).clamp(fine_s, COARSE_STEP_S)
    }

    /// One Runge-Kutta step of fourth order.
    fn classic_step(
        &self,
        motion: &Motion,
        (input, bias): (&ModelInput, &Bias),
        &IntegrationStep { h, decay: [half, whole] }: &IntegrationStep,
    ) -> Motion {
        let off_n = motion.thrust_n - input.thrust_n;
        let [start, middle, end] = [1.0, half, whole].map(|share| input.thrust_n + off_n * share);
        let x = motion.vector();
        // A loop instead of four statements, so that the derivative is compiled once.
        let (mut slope, mut sum) = (Vector13::zeros(), Vector13::zeros());
        for (ahead, weight, thrust_n) in
            [(0.0, 1.0, start), (h / 2.0, 2.0, middle), (h / 2.0, 2.0, middle), (h, 1.0, end)]
        {
            let stage = Motion::from_vector(&(x + slope * ahead), thrust_n);
            slope = self.derivative(&stage, input, bias);
            sum += slope * weight;
        }
        Motion::from_vector(&(x + sum * (h / 6.0)), end)
    }

    /// One step by the midpoint method.
    fn midpoint_step(
        &self,
        motion: &Motion,
        (input, bias): (&ModelInput, &Bias),
        &IntegrationStep { h, decay }: &IntegrationStep,
    ) -> Motion {
        let off_n = motion.thrust_n - input.thrust_n;
        let [middle, end] = decay.map(|share| input.thrust_n + off_n * share);
        let x = motion.vector();
        let half = x + self.derivative(motion, input, bias) * (h / 2.0);
        let slope = self.derivative(&Motion::from_vector(&half, middle), input, bias);
        Motion::from_vector(&(x + slope * h), end)
    }

    // A call would cost as much as a third of its body.
    #[inline(always)]
    fn derivative(&self, motion: &Motion, input: &ModelInput, bias: &Bias) -> Vector13 {
        let rate_dot = match &self.rotation {
            // Eq. (61), erratum E-61, with the lag of the on-board loop
            Rotation::RateLoop { lag_s } => (input.demand + bias.demand - motion.rate) / *lag_s,
            Rotation::AttitudeLoop { gain_per_s, greatest_rate, lag_s } => {
                let left = 2.0 * AttitudeError::between(&motion.attitude, &input.attitude).eps();
                let demand = (left * *gain_per_s)
                    .zip_map(greatest_rate, |rate, limit| rate.clamp(-limit, limit));
                (demand + bias.demand - motion.rate) / *lag_s
            }
            // Eq. (3), erratum E-03
            Rotation::RigidBody { inertia } => {
                input.demand + bias.demand
                    - inertia.inverse() * inertia.gyroscopic_torque(BodyRate(motion.rate)).0
            }
        };
        // Newton's law, in the world frame
        let acceleration = motion.attitude.to_world(&Vector3::z())
            * (motion.thrust_n / self.mass_kg)
            - Vector3::z() * self.gravity_m_s2
            - motion.velocity * self.drag_per_s
            + bias.acceleration;
        let attitude_dot = quaternion_rate(&motion.attitude, BodyRate(motion.rate));
        vector13(&motion.velocity, &acceleration, attitude_dot.into(), &rate_dot)
    }
}

/// Vector of these parts, written element by element: an iterator over the chained parts takes several times as long as the
/// derivative itself.
#[inline]
fn vector13(
    position: &Vector3<f64>,
    velocity: &Vector3<f64>,
    attitude: [f64; 4],
    rate: &Vector3<f64>,
) -> Vector13 {
    let [x, y, z, w] = attitude;
    let ([px, py, pz], [vx, vy, vz]) = ((*position).into(), (*velocity).into());
    Vector13::from([px, py, pz, vx, vy, vz, x, y, z, w, rate.x, rate.y, rate.z])
}
