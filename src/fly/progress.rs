//! Progress bar and interrupts of a flight in progress.

use std::cell::Cell;
use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use indicatif::{ProgressBar, ProgressStyle};
use oqtal_bus::code::{ControlHolder, HandoverCause, Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::{TelemetryV1, VehicleV1};
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::time::{Span, Time};
use oqtal_control::trajectory::Phase;
use oqtal_lab::mission::Mission;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;

use oqtal_observe::recorder::Recorder;

/// Time after which obstacles that prevent the take-off are reported.
const OBSTACLE_TIMEOUT: Span = Span::from_millis(1000);

/// Progress bar: one line on standard error, cut off at the width of the terminal and removed on drop; invisible if standard
/// error is not a terminal. Obstacles to the take-off and the first hand-over to the fallback law are printed in any case.
#[derive(Debug)]
pub struct FlightProgress {
    bar: ProgressBar,
    /// Whether a flight was requested; `false` in a replay.
    awaits_flight: bool,
    obstruction: Cell<Obstruction>,
    fallback_is_said: Cell<bool>,
}

/// Obstacles to the take-off.
#[derive(Clone, Copy, Debug, Default)]
struct Obstruction {
    obstacles: ArmingObstacles,
    since: Time,
    said: ArmingObstacles,
}

impl FlightProgress {
    /// A bar for the flight `mission`.
    pub fn new(mission: &Mission) -> Self {
        let bar = ProgressBar::new(mission.expected().seconds().ceil() as u64);
        let style = ProgressStyle::with_template("{bar:8.cyan/blue} {pos:>3}/{len} s {wide_msg}");
        bar.set_style(style.expect("the template is constant and valid"));
        bar.set_message("waiting for the processes");
        let awaits_flight = mission.recording.is_none();
        let (obstruction, fallback_is_said) = (Cell::default(), Cell::default());
        Self { bar, awaits_flight, obstruction, fallback_is_said }
    }

    /// Shows the newest tick of `recorder`.
    pub fn show(&self, recorder: &Recorder) {
        let Some(sample) = recorder.latest() else { return };
        let telemetry = &sample.telemetry;
        // After a flight they are obstacles to another one, which nobody awaits.
        if self.awaits_flight && !recorder.was_armed() {
            self.report_obstacles(telemetry);
        }
        if telemetry.fallback == 1 && !self.fallback_is_said.get() {
            self.report_fallback(telemetry);
        }
        if telemetry.mission_s.is_finite() {
            self.bar.set_position(telemetry.mission_s.max(0.0) as u64);
        }
        let mode =
            Mode::from_code(telemetry.mode).map_or_else(String::new, |mode| mode.to_string());
        let flying = telemetry.mode == Mode::Flying.code();
        let phase = Phase::from_number(telemetry.phase).filter(|_| flying);
        // A phase implies that the vehicle is flying.
        let doing = phase.map_or(mode, |phase| phase.to_string());
        let state = match SafetyState::from_code(telemetry.state) {
            Some(SafetyState::Nominal) | None => String::new(),
            Some(state) => format!(" {state}"),
        };
        let [x, y, z] = sample.position().into();
        let error_cm = 100.0 * sample.position_error().norm();
        self.bar.set_message(format!(
            "{doing}{state}, {error_cm:.0} cm off at {x:+.1} {y:+.1} {z:+.1} m{}",
            recorder.wire().latest().map_or_else(String::new, vehicle)
        ));
    }

    /// Prints the obstacles to the take-off, again when there is a new one, after [`OBSTACLE_TIMEOUT`].
    fn report_obstacles(&self, telemetry: &TelemetryV1) {
        let obstacles = ArmingObstacles::from_bits(telemetry.obstacles);
        let Obstruction { obstacles: last, since, mut said } = self.obstruction.get();
        let since = if last == obstacles { since } else { telemetry.time };
        let is_long = telemetry.time.since(since) >= OBSTACLE_TIMEOUT;
        if is_long && obstacles.iter().any(|obstacle| !said.contains(obstacle)) {
            said = ArmingObstacles::from_bits(said.bits() | obstacles.bits());
            self.bar.suspend(|| say(&format!("oqtal: no take-off yet: {obstacles}")));
        }
        self.obstruction.set(Obstruction { obstacles, since, said });
    }

    /// Prints why the fallback law flies, at the first hand-over.
    fn report_fallback(&self, telemetry: &TelemetryV1) {
        let cause = HandoverCause::from_code(telemetry.handover_cause);
        if let Some(cause) = cause.filter(|cause| *cause != HandoverCause::None) {
            self.bar.suspend(|| say(&format!("oqtal: the fallback law flies: {cause}")));
            self.fallback_is_said.set(true);
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for FlightProgress {
    fn drop(&mut self) {
        self.finish();
    }
}

/// State of a vehicle behind a bridge as text; empty for a simulated vehicle on the bus.
fn vehicle(vehicle: &VehicleV1) -> String {
    if !vehicle.link_quality.is_finite() && vehicle.wire_ns == 0 {
        return String::new();
    }
    let state = match vehicle {
        VehicleV1 { link: 0, .. } => return ", vehicle silent".to_owned(),
        vehicle if vehicle.control == ControlHolder::Another.code() => {
            return ", another has control".to_owned();
        }
        vehicle if vehicle.is_being_stopped() => ", motors being stopped",
        vehicle if vehicle.is_starting() => ", motors starting",
        VehicleV1 { armed: 1, .. } => "",
        _ => ", motors off",
    };
    let VehicleV1 { battery_v, link_quality, .. } = vehicle;
    format!("{state}, {battery_v:.1} V, link {:.0} %", 100.0 * link_quality)
}

/// Interrupts by Ctrl-C: the first lands the vehicle, the second stops the motors. The loss of the terminal lands the vehicle.
#[derive(Debug)]
pub struct Interrupts {
    count: Arc<AtomicU32>,
    seen: AtomicU32,
}

impl Interrupts {
    /// Installs the signal handler; possible once per process.
    ///
    /// # Errors
    /// The operating system refuses the handler.
    pub fn listen() -> Result<Self, Failure> {
        let count = Arc::new(AtomicU32::new(0));
        let counter = Arc::clone(&count);
        let has_terminal = || File::open("/dev/tty").is_ok();
        let had_terminal = has_terminal();
        ctrlc::set_handler(move || {
            // The loss of a terminal is signalled by the shell and by the kernel: they are not a second Ctrl-C.
            if had_terminal && !has_terminal() {
                counter.fetch_max(1, Ordering::AcqRel);
            } else {
                counter.fetch_add(1, Ordering::AcqRel);
            }
        })
        .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))?;
        Ok(Self { count, seen: AtomicU32::new(0) })
    }

    /// Whether there was an interrupt.
    pub fn any(&self) -> bool {
        self.count.load(Ordering::Acquire) > 0
    }

    /// Fails if there was an interrupt; to be called before the take-off.
    ///
    /// # Errors
    /// There was an interrupt (exit code 1).
    pub fn check(&self) -> Result<(), Failure> {
        if self.any() { Err(before_take_off()) } else { Ok(()) }
    }

    /// Operator command for interrupts since the last call; `None` without a new interrupt.
    pub fn next(&self) -> Option<OperatorCommand> {
        let count = self.count.load(Ordering::Acquire);
        if count == self.seen.swap(count, Ordering::AcqRel) {
            return None;
        }
        Some(if count == 1 { OperatorCommand::Land } else { OperatorCommand::Stop })
    }
}

/// Tells the operator the effect of an interrupt in flight.
pub fn tell_interrupt(command: OperatorCommand) {
    say(match command {
        OperatorCommand::Land => "landing; Ctrl-C again stops the motors",
        _ => "stopping",
    });
}

/// Failure of a flight that was interrupted before its take-off.
pub fn before_take_off() -> Failure {
    Failure::new(Exit::Flight, "interrupted before the take-off")
}
