//! One pose through the estimator.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use oqtal_control::estimator::{Estimator, EstimatorOptions};
use oqtal_control::quaternion::Attitude;

const DT_S: f64 = 1.0 / 60.0;

fn estimator(criterion: &mut Criterion) {
    let mut estimator = Estimator::new(EstimatorOptions::default());
    let attitude = Attitude::from_rotation_vector(Vector3::new(0.05, -0.1, 0.2));
    let mut frame = 0.0;
    criterion.bench_function("estimator/pose", |bencher| {
        bencher.iter(|| {
            frame += 1.0;
            let t_s = frame * DT_S;
            let position = Vector3::new(0.1 * t_s, 0.0, 1.0);
            estimator.update(black_box(t_s), black_box(position), black_box(attitude))
        });
    });
    // Otherwise poses were refused.
    assert!(estimator.latest().velocity.x > 0.05);
}

criterion_group!(benches, estimator);
criterion_main!(benches);
