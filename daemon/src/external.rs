//! External law: the question that the daemon sends in every tick of a flight, and the check of the answer.

use std::fmt;

use nalgebra::Vector3;
use oqtal_bus::code::HandoverCause;
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Interface};
use oqtal_control::controller::LawTerms;
use oqtal_control::quantity::{StickCommand, Torque};
use oqtal_control::quaternion::Attitude;

use crate::command::{RotationCommand, SATURATED, VehicleCommand};
use crate::question::QuestionView;
use crate::stack::ControlOutput;

/// Tolerance for rounding: part by which an answer may exceed the vehicle's range, and the norm of a quaternion 1 \[-\].
const TOLERANCE: f64 = 1e-6;

/// A law outside the daemon: in this process, or behind a socket.
pub trait ExternalLaw {
    /// Restarts integrals and filters: a flight begins.
    fn reset(&mut self);

    /// Takes the flight at a tick before its question: a law in this process may use more of it than the question has.
    fn look(&mut self, _view: &QuestionView) {}

    /// The command for `state`, in units of the vehicle: see [`ExternalV1`]. `None` without an answer in time; [`without_answer`] for
    /// another reason.
    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1>;

    /// Whether the law will not answer any more: a flight in one process then ends.
    fn has_ended(&self) -> bool {
        false
    }
}

/// In place of an answer: the reason why there is none, [`HandoverCause::Absent`], [`HandoverCause::Ended`] or
/// [`HandoverCause::Malformed`].
pub fn without_answer(reason: HandoverCause) -> ExternalV1 {
    ExternalV1 { verdict: reason.code(), ..ExternalV1::default() }
}

/// The reason in place of `answer`; `None` for an answer.
pub fn reason_of(answer: &ExternalV1) -> Option<HandoverCause> {
    use HandoverCause::{Absent, Ended, Malformed};
    let reason = HandoverCause::from_code(answer.verdict);
    reason.filter(|reason| matches!(reason, Absent | Ended | Malformed))
}

impl<L: ExternalLaw + ?Sized> ExternalLaw for &mut L {
    fn reset(&mut self) {
        (**self).reset();
    }

    fn look(&mut self, view: &QuestionView) {
        (**self).look(view);
    }

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        (**self).answer(state)
    }

    fn has_ended(&self) -> bool {
        (**self).has_ended()
    }
}

/// The external law of a daemon, or none.
#[derive(Default)]
pub struct LawPort<'l>(Option<Box<dyn ExternalLaw + 'l>>);

impl<'l> LawPort<'l> {
    /// The port to `law`.
    pub fn of(law: impl ExternalLaw + 'l) -> Self {
        Self(Some(Box::new(law)))
    }

    /// Whether the port has no law.
    pub fn is_none(&self) -> bool {
        self.0.is_none()
    }
}

impl ExternalLaw for LawPort<'_> {
    fn reset(&mut self) {
        self.0.iter_mut().for_each(|law| law.reset());
    }

    fn look(&mut self, view: &QuestionView) {
        self.0.iter_mut().for_each(|law| law.look(view));
    }

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        self.0.as_mut()?.answer(state)
    }

    fn has_ended(&self) -> bool {
        self.0.as_ref().is_some_and(|law| law.has_ended())
    }
}

impl fmt::Debug for LawPort<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("LawPort").field(&self.0.is_some()).finish()
    }
}

/// Questions to an external law, and its answers. No method but the constructor allocates.
#[derive(Clone, Debug)]
pub struct ExternalControl {
    interface: Interface,
    budget: Span,
    is_virtual: bool,
    greatest_rate: Vector3<f64>,
    greatest_torque: f64,
    greatest_thrust: f64,
    /// The question of this tick, with the fields that do not change.
    question: StateV1,
    /// The answer of this tick; `None` if the law was not asked.
    answer: Option<ExternalV1>,
    /// Whether the law is to be reset before the next question.
    restarts: bool,
}

impl ExternalControl {
    /// The questions of a daemon of `config`.
    pub fn new(config: &Config) -> Self {
        let vehicle = &config.vehicle;
        Self {
            interface: vehicle.interface,
            budget: Span::from_seconds(config.external.budget_us * 1e-6),
            is_virtual: config.clock.kind != oqtal_config::ClockKind::Real,
            greatest_rate: vehicle.rate_authority_rad_s.into(),
            greatest_torque: vehicle.max_torque_nm,
            greatest_thrust: vehicle.max_thrust_n,
            question: StateV1 {
                period_s: 1.0 / config.control.rate_hz,
                gravity: vehicle.gravity_m_s2,
                greatest_thrust: vehicle.max_thrust_n,
                greatest_rate: vehicle.rate_authority_rad_s,
                greatest_torque: vehicle.max_torque_nm,
                ..StateV1::default()
            },
            answer: None,
            restarts: true,
        }
    }

    /// A flight begins.
    pub fn restart(&mut self) {
        self.restarts = true;
    }

    /// Begins a tick in which the law was not asked yet.
    pub fn begin_tick(&mut self) {
        self.question.flown = self.answer.take().map_or(0, |answer| u64::from(answer.flown));
    }

    /// Question and answer of this tick; `None` if the law was not asked.
    pub fn exchange(&self) -> Option<(&StateV1, &ExternalV1)> {
        self.answer.as_ref().map(|answer| (&self.question, answer))
    }

    /// Records whether the answer of this tick is flown, and why not.
    pub fn record(&mut self, verdict: HandoverCause, flown: bool) {
        if let Some(answer) = &mut self.answer {
            (answer.verdict, answer.flown) = (verdict.code(), u8::from(flown));
        }
    }

    /// Asks `law` and returns its output, or why its answer cannot be flown.
    ///
    /// # Errors
    /// The law does not answer this question, or its answer is not finite or out of range.
    pub fn ask(
        &mut self,
        view: &QuestionView,
        law: &mut dyn ExternalLaw,
    ) -> Result<ControlOutput, HandoverCause> {
        if std::mem::take(&mut self.restarts) {
            law.reset();
            self.question.flight += 1;
        }
        self.fill_in(view);
        law.look(view);
        let answered = law.answer(&self.question);
        let StateV1 { sequence, time, .. } = self.question;
        let mut answer = answered.unwrap_or_default();
        answer.question = sequence;
        if !answer.asked_at.is_set() {
            answer.asked_at = time;
        }
        let reason = answered.as_ref().map_or(Some(HandoverCause::Missing), reason_of);
        if reason.is_none() && !answer.answered_at.is_set() {
            answer.answered_at = time;
        }
        self.answer = Some(answer);
        // The fallback does not fly a prescribed attitude.
        let mut fallback = *view.fallback;
        fallback.setpoint.attitude = view.reference.attitude.unwrap_or(fallback.setpoint.attitude);
        reason.map_or_else(|| self.output(&answer, &fallback), Err)
    }

    fn fill_in(&mut self, view: &QuestionView) {
        let QuestionView { now, ahead, tracker, reference, fallback, .. } = *view;
        let (bias, unknown) = (tracker.bias(), [f64::NAN; 3]);
        let prescribed = reference.attitude;
        let question = &mut self.question;
        question.sequence += 1;
        question.time = now;
        question.acts_at = now + Span::from_seconds(tracker.effect_delay_s());
        question.answer_by = if self.is_virtual { Time::UNSET } else { now + self.budget };
        question.position = ahead.position.into();
        question.velocity = ahead.velocity.into();
        question.attitude = ahead.attitude.xyzw();
        question.rate = ahead.rate.into();
        question.thrust = ahead.thrust_n;
        // The bias is estimated with this mass, which the adaptation changes.
        question.mass = tracker.model().mass_kg;
        question.acceleration_bias = bias.acceleration.into();
        question.demand_bias = bias.demand.into();
        question.reference_position = reference.position.into();
        question.reference_velocity = reference.velocity.into();
        question.reference_acceleration = reference.acceleration.into();
        question.reference_jerk = reference.jerk.into();
        question.reference_yaw = reference.yaw_rad;
        question.reference_attitude = prescribed.map_or([f64::NAN; 4], |it| it.attitude.xyzw());
        question.reference_rate = prescribed.map_or(unknown, |it| it.rate.0.into());
        if let VehicleCommand::Armed { rotation, thrust_n, attitude } = fallback.command {
            let rotation_of = |is_torque: bool| match rotation {
                RotationCommand::Torque(Torque(torque)) if is_torque => torque,
                RotationCommand::Sticks(StickCommand(sticks)) if !is_torque => {
                    sticks.component_mul(&self.greatest_rate)
                }
                _ => Vector3::zeros(),
            };
            question.fallback_rate = rotation_of(false).into();
            question.fallback_torque = rotation_of(true).into();
            question.fallback_attitude = attitude.xyzw();
            question.fallback_thrust = thrust_n;
        }
    }

    /// The output of an answer; set-points for the report are those of the fallback law.
    fn output(
        &self,
        answer: &ExternalV1,
        fallback: &ControlOutput,
    ) -> Result<ControlOutput, HandoverCause> {
        let ExternalV1 { rate, torque, attitude, thrust, .. } = *answer;
        self.require_in_time(answer)?;
        let share = Vector3::from(rate).component_div(&self.greatest_rate);
        let turn = Vector3::from(torque) / self.greatest_torque;
        let (share, is_torque) = match self.interface {
            Interface::Torque => (turn, true),
            Interface::Rate | Interface::Attitude => (share, false),
        };
        let orientation = self.orientation(attitude)?;
        if !(share.iter().all(|number| number.is_finite()) && thrust.is_finite()) {
            return Err(HandoverCause::NotFinite);
        }
        let most = 1.0 + TOLERANCE;
        let thrusts = -TOLERANCE..=most;
        if share.amax() > most || !thrusts.contains(&(thrust / self.greatest_thrust)) {
            return Err(HandoverCause::OutOfRange);
        }
        let limited = share.map(|number| number.clamp(-1.0, 1.0));
        let rotation: RotationCommand = match is_torque {
            true => Torque(limited * self.greatest_torque).into(),
            false => StickCommand(limited).into(),
        };
        let attitude = orientation.unwrap_or(fallback.setpoint.attitude.attitude);
        let thrust_n = thrust.clamp(0.0, self.greatest_thrust);
        let command = VehicleCommand::Armed { rotation, thrust_n, attitude };
        let saturated = !self.interface.holds_attitude() && limited.amax() >= SATURATED;
        let terms = LawTerms { proportional: rotation.vector(), ..LawTerms::default() };
        Ok(ControlOutput { command, saturated, terms, ..*fallback })
    }

    /// Refuses an answer to an earlier question, or after the deadline, as late, and an answer to a question that was not asked as such.
    fn require_in_time(&self, answer: &ExternalV1) -> Result<(), HandoverCause> {
        let StateV1 { sequence: asked, answer_by, .. } = self.question;
        let is_late =
            answer.sequence < asked || answer_by.is_set() && answer.answered_at > answer_by;
        match answer.sequence {
            sequence if sequence == 0 || sequence > asked => Err(HandoverCause::OtherQuestion),
            _ if is_late => Err(HandoverCause::Missing),
            _ => Ok(()),
        }
    }

    /// The attitude of an answer; `None` if the vehicle does not need it and it is not of unit norm.
    fn orientation(&self, xyzw: [f64; 4]) -> Result<Option<Attitude>, HandoverCause> {
        let norm = xyzw.iter().map(|number| number * number).sum::<f64>().sqrt();
        let is_unit = (norm - 1.0).abs() <= 1e-3;
        match Attitude::from_xyzw(xyzw).filter(|_| is_unit) {
            None if self.interface.holds_attitude() => Err(match norm {
                0.0 => HandoverCause::NoAttitude,
                norm if norm.is_finite() => HandoverCause::OutOfRange,
                _ => HandoverCause::NotFinite,
            }),
            orientation => Ok(orientation),
        }
    }
}

#[cfg(test)]
mod tests {
    use oqtal_config::Setting;
    use oqtal_control::position::PositionCommand;

    use super::*;

    const FINE: ExternalV1 = ExternalV1 {
        sequence: 3,
        rate: [2.0, -1.0, 0.0],
        torque: [1.0, -0.5, 0.0],
        attitude: [0.0, 0.0, 0.0, 1.0],
        thrust: 5.0,
        question: 0,
        asked_at: Time::UNSET,
        answered_at: Time::UNSET,
        verdict: 0,
        flown: 0,
    };

    /// The command for `answer`, by the interface of the vehicle.
    fn command(interface: &str, answer: ExternalV1) -> Result<VehicleCommand, HandoverCause> {
        let setting = Setting::flag("--set", "vehicle.interface", interface);
        let config = Config::from_settings(&[setting]).unwrap();
        let mut external = ExternalControl::new(&config);
        external.question.sequence = FINE.sequence;
        external.question.answer_by = Time::from_nanos(100);
        let fallback = ControlOutput {
            setpoint: PositionCommand {
                attitude: Default::default(),
                thrust_n: 0.0,
                velocity: Vector3::zeros(),
            },
            command: VehicleCommand::Disarmed,
            terms: LawTerms::default(),
            saturated: false,
        };
        external.output(&answer, &fallback).map(|output| output.command)
    }

    #[test]
    fn f70_an_answer_becomes_a_command_within_the_range_of_the_vehicle() {
        let (attitude, thrust_n) = (Attitude::LEVEL, 5.0);
        let sticks = StickCommand(Vector3::new(1.0, -0.5, 0.0)).into();
        let torque = Torque(Vector3::new(1.0, -0.5, 0.0)).into();
        for (interface, rotation) in [("rate", sticks), ("attitude", sticks), ("torque", torque)] {
            let expected = VehicleCommand::Armed { rotation, thrust_n, attitude };
            assert_eq!(command(interface, FINE), Ok(expected), "{interface}");
        }
    }

    #[test]
    fn f70_an_answer_that_is_late_not_a_number_out_of_range_or_to_another_question_is_refused() {
        use HandoverCause::{Missing, NoAttitude, NotFinite, OtherQuestion, OutOfRange};
        let nan = f64::NAN;
        for (interface, answer, cause) in [
            ("rate", ExternalV1 { sequence: 0, ..FINE }, OtherQuestion),
            ("rate", ExternalV1 { sequence: 4, ..FINE }, OtherQuestion),
            ("rate", ExternalV1 { sequence: 2, ..FINE }, Missing),
            ("rate", ExternalV1 { answered_at: Time::from_nanos(101), ..FINE }, Missing),
            ("rate", ExternalV1 { rate: [0.0, nan, 0.0], ..FINE }, NotFinite),
            ("torque", ExternalV1 { torque: [nan; 3], ..FINE }, NotFinite),
            ("attitude", ExternalV1 { attitude: [nan; 4], ..FINE }, NotFinite),
            ("rate", ExternalV1 { thrust: f64::INFINITY, ..FINE }, NotFinite),
            ("rate", ExternalV1 { rate: [2.1, 0.0, 0.0], ..FINE }, OutOfRange),
            ("torque", ExternalV1 { torque: [0.0, -1.1, 0.0], ..FINE }, OutOfRange),
            ("attitude", ExternalV1 { attitude: [0.0; 4], ..FINE }, NoAttitude),
            ("attitude", ExternalV1 { attitude: [0.0, 0.0, 0.0, 2.0], ..FINE }, OutOfRange),
            ("rate", ExternalV1 { thrust: -0.1, ..FINE }, OutOfRange),
            ("rate", ExternalV1 { thrust: 20.1, ..FINE }, OutOfRange),
        ] {
            assert_eq!(command(interface, answer), Err(cause), "{interface}: {answer:?}");
        }
        let unused = ExternalV1 { attitude: [nan; 4], torque: [nan; 3], ..FINE };
        assert!(command("rate", unused).is_ok());
    }
}
