//! Selection between a law and its fallback, tick by tick. The fallback law is computed in every tick; the law's command is flown
//! while it passes the checks of the answer and of the envelope.
//!
//! A command that leads out of the envelope, or is not a number, is replaced at once. In every other change of the law the command
//! continues from the last one; the command in transition must pass the envelope, too.
//!
//! A law that failed returns after a number of good commands in a row, once the fallback has flown for a time in which the vehicle
//! recovers. Each failure soon after a return doubles this time, up to a limit. The time also applies to a new process of an external law,
//! since the vehicle must recover from either process, and to a law that connects for the first time in flight.

use oqtal_bus::code::HandoverCause;
use oqtal_config::Config;
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{Motion, MotionTracker};
use oqtal_control::quantity::StickCommand;

use crate::command::{RotationCommand, VehicleCommand};
use crate::envelope::{Candidate, Envelope};
use crate::handover::Handover;
use crate::stack::{ControlOutput, ControlStack};

/// Multiple of `external.return-answers` for which a law must fly before its next failure counts as a first one \[-\].
const STEADY_MULTIPLE: u32 = 10;
/// Greatest multiple of `external.return-answers` for which the fallback flies after a failure \[-\].
const LONGEST_MULTIPLE: u32 = 4;
/// Roll or pitch command, as a share of its range, above which the fallback's yaw command is reduced \[-\].
const YAW_GIVES_WAY: f64 = 0.5;

/// A tick in which a law is selected.
#[derive(Clone, Copy, Debug)]
pub struct GuardedTick<'a> {
    /// The motion predicted for the command's effect.
    pub ahead: &'a Motion,
    /// The model of the prediction.
    pub tracker: &'a MotionTracker,
    /// Heading of the reference \[rad\].
    pub heading_rad: f64,
    /// The last command.
    pub last: &'a VehicleCommand,
    /// Time since the last tick \[s\].
    pub dt_s: f64,
    /// Whether the law may fly: neither in take-off and landing nor while the daemon reacts to a fault.
    pub is_free: bool,
}

/// State of the selection for telemetry.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GuardReport {
    /// Failures of the law in this flight \[-\].
    pub handovers: u64,
    /// First reason against the law since it last flew; [`HandoverCause::Absent`] while no law is connected.
    pub cause: HandoverCause,
    /// Whether the fallback law computed the last command.
    pub is_fallback: bool,
    /// Whether it did so in a tick in which the law was permitted to fly.
    pub law_fails: bool,
}

/// Selection between a law and its fallback. No method but the constructor allocates.
#[derive(Clone, Debug)]
pub struct LawGuard {
    envelope: Envelope,
    handover: Handover,
    return_answers: u32,
    /// Ticks for which the fallback must fly before the law returns \[-\]; doubled by each failure soon after a return, up to
    /// [`LONGEST_MULTIPLE`].
    required_fallback: u32,
    /// Ticks that the fallback has flown since the last failure \[-\].
    recovered: u32,
    /// Good commands of the law in a row \[-\].
    good: u32,
    /// Ticks that the law has flown since its last failure \[-\].
    flown: u32,
    /// Whether the law failed and has not returned.
    failed: bool,
    /// First reason against the law since it last flew; `None` without one. [`HandoverCause::Absent`] only if a law that had flown was
    /// disconnected, and until there is another reason.
    failure: HandoverCause,
    /// Whether no law was connected in the last tick.
    is_absent: bool,
    /// Whether an operator gives control back to the law.
    resumes: bool,
    report: GuardReport,
}

impl LawGuard {
    /// The selection of `config`; the fallback flies.
    ///
    /// # Errors
    /// The vehicle has no model.
    pub fn new(config: &Config) -> Result<Self, OptionError> {
        Ok(Self {
            envelope: Envelope::new(config)?,
            handover: Handover::new(config),
            return_answers: config.external.return_answers,
            required_fallback: 0,
            recovered: 0,
            good: 0,
            flown: 0,
            failed: false,
            failure: HandoverCause::None,
            is_absent: false,
            resumes: false,
            report: GuardReport { is_fallback: true, ..GuardReport::default() },
        })
    }

    /// A flight begins: the fallback flies until the law may.
    pub fn restart(&mut self) {
        self.handover.reset();
        (self.required_fallback, self.recovered) = (0, 0);
        (self.good, self.flown) = (0, 0);
        (self.failed, self.resumes) = (false, false);
        self.failure = HandoverCause::None;
        self.report = GuardReport { is_fallback: true, ..GuardReport::default() };
    }

    /// Gives control back to a law that failed, at its next good command; `false` while no law is connected. The end of the law ends
    /// the request.
    pub fn resume(&mut self) -> bool {
        self.resumes = self.failed && !self.is_absent;
        !self.is_absent
    }

    /// Checks the next commands against `envelope`, and leaves the previous envelope in its place.
    pub fn exchange_envelope(&mut self, envelope: &mut Envelope) {
        std::mem::swap(&mut self.envelope, envelope);
    }

    /// Limits the slew of the next commands: what computes them has changed.
    pub fn begin_handover(&mut self) {
        self.handover.begin();
    }

    /// The state of the selection.
    pub fn report(&self) -> &GuardReport {
        &self.report
    }

    /// Selects the output of a tick: that of the law if it is good, else `fallback`. Returns it with the reason against the law's,
    /// [`HandoverCause::None`] if there is none.
    pub fn select(
        &mut self,
        tick: &GuardedTick,
        law: Result<ControlOutput, HandoverCause>,
        fallback: ControlOutput,
    ) -> (ControlOutput, HandoverCause) {
        let cause = match &law {
            Ok(output) => self.check(tick, &output.command),
            Err(cause) => *cause,
        };
        self.is_absent = cause == HandoverCause::Absent;
        self.resumes &= !matches!(cause, HandoverCause::Absent | HandoverCause::Ended);
        self.good = if cause == HandoverCause::None { self.good.saturating_add(1) } else { 0 };
        let selected = match law {
            Ok(output) if cause == HandoverCause::None && tick.is_free && self.may_return() => {
                self.towards_law(tick, output)
            }
            _ => Err(cause),
        };
        match selected {
            Ok(output) => {
                (self.failed, self.resumes) = (false, false);
                self.failure = HandoverCause::None;
                self.flown = self.flown.saturating_add(1);
                (self.report.is_fallback, self.report.law_fails) = (false, false);
                (output, cause)
            }
            Err(reason) => (self.towards_fallback(tick, fallback, reason), reason),
        }
    }

    fn may_return(&self) -> bool {
        let has_recovered =
            self.good >= self.return_answers && self.recovered >= self.required_fallback;
        !self.failed || self.resumes || self.return_answers > 0 && has_recovered
    }

    /// The law's `output` in transition from the last command, or why the transition must not be flown.
    fn towards_law(
        &mut self,
        tick: &GuardedTick,
        output: ControlOutput,
    ) -> Result<ControlOutput, HandoverCause> {
        let mut handover = self.handover.clone();
        if self.report.is_fallback {
            handover.begin_until_reached();
        }
        let command = handover.apply(tick.last, output.command, tick.dt_s);
        if command != output.command {
            match self.check(tick, &command) {
                HandoverCause::None => {}
                cause => return Err(cause),
            }
        }
        self.handover = handover;
        Ok(ControlOutput { command, ..output })
    }

    fn towards_fallback(
        &mut self,
        tick: &GuardedTick,
        fallback: ControlOutput,
        reason: HandoverCause,
    ) -> ControlOutput {
        self.report.law_fails = tick.is_free;
        if tick.is_free {
            self.note_failure(reason);
        }
        if !self.report.is_fallback {
            self.report.is_fallback = true;
            self.handover.reset();
            if !is_dangerous(reason) {
                self.handover.begin_until_reached();
            }
        }
        self.recovered = self.recovered.saturating_add(1);
        let command = match self.failed {
            true => with_tilt_first(fallback.command),
            false => fallback.command,
        };
        let transition = self.handover.apply(tick.last, command, tick.dt_s);
        if transition == command || self.check(tick, &transition) == HandoverCause::None {
            return ControlOutput { command: transition, ..fallback };
        }
        self.handover.reset();
        ControlOutput { command, ..fallback }
    }

    /// Records that the law fails in this tick, for `reason`, or that it waits for its return.
    fn note_failure(&mut self, reason: HandoverCause) {
        use HandoverCause::{Absent, None};
        let hands_over = !self.report.is_fallback;
        let is_first = match reason {
            None => false,
            Absent => hands_over,
            _ => matches!(self.failure, None | Absent),
        };
        if is_first {
            self.failure = reason;
        }
        self.report.cause = if reason == Absent { Absent } else { self.failure };
        if hands_over {
            self.record_failure();
        } else if self.good == 0 {
            // A law that has not flown hands nothing over, but returns like any other that failed.
            self.failed = true;
        }
    }

    /// Counts a failure, and sets the time for which the fallback flies after it.
    fn record_failure(&mut self) {
        let soon = self.flown < STEADY_MULTIPLE.saturating_mul(self.return_answers);
        self.required_fallback = match self.report.handovers {
            1.. if soon => {
                let longest = self.return_answers.saturating_mul(LONGEST_MULTIPLE);
                self.required_fallback.saturating_mul(2).min(longest)
            }
            _ => self.return_answers,
        };
        (self.flown, self.recovered, self.good) = (0, 0, 0);
        (self.failed, self.resumes) = (true, false);
        self.report.handovers += 1;
    }

    fn check(&self, tick: &GuardedTick, command: &VehicleCommand) -> HandoverCause {
        let GuardedTick { ahead, tracker, heading_rad, .. } = *tick;
        self.envelope.check(&Candidate { command, ahead, tracker, heading_rad })
    }
}

/// `command` with its yaw rate reduced under large commands of roll and pitch. All axes share the range of the rotors: a yaw rate that
/// is reversed together with roll and pitch can delay these by a tenth of a second, in which the vehicle tilts further.
fn with_tilt_first(mut command: VehicleCommand) -> VehicleCommand {
    if let VehicleCommand::Armed {
        rotation: RotationCommand::Sticks(StickCommand(sticks)), ..
    } = &mut command
    {
        let left = (1.0 - sticks.xy().amax()) / (1.0 - YAW_GIVES_WAY);
        sticks.z *= left.clamp(0.0, 1.0);
    }
    command
}

/// `next` with the control that the control stack keeps in a daemon that was started with `started`: the stack is the fallback of an
/// external law, and a fallback law is not changed in flight. Limits of the position loops are those of `next`.
pub(crate) fn of_stack(started: &Config, next: &Config) -> Config {
    if next.control.is_external() { trusted(started, next) } else { next.clone() }
}

/// `next` with the control of `started`.
fn trusted(started: &Config, next: &Config) -> Config {
    let mut trusted = next.clone();
    trusted.control = started.control;
    trusted
}

/// Note that the settings of `next` that differ from those of `present` do not change the fallback law; `None` if none is of it.
pub(crate) fn note_on_fallback(present: &Config, next: &Config) -> Option<String> {
    let own = match next.control.of_fallback() {
        // It flies on the predictive stack.
        Some(fallback) => {
            vec![format!("control.{}.", fallback.built_in().name()), "control.predictive.".into()]
        }
        None if next.control.is_external() => vec!["control.".to_owned()],
        None => return None,
    };
    let changed = present.differences(next).unwrap_or_default();
    let is_own = |line: &String| own.iter().any(|section| line.starts_with(section));
    changed.iter().any(is_own).then(|| {
        "the fallback law keeps the gains of the daemon's start; a change of [control] reaches it when the daemon starts again"
            .to_owned()
    })
}

/// The parts of a guarded law that settings change.
#[derive(Debug)]
pub struct LiveGuard {
    pub(crate) envelope: Envelope,
    /// The fallback of a built-in law; the fallback of an external one is the control stack.
    pub(crate) fallback: Option<ControlStack>,
}

impl LiveGuard {
    /// The parts for `next`; `None` if the law flies without a fallback. The fallback has the limits of `next` and the gains of
    /// `started`: gains that fail must not be those of the law that then takes over.
    ///
    /// # Errors
    /// An option of the fallback law is not allowed.
    pub(crate) fn new(started: &Config, next: &Config) -> Result<Option<Self>, OptionError> {
        let trusted = trusted(started, next);
        let fallback = ControlStack::of_fallback(&trusted)?;
        if fallback.is_none() && !trusted.control.is_external() {
            return Ok(None);
        }
        Ok(Some(Self { envelope: Envelope::new(&trusted)?, fallback }))
    }
}

/// Whether the last command may lead further in the direction of the danger.
fn is_dangerous(cause: HandoverCause) -> bool {
    use HandoverCause::{Fence, Floor, NotFinite, OutOfRange, Rate, Speed, Tilt};
    matches!(cause, NotFinite | OutOfRange | Tilt | Rate | Speed | Fence | Floor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use HandoverCause::{Absent, Ended, None, Tilt};

    #[test]
    fn the_first_reason_since_the_law_flew_stays_the_cause_until_it_returns() {
        for (has_flown, reasons) in [
            (
                true,
                [(Absent, Absent), (None, Absent), (Tilt, Tilt), (Absent, Absent), (None, Tilt)],
            ),
            (true, [(Ended, Ended), (Absent, Absent), (None, Ended), (Tilt, Ended), (None, Ended)]),
            (false, [(Absent, Absent), (None, None), (Tilt, Tilt), (Absent, Absent), (None, Tilt)]),
        ] {
            let mut guard = LawGuard::new(&Config::default()).unwrap();
            guard.report.is_fallback = !has_flown;
            for (reason, cause) in reasons {
                guard.note_failure(reason);
                guard.report.is_fallback = true;
                assert_eq!(guard.report.cause, cause, "{reasons:?}");
            }
            assert_eq!(guard.report.handovers, u64::from(has_flown));
        }
    }
}
