//! One millisecond of the plant, hovering on the last command, at both fidelities.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_plant_sim::{Plant, PlantOutput};

const MILLISECOND: Span = Span::from_millis(1);
/// Milliseconds between two commands \[-\]: without commands the motors stop.
const COMMAND_EVERY: u64 = 16;

fn bench(criterion: &mut Criterion, fidelity: &str) {
    let config =
        Config::from_settings(&[Setting::flag("bench", "plant.fidelity", fidelity)]).unwrap();
    let mut now = Time::VIRTUAL_START;
    let mut plant = Plant::new(&config, now);
    let hover = CommandV1 {
        actuation: Actuation::Sticks.code(),
        thrust: config.plant.mass_kg * config.plant.gravity_m_s2 / config.plant.max_thrust_n,
        ..CommandV1::default()
    };
    let mut millisecond = 0;
    let mut samples = 0_u64;
    criterion.bench_function(&format!("plant/{fidelity}, 1 ms"), |bencher| {
        bencher.iter(|| {
            millisecond += 1;
            if millisecond % COMMAND_EVERY == 0 {
                plant.receive(now, Header::default(), black_box(hover), 0);
            }
            now = now + MILLISECOND;
            plant.advance(black_box(now), |output| {
                samples += u64::from(matches!(output, PlantOutput::Truth(_)));
            });
        });
    });
    assert!(samples >= millisecond);
}

fn plant(criterion: &mut Criterion) {
    bench(criterion, "eq61");
    bench(criterion, "rotors");
}

criterion_group!(benches, plant);
criterion_main!(benches);
