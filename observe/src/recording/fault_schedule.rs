//! Faults by hand as events: when each begins and ends. Their times count from the first command that arms, as for the processes
//! that inject them.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use crate::event::of_fault;

/// The faults of a flight that have not begun or ended yet.
#[derive(Debug)]
pub struct FaultSchedule {
    /// Time after arming, and words; later ones first.
    pending: Vec<(Span, String)>,
    armed_at: Option<Time>,
    /// Whether faults act on a vehicle that is not simulated.
    acts_on_any: bool,
}

impl FaultSchedule {
    /// The faults of `config`.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        let changes = config.fault.inject.iter().flat_map(of_fault);
        let mut pending: Vec<_> =
            changes.map(|(at_s, text)| (Span::from_seconds(at_s), text)).collect();
        pending.sort_by_key(|(at, _)| std::cmp::Reverse(*at));
        // An emulated vehicle behind a bridge is simulated, but the bridge does not know.
        let acts_on_any = config.fault.with_real_vehicle || !config.plant.wire.link.is_empty();
        Self { pending, armed_at: None, acts_on_any }
    }

    /// Takes a command: the first one that arms begins the time of faults.
    pub fn command(&mut self, header: &Header, command: &CommandV1) {
        if self.armed_at.is_none() && command.actuation != Actuation::Disarmed.code() {
            self.armed_at = Some(header.stamps.command_published_at);
        }
    }

    /// Takes a message of the vehicle: on one that is not simulated no fault acts, unless that was asked for.
    pub fn vehicle(&mut self, vehicle: &VehicleV1) {
        if vehicle.simulated == 0 && !self.acts_on_any {
            self.pending.clear();
        }
    }

    /// The next change that has come at `now`, and its instant.
    pub fn due(&mut self, now: Time) -> Option<(Time, String)> {
        let at = self.armed_at? + self.pending.last()?.0;
        if at > now {
            return None;
        }
        self.pending.pop().map(|(_, text)| (at, text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::Stamps;

    fn schedule() -> FaultSchedule {
        let mut config = Config::default();
        config.fault.inject =
            ["pose:off@5+0.5", "daemon:kill@1"].map(|text| text.parse().unwrap()).to_vec();
        FaultSchedule::of(&config)
    }

    fn arm(schedule: &mut FaultSchedule, at: Time) {
        let stamps = Stamps { command_published_at: at, ..Stamps::default() };
        let header = Header { stamps, ..Header::default() };
        let actuation = Actuation::Sticks.code();
        schedule.command(&header, &CommandV1 { actuation, ..CommandV1::default() });
    }

    #[test]
    fn faults_begin_and_end_by_the_clock_of_arming() {
        let armed_at = Time::VIRTUAL_START;
        let mut schedule = schedule();
        schedule.command(&Header::default(), &CommandV1::default());
        assert_eq!(schedule.due(armed_at + Span::from_millis(9000)), None, "not armed");
        arm(&mut schedule, armed_at);
        let mut told = Vec::new();
        for millis in (0..7000).step_by(100) {
            while let Some((at, text)) = schedule.due(armed_at + Span::from_millis(millis)) {
                told.push((at.since(armed_at).seconds(), text));
            }
        }
        let texts = ["daemon:kill@1 begins", "pose:off@5+0.5 begins", "pose:off@5+0.5 ends"];
        let expected: Vec<_> = [1.0, 5.0, 5.5].into_iter().zip(texts.map(str::to_owned)).collect();
        assert_eq!(told, expected);
    }

    #[test]
    fn on_a_real_vehicle_no_fault_is_told() {
        let mut schedule = schedule();
        schedule.vehicle(&VehicleV1::default());
        arm(&mut schedule, Time::VIRTUAL_START);
        assert_eq!(schedule.due(Time::VIRTUAL_START + Span::from_millis(9000)), None);
    }
}
