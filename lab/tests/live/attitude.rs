//! Attitudes that a planner prescribes, flown by a law that fails.

use oqtal_bus::code::{OperatorCommand, ReferenceKind};
use oqtal_bus::message::{ExternalV1, ReferenceV1, StateV1};
use oqtal_bus::time::Span;
use oqtal_control::quaternion::Attitude;
use oqtal_daemon::{ExternalLaw, LawPort};
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;

use super::{fly_for, hover};
use crate::external::pd::PositionPd;

/// A law that flies prescribed attitudes for this number of ticks, then answers no more.
struct Attitudes(u32);

impl ExternalLaw for Attitudes {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let good = PositionPd::default().command(state);
        let Some(wanted) = Attitude::from_xyzw(state.reference_attitude) else { return Some(good) };
        self.0 = self.0.checked_sub(1)?;
        let left = Attitude::from_xyzw(state.attitude).unwrap().rotation_to(&wanted);
        let rate = (left * 6.0).map(|rate| rate.clamp(-1.5, 1.5)).into();
        Some(ExternalV1 { rate, attitude: wanted.xyzw(), ..good })
    }
}

#[test]
fn f70_a_law_that_fails_while_it_flies_a_prescribed_attitude_is_followed_by_a_stop() {
    let mission = hover(20.0, &["control.controller=external"]);
    let law = LawPort::of(Attitudes(40));
    let mut flight = OnlineFlight::begin_with(&mission, None, law).unwrap();
    fly_for(&mut flight, 8.0);
    let period = Span::from_millis(20);
    flight.pause_every(period);
    // The planner does not notice, and continues for 3 s.
    let half_rad = 4.0_f64.to_radians();
    for _ in 0..180 {
        let now = flight.now();
        flight
            .publish(ReferenceV1 {
                time: now,
                valid_until: now + period.scaled(3.0),
                kind: ReferenceKind::Attitude.code(),
                position: [0.0, 0.0, 1.0],
                attitude: [0.0, half_rad.sin(), 0.0, half_rad.cos()],
                ..ReferenceV1::default()
            })
            .unwrap();
        assert!(flight.advance().unwrap());
    }
    let ticks: Vec<_> = flight.samples().iter().map(|sample| sample.telemetry).collect();
    let failed = ticks.iter().position(|tick| tick.handovers > 0).expect("the law fails");
    let speed = |index: usize| ticks[index].velocity.iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!(speed(failed) > 0.5, "{} m/s", speed(failed));
    let tilt = |index: usize| ticks[index].attitude_command[1];
    assert!(tilt(failed - 1) > 0.06 && tilt(failed + 1) < 0.05, "the command of the planner");
    let way = |tick: &oqtal_bus::message::TelemetryV1| {
        (0..2).map(|axis| (tick.position[axis] - ticks[failed].position[axis]).powi(2)).sum::<f64>()
    };
    let furthest_m = ticks[failed..].iter().map(way).fold(0.0, f64::max).sqrt();
    let stopped = speed(ticks.len() - 1);
    assert!(furthest_m < 1.5 && stopped < 0.1, "{furthest_m} m, {stopped} m/s");
    assert!(flight.request(OperatorCommand::Land).unwrap());
    flight.end_after(Span::from_millis(20_000));
    assert_eq!(flight.finish().unwrap().outcome, Outcome::Landed);
}
