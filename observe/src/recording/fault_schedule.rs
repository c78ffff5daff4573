//! Beginnings and ends of injected faults and disturbances, as events. Their times count from the first command that arms, as in
//! the injecting processes.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, Header, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;

use crate::event::of_faults;

/// Source of an event in a recording: `fault` or `disturbance`.
type Source = &'static str;

/// Faults and disturbances of a flight that have not yet begun or ended.
#[derive(Debug)]
pub struct FaultSchedule {
    /// Time after arming, source and text; latest first.
    pending: Vec<(Span, Source, String)>,
    armed_at: Option<Time>,
    /// Whether faults also act on a vehicle that is not simulated.
    acts_on_any: bool,
}

impl FaultSchedule {
    /// The faults and disturbances of `config`.
    pub fn of(config: &Config) -> Self {
        let changes = of_faults(config);
        let mut pending: Vec<_> =
            changes.map(|(at_s, source, text)| (Span::from_seconds(at_s), source, text)).collect();
        pending.sort_by_key(|(at, ..)| std::cmp::Reverse(*at));
        // A bridge reports a vehicle as real, also an emulated one or a firmware executed as a program.
        let acts_on_any =
            config.fault.with_real_vehicle || config.plant.is_simulated_behind_bridge();
        Self { pending, armed_at: None, acts_on_any }
    }

    /// Receives a command; the times of faults count from the first command that arms.
    pub fn command(&mut self, header: &Header, command: &CommandV1) {
        if self.armed_at.is_none() && command.actuation != Actuation::Disarmed.code() {
            self.armed_at = Some(header.stamps.command_published_at);
        }
    }

    /// Receives a message of the vehicle; faults do not act on a real vehicle, unless the configuration requests it.
    pub fn vehicle(&mut self, vehicle: &VehicleV1) {
        if vehicle.simulated == 0 && !self.acts_on_any {
            self.pending.clear();
        }
    }

    /// Removes and returns the next change up to `now`: its instant, source and text.
    pub fn due(&mut self, now: Time) -> Option<(Time, Source, String)> {
        let at = self.armed_at? + self.pending.last()?.0;
        if at > now {
            return None;
        }
        self.pending.pop().map(|(_, source, text)| (at, source, text))
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
        config.plant.disturb = vec!["mass@6=0.1kg".parse().unwrap()];
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
            while let Some((at, source, text)) = schedule.due(armed_at + Span::from_millis(millis))
            {
                told.push((at.since(armed_at).seconds(), format!("{source} {text}")));
            }
        }
        let texts = [
            "fault daemon:kill@1 begins",
            "fault pose:off@5+0.5 begins",
            "fault pose:off@5+0.5 ends",
            "disturbance mass@6=0.1kg begins",
        ];
        let expected: Vec<_> =
            [1.0, 5.0, 5.5, 6.0].into_iter().zip(texts.map(str::to_owned)).collect();
        assert_eq!(told, expected);
    }

    #[test]
    fn on_a_real_vehicle_there_is_no_event_of_a_fault() {
        let mut schedule = schedule();
        schedule.vehicle(&VehicleV1::default());
        arm(&mut schedule, Time::VIRTUAL_START);
        assert_eq!(schedule.due(Time::VIRTUAL_START + Span::from_millis(9000)), None);
    }
}
