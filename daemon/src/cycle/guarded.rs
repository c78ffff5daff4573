//! The law of a flight under its fallback: an external law, or a built-in one with `control.fallback`.

use oqtal_bus::code::{Cause, HandoverCause};
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::predictive::Motion;
use oqtal_control::trajectory::Reference;

use super::control::{ControlTick, Directive};
use super::course::FlightCourse;
use super::intake::Intake;
use crate::command::VehicleCommand;
use crate::external::{ExternalControl, ExternalLaw};
use crate::law_guard::{GuardReport, GuardedTick, LawGuard, LiveGuard};
use crate::question::QuestionView;
use crate::stack::{ControlOutput, ControlStack, LawInput};

/// The tick of a guarded law.
#[derive(Clone, Copy, Debug)]
pub(super) struct LawTick<'a> {
    /// The tick.
    pub(super) tick: &'a ControlTick,
    /// The task of the control.
    pub(super) directive: &'a Directive,
    /// The motion of the vehicle.
    pub(super) intake: &'a Intake,
    /// The command of the last tick.
    pub(super) last: &'a VehicleCommand,
    /// The course of the flight.
    pub(super) course: &'a FlightCourse,
    /// The reference of a fallback while an attitude is prescribed; `None` otherwise.
    pub(super) of_fallback: Option<Reference>,
    /// Whether the law may fly.
    pub(super) is_free: bool,
}

/// The law that is guarded.
// Not boxed: the cache warm-up copies the law, and a copy must not allocate.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)]
enum GuardedLaw {
    /// Outside the daemon; the control stack is its fallback.
    External(ExternalControl),
    /// The law of the control stack; its fallback is this one.
    BuiltIn(ControlStack),
}

/// A guarded law, with its fallback.
#[derive(Clone, Debug)]
pub(super) struct GuardedControl {
    law: GuardedLaw,
    guard: LawGuard,
}

impl GuardedControl {
    /// The guarded law of `config`; `None` if the law of the control stack flies without a fallback.
    ///
    /// # Errors
    /// An option of the fallback law or of the vehicle is not allowed.
    pub(super) fn new(config: &Config) -> Result<Option<Self>, OptionError> {
        let law = match ControlStack::of_fallback(config)? {
            Some(stack) => GuardedLaw::BuiltIn(stack),
            None if config.control.is_external() => {
                GuardedLaw::External(ExternalControl::new(config))
            }
            None => return Ok(None),
        };
        Ok(Some(Self { law, guard: LawGuard::new(config)? }))
    }

    /// Resets both laws for a new flight.
    pub(super) fn restart(&mut self) {
        self.guard.restart();
        match &mut self.law {
            GuardedLaw::External(external) => external.restart(),
            GuardedLaw::BuiltIn(fallback) => fallback.reset(),
        }
    }

    /// Lets a fallback of its own stop the vehicle: a hold begins.
    pub(super) fn begin_stop(&mut self) {
        if let GuardedLaw::BuiltIn(fallback) = &mut self.law {
            fallback.begin_stop();
        }
    }

    /// Begins a tick.
    pub(super) fn begin_tick(&mut self) {
        if let GuardedLaw::External(external) = &mut self.law {
            external.begin_tick();
        }
    }

    /// Gives control back to a law that failed.
    ///
    /// # Errors
    /// No law is connected.
    pub(super) fn resume(&mut self) -> Result<(), Cause> {
        if self.guard.resume() { Ok(()) } else { Err(Cause::NoLaw) }
    }

    /// Whether the law is external.
    pub(super) fn is_external(&self) -> bool {
        matches!(self.law, GuardedLaw::External(_))
    }

    /// Exchanges what settings change with that of `live`; the flight continues.
    pub(super) fn exchange_settings(&mut self, live: &mut LiveGuard) {
        self.guard.exchange_envelope(&mut live.envelope);
        if let (GuardedLaw::BuiltIn(stack), Some(next)) = (&mut self.law, &mut live.fallback) {
            next.adopt(stack, false);
            std::mem::swap(stack, next);
        }
    }

    /// Limits the slew of the next commands: the control stack or the kind of the reference has changed. Commands of an external law,
    /// which does not change with them, are not limited.
    pub(super) fn begin_handover(&mut self) {
        if !self.is_external() || self.report().is_fallback {
            self.guard.begin_handover();
        }
    }

    /// The state of the selection.
    pub(super) fn report(&self) -> &GuardReport {
        self.guard.report()
    }

    /// Question and answer of this tick; `None` if no external law was asked.
    pub(super) fn exchange(&self) -> Option<(&StateV1, &ExternalV1)> {
        match &self.law {
            GuardedLaw::External(external) => external.exchange(),
            GuardedLaw::BuiltIn(_) => None,
        }
    }

    /// Selects between `output`, that of the control stack, and that of the other law, which may be `outside`.
    pub(super) fn select(
        &mut self,
        law_tick: &LawTick,
        output: ControlOutput,
        outside: &mut dyn ExternalLaw,
    ) -> ControlOutput {
        let LawTick { tick, intake, directive, last, is_free, .. } = *law_tick;
        let tracker = intake.tracker();
        let now_s = tick.now.seconds();
        let (Directive::Fly { reference, .. }, Some(ahead)) =
            (directive, tracker.motion_at(now_s + tracker.effect_delay_s()))
        else {
            return output;
        };
        let prescribed = reference.attitude.map(|it| EulerAngles::from_attitude(&it.attitude).yaw);
        let heading_rad = prescribed.unwrap_or(reference.yaw_rad);
        let (law, fallback) = match &mut self.law {
            GuardedLaw::External(external) => {
                (ask(external, law_tick, (&ahead, reference), (&output, outside)), output)
            }
            GuardedLaw::BuiltIn(stack) => {
                let reference = law_tick.of_fallback.as_ref().unwrap_or(reference);
                let computed = intake.motion(tick.now, tick.is_fresh).and_then(|estimate| {
                    let dt_s = tick.dt_s;
                    stack.compute(&LawInput { now_s, dt_s, estimate, tracker, reference })
                });
                let Some(fallback) = computed else { return output };
                (finite(output), fallback)
            }
        };
        let dt_s = tick.dt_s;
        let guarded = GuardedTick { ahead: &ahead, tracker, heading_rad, last, dt_s, is_free };
        let (selected, verdict) = self.guard.select(&guarded, law, fallback);
        let flown = !self.guard.report().is_fallback;
        match &mut self.law {
            GuardedLaw::External(external) => external.record(verdict, flown),
            GuardedLaw::BuiltIn(stack) if flown => stack.yield_to(&selected.command, tracker),
            GuardedLaw::BuiltIn(_) => {}
        }
        selected
    }
}

/// The output of the external law.
fn ask(
    external: &mut ExternalControl,
    law_tick: &LawTick,
    (ahead, reference): (&Motion, &Reference),
    (fallback, outside): (&ControlOutput, &mut dyn ExternalLaw),
) -> Result<ControlOutput, HandoverCause> {
    let LawTick { tick, intake, course, .. } = *law_tick;
    let (now, tracker) = (tick.now, intake.tracker());
    let acts_at = now + Span::from_seconds(tracker.effect_delay_s());
    // The oscillation reveals poses that do not follow the vehicle; an external law must fly it, too.
    let offset_rad = intake.consistency().heading_offset_rad(acts_at);
    let course = |at: Time| course.reference_at(at, offset_rad);
    let reference = &course(acts_at).unwrap_or(*reference);
    let course = &course;
    external.ask(&QuestionView { now, ahead, tracker, reference, course, fallback }, outside)
}

/// `output`, if its command is finite.
fn finite(output: ControlOutput) -> Result<ControlOutput, HandoverCause> {
    match output.command.finite_or_disarmed() {
        VehicleCommand::Disarmed => Err(HandoverCause::NotFinite),
        VehicleCommand::Armed { .. } => Ok(output),
    }
}
