//! What may be said to a vehicle, whatever the daemon, the vehicle and the clock do.

use oqtal_bridge::{CommandGate, ForwardedCommand, MotorStatus, SafetyLimits, VehicleSetpoint};
use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, Stamps};
use oqtal_bus::time::{Span, Time};
use proptest::prelude::*;

const PERIOD: Span = Span::from_nanos(16_666_667);
const LIMITS: SafetyLimits = SafetyLimits {
    command_age: Span::from_nanos(50_000_001),
    status_age: Span::from_millis(375),
    sequence: Span::from_millis(3000),
    rest: Span::from_millis(1500),
};
const START: Time = Time::VIRTUAL_START;

/// Something that happens, and how long after the last thing.
#[derive(Clone, Debug)]
enum Stimulus {
    /// A command that was published so long ago, or is said to come from the future.
    Command {
        kind: u8,
        stick: f64,
        age_us: i64,
    },
    Status {
        run: bool,
    },
    Reopened,
    VehicleFrame,
}

fn event() -> impl Strategy<Value = Stimulus> {
    let stick = prop_oneof![-1.0..1.0, Just(f64::NAN), Just(f64::INFINITY)];
    let age = prop_oneof![4 => 0..2000_i64, 1 => 0..200_000_i64, 1 => -50_000..0_i64];
    prop_oneof![
        6 => (0..4_u8, stick, age).prop_map(|(kind, stick, age_us)| Stimulus::Command { kind, stick, age_us }),
        3 => any::<bool>().prop_map(|run| Stimulus::Status { run }),
        1 => Just(Stimulus::Reopened),
        8 => Just(Stimulus::VehicleFrame),
    ]
}

fn events() -> impl Strategy<Value = Vec<(i64, Stimulus)>> {
    let pause = prop_oneof![6 => 0..20_000_i64, 1 => 0..2_000_000_i64];
    prop::collection::vec((pause, event()), 1..200)
}

fn flight(stick: f64) -> CommandV1 {
    let actuation = Actuation::Sticks.code();
    CommandV1 { actuation, sticks: [stick, 0.0, 0.0], thrust: 0.5, ..CommandV1::default() }
}

fn header(sequence: u64, published_at: Time) -> Header {
    let stamps = Stamps { command_published_at: published_at, ..Stamps::default() };
    Header { sequence, stamps, ..Header::default() }
}

proptest! {
    #[test]
    fn no_frame_carries_a_command_older_than_three_periods(events in events()) {
        let mut safety = CommandGate::new(START, LIMITS);
        let (mut now, mut sequence) = (START, 0);
        let mut published = std::collections::BTreeMap::new();
        let mut neutral_first = true;
        for (pause_us, event) in events {
            now = now + Span::from_nanos(pause_us * 1000);
            match event {
                Stimulus::Command { kind, stick, age_us } => {
                    sequence += 1;
                    let at = now - Span::from_nanos(age_us * 1000);
                    let command = CommandV1 { actuation: kind, ..flight(stick + sequence as f64) };
                    safety.receive(now, &header(sequence, at), command);
                    published.insert(command.sticks[0].to_bits(), at);
                }
                Stimulus::Status { run } => safety.hear(MotorStatus { heard_at: now, run }),
                Stimulus::Reopened => {
                    safety.forget(now);
                    neutral_first = true;
                }
                Stimulus::VehicleFrame => {
                    let (setpoint, about, _) = safety.decide(now);
                    if let VehicleSetpoint::Fly(command) = setpoint {
                        let at = published[&command.sticks[0].to_bits()];
                        prop_assert!(at <= now && now.since(at) <= LIMITS.command_age);
                        prop_assert!(command.sticks.iter().all(|stick| stick.is_finite()));
                        prop_assert_eq!(command.actuation, Actuation::Sticks.code());
                    }
                    if let Some(ForwardedCommand { stamps, .. }) = about {
                        prop_assert!(now.since(stamps.command_published_at) <= LIMITS.command_age);
                    }
                    prop_assert!(!neutral_first || setpoint == VehicleSetpoint::Zero, "{:?}", setpoint);
                    neutral_first = false;
                }
            }
        }
    }

    #[test]
    fn a_toggle_is_sent_only_while_a_fresh_status_asks_for_it_and_not_for_ever(events in events()) {
        let mut safety = CommandGate::new(START, LIMITS);
        let (mut now, mut sequence) = (START, 0);
        let mut status: Option<(Time, bool)> = None;
        let mut toggling_since = None;
        for (pause_us, event) in events {
            now = now + Span::from_nanos(pause_us * 1000);
            match event {
                Stimulus::Command { kind, stick, age_us } => {
                    sequence += 1;
                    let at = now - Span::from_nanos(age_us * 1000);
                    safety.receive(now, &header(sequence, at), CommandV1 { actuation: kind, ..flight(stick) });
                }
                Stimulus::Status { run } => {
                    status = Some((now, run));
                    safety.hear(MotorStatus { heard_at: now, run });
                }
                Stimulus::Reopened => {
                    status = None;
                    safety.forget(now);
                }
                Stimulus::VehicleFrame => {
                    let (setpoint, ..) = safety.decide(now);
                    let wanted = match setpoint {
                        VehicleSetpoint::StartMotors => Some(false),
                        VehicleSetpoint::StopMotors => Some(true),
                        VehicleSetpoint::Zero | VehicleSetpoint::Fly(_) => None,
                    };
                    let Some(run) = wanted else {
                        if !safety.is_in_sequence() {
                            toggling_since = None;
                        }
                        continue;
                    };
                    let (heard_at, said) = status.expect("a toggle without any status");
                    prop_assert_eq!(said, run);
                    prop_assert!(now.since(heard_at) <= LIMITS.status_age);
                    let since = *toggling_since.get_or_insert(now);
                    prop_assert!(now.since(since) < LIMITS.sequence + LIMITS.sequence);
                }
            }
        }
    }
}

/// A vehicle whose motors were started by commands, up to the first frame that passes one on.
struct Flying {
    safety: CommandGate,
    now: Time,
    sequence: u64,
}

impl Flying {
    fn new() -> Self {
        let mut flying = Self { safety: CommandGate::new(START, LIMITS), now: START, sequence: 0 };
        for _ in 0..5 {
            flying.frame();
        }
        flying.status(false);
        assert_eq!(flying.command(flight(0.1)), VehicleSetpoint::StartMotors);
        flying.status(true);
        assert!(matches!(flying.command(flight(0.1)), VehicleSetpoint::Fly(_)));
        flying
    }

    /// The next frame, a period later.
    fn frame(&mut self) -> VehicleSetpoint {
        self.now = self.now + PERIOD;
        self.safety.decide(self.now).0
    }

    fn command(&mut self, command: CommandV1) -> VehicleSetpoint {
        self.sequence += 1;
        self.safety.receive(self.now + PERIOD, &header(self.sequence, self.now + PERIOD), command);
        self.frame()
    }

    fn status(&mut self, run: bool) {
        self.safety.hear(MotorStatus { heard_at: self.now, run });
    }

    fn frames(&mut self, count: usize) -> Vec<VehicleSetpoint> {
        (0..count).map(|_| self.frame()).collect()
    }
}

#[test]
fn f14_after_the_last_command_at_most_four_frames_are_not_neutral_however_long_nobody_speaks() {
    let mut flying = Flying::new();
    let mut after = Vec::new();
    for _ in 0..600 {
        flying.status(true);
        after.push(flying.frame());
    }
    let first = after.iter().position(|setpoint| *setpoint == VehicleSetpoint::Zero).unwrap();
    assert!(first <= 4, "{first}");
    assert!(
        after[first..].iter().all(|setpoint| *setpoint == VehicleSetpoint::Zero),
        "no toggle either"
    );
}

#[test]
fn a_disarmed_vehicle_is_stopped_after_a_rest_and_not_before() {
    let mut flying = Flying::new();
    let mut orders = Vec::new();
    for _ in 0..100 {
        flying.status(true);
        orders.push(flying.command(CommandV1::default()));
    }
    let first = orders.iter().position(|setpoint| *setpoint != VehicleSetpoint::Zero).unwrap();
    assert!((89..=92).contains(&first), "1.5 s are 90 periods, not {first}");
    assert_eq!(orders[first], VehicleSetpoint::StopMotors);
    flying.status(false);
    assert_eq!(flying.command(CommandV1::default()), VehicleSetpoint::Zero);
}

#[test]
fn a_daemon_that_never_stopped_wanting_to_fly_does_not_restart_the_motors_after_a_reopened_port() {
    let mut flying = Flying::new();
    flying.safety.forget(flying.now);
    for _ in 0..300 {
        flying.status(false);
        assert_eq!(flying.command(flight(0.1)), VehicleSetpoint::Zero);
    }
    for _ in 0..5 {
        flying.command(CommandV1::default());
    }
    flying.status(false);
    assert_eq!(flying.command(flight(0.1)), VehicleSetpoint::StartMotors);
}

#[test]
fn f15_a_daemon_that_comes_back_after_a_long_silence_must_be_disarmed_first() {
    let mut flying = Flying::new();
    flying.frames(120);
    flying.status(true);
    assert_eq!(flying.command(flight(0.1)), VehicleSetpoint::Zero);
}

#[test]
fn f15_a_daemon_that_paused_for_some_periods_flies_on() {
    let mut flying = Flying::new();
    flying.frames(10);
    flying.status(true);
    assert!(matches!(flying.command(flight(0.1)), VehicleSetpoint::Fly(_)));
}

#[test]
fn a_command_that_waited_while_the_bridge_was_stopped_is_never_sent() {
    let mut flying = Flying::new();
    let published = flying.now;
    flying.now = flying.now + Span::from_millis(200);
    assert!(!flying.safety.receive(flying.now, &header(99, published), flight(0.7)));
    assert_eq!(flying.frame(), VehicleSetpoint::Zero);
    assert_eq!(flying.safety.refused(), 1);
}

#[test]
fn the_last_word_of_a_daemon_is_taken_though_it_has_no_stamps() {
    let mut flying = Flying::new();
    flying.safety.receive(flying.now, &header(100, Time::UNSET), CommandV1::default());
    assert_eq!(flying.frame(), VehicleSetpoint::Zero);
}
