//! The safety supervisor: every limit of the daemon is a row of one table, with its action, its bound and its end. A pure
//! function of conditions and time; the thresholds are in `[safety]` and `[fence]`, the conditions are computed in `limits.rs`.
//!
//! In each tick every row whose condition has held for its time becomes active, and every active row whose end has come becomes
//! inactive. The state is the most severe action of an active row, the cause is that of the row that brought it about.

use oqtal_bus::code::{Cause, SafetyState};
use oqtal_bus::time::{Span, Time};

use crate::limits::LimitConditions;
use SafetyState::{Coast, Degraded, Descend, Hold, Land, Stop};

/// Time far from the reference after which a vehicle is landed, F44 \[ms\].
pub(crate) const FAR_OFF_MS: i64 = 3000;

/// The conditions of one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SafetyConditions {
    /// No accepted pose for longer than the longest pause of a regular source.
    pub poses_missing: bool,
    /// Enough good poses arrived in a row.
    pub poses_good: bool,
    /// In flight: the last accepted pose is too old.
    pub blind_too_long: bool,
    /// In flight: the vehicle may descend without poses.
    pub may_descend: bool,
    /// In flight: the predicted motion is at the floor.
    pub is_down: bool,
    /// On the ground: the vehicle does not answer, so that a flight must not begin.
    pub vehicle_silent: bool,
    /// In flight: the vehicle has not answered for too long, or its bridge was restarted. Before a flight: another vehicle took
    /// the place of the one for which the flight was requested.
    pub vehicle_lost: bool,
    /// In flight: the motors do not start, or stopped.
    pub motors_do_not_run: bool,
    /// In flight: a pilot or the vehicle itself took control.
    pub control_taken: bool,
    /// An operator requested a stop.
    pub operator_stops: bool,
    /// The daemon begins after one that ended in flight.
    pub ended_in_flight: bool,
    /// An operator requested a flight.
    pub operator_arms: bool,
    /// A flight is active.
    pub is_flying: bool,
    /// The limits of the flight and of the loop.
    pub limits: LimitConditions,
}

/// End of an active row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// An operator arms again, with good poses and a vehicle that answers.
    Armed,
    /// The flight has ended.
    Landed,
    /// Enough good poses arrived in a row.
    PosesGood,
    /// The condition has not held for this time \[ms\].
    Gone(i64),
}

/// A row of the table.
#[derive(Clone, Copy, Debug)]
pub struct SafetyRow {
    /// Row of docs/faults.md.
    pub id: &'static str,
    /// Reported cause; `None` for the cause for which the poses are missing.
    pub cause: Option<Cause>,
    /// The condition.
    pub when: fn(&SafetyConditions) -> bool,
    /// Time for which the condition must hold \[ms\].
    pub after_ms: i64,
    /// The action.
    pub action: SafetyState,
    /// The end of the action.
    pub ends: Ending,
}

/// All limits, the most severe first.
#[rustfmt::skip]
pub const LIMITS: [SafetyRow; 42] = {
    use Ending::{Armed, Gone, Landed, PosesGood};
    use SafetyRow as Row;
    [
        // Motors off, latched.
        Row { id: "F33", cause: Some(Cause::Operator), when: |c| c.operator_stops, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F14", cause: Some(Cause::EndedInFlight), when: |c| c.ended_in_flight, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F15", cause: Some(Cause::Overrun), when: |c| c.limits.stood_still, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F02", cause: None, when: |c| c.blind_too_long && !c.may_descend, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F57", cause: Some(Cause::ControlTaken), when: |c| c.control_taken, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F18", cause: Some(Cause::NoVehicle), when: |c| c.vehicle_lost, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F36", cause: Some(Cause::MotorsNotRunning), when: |c| c.motors_do_not_run, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F37", cause: Some(Cause::Fence), when: |c| c.limits.leaves_fence, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F38", cause: Some(Cause::Tilt), when: |c| c.limits.tipped, after_ms: 100, action: Stop, ends: Armed },
        Row { id: "F59", cause: Some(Cause::Contradiction), when: |c| c.limits.poses_mislead, after_ms: 300, action: Stop, ends: Armed },
        Row { id: "F39", cause: Some(Cause::Crash), when: |c| c.limits.lies_on_floor, after_ms: 2000, action: Stop, ends: Armed },
        Row { id: "F40", cause: Some(Cause::NoLift), when: |c| c.limits.stays_on_floor, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F41", cause: Some(Cause::Landing), when: |c| c.limits.landing_overdue, after_ms: 0, action: Stop, ends: Armed },
        Row { id: "F48", cause: None, when: |c| c.blind_too_long && c.is_down, after_ms: 200, action: Stop, ends: Armed },
        // Level and descend, then land with the poses that came back.
        Row { id: "F48", cause: None, when: |c| c.blind_too_long && c.may_descend, after_ms: 0, action: Descend, ends: PosesGood },
        Row { id: "F48", cause: None, when: |c| c.blind_too_long && c.may_descend, after_ms: 0, action: Land, ends: Landed },
        // Land where the vehicle is.
        Row { id: "F42", cause: Some(Cause::NoLift), when: |c| c.limits.sinks, after_ms: 700, action: Land, ends: Landed },
        Row { id: "F43", cause: Some(Cause::Speed), when: |c| c.limits.too_fast, after_ms: 200, action: Land, ends: Landed },
        Row { id: "F44", cause: Some(Cause::Tracking), when: |c| c.limits.far_off, after_ms: FAR_OFF_MS, action: Land, ends: Landed },
        Row { id: "F45", cause: Some(Cause::Battery), when: |c| c.limits.battery_empty, after_ms: 2000, action: Land, ends: Landed },
        Row { id: "F46", cause: Some(Cause::Link), when: |c| c.limits.link_bad, after_ms: 2000, action: Land, ends: Landed },
        Row { id: "F04", cause: Some(Cause::PosesLate), when: |c| c.limits.poses_too_old, after_ms: 500, action: Land, ends: Landed },
        Row { id: "F47", cause: Some(Cause::HeldTooLong), when: |c| c.limits.held_too_long, after_ms: 0, action: Land, ends: Landed },
        Row { id: "F35", cause: Some(Cause::ReferencesEnded), when: |c| c.limits.references_overdue, after_ms: 0, action: Land, ends: Landed },
        Row { id: "F68", cause: Some(Cause::FilesLost), when: |c| c.limits.files_lost, after_ms: 0, action: Land, ends: Landed },
        // Hold the position.
        Row { id: "F47", cause: Some(Cause::Fence), when: |c| c.limits.in_fence_margin, after_ms: 0, action: Hold, ends: Gone(500) },
        // Fly on the prediction, then hold the last command; on the ground: no take-off.
        Row { id: "F01", cause: None, when: |c| c.poses_missing, after_ms: 0, action: Coast, ends: PosesGood },
        Row { id: "F58", cause: None, when: |c| c.limits.poses_contradict, after_ms: 0, action: Coast, ends: Landed },
        Row { id: "F18", cause: Some(Cause::NoVehicle), when: |c| c.vehicle_silent, after_ms: 0, action: Coast, ends: Gone(0) },
        // Warn.
        Row { id: "F35", cause: Some(Cause::Setpoint), when: |c| c.limits.setpoint_refused, after_ms: 0, action: Degraded, ends: Gone(500) },
        Row { id: "F70", cause: Some(Cause::Fallback), when: |c| c.limits.law_fails, after_ms: 0, action: Degraded, ends: Gone(0) },
        Row { id: "F35", cause: Some(Cause::ReferencesEnded), when: |c| c.limits.references_ended, after_ms: 0, action: Degraded, ends: Gone(0) },
        Row { id: "F38", cause: Some(Cause::Tilt), when: |c| c.limits.tilted, after_ms: 100, action: Degraded, ends: Gone(1000) },
        Row { id: "F45", cause: Some(Cause::Battery), when: |c| c.limits.battery_low, after_ms: 2000, action: Degraded, ends: Gone(2000) },
        Row { id: "F46", cause: Some(Cause::Link), when: |c| c.limits.link_poor, after_ms: 2000, action: Degraded, ends: Gone(2000) },
        Row { id: "F04", cause: Some(Cause::PosesLate), when: |c| c.limits.poses_old, after_ms: 200, action: Degraded, ends: Gone(1000) },
        Row { id: "F11", cause: Some(Cause::PosesLost), when: |c| c.limits.poses_lost, after_ms: 0, action: Degraded, ends: Gone(1000) },
        Row { id: "F59", cause: Some(Cause::Contradiction), when: |c| c.limits.poses_disagree, after_ms: 0, action: Degraded, ends: Gone(1000) },
        Row { id: "F22", cause: Some(Cause::Overrun), when: |c| c.limits.overrun, after_ms: 0, action: Degraded, ends: Gone(0) },
        Row { id: "F31", cause: Some(Cause::Configuration), when: |c| c.limits.configs_differ, after_ms: 0, action: Degraded, ends: Gone(0) },
        Row { id: "F44", cause: Some(Cause::Tracking), when: |c| c.limits.far_off, after_ms: 1000, action: Degraded, ends: Gone(1000) },
        Row { id: "F42", cause: Some(Cause::NoLift), when: |c| c.limits.sinks, after_ms: 200, action: Degraded, ends: Gone(1000) },
    ]
};

/// Progress of a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct RowState {
    /// Instant since which the condition holds.
    held_since: Option<Time>,
    /// Last instant at which the condition held.
    held_at: Option<Time>,
    is_active: bool,
}

/// The safety state and its cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Supervisor {
    rows: [RowState; LIMITS.len()],
    /// The row that brought the state about; `None` in Nominal.
    lead: Option<usize>,
    cause: Cause,
}

impl Default for Supervisor {
    /// Coast: neither poses nor a vehicle yet.
    fn default() -> Self {
        let rows = LIMITS.map(|row| RowState {
            is_active: row.action == Coast && row.ends == Ending::PosesGood,
            ..RowState::default()
        });
        let lead = rows.iter().position(|row| row.is_active);
        Self { rows, lead, cause: Cause::NoPose }
    }
}

impl Supervisor {
    /// Evaluates the table at `now`. `pose_cause` is why poses are missing, if they are.
    pub fn step(
        &mut self,
        now: Time,
        conditions: &SafetyConditions,
        pose_cause: Cause,
    ) -> SafetyState {
        for (row, state) in LIMITS.iter().zip(&mut self.rows) {
            state.advance(now, row, conditions);
        }
        let active = |index: &usize| self.rows[*index].is_active;
        let worst = (0..LIMITS.len()).filter(active).map(|index| LIMITS[index].action).max();
        let lead = self.lead.filter(active).map(|lead| LIMITS[lead].action);
        if lead.is_none() || lead != worst {
            self.lead = (0..LIMITS.len()).filter(active).find(|i| Some(LIMITS[*i].action) == worst);
            self.cause = match self.lead {
                Some(lead) => LIMITS[lead].cause.unwrap_or(pose_cause),
                None => Cause::None,
            };
        }
        self.state()
    }

    /// Renews the cause for which poses are missing, on the ground: there it may change while the state lasts.
    pub fn renew_cause(&mut self, pose_cause: Cause) {
        if self.state() == Coast && self.lead.is_some_and(|lead| LIMITS[lead].cause.is_none()) {
            self.cause = pose_cause;
        }
    }

    /// The present state.
    pub fn state(&self) -> SafetyState {
        self.lead.map_or(SafetyState::Nominal, |lead| LIMITS[lead].action)
    }

    /// Why the state is not Nominal.
    pub fn cause(&self) -> Cause {
        self.cause
    }
}

impl RowState {
    fn advance(&mut self, now: Time, row: &SafetyRow, conditions: &SafetyConditions) {
        if (row.when)(conditions) {
            let since = *self.held_since.get_or_insert(now);
            self.held_at = Some(now);
            self.is_active |= now.since(since) >= Span::from_millis(row.after_ms);
            return;
        }
        self.held_since = None;
        let ended = match row.ends {
            Ending::Armed => {
                let SafetyConditions { poses_good, vehicle_silent, operator_stops, .. } =
                    *conditions;
                conditions.operator_arms && poses_good && !vehicle_silent && !operator_stops
            }
            Ending::Landed => !conditions.is_flying,
            Ending::PosesGood => conditions.poses_good,
            Ending::Gone(millis) => {
                self.held_at.is_none_or(|at| now.since(at) >= Span::from_millis(millis))
            }
        };
        self.is_active &= !ended;
    }
}

#[cfg(test)]
mod tests;
