//! Tests of the studies on whole flights. One program, since each of its modules would link the whole crate otherwise:
//! `cargo test -p oqtal-lab --test studies margins::` executes one module.

mod cameras;
mod external;
mod far_steps;
mod fast;
mod fence;
mod heading;
mod identify;
mod landing;
mod live;
mod live_tuning;
mod margins;
mod metrics;
mod online_tuning;
mod second_lag;
mod steps;
mod untold;

use oqtal_config::{Config, Setting};
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation;
use oqtal_observe::flight::Flight;

/// The configuration with these settings, each as `KEY=VALUE`.
fn config(settings: &[impl AsRef<str>]) -> Config {
    let parsed = settings.iter().map(|text| Setting::parse("test", text.as_ref()).unwrap());
    Config::from_settings(&parsed.collect::<Vec<_>>()).unwrap()
}

/// Random numbers of a linear congruential generator with a stable sequence.
struct Draw(u64);

impl Draw {
    /// A number in 0..1.
    fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn one<T: Copy>(&mut self, values: &[T]) -> T {
        values[(self.next() * values.len() as f64) as usize]
    }
}

/// The flight of `config` in one process.
fn flown(config: Config) -> Flight {
    simulation::fly(&Mission::new(config).unwrap()).unwrap()
}
