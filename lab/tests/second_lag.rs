//! Identification of a second-order rate loop.

use nalgebra::Vector3;
use oqtal_control::quaternion::Attitude;
use oqtal_lab::identify::data::{CommandRecord, FlightData, PoseRecord};
use oqtal_lab::identify::fit::{FitParameter, precise_fit};
use oqtal_lab::identify::rotation::{self, RotationModel, RotationNoise};
use oqtal_lab::identify::turning::turning;

const PERIOD_S: f64 = 1.0 / 60.0;
/// Rate at full stick \[rad/s\].
const AUTHORITY: f64 = 2.0;

/// Vehicle under oscillating sticks, whose rate follows the demand through two lags after a dead time, with attitude errors up to
/// a milliradian.
fn swinging([dead_s, lag_s, fast_s]: [f64; 3], ticks: u32) -> FlightData {
    let mut data = FlightData::default();
    let mut attitude = Attitude::LEVEL;
    let [mut rate, mut target] = [Vector3::zeros(); 2];
    let mut seed = 7_u32;
    let mut noise = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        2e-3 * (f64::from(seed >> 8) / f64::from(1 << 24) - 0.5)
    };
    let sticks = |tick: f64| {
        let swing = |per_s: f64| (per_s * tick * PERIOD_S).sin().signum();
        Vector3::new(swing(7.0), swing(-5.0), swing(3.0)) * 0.4
    };
    let steps = 50;
    let h_s = PERIOD_S / f64::from(steps);
    for tick in 0..ticks {
        let t_s = f64::from(tick) * PERIOD_S;
        let measured = attitude.turned_by(Vector3::from_fn(|_, _| noise()));
        let position = Vector3::z();
        data.air.push(PoseRecord { captured_s: t_s, latency_s: 0.0, position, attitude: measured });
        let sticks_now = sticks(f64::from(tick));
        data.commands.push(CommandRecord { sent_s: t_s, sticks: sticks_now, thrust: 0.5 });
        for step in 0..steps {
            let acting = (t_s + (f64::from(step) + 0.5) * h_s - dead_s) / PERIOD_S;
            let demand = match acting < 0.0 {
                true => Vector3::zeros(),
                false => sticks(acting.floor()) * AUTHORITY,
            };
            target += (demand - target) * (h_s / fast_s);
            rate += (target - rate) * (h_s / lag_s);
            attitude = attitude.turned_by(rate * h_s);
        }
    }
    data
}

/// The identified delay includes the second lag; the identified lag equals the vehicle's.
#[test]
fn a_second_lag_is_found_and_is_a_part_of_the_delay() {
    let (dead_s, lag_s, fast_s) = (20e-3, 50e-3, 12e-3);
    let data = swinging([dead_s, lag_s, fast_s], 1200);
    let (authority, bias) = (Vector3::repeat(AUTHORITY), Vector3::zeros());
    let start = RotationModel { delay_s: 25e-3, lag_s: 55e-3, fast_s: 0.0, authority, bias };
    let found = turning(&[data], &start).unwrap();
    let RotationModel { delay_s, lag_s: found_s, fast_s: second_s, .. } = found.models[0];
    assert!((second_s - fast_s).abs() < 2e-3, "{:?}", found.models[0]);
    assert!((delay_s - dead_s - fast_s).abs() < 1e-3, "{:?}", found.models[0]);
    assert!((found_s - lag_s).abs() < 2e-3, "{:?}", found.models[0]);
}

/// The second lag belongs to the rate loop: a thrust takes effect after the whole delay.
#[test]
fn a_thrust_is_not_commanded_earlier_by_the_second_lag() {
    let mut data = swinging([20e-3, 50e-3, 10e-3], 30);
    data.commands.iter_mut().skip(12).for_each(|command| command.thrust = 0.7);
    let (authority, bias) = (Vector3::repeat(AUTHORITY), Vector3::zeros());
    let model = RotationModel { delay_s: 30e-3, lag_s: 50e-3, fast_s: 10e-3, authority, bias };
    let noise = RotationNoise { measured_rad: 1e-3, walk_ratio: 1.0 };
    let pass = rotation::pass(&data, &model, &noise);
    let before_s: f64 =
        pass.pieces.iter().take_while(|piece| piece.share != 0.7).map(|piece| piece.h_s).sum();
    assert!((before_s - 12.0 * PERIOD_S - 30e-3).abs() < 1e-9, "{before_s} s");
}

/// Residuals that do not depend on a parameter beyond its bound, as for a lag, which cannot be negative.
#[test]
fn at_a_bound_the_interval_is_as_wide_as_inside() {
    let width = |aim: f64| {
        let residuals = |values: &[f64]| {
            let of = |k: u32| if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            (0..100).map(|k| values[0].max(0.0) - aim + of(k)).collect::<Vec<_>>()
        };
        let bounds = [0.0, 10.0];
        let mut parameters = [FitParameter { start: 1.0, bounds, step: 1e-3, is_fixed: false }];
        let found = precise_fit(&mut parameters, &[100], &residuals).unwrap();
        (found.values[0], found.covariance[(0, 0)].sqrt())
    };
    let (inside, at_bound) = (width(2.0), width(-1e-3));
    assert!(at_bound.0 < 1e-9, "{at_bound:?}");
    assert!((at_bound.1 / inside.1 - 1.0).abs() < 0.1, "{at_bound:?}, {inside:?}");
}
