//! Equations of motion of the simulated vehicles: state and input in, derivative out.

use nalgebra::{Matrix4, Vector3, Vector4};
use oqtal_config::{Fidelity, Interface, PlantOptions};
use oqtal_control::quantity::{BodyRate, Torque};
use oqtal_control::rigid_body::Inertia;

use crate::state::{Derivative, State};

/// The command in effect.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlantInput {
    /// Sticks `[delta_r, delta_p, delta_y]` of Eq. (61) \[-1..1, body\].
    pub sticks: Vector3<f64>,
    /// Torque \[N m, body\].
    pub torque: Vector3<f64>,
    /// Collective thrust `delta_c` of Eq. (61) \[0..1\].
    pub thrust: f64,
}

/// Disturbances by the surroundings, constant over an integration step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disturbance {
    /// Acceleration by gusts and constant forces \[m/s^2, world\].
    pub acceleration: Vector3<f64>,
    /// Bias of the on-board rate loop \[rad/s, body\].
    pub rate_drift: Vector3<f64>,
    /// Battery voltage over the nominal one \[-\]; 1 where thrust does not depend on the voltage.
    pub voltage_ratio: f64,
}

/// The equations of motion of a vehicle.
#[derive(Clone, Debug)]
pub enum Dynamics {
    /// Table I: torque in.
    Spacecraft(Spacecraft),
    /// Eq. (61): the rate follows the sticks.
    Eq61(Eq61),
    /// Four rotors and the on-board rate loop.
    Rotors(Box<Rotors>),
}

impl Dynamics {
    /// The equations of motion of the simulated vehicle that `plant` describes.
    #[must_use]
    pub fn new(plant: &PlantOptions) -> Self {
        match (plant.interface, plant.fidelity) {
            (Interface::Torque, _) => Self::Spacecraft(Spacecraft::new(plant)),
            (Interface::Rate, Fidelity::Eq61) => Self::Eq61(Eq61::new(plant)),
            (Interface::Rate, Fidelity::Rotors) => Self::Rotors(Box::new(Rotors::new(plant))),
        }
    }

    /// The state `h` seconds after `state`, under a constant input and disturbance.
    #[must_use]
    pub fn step(
        &self,
        state: &State,
        h: f64,
        input: &PlantInput,
        disturbance: &Disturbance,
    ) -> State {
        // One dispatch a step in place of one at each of the four Runge-Kutta stages.
        match self {
            Self::Spacecraft(it) => state.step(h, |s| it.derivative(s, input, disturbance)),
            Self::Eq61(it) => state.step(h, |s| it.derivative(s, input, disturbance)),
            Self::Rotors(it) => state.step(h, |s| it.derivative(s, input, disturbance)),
        }
    }

    /// Thrust now \[N\].
    #[must_use]
    pub fn thrust(&self, state: &State) -> f64 {
        match self {
            Self::Spacecraft(_) | Self::Eq61(_) => state.actuators.x,
            Self::Rotors(vehicle) => vehicle.thrust_coefficient * state.actuators.norm_squared(),
        }
    }
}

/// Translation, which all vehicles share: a point mass under thrust, weight, drag and gusts.
#[derive(Clone, Debug)]
struct Translation {
    per_mass: f64,
    gravity: f64,
    drag: f64,
}

impl Translation {
    fn new(plant: &PlantOptions) -> Self {
        let per_mass = plant.mass_kg.recip();
        Self { per_mass, gravity: plant.gravity_m_s2, drag: plant.drag_per_s }
    }

    /// Newton's law in the world frame, in place of Eq. (15), erratum E-15.
    #[inline]
    fn acceleration(&self, state: &State, thrust: f64, disturbance: &Disturbance) -> Vector3<f64> {
        state.thrust_axis() * (thrust * self.per_mass)
            - Vector3::z() * self.gravity
            - state.velocity * self.drag
            + disturbance.acceleration
    }
}

/// Bandwidth \[1/s\] of a first-order lag \[ms\]. A lag below a millisecond, the integration step, is taken as a millisecond:
/// the integrator is stable down to it, and thrust stays a state.
fn bandwidth(lag_ms: f64) -> f64 {
    1e3 / lag_ms.max(1.0)
}

/// A rigid body with torque input, as the lander of Table I.
#[derive(Clone, Debug)]
pub struct Spacecraft {
    translation: Translation,
    inertia: Inertia,
    max_thrust: f64,
    thrust_bandwidth: f64,
}

impl Spacecraft {
    fn new(plant: &PlantOptions) -> Self {
        Self {
            translation: Translation::new(plant),
            inertia: plant.inertia().expect("the configuration was checked"),
            max_thrust: plant.max_thrust_n,
            thrust_bandwidth: bandwidth(plant.thrust_lag_ms),
        }
    }

    #[inline]
    fn derivative(
        &self,
        state: &State,
        input: &PlantInput,
        disturbance: &Disturbance,
    ) -> Derivative {
        let thrust = state.actuators.x;
        Derivative {
            position: state.velocity,
            velocity: self.translation.acceleration(state, thrust, disturbance),
            attitude: state.attitude_rate(),
            // Eq. (3), erratum E-03.
            rate: self.inertia.acceleration(BodyRate(state.rate), Torque(input.torque)).0,
            actuators: Vector4::x()
                * ((input.thrust * self.max_thrust - thrust) * self.thrust_bandwidth),
        }
    }
}

/// The Hummingbird by Eq. (61), with the lags of a real vehicle.
#[derive(Clone, Debug)]
pub struct Eq61 {
    translation: Translation,
    authority: Vector3<f64>,
    rate_bandwidth: f64,
    max_thrust: f64,
    thrust_bandwidth: f64,
}

impl Eq61 {
    fn new(plant: &PlantOptions) -> Self {
        Self {
            translation: Translation::new(plant),
            authority: Vector3::from(plant.rate_authority_rad_s),
            rate_bandwidth: 1e3 / plant.rate_lag_ms,
            max_thrust: plant.max_thrust_n,
            thrust_bandwidth: bandwidth(plant.thrust_lag_ms),
        }
    }

    #[inline]
    fn derivative(
        &self,
        state: &State,
        input: &PlantInput,
        disturbance: &Disturbance,
    ) -> Derivative {
        let thrust = state.actuators.x;
        // Eq. (61), erratum E-61: the rate that the on-board loop follows, its bias included.
        let rate_command = self.authority.component_mul(&input.sticks) + disturbance.rate_drift;
        // The thrust of a rotor is proportional to the square of its voltage.
        let greatest = self.max_thrust * disturbance.voltage_ratio.powi(2);
        Derivative {
            position: state.velocity,
            velocity: self.translation.acceleration(state, thrust, disturbance),
            attitude: state.attitude_rate(),
            rate: (rate_command - state.rate) * self.rate_bandwidth,
            actuators: Vector4::x() * ((input.thrust * greatest - thrust) * self.thrust_bandwidth),
        }
    }
}

/// The Hummingbird as four rotors on two crossed arms along body x and y, with its on-board rate loop. Front and back rotor turn
/// one way, left and right rotor the other.
#[derive(Clone, Debug)]
pub struct Rotors {
    translation: Translation,
    inertia: Inertia,
    authority: Vector3<f64>,
    rate_lag: f64,
    max_thrust: f64,
    thrust_coefficient: f64,
    rotor_lag: f64,
    max_speed: f64,
    /// From squared rotor speeds \[(rad/s)^2\] to `[thrust \[N\]; torque \[N m\]]`.
    mix: Matrix4<f64>,
    /// Inverse of `mix`.
    unmix: Matrix4<f64>,
}

impl Rotors {
    fn new(plant: &PlantOptions) -> Self {
        let rotors = &plant.rotors;
        let (k, d) = (rotors.thrust_coefficient, rotors.torque_coefficient);
        let arm = k * rotors.arm_m;
        // Columns: front (+x), left (+y), back (-x), right (-y). Lift at +y rolls the vehicle about +x.
        let mix = Matrix4::new(
            k, k, k, k, //
            0.0, arm, 0.0, -arm, //
            -arm, 0.0, arm, 0.0, //
            -d, d, -d, d,
        );
        Self {
            translation: Translation::new(plant),
            inertia: plant.inertia().expect("the configuration was checked"),
            authority: Vector3::from(plant.rate_authority_rad_s),
            rate_lag: plant.rate_lag_ms * 1e-3,
            max_thrust: plant.max_thrust_n,
            thrust_coefficient: k,
            rotor_lag: rotors.lag_ms * 1e-3,
            max_speed: rotors.max_speed_rad_s,
            mix,
            unmix: mix.try_inverse().expect("arm and coefficients are above zero"),
        }
    }

    #[inline]
    fn derivative(
        &self,
        state: &State,
        input: &PlantInput,
        disturbance: &Disturbance,
    ) -> Derivative {
        let speeds = state.actuators;
        let wrench = self.mix * speeds.component_mul(&speeds);
        let torque = wrench.fixed_rows::<3>(1).into_owned();
        let targets = self.on_board_loop(state, input, disturbance);
        Derivative {
            position: state.velocity,
            velocity: self.translation.acceleration(state, wrench.x, disturbance),
            attitude: state.attitude_rate(),
            // Eq. (3), erratum E-03.
            rate: self.inertia.acceleration(BodyRate(state.rate), Torque(torque)).0,
            actuators: (targets - speeds) / self.rotor_lag,
        }
    }

    /// Rotor speeds \[rad/s\] commanded by the on-board rate loop: proportional in the rate with the loop's time constant,
    /// gyroscopic torque compensated, thrust curve inverted; rate drift and battery voltage are not compensated.
    fn on_board_loop(
        &self,
        state: &State,
        input: &PlantInput,
        disturbance: &Disturbance,
    ) -> Vector4<f64> {
        if input.thrust <= 0.0 {
            return Vector4::zeros();
        }
        // Eq. (61), erratum E-61.
        let rate_command = self.authority.component_mul(&input.sticks) + disturbance.rate_drift;
        let torque = self.inertia.matrix() * ((rate_command - state.rate) / self.rate_lag)
            + self.inertia.gyroscopic_torque(BodyRate(state.rate)).0;
        let wrench = Vector4::new(input.thrust * self.max_thrust, torque.x, torque.y, torque.z);
        let limit = self.max_speed;
        (self.unmix * wrench)
            .map(|squared| squared.max(0.0).sqrt().min(limit) * disturbance.voltage_ratio)
    }
}
