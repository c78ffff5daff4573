//! Operator's stop at the simulated vehicle, independent of the commands of the daemon.

use oqtal_bus::code::Actuation;
use oqtal_bus::memory::{MemoryBus, MemoryReader, MemoryWriter};
use oqtal_bus::message::{CommandV1, Stamps, VehicleV1};
use oqtal_bus::stop::StopSwitch;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, TRUTH, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::Config;
use oqtal_plant_sim::{Plant, PlantTurn, Stepping};
use oqtal_runtime::turn::step;

use crate::START;

const PERIOD: Span = Span::from_nanos(16_666_667);

/// Plant, and a daemon without a stop switch.
struct Bench {
    plant: PlantTurn<MemoryBus>,
    commands: MemoryWriter<CommandV1>,
    vehicles: MemoryReader<VehicleV1>,
    stop: StopSwitch,
    now: Time,
}

impl Bench {
    fn new(is_shadow: bool) -> Self {
        let bus = MemoryBus::new();
        let mut config = Config::default();
        config.plant.shadow = is_shadow;
        let plant = Plant::new(&config, START);
        Self {
            plant: PlantTurn::open(&bus, plant, Stepping::Exact, &config).unwrap(),
            commands: bus.writer(&COMMAND).unwrap(),
            vehicles: bus.observer(&VEHICLE).unwrap(),
            stop: bus.stop_switch().unwrap(),
            now: START,
        }
    }

    /// One period in which `actuation` is commanded; returns the vehicle reports of that period.
    fn period(&mut self, actuation: Actuation) -> Vec<VehicleV1> {
        let stamps = Stamps { command_published_at: self.now, ..Stamps::default() };
        let thrust = if actuation == Actuation::Disarmed { 0.0 } else { 0.4 };
        let body = CommandV1 { actuation: actuation.code(), thrust, ..CommandV1::default() };
        self.commands.send(0, stamps, body).unwrap();
        let end = self.now + PERIOD;
        while self.now < end {
            let next = step(&mut self.plant, self.now).unwrap().next;
            self.now = next.map_or(end, |next| next.min(end));
        }
        std::iter::from_fn(|| self.vehicles.receive().unwrap()).map(|(_, v)| v).collect()
    }
}

#[test]
fn f15_no_command_reaches_the_motors_from_the_turn_after_a_stop_until_disarmed_is_commanded() {
    let mut bench = Bench::new(false);
    for _ in 0..4 {
        bench.period(Actuation::Sticks);
    }
    assert!(bench.period(Actuation::Sticks).last().unwrap().armed == 1);
    let number = bench.stop.raise();
    for _ in 0..20 {
        let reports = bench.period(Actuation::Sticks);
        assert!(reports.iter().all(|v| (v.armed, v.stopped) == (0, 1)), "{reports:?}");
        let report = bench.stop.report(number);
        assert!(report.vehicle_obeys && report.motors_off && !report.daemon_obeys);
    }
    bench.period(Actuation::Disarmed);
    assert!(bench.period(Actuation::Disarmed).iter().all(|v| (v.armed, v.stopped) == (0, 0)));
    bench.period(Actuation::Sticks);
    bench.period(Actuation::Sticks);
    assert!(bench.period(Actuation::Sticks).iter().all(|v| (v.armed, v.stopped) == (1, 0)));
}

#[test]
fn commands_on_the_radio_when_a_stop_comes_do_not_act() {
    let mut bench = Bench::new(false);
    bench.period(Actuation::Disarmed);
    bench.period(Actuation::Disarmed);
    // In transit on the radio for 20 ms, longer than a period.
    bench.period(Actuation::Sticks);
    bench.stop.raise();
    for _ in 0..3 {
        assert!(bench.period(Actuation::Disarmed).iter().all(|v| v.armed == 0));
    }
}

#[test]
fn a_shadow_neither_confirms_nor_lifts_the_stop_of_the_real_vehicle() {
    let mut bench = Bench::new(true);
    let number = bench.stop.raise();
    for _ in 0..3 {
        bench.period(Actuation::Disarmed);
    }
    assert!(!bench.stop.report(number).vehicle_obeys);
}

#[test]
fn after_a_pause_of_any_length_an_observer_loses_no_published_truth() {
    let (bus, config) = (MemoryBus::new(), Config::default());
    let mut truths = bus.observer(&TRUTH).unwrap();
    let plant = Plant::new(&config, START);
    let mut plant = PlantTurn::open(&bus, plant, Stepping::Exact, &config).unwrap();
    let mut now = START;
    for pause_s in [0.02, 0.3, 1.0, 30.0] {
        now = now + Span::from_seconds(pause_s);
        step(&mut plant, now).unwrap();
        let samples: Vec<_> = std::iter::from_fn(|| truths.receive().unwrap()).collect();
        let (_, newest) = samples.last().unwrap();
        assert!(samples.len() >= 20 && now.since(newest.time) < Span::from_millis(200));
        assert_eq!(truths.lost(), 0, "{pause_s} s");
    }
}
