//! An independent check of hand-overs: the motion under an answer, propagated from the question alone.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_bus::time::Time;
use oqtal_daemon::ExternalLaw;

const STEP_S: f64 = 1e-3;
/// Of the Hummingbird in `deploy/oqtal.toml`.
const LAG_S: f64 = 0.05;
/// Of the rate in the envelope: twice that of the vehicle.
const RATE_LAG_S: f64 = 0.1;
const DRAG_PER_S: f64 = 0.25;
/// 0.3 of the acceleration at the tilt limit of 15 degrees, and of the vertical limit.
const SIDEWAYS: f64 = 0.3 * 9.81 * 0.267_949_192_431_122_7;
const VERTICAL: f64 = 0.3 * 4.0;

/// A law, and whether each of its answers leads out of an envelope that is a little smaller, and of one that is a little larger.
pub struct Watched<L> {
    pub law: L,
    pub leads_out: Vec<(Time, [bool; 2])>,
}

impl<L: ExternalLaw> ExternalLaw for Watched<L> {
    fn reset(&mut self) {
        self.law.reset();
    }

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let answer = self.law.answer(state)?;
        let leads_out = [0.96, 1.04].map(|size| leads_out(state, &answer, size));
        self.leads_out.push((state.time, leads_out));
        Some(answer)
    }
}

/// Whether `answer` leads out of the envelope as shipped, in the room of the sabotage, `size` times as large.
fn leads_out(state: &StateV1, answer: &ExternalV1, size: f64) -> bool {
    let [x, y, z, w] = state.attitude;
    let quaternion = nalgebra::Quaternion::new(w, x, y, z);
    let mut r: Matrix3<f64> =
        UnitQuaternion::new_normalize(quaternion).to_rotation_matrix().into_inner();
    let [mut p, mut v, mut rate] = [state.position, state.velocity, state.rate].map(Vector3::from);
    let mut thrust = state.thrust;
    let (drift, wind) = (Vector3::from(state.demand_bias), Vector3::from(state.acceleration_bias));
    let most = state.greatest_rate[0];
    for step in 0..=1000 {
        let t_s = f64::from(step) * STEP_S;
        if is_outside((&p, &v), (&r, &rate), size) {
            return true;
        }
        let up: Vector3<f64> = r.row(2).transpose();
        // Level to 10 degrees.
        if t_s >= 0.3 && up.z >= 0.985 {
            return false;
        }
        let (command, lift) = if t_s < 2.0 * state.period_s {
            (Vector3::from(answer.rate), answer.thrust)
        } else {
            // The shortest rotation to the vertical, at a quarter of it in 1/16 s.
            let sine = Vector3::new(-up.y, up.x, 0.0);
            let angle = sine.norm().atan2(up.z);
            let left = sine * (angle / sine.norm().max(1e-12));
            let rate = (4.0 * left - drift).map(|rate| rate.clamp(-most, most));
            (rate, (state.mass * state.gravity / up.z.max(0.5)).min(state.greatest_thrust))
        };
        let force = r.column(2) * (thrust / state.mass) + wind - v * DRAG_PER_S;
        let acceleration = force - Vector3::z() * state.gravity;
        p += v * STEP_S + acceleration * (0.5 * STEP_S * STEP_S);
        v += acceleration * STEP_S;
        r *= Rotation3::new(rate * STEP_S).into_inner();
        rate += (command + drift - rate) * (STEP_S / RATE_LAG_S);
        thrust += (lift - thrust) * (STEP_S / LAG_S);
    }
    false
}

fn is_outside(
    (p, v): (&Vector3<f64>, &Vector3<f64>),
    (r, rate): (&Matrix3<f64>, &Vector3<f64>),
    size: f64,
) -> bool {
    // The turn to 15 degrees at 2 rad/s takes 0.131 s; the lags of rate and thrust are equal.
    let way = |speed: f64, turn_s: f64, braking: f64| {
        speed * (0.1 + turn_s + LAG_S) + speed * speed.abs() / (2.0 * braking)
    };
    let flat = Vector3::new(v.x, v.y, 0.0);
    let share =
        if flat.norm() > 0.0 { way(flat.norm(), 0.131, SIDEWAYS) / flat.norm() } else { 0.0 };
    let rest = p + flat * share + Vector3::z() * way(v.z, 0.0, VERTICAL);
    // 0.3 m inside, more or less for another size of the envelope.
    let margin = 0.3 - (size - 1.0);
    let limit_m = 3.5 - margin;
    r[(2, 2)] < (40.0 * size).to_radians().cos()
        || rate.amax() > 6.0 * size
        || v.norm() > 3.0 * size
        || rest.x.abs() > limit_m
        || rest.y.abs() > limit_m
        || rest.z > 3.0 - margin
        || rest.z < margin
}
