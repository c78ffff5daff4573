//! Geometry of the four rotors, and aerodynamic forces on them: drag, inflow damping, ground effect.
//!
//! A rotor that turns at `w` and moves at the velocity `v` relative to the air meets, besides its thrust, the force
//! `-w diag(k_d, k_d, k_z) v` in body axes: `k_d` is the drag in its plane (blade flapping and induced drag), `k_z` the loss of
//! thrust by inflow along its axis (Svacha, Mohta and Kumar, *Improving quadrotor trajectory tracking by compensating for
//! aerodynamic effects*, ICUAS 2017; values of the Hummingbird: RotorPy, `hummingbird_params.py`). Since each rotor moves with
//! the body's rotation too, inflow also damps roll and pitch.
//!
//! Close to the floor the same power gives more thrust, by `1 / (1 - (R / 4 z)^2)` (Cheeseman and Bennett, *The effect of the
//! ground on a helicopter rotor in forward flight*, ARC R&M 3021, 1955).

use nalgebra::{Matrix3x4, Matrix4, UnitQuaternion, Vector3, Vector4};
use oqtal_config::{RotorLayout, RotorOptions};

use crate::state::State;

/// Height below which the ground effect is constant, over the radius of a rotor \[-\]: the formula is valid down to it.
const LEAST_HEIGHT: f64 = 0.5;

/// Map from squared rotor speeds \[(rad/s)^2\] to `[thrust \[N\]; torque \[N m\]]`. Lift at +y rolls the vehicle about +x.
pub fn mix(rotors: &RotorOptions) -> Matrix4<f64> {
    let (k, d) = (rotors.thrust_coefficient, rotors.torque_coefficient);
    let arm = k * rotors.arm_m;
    match rotors.layout {
        // Columns: front (+x), left (+y), back (-x), right (-y).
        RotorLayout::Plus => Matrix4::new(
            k, k, k, k, //
            0.0, arm, 0.0, -arm, //
            -arm, 0.0, arm, 0.0, //
            -d, d, -d, d,
        ),
        // Columns: front right, back right, back left, front left.
        RotorLayout::Cross => {
            let lever = arm * std::f64::consts::FRAC_1_SQRT_2;
            Matrix4::new(
                k, k, k, k, //
                -lever, -lever, lever, lever, //
                -lever, lever, lever, -lever, //
                -d, d, -d, d,
            )
        }
    }
}

/// Aerodynamic forces on the rotors.
#[derive(Clone, Debug)]
pub struct RotorAir {
    /// `diag(k_d, k_d, k_z)` \[N s^2/(rad m), body\].
    coefficients: Vector3<f64>,
    /// Positions of the rotors relative to the centre of mass \[m, body\].
    places: Matrix3x4<f64>,
    thrust_coefficient: f64,
    /// Radius of a rotor \[m\]; `None` without ground effect.
    radius: Option<f64>,
}

impl RotorAir {
    /// Aerodynamic model of these rotors; `None` if it has no effect.
    pub fn new(rotors: &RotorOptions) -> Option<Self> {
        let has_drag = rotors.drag_coefficient > 0.0 || rotors.inflow_coefficient > 0.0;
        if !has_drag && !rotors.ground_effect {
            return None;
        }
        // A rotor at (x, y) produces the torque (y, -x) per newton of lift, taken from the mix.
        let mix = mix(rotors) / rotors.thrust_coefficient;
        let mut places = Matrix3x4::zeros();
        places.row_mut(0).copy_from(&-mix.row(2));
        places.row_mut(1).copy_from(&mix.row(1));
        let (in_plane, along) = (rotors.drag_coefficient, rotors.inflow_coefficient);
        Some(Self {
            coefficients: Vector3::new(in_plane, in_plane, along),
            places,
            thrust_coefficient: rotors.thrust_coefficient,
            radius: rotors.ground_effect.then_some(rotors.radius_m),
        })
    }

    /// Force \[N, body\] and torque \[N m, body\] on rotors at these speeds \[rad/s\] whose centre moves through the air at `velocity`
    /// \[m/s, body\], while the body turns at `rate` \[rad/s, body\].
    pub fn wrench(
        &self,
        speeds: &Vector4<f64>,
        velocity: &Vector3<f64>,
        rate: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        for (place, speed) in self.places.column_iter().zip(speeds.iter()) {
            let place = place.into_owned();
            let through_air = velocity + rate.cross(&place);
            let of_rotor = -self.coefficients.component_mul(&through_air) * *speed;
            force += of_rotor;
            torque += place.cross(&of_rotor);
        }
        (force, torque)
    }

    /// Speed of each rotor \[rad/s\] when all four share this thrust \[N\].
    pub fn speeds(&self, thrust: f64) -> Vector4<f64> {
        Vector4::repeat((thrust.max(0.0) / (4.0 * self.thrust_coefficient)).sqrt())
    }

    /// Thrust at this height above the floor over thrust far from it \[-\].
    #[inline]
    pub fn ground_ratio(&self, height: f64) -> f64 {
        let Some(radius) = self.radius else { return 1.0 };
        let share = radius / (4.0 * height.max(LEAST_HEIGHT * radius));
        (1.0 - share * share).recip()
    }
}

/// Aerodynamic effects on a vehicle.
pub(crate) struct AirForces {
    /// Drag of the rotors \[N, world\].
    pub drag: Vector3<f64>,
    /// Torque of that drag \[N m, body\].
    pub torque: Vector3<f64>,
    /// Thrust at this height over thrust far from the floor \[-\].
    pub ground_ratio: f64,
}

impl AirForces {
    /// Aerodynamic effects on a vehicle in the air velocity `wind` \[m/s, world\]; `speeds` yields the speeds of its rotors
    /// \[rad/s\]. None without `air`.
    #[inline(always)]
    pub fn on(
        air: Option<&RotorAir>,
        state: &State,
        wind: &Vector3<f64>,
        speeds: impl FnOnce(&RotorAir) -> Vector4<f64>,
    ) -> Self {
        match air {
            None => Self { drag: Vector3::zeros(), torque: Vector3::zeros(), ground_ratio: 1.0 },
            Some(air) => Self::on_rotors(air, speeds(air), *state, wind),
        }
    }

    /// Aerodynamic effects on rotors at these speeds \[rad/s\].
    // Not inlined, and without a reference to the state: that of a vehicle without these effects stays in registers.
    #[inline(never)]
    fn on_rotors(air: &RotorAir, speeds: Vector4<f64>, state: State, wind: &Vector3<f64>) -> Self {
        let attitude = UnitQuaternion::new_unchecked(state.attitude);
        let velocity = attitude.inverse_transform_vector(&(state.velocity - wind));
        let (force, torque) = air.wrench(&speeds, &velocity, &state.rate);
        let drag = attitude * force;
        Self { drag, torque, ground_ratio: air.ground_ratio(state.position.z) }
    }
}
