//! The plant as the body of a firmware: sensors and motors.

use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, RotorLayout};
use oqtal_plant_sim::SceneDisturbance;
use oqtal_plant_sim::firmware::{BodyOutput, FirmwareBody, InertialSample};

use crate::{START, calm};

/// Standard gravity \[m/s^2\].
const G: f64 = 9.80665;

/// A body without gusts, drift and drag, and the time of the test.
struct Bench {
    body: FirmwareBody,
    now: Time,
    last: InertialSample,
    samples: usize,
}

impl Bench {
    fn new(layout: RotorLayout) -> Self {
        let mut config = Config::default();
        config.plant.rotors.layout = layout;
        config.plant.gust_sd_m_s2 = 0.0;
        config.plant.force_n = [0.0; 3];
        config.plant.drag_per_s = 0.0;
        let last = InertialSample { force: [0.0; 3], rate: [0.0; 3], attitude: [0.0; 4] };
        Self { body: FirmwareBody::new(&config, START), now: START, last, samples: 0 }
    }

    /// Drives the motors, every millisecond as a firmware does.
    fn drive(&mut self, motors: [f64; 4], millis: u32) {
        for _ in 0..millis {
            self.body.drive(motors);
            self.idle(1);
        }
    }

    /// Advances without motor values.
    fn idle(&mut self, millis: u32) {
        for _ in 0..millis {
            self.now = self.now + Span::from_millis(1);
            let Self { body, last, samples, .. } = self;
            body.advance(self.now, |output| {
                if let BodyOutput::Sensors(sample) = output {
                    *last = sample;
                    *samples += 1;
                }
            });
        }
    }

    /// Measured specific force \[g, body\] and body rate \[rad/s, body\].
    fn measured(&self) -> ([f64; 3], [f64; 3]) {
        (self.last.force.map(|value| value / G), self.last.rate)
    }

    fn rate(&self) -> [f64; 3] {
        self.body.plant().truth().rate
    }
}

/// Power of all motors at which the vehicle hovers \[0..1\].
fn hover() -> f64 {
    let plant = Config::default().plant;
    (plant.mass_kg * plant.gravity_m_s2 / plant.max_thrust_n).sqrt()
}

#[test]
fn at_rest_and_in_hover_the_sensors_measure_one_g_at_a_kilohertz() {
    let mut bench = Bench::new(RotorLayout::Cross);
    bench.idle(500);
    assert_eq!(bench.samples, 501, "one at the start, and one each millisecond");
    let ([x, y, z], rate) = bench.measured();
    assert!(x == 0.0 && y == 0.0 && (z - 1.0).abs() < 2e-3, "{x} {y} {z}");
    assert_eq!(rate, [0.0; 3]);
    bench.drive([hover() * 1.05; 4], 300);
    bench.drive([hover(); 4], 200);
    let ([x, y, z], _) = bench.measured();
    assert!(x == 0.0 && y == 0.0 && (z - 1.0).abs() < 0.02, "{x} {y} {z}");
    assert!(bench.body.plant().truth().position[2] > 0.01);
}

#[test]
fn in_free_fall_the_accelerometer_measures_nothing() {
    let mut bench = Bench::new(RotorLayout::Plus);
    bench.drive([1.0; 4], 500);
    bench.drive([0.0; 4], 100);
    let (force, _) = bench.measured();
    assert!(force.iter().all(|force| force.abs() < 2e-3), "{force:?}");
}

#[test]
fn a_firmware_that_is_silent_loses_its_motors() {
    let mut bench = Bench::new(RotorLayout::Cross);
    bench.drive([1.0; 4], 400);
    bench.idle(250);
    let ([_, _, force], _) = bench.measured();
    assert!(force > 1.5, "the last values act for 250 ms: {force} g");
    bench.idle(100);
    let ([_, _, force], _) = bench.measured();
    assert!(force.abs() < 2e-3, "{force} g");
}

/// Order of the rotors in each layout, and axes about which more power turns the vehicle; the gyroscope agrees.
#[test]
fn each_rotor_turns_the_vehicle_as_its_place_and_sense_say() {
    let cross = [[-1, -1, -1], [-1, 1, 1], [1, 1, -1], [1, -1, 1]];
    let plus = [[0, -1, -1], [1, 0, 1], [0, 1, -1], [-1, 0, 1]];
    for (layout, signs) in [(RotorLayout::Cross, cross), (RotorLayout::Plus, plus)] {
        for (rotor, sign) in signs.into_iter().enumerate() {
            let mut bench = Bench::new(layout);
            bench.drive([hover() * 1.2; 4], 500);
            let mut motors = [hover(); 4];
            motors[rotor] *= 1.05;
            bench.drive(motors, 30);
            let rates = bench.rate();
            let most = rates.into_iter().fold(0.0, |most: f64, rate| most.max(rate.abs()));
            for (rate, sign) in rates.into_iter().zip(sign) {
                // Gyroscopic torques turn the other axes slightly.
                let right =
                    if sign == 0 { rate.abs() < 0.05 * most } else { rate * f64::from(sign) > 0.0 };
                assert!(right, "{layout:?}, rotor {rotor}: {rates:?}");
            }
            let (_, measured) = bench.measured();
            for (measured, rate) in measured.into_iter().zip(bench.rate()) {
                assert_eq!(measured, rate);
            }
        }
    }
}

#[test]
fn a_linear_share_of_the_thrust_lifts_at_less_power() {
    let thrust_at_half = |quadratic: f64| {
        let mut config = Config::default();
        config.plant.rotors.quadratic_thrust = quadratic;
        let mut body = FirmwareBody::new(&config, START);
        for milli in 1..=100 {
            body.drive([0.5; 4]);
            body.advance(START + Span::from_millis(milli), |_| {});
        }
        body.plant().truth().velocity[2]
    };
    assert!(thrust_at_half(0.5) > thrust_at_half(1.0));
}

/// The body has waited 40 ms for its firmware before the motors were armed.
#[test]
fn a_disturbance_is_not_late_by_the_time_for_which_the_body_has_waited() {
    let mut config = calm(&[("plant.disturb", toml::Value::from(vec!["force@0.1+0.01=0,0,30N"]))]);
    config.plant.drag_per_s = 0.0;
    let mut body = FirmwareBody::new(&config, START);
    let slip = Span::from_millis(40);
    let armed_at = Some(START + slip);
    body.disturb(SceneDisturbance { armed_at, ..SceneDisturbance::default() }, slip);
    body.advance(START + Span::from_millis(99), |_| {});
    assert_eq!(body.plant().truth().velocity[2], 0.0);
    body.advance(START + Span::from_millis(110), |_| {});
    assert!(body.plant().truth().velocity[2] > 0.4);
}
