//! Selection of set-points for any behaviour of the daemon, the vehicle and the clock.

use oqtal_bridge::{
    CommandGate, ForwardedCommand, MotorEvent, MotorStatus, ReportedMotors, VehicleSetpoint,
};
use oqtal_bus::code::{Actuation, ControlHolder};
use oqtal_bus::message::CommandV1;
use oqtal_bus::stop::StoppedMotors;
use oqtal_bus::time::{Span, Time};
use proptest::prelude::*;

use crate::common::{LIMITS, PERIOD, START, header};

/// Input of the gate.
#[derive(Clone, Debug)]
enum Stimulus {
    /// A command of this actuation code, published `age_us` ago \[us\]; negative for the future.
    Command { actuation: u8, stick: f64, age_us: i64 },
    /// The vehicle reports its motors.
    Status { motors: ReportedMotors },
    /// Holder of the control of the vehicle.
    Control(ControlHolder),
    /// The port is opened again.
    Reopened,
    /// A set-point is due.
    Frame,
}

fn stimulus() -> impl Strategy<Value = Stimulus> {
    let stick = prop_oneof![-1.0..1.0, Just(f64::NAN), Just(f64::INFINITY)];
    let age = prop_oneof![4 => 0..2000_i64, 1 => 0..200_000_i64, 1 => -50_000..0_i64];
    let command = (0..5_u8, stick, age);
    prop_oneof![
        6 => command.prop_map(|(actuation, stick, age_us)| Stimulus::Command { actuation, stick, age_us }),
        3 => prop_oneof![Just(ReportedMotors::Off), Just(ReportedMotors::SpoolingUp), Just(ReportedMotors::Running)]
            .prop_map(|motors| Stimulus::Status { motors }),
        1 => prop_oneof![Just(ControlHolder::Bridge), Just(ControlHolder::Another)].prop_map(Stimulus::Control),
        1 => Just(Stimulus::Reopened),
        8 => Just(Stimulus::Frame),
    ]
}

/// Stimuli, each after a pause \[us\].
fn stimuli() -> impl Strategy<Value = Vec<(i64, Stimulus)>> {
    let pause = prop_oneof![6 => 0..20_000_i64, 1 => 0..2_000_000_i64];
    prop::collection::vec((pause, stimulus()), 1..200)
}

fn flight(stick: f64) -> CommandV1 {
    let actuation = Actuation::Sticks.code();
    CommandV1 { actuation, sticks: [stick, 0.0, 0.0], thrust: 0.5, ..CommandV1::default() }
}

/// Applies stimuli to a gate, and records the reference for comparison.
struct Player {
    gate: CommandGate,
    now: Time,
    sequence: u64,
    /// Publication of each command, by the bits of its first stick.
    published: std::collections::BTreeMap<u64, Time>,
    status: Option<MotorStatus>,
    /// No frame has been sent since the port was opened.
    is_first: bool,
}

impl Player {
    fn new() -> Self {
        let (gate, published) = (CommandGate::new(START, LIMITS), Default::default());
        Self { gate, now: START, sequence: 0, published, status: None, is_first: true }
    }

    /// Applies a stimulus; returns the set-point of a frame, and the command that it forwards.
    fn play(
        &mut self,
        pause_us: i64,
        stimulus: Stimulus,
    ) -> Option<(VehicleSetpoint, Option<ForwardedCommand>)> {
        self.now = self.now + Span::from_nanos(pause_us * 1000);
        match stimulus {
            Stimulus::Command { actuation, stick, age_us } => {
                self.sequence += 1;
                let at = self.now - Span::from_nanos(age_us * 1000);
                // A distinct stick for every command.
                let command = CommandV1 { actuation, ..flight(stick + self.sequence as f64) };
                self.gate.receive(self.now, &header(self.sequence, at), command);
                self.published.insert(command.sticks[0].to_bits(), at);
            }
            Stimulus::Status { motors } => {
                let status = MotorStatus { received_at: self.now, motors };
                self.status = Some(status);
                self.gate.update_status(status);
            }
            Stimulus::Control(control) => self.gate.update_control(control),
            Stimulus::Reopened => {
                self.gate.reset(self.now);
                (self.status, self.is_first) = (None, true);
            }
            Stimulus::Frame => {
                let (setpoint, forwarded, _) = self.gate.select_command(self.now);
                return Some((setpoint, forwarded));
            }
        }
        None
    }
}

proptest! {
    #[test]
    fn no_frame_carries_a_command_older_than_three_periods(stimuli in stimuli()) {
        let mut player = Player::new();
        for (pause_us, stimulus) in stimuli {
            let Some((setpoint, forwarded)) = player.play(pause_us, stimulus) else { continue };
            let now = player.now;
            if let VehicleSetpoint::Fly(command) = setpoint {
                let at = player.published[&command.sticks[0].to_bits()];
                prop_assert!(at <= now && now.since(at) <= LIMITS.command_age);
                prop_assert!(command.sticks.iter().all(|stick| stick.is_finite()));
                prop_assert_eq!(command.actuation, Actuation::Sticks.code());
            }
            if let Some(ForwardedCommand { stamps, .. }) = forwarded {
                prop_assert!(now.since(stamps.command_published_at) <= LIMITS.command_age);
            }
            let is_released = player.gate.control() == ControlHolder::Another;
            prop_assert_eq!(setpoint == VehicleSetpoint::Released, is_released);
            let is_quiet = matches!(setpoint, VehicleSetpoint::Zero | VehicleSetpoint::Released);
            prop_assert!(!player.is_first || is_quiet, "{:?}", setpoint);
            player.is_first = false;
        }
    }

    #[test]
    fn a_toggle_is_sent_only_while_a_fresh_status_asks_for_it_and_not_for_ever(stimuli in stimuli()) {
        let mut player = Player::new();
        let mut toggling_since = None;
        for (pause_us, stimulus) in stimuli {
            let Some((setpoint, _)) = player.play(pause_us, stimulus) else { continue };
            let running = match setpoint {
                VehicleSetpoint::StartMotors => false,
                VehicleSetpoint::StopMotors => true,
                VehicleSetpoint::Zero | VehicleSetpoint::Fly(_) | VehicleSetpoint::Released => {
                    toggling_since = toggling_since.filter(|_| player.gate.is_in_sequence());
                    continue;
                }
            };
            let status = player.status.expect("a toggle without any status");
            prop_assert_eq!(status.motors.are_armed(), running);
            prop_assert!(player.now.since(status.received_at) <= LIMITS.status_age);
            let since = *toggling_since.get_or_insert(player.now);
            prop_assert!(player.now.since(since) < LIMITS.sequence + LIMITS.sequence);
        }
    }
}

/// A flight: the motors were started by commands, and a first command was forwarded.
struct Flying {
    gate: CommandGate,
    now: Time,
    sequence: u64,
}

impl Flying {
    /// A vehicle with motors off, before a first command.
    fn waiting() -> Self {
        let mut flying = Self { gate: CommandGate::new(START, LIMITS), now: START, sequence: 0 };
        flying.frames(5);
        flying.status(false);
        flying
    }

    fn new() -> Self {
        let mut flying = Self::waiting();
        assert_eq!(flying.command(flight(0.1)), VehicleSetpoint::StartMotors);
        flying.status(true);
        assert!(matches!(flying.command(flight(0.1)), VehicleSetpoint::Fly(_)));
        flying
    }

    /// Decides the next frame, a period later.
    fn frame(&mut self) -> VehicleSetpoint {
        self.now = self.now + PERIOD;
        self.gate.select_command(self.now).0
    }

    fn command(&mut self, command: CommandV1) -> VehicleSetpoint {
        self.sequence += 1;
        self.gate.receive(self.now + PERIOD, &header(self.sequence, self.now + PERIOD), command);
        self.frame()
    }

    fn status(&mut self, running: bool) {
        self.gate.update_status(MotorStatus {
            received_at: self.now,
            motors: ReportedMotors::of(running),
        });
    }

    fn frames(&mut self, count: usize) -> Vec<VehicleSetpoint> {
        (0..count).map(|_| self.frame()).collect()
    }
}

#[test]
fn f14_after_the_last_command_at_most_four_frames_are_not_zero_however_long_the_silence() {
    let (mut flying, mut after, mut events) = (Flying::new(), Vec::new(), Vec::new());
    for _ in 0..600 {
        flying.status(true);
        flying.now = flying.now + PERIOD;
        let (setpoint, _, event) = flying.gate.select_command(flying.now);
        after.push(setpoint);
        events.extend(event);
    }
    let is_zero = |setpoint: &VehicleSetpoint| *setpoint == VehicleSetpoint::Zero;
    let first = after.iter().position(is_zero).unwrap();
    assert!(first <= 4 && after[first..].iter().all(is_zero), "{first}; no toggle either");
    assert_eq!(events, [MotorEvent::DaemonSilent(PERIOD.scaled(90.0))]);
}

#[test]
fn a_disarmed_vehicle_is_stopped_after_a_rest_and_not_before() {
    let mut flying = Flying::new();
    let mut setpoints = Vec::new();
    for _ in 0..100 {
        flying.status(true);
        setpoints.push(flying.command(CommandV1::default()));
    }
    let first = setpoints.iter().position(|setpoint| *setpoint != VehicleSetpoint::Zero).unwrap();
    assert!((89..=92).contains(&first), "1.5 s are 90 periods, not {first}");
    assert_eq!(setpoints[first], VehicleSetpoint::StopMotors);
    flying.status(false);
    assert_eq!(flying.command(CommandV1::default()), VehicleSetpoint::Zero);
}

#[test]
fn a_daemon_that_never_stopped_wanting_to_fly_does_not_restart_the_motors_after_a_reopened_port() {
    let mut flying = Flying::new();
    flying.gate.reset(flying.now);
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
fn a_command_that_waited_while_the_bridge_was_suspended_is_never_sent() {
    let mut flying = Flying::new();
    let published = flying.now;
    flying.now = flying.now + Span::from_millis(200);
    assert!(!flying.gate.receive(flying.now, &header(99, published), flight(0.7)));
    assert_eq!(flying.frame(), VehicleSetpoint::Zero);
    assert_eq!(flying.gate.rejected(), 1);
}

#[test]
fn the_final_disarmed_command_of_a_daemon_is_accepted_without_stamps() {
    let mut flying = Flying::new();
    flying.gate.receive(flying.now, &header(100, Time::UNSET), CommandV1::default());
    assert_eq!(flying.frame(), VehicleSetpoint::Zero);
}

#[test]
fn f15_an_operators_stop_ends_flight_at_once_and_stops_the_motors_without_rest() {
    let mut player = Player::new();
    let flown = |player: &mut Player, running: bool| {
        player.play(1000, Stimulus::Command { actuation: 1, stick: 0.1, age_us: 0 });
        player.play(100, Stimulus::Status { motors: ReportedMotors::of(running) });
        player.play(15_000, Stimulus::Frame).unwrap().0
    };
    // No flight is requested for a command timeout, then motors that run are flown.
    player.play(100_000, Stimulus::Status { motors: ReportedMotors::Running });
    player.play(0, Stimulus::Frame);
    flown(&mut player, true);
    assert!(matches!(flown(&mut player, true), VehicleSetpoint::Fly(_)));
    let stopped_at = player.now;
    player.gate.keep_stopped(Some(stopped_at));
    for _ in 0..30 {
        let setpoint = flown(&mut player, true);
        assert_eq!(setpoint, VehicleSetpoint::StopMotors);
        assert!(player.gate.stopped_motors() != StoppedMotors::Off);
    }
    for _ in 0..60 {
        assert_eq!(flown(&mut player, false), VehicleSetpoint::Zero);
    }
    assert!(player.gate.stopped_motors() == StoppedMotors::Off);
    player.gate.keep_stopped(None);
    assert!(matches!(flown(&mut player, false), VehicleSetpoint::StartMotors));
}

#[test]
fn f57_nothing_is_sent_while_another_has_control_until_it_returns_and_flight_is_requested_again() {
    let mut flying = Flying::new();
    flying.status(true);
    assert!(matches!(flying.command(flight(0.1)), VehicleSetpoint::Fly(_)));
    flying.gate.update_control(ControlHolder::Another);
    let (setpoint, forwarded, event) = flying.gate.select_command(flying.now);
    assert_eq!((setpoint, forwarded), (VehicleSetpoint::Released, None));
    assert_eq!(event, Some(MotorEvent::ControlTaken));
    assert!(!flying.gate.may_run(), "no emergency stop at the end of the bridge either");
    // The daemon commands "motors off" for any time: the pilot controls the motors.
    for _ in 0..300 {
        flying.status(true);
        assert_eq!(flying.command(CommandV1::default()), VehicleSetpoint::Released);
    }
    flying.gate.keep_stopped(Some(flying.now));
    assert_eq!(flying.frame(), VehicleSetpoint::Released);
    flying.gate.keep_stopped(None);
    // Control returns in the air while a daemon still requests flight: it must end its flight first.
    flying.command(flight(0.1));
    flying.gate.update_control(ControlHolder::Bridge);
    for _ in 0..30 {
        flying.status(true);
        assert_eq!(flying.command(flight(0.1)), VehicleSetpoint::Zero);
    }
    for _ in 0..120 {
        flying.status(true);
        assert_eq!(flying.command(CommandV1::default()), VehicleSetpoint::Zero, "not started here");
    }
    flying.status(true);
    assert!(matches!(flying.command(flight(0.1)), VehicleSetpoint::Fly(_)));
}

/// A report counts that arrived after the stop, while no toggle that was sent may still take effect.
#[test]
fn f33_the_motors_are_off_once_the_vehicle_says_so_after_a_stop() {
    let mut flying = Flying::new();
    flying.status(false);
    flying.gate.keep_stopped(Some(flying.now));
    assert!(flying.gate.stopped_motors() != StoppedMotors::Off, "reported with the stop");
    flying.frame();
    flying.status(false);
    flying.frame();
    assert!(flying.gate.stopped_motors() == StoppedMotors::Off && !flying.gate.is_starting());
    flying.status(true);
    assert!(flying.gate.stopped_motors() != StoppedMotors::Off);
    // A start sequence that was cancelled: the motors may still start.
    let mut starting = Flying::waiting();
    assert_eq!(starting.command(flight(0.1)), VehicleSetpoint::StartMotors);
    assert!(starting.gate.is_starting());
    starting.gate.keep_stopped(Some(starting.now));
    starting.frame();
    starting.status(false);
    assert!(starting.gate.stopped_motors() != StoppedMotors::Off);
}

#[test]
fn f33_a_flight_command_from_before_the_end_of_a_stop_is_never_sent() {
    let mut flying = Flying::new();
    flying.gate.keep_stopped(Some(flying.now));
    flying.gate.receive(flying.now, &header(9, flying.now), flight(0.2));
    flying.gate.keep_stopped(None);
    flying.status(true);
    assert!(!matches!(flying.frame(), VehicleSetpoint::Fly(_)));
    let mut disarmed = Flying::new();
    disarmed.gate.receive(disarmed.now, &header(9, disarmed.now), CommandV1::default());
    disarmed.gate.keep_stopped(Some(disarmed.now));
    disarmed.gate.keep_stopped(None);
    let (_, forwarded, _) = disarmed.gate.select_command(disarmed.now);
    assert_eq!(forwarded.map(|forwarded| forwarded.command), Some(9), "motors off is sent");
}

/// Start and stop are one toggle: without a recent status it might stop motors that have started.
#[test]
fn a_start_sequence_pauses_while_the_vehicle_does_not_report() {
    let mut starting = Flying::waiting();
    let sent: Vec<_> = (0..40).map(|_| starting.command(flight(0.1))).collect();
    assert_eq!([sent[0], sent[39]], [VehicleSetpoint::StartMotors, VehicleSetpoint::Zero]);
    starting.status(false);
    assert_eq!(starting.command(flight(0.1)), VehicleSetpoint::StartMotors);
    assert!(Flying::new().gate.may_run());
}
