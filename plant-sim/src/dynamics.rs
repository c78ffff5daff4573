//! Equations of motion of the simulated vehicles: state and input in, derivative out.

use nalgebra::{Matrix4, Quaternion, Vector3, Vector4};
use oqtal_config::{Fidelity, Interface, PlantOptions};
use oqtal_control::quantity::{BodyRate, Torque};
use oqtal_control::rigid_body::Inertia;

use crate::input::{Disturbance, PlantInput};
use crate::rotors::{AirForces, RotorAir, mix};
use crate::state::{Derivative, EquationsOfMotion, State};

/// The equations of motion of a vehicle.
#[derive(Clone, Debug)]
pub struct Dynamics {
    translation: Translation,
    body: Body,
}

/// Model of the forces and torques on the vehicle.
#[derive(Clone, Debug)]
enum Body {
    /// Table I: torque in.
    Spacecraft(Spacecraft),
    /// Eq. (61): the rate follows its command.
    Eq61(Eq61),
    /// Four rotors with the on-board rate loop.
    Rotors(Box<Rotors>),
}

/// The response of a body to its input.
struct Response {
    /// Thrust along body z \[N\].
    thrust: f64,
    /// Drag of the rotors \[N, world\].
    drag: Vector3<f64>,
    /// Angular acceleration \[rad/s^2, body\].
    rate: Vector3<f64>,
    /// Change of the actuators \[N/s\] or \[rad/s^2\].
    actuators: Vector4<f64>,
}

/// A model of the forces and torques on a vehicle.
trait Responsive {
    /// The response of the body in `state`.
    fn response(&self, state: &State, input: &PlantInput, outer: &Disturbance) -> Response;
}

/// A vehicle during an integration step.
struct Moved<'a, B> {
    translation: &'a Translation,
    body: &'a B,
    input: &'a PlantInput,
    outer: &'a Disturbance,
}

impl<B: Responsive> EquationsOfMotion for Moved<'_, B> {
    #[inline(always)]
    fn derivative(&self, state: &State) -> Derivative {
        let response = self.body.response(state, self.input, self.outer);
        self.translation.derivative(state, response, self.outer)
    }
}

impl Dynamics {
    /// The equations of motion of the simulated vehicle that `plant` describes.
    pub fn new(plant: &PlantOptions) -> Self {
        let body = match (plant.interface, plant.fidelity) {
            (Interface::Torque, _) => Body::Spacecraft(Spacecraft::new(plant)),
            (_, Fidelity::Eq61) => Body::Eq61(Eq61::new(plant)),
            (_, Fidelity::Rotors) => Body::Rotors(Box::new(Rotors::new(plant))),
        };
        Self { translation: Translation::new(plant), body }
    }

    /// Advances `state` by `h` seconds under a constant input and disturbance.
    pub fn advance(&self, state: &mut State, h: f64, input: &PlantInput, outer: &Disturbance) {
        let Self { translation, body } = self;
        // One dispatch per step instead of one at each of the four Runge-Kutta stages.
        match body {
            Body::Spacecraft(body) => state.advance(h, &Moved { translation, body, input, outer }),
            // The same statement twice: here the compiler omits the terms that this vehicle does not have.
            Body::Eq61(body) if body.is_plain() => {
                state.advance(h, &Moved { translation, body, input, outer });
            }
            Body::Eq61(body) => state.advance(h, &Moved { translation, body, input, outer }),
            Body::Rotors(body) => {
                state.advance(h, &Moved { translation, body: &**body, input, outer });
            }
        }
    }

    /// Present thrust \[N\].
    pub fn thrust(&self, state: &State) -> f64 {
        let Body::Rotors(rotors) = &self.body else { return state.actuators.x };
        rotors.thrust_coefficient * state.actuators.norm_squared()
    }

    /// State of the actuators at which the thrust supports the weight.
    pub fn hovering(&self) -> Vector4<f64> {
        let weight_n = self.translation.gravity / self.translation.per_mass;
        let Body::Rotors(rotors) = &self.body else { return Vector4::x() * weight_n };
        Vector4::repeat((weight_n / (4.0 * rotors.thrust_coefficient)).sqrt())
    }
}

/// Translation, common to all vehicles: a point mass under thrust, weight, drag and gusts.
#[derive(Clone, Debug)]
struct Translation {
    per_mass: f64,
    gravity: f64,
    drag: f64,
}

impl Translation {
    fn new(plant: &PlantOptions) -> Self {
        let (per_mass, gravity) = (plant.mass_kg.recip(), plant.gravity_m_s2);
        Self { per_mass, gravity, drag: plant.drag_per_s }
    }

    /// Derivative of `state` for a body with the response `response`.
    #[inline(always)]
    fn derivative(
        &self,
        state: &State,
        response: Response,
        disturbance: &Disturbance,
    ) -> Derivative {
        Derivative {
            position: state.velocity,
            velocity: self.acceleration(state, (response.thrust, response.drag), disturbance),
            attitude: state.attitude_rate(),
            rate: response.rate + disturbance.angular_acceleration,
            actuators: response.actuators,
        }
    }

    /// Newton's law in the world frame, in place of Eq. (15), erratum E-15.
    #[inline(always)]
    fn acceleration(
        &self,
        state: &State,
        (thrust, rotor_drag): (f64, Vector3<f64>),
        disturbance: &Disturbance,
    ) -> Vector3<f64> {
        let per_mass = self.per_mass * disturbance.mass_ratio;
        state.thrust_axis() * (thrust * per_mass)
            - Vector3::z() * self.gravity
            - state.velocity * (self.drag * disturbance.mass_ratio)
            + rotor_drag * per_mass
            + disturbance.acceleration
    }
}

/// Thrust that follows its command with a first-order lag.
#[derive(Clone, Debug)]
struct LaggedThrust {
    greatest: f64,
    bandwidth: f64,
}

impl LaggedThrust {
    fn new(plant: &PlantOptions) -> Self {
        // A lag is at least one integration step, 1 ms: the integrator is stable, and thrust remains a state.
        Self { greatest: plant.max_thrust_n, bandwidth: 1e3 / plant.thrust_lag_ms.max(1.0) }
    }

    /// Rate of change of the actuators towards the collective thrust `delta_c`; `share` scales the greatest thrust \[-\].
    #[inline(always)]
    fn change(&self, thrust: f64, delta_c: f64, share: f64) -> Vector4<f64> {
        let change = (delta_c * (self.greatest * share) - thrust) * self.bandwidth;
        Vector4::new(change, 0.0, 0.0, 0.0)
    }
}

/// Rigid body with torque input, like the lander of Table I.
#[derive(Clone, Debug)]
struct Spacecraft {
    inertia: Inertia,
    thrust: LaggedThrust,
}

impl Spacecraft {
    fn new(plant: &PlantOptions) -> Self {
        let inertia = plant.inertia().expect("the configuration was checked");
        Self { inertia, thrust: LaggedThrust::new(plant) }
    }
}

impl Responsive for Spacecraft {
    #[inline(always)]
    fn response(&self, state: &State, input: &PlantInput, _outer: &Disturbance) -> Response {
        let thrust = state.actuators.x;
        Response {
            thrust,
            drag: Vector3::zeros(),
            // Eq. (3), erratum E-03.
            rate: self.inertia.acceleration(BodyRate(state.rate), Torque(input.torque)).0,
            actuators: self.thrust.change(thrust, input.thrust, 1.0),
        }
    }
}

/// On-board loop that sets the body rate: from the sticks, or from the error of the commanded attitude.
#[derive(Clone, Debug)]
struct RateCommand {
    authority: Vector3<f64>,
    /// Gain from attitude error to body rate \[1/s\]; `None` if the sticks command the rate.
    attitude_gain: Option<f64>,
}

impl RateCommand {
    fn new(plant: &PlantOptions) -> Self {
        Self {
            authority: Vector3::from(plant.rate_authority_rad_s),
            attitude_gain: plant.interface.holds_attitude().then_some(plant.attitude_gain_per_s),
        }
    }

    /// Set-point of the on-board rate loop, including its bias \[rad/s, body\].
    #[inline(always)]
    fn rate(&self, state: &State, input: &PlantInput, disturbance: &Disturbance) -> Vector3<f64> {
        let command = match self.attitude_gain {
            // Eq. (61), erratum E-61.
            None => self.authority.component_mul(&input.sticks),
            Some(gain) => self.towards(&input.attitude, state.attitude, gain),
        };
        command + disturbance.rate_drift
    }

    /// Body rate proportional to the remaining rotation to `target`, the shorter way round, within the authority.
    // Not inlined, and without a reference to the state: that of a vehicle that takes sticks stays in registers.
    #[inline(never)]
    fn towards(
        &self,
        target: &Quaternion<f64>,
        attitude: Quaternion<f64>,
        gain: f64,
    ) -> Vector3<f64> {
        let error = attitude.conjugate() * target;
        let rate = error.imag() * (2.0 * gain).copysign(error.w);
        rate.zip_map(&self.authority, |rate, limit| rate.clamp(-limit, limit))
    }
}

/// The Hummingbird by Eq. (61), with the lags of a real vehicle.
#[derive(Clone, Debug)]
struct Eq61 {
    command: RateCommand,
    rate_bandwidth: Vector3<f64>,
    thrust: LaggedThrust,
    air: Option<RotorAir>,
}

impl Eq61 {
    fn new(plant: &PlantOptions) -> Self {
        Self {
            command: RateCommand::new(plant),
            rate_bandwidth: Vector3::from(plant.rate_lag_ratio)
                .map(|ratio| 1e3 / (plant.rate_lag_ms * ratio)),
            thrust: LaggedThrust::new(plant),
            air: RotorAir::new(&plant.rotors),
        }
    }

    /// Whether the vehicle takes sticks and meets no aerodynamic effects on its rotors.
    fn is_plain(&self) -> bool {
        self.command.attitude_gain.is_none() && self.air.is_none()
    }
}

impl Responsive for Eq61 {
    #[inline(always)]
    fn response(&self, state: &State, input: &PlantInput, disturbance: &Disturbance) -> Response {
        let thrust = state.actuators.x;
        // The thrust of a rotor is proportional to the square of its voltage.
        let share = disturbance.voltage_ratio.powi(2);
        // The on-board loop, which Eq. (61) contains, holds the rate against aerodynamic torques.
        let air =
            AirForces::on(self.air.as_ref(), state, &disturbance.wind, |air| air.speeds(thrust));
        Response {
            thrust: thrust * air.ground_ratio,
            drag: air.drag,
            rate: (self.command.rate(state, input, disturbance) - state.rate)
                .component_mul(&self.rate_bandwidth),
            actuators: self.thrust.change(thrust, input.thrust, share),
        }
    }
}

/// Four rotors on two crossed arms, with the on-board rate loop, or driven by a firmware. Opposite rotors turn in the same
/// direction.
#[derive(Clone, Debug)]
struct Rotors {
    inertia: Inertia,
    command: RateCommand,
    rate_lag: Vector3<f64>,
    max_thrust: f64,
    thrust_coefficient: f64,
    rotor_lag: f64,
    max_speed: f64,
    quadratic_thrust: f64,
    /// Map from squared rotor speeds \[(rad/s)^2\] to `[thrust \[N\]; torque \[N m\]]`.
    mix: Matrix4<f64>,
    /// Inverse of `mix` for intact rotors, as assumed by the on-board loop.
    unmix: Matrix4<f64>,
    air: Option<RotorAir>,
}

impl Rotors {
    fn new(plant: &PlantOptions) -> Self {
        let rotors = &plant.rotors;
        let mix = mix(rotors);
        Self {
            inertia: plant.inertia().expect("the configuration was checked"),
            command: RateCommand::new(plant),
            rate_lag: Vector3::from(plant.rate_lag_ratio) * (plant.rate_lag_ms * 1e-3),
            max_thrust: plant.max_thrust_n,
            thrust_coefficient: rotors.thrust_coefficient,
            rotor_lag: rotors.lag_ms * 1e-3,
            max_speed: rotors.max_speed_rad_s,
            quadratic_thrust: rotors.quadratic_thrust,
            mix: mix * Matrix4::from_diagonal(&Vector4::from(rotors.strength)),
            unmix: mix.try_inverse().expect("arm and coefficients are above zero"),
            air: RotorAir::new(rotors),
        }
    }

    /// Rotor speed \[rad/s\] at this motor power and nominal voltage.
    fn speed(&self, power: f64) -> f64 {
        let thrust = power * (self.quadratic_thrust * power + 1.0 - self.quadratic_thrust);
        self.max_speed * thrust.sqrt()
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
        let rate_command = self.command.rate(state, input, disturbance);
        let torque = self.inertia.matrix()
            * (rate_command - state.rate).component_div(&self.rate_lag)
            + self.inertia.gyroscopic_torque(BodyRate(state.rate)).0;
        let wrench = Vector4::new(input.thrust * self.max_thrust, torque.x, torque.y, torque.z);
        (self.unmix * wrench)
            .map(|squared| squared.max(0.0).sqrt().min(self.max_speed) * disturbance.voltage_ratio)
    }
}

impl Responsive for Rotors {
    #[inline]
    fn response(&self, state: &State, input: &PlantInput, disturbance: &Disturbance) -> Response {
        let speeds = state.actuators;
        let wrench = self.mix * speeds.component_mul(&speeds);
        let air = AirForces::on(self.air.as_ref(), state, &disturbance.wind, |_| speeds);
        let torque = wrench.fixed_rows::<3>(1).into_owned() + air.torque;
        let targets = match &input.motors {
            None => self.on_board_loop(state, input, disturbance),
            Some(motors) => motors.map(|power| self.speed(power)) * disturbance.voltage_ratio,
        };
        Response {
            thrust: wrench.x * air.ground_ratio,
            drag: air.drag,
            // Eq. (3), erratum E-03.
            rate: self.inertia.acceleration(BodyRate(state.rate), Torque(torque)).0,
            actuators: (targets - speeds) / self.rotor_lag,
        }
    }
}
