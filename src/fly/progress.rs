//! Progress bar and interrupts of a flight under way.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use indicatif::{ProgressBar, ProgressStyle};
use oqtal_bus::code::{Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::VehicleV1;
use oqtal_bus::time::Span;
use oqtal_control::trajectory::Phase;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;

use oqtal_observe::recorder::Recorder;

/// A progress bar on standard error, removed when dropped; invisible where standard error is no terminal.
#[derive(Debug)]
pub struct FlightProgress {
    bar: ProgressBar,
}

impl FlightProgress {
    /// A bar for a flight of the duration `expected`.
    #[must_use]
    pub fn new(expected: Span) -> Self {
        let bar = ProgressBar::new(expected.seconds().ceil() as u64);
        let style = ProgressStyle::with_template("{bar:30.cyan/blue} {pos:>3}/{len} s  {msg}");
        bar.set_style(style.expect("the template is constant and valid"));
        bar.set_message("waiting for the processes");
        Self { bar }
    }

    /// Shows the newest tick of `recorder`.
    pub fn show(&self, recorder: &Recorder) {
        let Some(sample) = recorder.latest() else { return };
        let telemetry = &sample.telemetry;
        if telemetry.mission_s.is_finite() {
            self.bar.set_position(telemetry.mission_s.max(0.0) as u64);
        }
        let mode =
            Mode::from_code(telemetry.mode).map_or_else(String::new, |mode| mode.to_string());
        let flying = telemetry.mode == Mode::Flying.code();
        let phase = Phase::from_number(telemetry.phase).filter(|_| flying);
        let phase = phase.map_or_else(String::new, |phase| format!(", {phase}"));
        let state = match SafetyState::from_code(telemetry.state) {
            Some(SafetyState::Nominal) | None => String::new(),
            Some(state) => format!("  {state}"),
        };
        let [x, y, z] = sample.position().into();
        let error_cm = 100.0 * sample.position_error().norm();
        self.bar.set_message(format!(
            "{mode}{phase}{state}  at {x:+.2} {y:+.2} {z:+.2} m, {error_cm:.0} cm off{}",
            recorder.wire().latest().map_or_else(String::new, vehicle)
        ));
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
        VehicleV1 { starting: 1, .. } => "motors starting",
        VehicleV1 { armed: 1, .. } => "motors running",
        _ => "motors off",
    };
    let VehicleV1 { battery_v, link_quality, .. } = vehicle;
    format!(", {state}, {battery_v:.1} V, link {:.0} %", 100.0 * link_quality)
}

/// Interrupts by Ctrl-C: the first lands the vehicle, the second stops the motors.
#[derive(Debug)]
pub struct Interrupts {
    count: Arc<AtomicU32>,
    seen: AtomicU32,
}

impl Interrupts {
    /// Installs the signal handler; possible once in a process.
    ///
    /// # Errors
    /// The operating system refuses the handler.
    pub fn listen() -> Result<Self, Failure> {
        let count = Arc::new(AtomicU32::new(0));
        let counter = Arc::clone(&count);
        ctrlc::set_handler(move || {
            counter.fetch_add(1, Ordering::AcqRel);
        })
        .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))?;
        Ok(Self { count, seen: AtomicU32::new(0) })
    }

    /// Whether there was an interrupt.
    pub fn any(&self) -> bool {
        self.count.load(Ordering::Acquire) > 0
    }

    /// The operator's command since the last call; `None` without a new interrupt.
    pub fn next(&self) -> Option<OperatorCommand> {
        let count = self.count.load(Ordering::Acquire);
        if count == self.seen.swap(count, Ordering::AcqRel) {
            return None;
        }
        let command = if count == 1 { OperatorCommand::Land } else { OperatorCommand::Stop };
        say(if count == 1 { "landing; Ctrl-C again stops the motors" } else { "stopping" });
        Some(command)
    }
}
