//! The simulated vehicle and its radio.

use nalgebra::Vector3;
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, TruthV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::quaternion::Attitude;
use oqtal_plant_sim::{Plant, PlantOutput};

use crate::{HOVER, START, calm};

fn sticks(roll: f64, thrust: f64) -> CommandV1 {
    let actuation = Actuation::Sticks.code();
    CommandV1 { actuation, sticks: [roll, 0.0, 0.0], thrust, ..CommandV1::default() }
}

#[test]
fn a_vehicle_that_holds_attitudes_turns_to_the_commanded_one_and_ignores_sticks() {
    let wanted = Attitude::from_rotation_vector(Vector3::new(0.2, -0.1, 0.5));
    let command = CommandV1 {
        actuation: Actuation::Attitude.code(),
        attitude: wanted.xyzw(),
        thrust: 1.5 * HOVER,
        ..CommandV1::default()
    };
    for fidelity in ["eq61", "rotors"] {
        let settings =
            [("plant.interface", "attitude".into()), ("plant.fidelity", fidelity.into())];
        let mut bench = Bench::new(&calm(&settings));
        bench.hold(command, 2000);
        let reached = Attitude::from_xyzw(bench.truth().attitude).unwrap();
        assert!(reached.angle_to(&wanted) < 1e-3, "{fidelity}: {}", reached.angle_to(&wanted));
        // q and -q are one attitude.
        let mirrored = CommandV1 { attitude: wanted.xyzw().map(|part| -part), ..command };
        bench.hold(mirrored, 200);
        assert!(Attitude::from_xyzw(bench.truth().attitude).unwrap().angle_to(&wanted) < 1e-3);
        assert_eq!(bench.applied.last().unwrap().1.armed, 1);
        bench.hold(sticks(0.5, HOVER), 100);
        assert_eq!(bench.applied.last().unwrap().1.armed, 0, "{fidelity}: sticks disarm it");
    }
}

#[test]
fn a_vehicle_on_the_floor_stays_where_it_stands() {
    let mut bench = Bench::new(&calm(&[("plant.force-n", vec![0.1, -0.1, 0.0].into())]));
    let first = bench.plant.truth();
    bench.hold(sticks(0.5, 0.5 * HOVER), 2000);
    let last = bench.plant.truth();
    assert_eq!((last.position, last.attitude), (first.position, first.attitude));
}

struct Bench {
    plant: Plant,
    now: Time,
    truths: Vec<TruthV1>,
    applied: Vec<(Time, VehicleV1)>,
}

impl Bench {
    fn new(config: &Config) -> Self {
        Self { plant: Plant::new(config, START), now: START, truths: vec![], applied: vec![] }
    }

    /// Flies on while a daemon repeats the last command before it times out.
    fn hold(&mut self, command: CommandV1, millis: i64) {
        for _ in 0..millis / 50 {
            self.command(command);
            self.fly(50);
        }
    }

    fn fly(&mut self, millis: i64) {
        self.now = self.now + Span::from_millis(millis);
        let (truths, applied) = (&mut self.truths, &mut self.applied);
        self.plant.advance(self.now, |output| match output {
            PlantOutput::Truth(truth) => truths.push(truth),
            PlantOutput::Applied(_, stamps, vehicle) => applied.push((stamps.applied_at, vehicle)),
        });
    }

    fn command(&mut self, command: CommandV1) {
        self.plant.receive(self.now, Header::default(), command, 0);
    }

    fn truth(&self) -> TruthV1 {
        self.plant.truth()
    }
}

#[test]
fn a_vehicle_rests_on_the_floor_until_it_is_lifted() {
    let mut bench = Bench::new(&calm(&[]));
    bench.fly(500);
    assert_eq!(bench.truth().position, [0.0; 3]);
    bench.hold(sticks(0.0, 0.5 * HOVER), 500);
    assert_eq!(bench.truth().position[2], 0.0, "half its weight lifts nothing");
    bench.hold(sticks(0.0, 2.0 * HOVER), 500);
    assert!(bench.truth().position[2] > 0.3);
}

#[test]
fn a_command_acts_exactly_after_the_radio_delay_and_is_answered_once() {
    let mut bench = Bench::new(&calm(&[]));
    bench.fly(7);
    let sent = bench.now;
    bench.command(sticks(0.0, 2.0 * HOVER));
    bench.fly(100);
    assert_eq!(bench.applied.len(), 1);
    assert_eq!(bench.applied[0].0, sent + Span::from_millis(20));
    let lifted = bench.truths.iter().find(|truth| truth.velocity[2] > 0.0).unwrap();
    assert!(lifted.time > sent + Span::from_millis(20));
}

#[test]
fn the_rate_follows_the_sticks_with_the_lag_of_the_on_board_loop() {
    for fidelity in ["eq61", "rotors"] {
        let mut bench = Bench::new(&calm(&[("plant.fidelity", fidelity.into())]));
        bench.hold(sticks(0.0, 1.5 * HOVER), 1000);
        bench.command(sticks(0.1, 1.5 * HOVER));
        bench.fly(20 + 50);
        let after_one_lag = bench.truth().rate[0] / 0.2;
        bench.hold(sticks(0.1, 1.5 * HOVER), 300);
        let settled = bench.truth().rate[0] / 0.2;
        let expected = 1.0 - (-1.0f64).exp();
        assert!((after_one_lag - expected).abs() < 0.06, "{fidelity}: {after_one_lag}");
        assert!((settled - 1.0).abs() < 0.01, "{fidelity}: {settled}");
    }
}

#[test]
fn hover_thrust_hovers() {
    for fidelity in ["eq61", "rotors"] {
        let mut bench = Bench::new(&calm(&[("plant.fidelity", fidelity.into())]));
        bench.hold(sticks(0.0, 2.0 * HOVER), 500);
        bench.hold(sticks(0.0, HOVER), 3000);
        let before = bench.truth().velocity[2];
        bench.hold(sticks(0.0, HOVER), 1000);
        // Only drag remains, a quarter of the speed per second.
        let expected = before * (-0.25f64).exp();
        assert!((bench.truth().velocity[2] - expected).abs() < 1e-3, "{fidelity}");
    }
}

#[test]
fn a_sagging_battery_takes_thrust_away() {
    let sag = [("plant.battery.sag", true.into()), ("plant.battery.capacity-ah", 0.02.into())];
    let mut fresh = Bench::new(&calm(&[]));
    let mut sagging = Bench::new(&calm(&sag));
    for bench in [&mut fresh, &mut sagging] {
        for _ in 0..40 {
            bench.command(sticks(0.0, 1.3 * HOVER));
            bench.fly(200);
        }
    }
    assert!(sagging.truth().velocity[2] < fresh.truth().velocity[2]);
    let voltage = |bench: &Bench| bench.applied.last().unwrap().1.battery_v;
    assert!(voltage(&sagging) < voltage(&fresh));
    assert!(voltage(&fresh) < 12.6);
}

#[test]
fn a_torque_turns_the_spacecraft_by_eulers_equation() {
    let settings =
        [("vehicle.preset", "spacecraft".into()), ("plant.command-delay-ms", 0.0.into())];
    let mut bench = Bench::new(&calm(&settings));
    let lift =
        CommandV1 { actuation: Actuation::Torque.code(), thrust: 1.0, ..CommandV1::default() };
    bench.hold(lift, 500);
    bench.hold(CommandV1 { torque: [0.1, 0.0, 0.0], ..lift }, 1000);
    // omega = tau t / J with J = 0.5.
    assert!((bench.truth().rate[0] - 0.2).abs() < 1e-9, "{:?}", bench.truth().rate);
}

#[test]
fn absurd_commands_never_make_an_absurd_state() {
    let mut bench = Bench::new(&calm(&[]));
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -5.0] {
        for actuation in 0..=u8::MAX {
            bench.command(CommandV1 {
                actuation,
                sticks: [value; 3],
                torque: [value; 3],
                attitude: [value; 4],
                thrust: value,
            });
            bench.fly(1);
        }
    }
    bench.fly(200);
    let truth = bench.truth();
    let numbers = truth.position.iter().chain(&truth.velocity).chain(&truth.attitude);
    assert!(numbers.chain(&truth.rate).all(|number| number.is_finite()), "{truth:?}");
}

#[test]
fn frames_are_numbered_and_fall_on_the_cameras_instants() {
    let mut bench = Bench::new(&calm(&[]));
    bench.fly(1000);
    let frames: Vec<_> = bench.truths.iter().filter(|truth| truth.capture > 0).collect();
    assert_eq!(frames.len(), 61);
    for (index, frame) in frames.iter().enumerate() {
        assert_eq!(frame.capture, index as u64 + 1);
        assert_eq!(frame.time, START + Span::from_seconds(index as f64 / 60.0));
    }
    let longest = bench.truths.windows(2).map(|pair| pair[1].time.since(pair[0].time)).max();
    assert!(longest <= Some(Span::from_millis(1)), "steps of at most a millisecond");
}

#[test]
fn gusts_have_their_standard_deviation_and_repeat_with_the_seed() {
    let velocity = |seed: i64| {
        let gusty = calm(&[
            ("plant.gust-sd-m-s2", 0.5.into()),
            ("plant.drag-per-s", 0.0.into()),
            ("clock.seed", seed.into()),
        ]);
        let mut bench = Bench::new(&gusty);
        bench.hold(sticks(0.0, 1.2 * HOVER), 5000);
        bench.truth().velocity
    };
    assert_eq!(velocity(1), velocity(1));
    // Integrated over 5 s: variance 2 sigma^2 tau (T - tau (1 - exp(-T / tau))).
    let (sigma, tau, t) = (0.5f64, 0.8, 5.0f64);
    let expected = (2.0 * sigma * sigma * tau * (t - tau * (1.0 - (-t / tau).exp()))).sqrt();
    let samples: Vec<f64> = (0..60).flat_map(|seed| velocity(seed)[..2].to_vec()).collect();
    let square_mean = samples.iter().map(|v| v * v).sum::<f64>() / samples.len() as f64;
    assert!((square_mean.sqrt() / expected - 1.0).abs() < 0.2, "{} {expected}", square_mean.sqrt());
}

#[test]
fn motors_stop_by_themselves_without_further_commands() {
    let mut bench = Bench::new(&calm(&[]));
    bench.command(sticks(0.0, 2.0 * HOVER));
    bench.fly(20 + 240);
    let rising = bench.truth().velocity[2];
    assert!(rising > 1.0);
    bench.fly(2000);
    assert_eq!(bench.truth().position[2], 0.0, "it fell");
}

#[test]
fn a_vehicle_ignores_commands_of_another_kind() {
    let mut bench = Bench::new(&calm(&[]));
    let actuation = Actuation::Torque.code();
    bench.command(CommandV1 { actuation, thrust: 1.0, ..CommandV1::default() });
    bench.fly(200);
    assert_eq!(bench.truth().position[2], 0.0);
}

#[test]
fn f12_a_long_pause_is_integrated_for_two_seconds_and_skipped_for_the_rest() {
    let mut bench = Bench::new(&calm(&[]));
    bench.hold(sticks(0.0, 1.2 * HOVER), 1000);
    assert!(bench.truth().position[2] > 0.5);
    let frames = |bench: &Bench| bench.plant.next_event();
    let woken = bench.now + Span::from_seconds(3600.0);
    assert_eq!(bench.plant.skip_pause(woken), Span::from_seconds(3598.0));
    assert_eq!(bench.plant.truth().time, woken);
    // The motors stopped because no command arrived, and the vehicle fell.
    assert_eq!((bench.plant.vehicle().armed, bench.plant.truth().position[2]), (0, 0.0));
    assert!(frames(&bench) > woken && frames(&bench) <= woken + Span::from_millis(17));
    let mut outputs = 0;
    bench.plant.advance(woken + Span::from_millis(100), |_| outputs += 1);
    assert!((100..=110).contains(&outputs), "{outputs} samples of 100 ms");
    assert_eq!(bench.plant.skip_pause(woken + Span::from_millis(2000)), Span::ZERO);
}
