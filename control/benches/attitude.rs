//! One step of each attitude law in each input form, the gain already computed.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Vector3};
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, ClassicLqr, ControlOptions, Geometric,
    InputForm, Oqtal, OqtalDt, QuaternionPid, RateInput, TorqueInput,
};
use oqtal_control::quantity::{AngularAcceleration, BodyRate};
use oqtal_control::quaternion::Attitude;
use oqtal_control::rigid_body::Inertia;

const DT_S: f64 = 1.0 / 60.0;

fn step(criterion: &mut Criterion, name: &str, mut law: impl AttitudeLaw) {
    let state = AttitudeState {
        attitude: Attitude::from_rotation_vector(Vector3::new(0.05, -0.1, 0.2)),
        rate: BodyRate(Vector3::new(0.1, -0.05, 0.08)),
    };
    let reference = AttitudeReference {
        attitude: Attitude::from_rotation_vector(Vector3::new(0.02, 0.03, 0.15)),
        rate: BodyRate(Vector3::new(0.03, 0.02, -0.05)),
        acceleration: AngularAcceleration::default(),
    };
    law.update(&state, &reference, DT_S);
    criterion.bench_function(name, |bencher| {
        bencher.iter(|| law.update(black_box(&state), black_box(&reference), black_box(DT_S)));
    });
    // Otherwise the benchmark would measure a Riccati solution.
    assert!(law.riccati_solves() <= 1);
}

fn laws(
    criterion: &mut Criterion,
    form: &str,
    options: &ControlOptions,
    input: impl InputForm + Copy,
) {
    step(criterion, &format!("{form}/pid"), QuaternionPid::new(options.pid, input).unwrap());
    step(criterion, &format!("{form}/lqr"), ClassicLqr::new(options.lqr, input).unwrap());
    step(criterion, &format!("{form}/oqtal"), Oqtal::new(options.oqtal, input).unwrap());
    let law = OqtalDt::new(options.oqtal_dt, input, DT_S).unwrap();
    step(criterion, &format!("{form}/oqtal-dt"), law);
    let law = Geometric::new(options.geometric, input).unwrap();
    step(criterion, &format!("{form}/geometric"), law);
}

fn attitude(criterion: &mut Criterion) {
    let rate = RateInput::new(Vector3::repeat(2.0)).unwrap();
    laws(criterion, "rate", &ControlOptions::default(), rate);
    let inertia = Inertia::new(Matrix3::from_diagonal_element(0.5)).unwrap();
    let torque = TorqueInput::new(inertia, 10.0).unwrap();
    laws(criterion, "torque", &ControlOptions::spacecraft(), torque);
}

criterion_group!(benches, attitude);
criterion_main!(benches);
