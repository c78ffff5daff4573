//! Duration of one frame in the emulated cameras: for each preset, and for the marker model with six cameras and eight markers
//! (limit: 100 us).

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_mocap_emu::Cameras;

fn bench(criterion: &mut Criterion, preset: &str, model: &str) {
    let settings = [("mocap.preset", preset), ("mocap.model", model)];
    let settings = settings.map(|(key, value)| Setting::flag("bench", key, value));
    let config = Config::from_settings(&settings).unwrap();
    let mut cameras = Cameras::new(&config.mocap, config.clock.seed);
    let mut truth = TruthV1 {
        time: Time::VIRTUAL_START,
        position: [0.1, 0.2, 1.0],
        attitude: [0.0, 0.0, 0.0, 1.0],
        ..TruthV1::default()
    };
    let mut delivered = 0_u64;
    criterion.bench_function(&format!("cameras/{preset}-{model}"), |bencher| {
        bencher.iter(|| {
            truth.capture += 1;
            truth.time = truth.time + Span::period_of(config.mocap.rate_hz);
            cameras.capture(black_box(&truth));
            while let Some(delivery) = cameras.deliver(truth.time) {
                delivered += 1;
                black_box(delivery);
            }
        });
    });
    assert!(delivered * 5 > truth.capture);
}

fn cameras(criterion: &mut Criterion) {
    bench(criterion, "qualisys", "pose");
    bench(criterion, "measured", "pose");
    bench(criterion, "room", "pose");
    bench(criterion, "qualisys", "markers");
}

criterion_group!(benches, cameras);
criterion_main!(benches);
