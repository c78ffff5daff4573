//! A whole turn of the daemon: guard, estimator, outer loops, attitude law, limits, report; with the gain at hand, and with a
//! Riccati equation solved in every turn.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::{Header, PoseV1, Stamps, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_daemon::{Cycle, trajectory};

/// A daemon that hovers, and the cameras that see it.
struct Hover {
    cycle: Cycle,
    now: Time,
    frame: u64,
}

impl Hover {
    fn new(settings: &[(&str, &str)]) -> Self {
        let mut flags = vec![
            Setting::flag("bench", "trajectory.kind", "hover"),
            Setting::flag("bench", "trajectory.duration-s", 3600.0),
        ];
        flags.extend(settings.iter().map(|(key, value)| Setting::flag("bench", key, *value)));
        let config = Config::from_settings(&flags).unwrap();
        let now = Time::VIRTUAL_START;
        let mut cycle = Cycle::new(&config, trajectory(&config).unwrap(), now).unwrap();
        cycle.request(now, OperatorCommand::Fly);
        Self { cycle, now, frame: 0 }
    }

    /// The pose of the next frame, and what the daemon makes of it.
    fn turn(&mut self) -> u64 {
        self.frame += 1;
        self.now = self.now + Span::period_of(60.0);
        let noise = if self.frame.is_multiple_of(2) { 1e-4 } else { -1e-4 };
        let pose = PoseV1 {
            position: [noise, 0.0, 1.0],
            attitude: [noise, 0.0, 0.0, 1.0],
            tracked: 1,
            ..PoseV1::default()
        };
        let stamps = Stamps {
            captured_at: self.now - Span::from_millis(15),
            pose_published_at: self.now,
            ..Stamps::default()
        };
        let header =
            Header { sequence: self.frame, pose_sequence: self.frame, stamps, ..Header::default() };
        let arrival = (header, pose);
        let vehicle = VehicleV1 { link: 1, armed: 1, ..VehicleV1::default() };
        self.cycle.receive_vehicle(self.now, &Header::default(), &vehicle);
        match self.cycle.step(black_box(self.now), Some(black_box(&arrival))) {
            Some(tick) => self.cycle.report(&tick.stamps, self.frame).riccati_solves,
            None => 0,
        }
    }
}

fn bench(criterion: &mut Criterion, name: &str, settings: &[(&str, &str)]) {
    criterion.bench_function(name, |bencher| {
        // Each measurement uses a new flight, so that none ends while it is timed.
        bencher.iter_batched_ref(
            || {
                let mut hover = Hover::new(settings);
                for _ in 0..60 {
                    hover.turn();
                }
                hover
            },
            Hover::turn,
            criterion::BatchSize::SmallInput,
        );
    });
}

fn cycle(criterion: &mut Criterion) {
    for law in ["pid", "lqr", "oqtal"] {
        bench(criterion, &format!("cycle/{law}"), &[("control.controller", law)]);
    }
    for law in ["lqr", "oqtal"] {
        let resolve = format!("control.{law}.resolve");
        let settings = [("control.controller", law), (&*resolve, "every-tick")];
        bench(criterion, &format!("cycle/{law}, solve every tick"), &settings);
    }
}

criterion_group!(benches, cycle);
criterion_main!(benches);
