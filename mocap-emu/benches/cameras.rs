//! Duration of one frame in the emulated cameras, with the default preset and with the preset of a measured room.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_mocap_emu::Cameras;

fn bench(criterion: &mut Criterion, preset: &str) {
    let config = Config::from_settings(&[Setting::flag("bench", "mocap.preset", preset)]).unwrap();
    let mut cameras = Cameras::new(&config.mocap, config.clock.seed);
    let mut truth = TruthV1 {
        time: Time::VIRTUAL_START,
        position: [0.1, 0.2, 1.0],
        attitude: [0.0, 0.0, 0.0, 1.0],
        ..TruthV1::default()
    };
    let mut delivered = 0_u64;
    criterion.bench_function(&format!("cameras/{preset}"), |bencher| {
        bencher.iter(|| {
            truth.capture += 1;
            truth.time = truth.time + Span::period_of(60.0);
            cameras.capture(black_box(&truth));
            while let Some(delivery) = cameras.deliver(truth.time) {
                delivered += 1;
                black_box(delivery);
            }
        });
    });
    assert!(delivered * 2 > truth.capture);
}

fn cameras(criterion: &mut Criterion) {
    bench(criterion, "qualisys");
    bench(criterion, "measured");
}

criterion_group!(benches, cameras);
criterion_main!(benches);
