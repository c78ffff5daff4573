//! Messages of a flight that were received more than once.

use oqtal_bus::time::Time;

use crate::flight::Flight;

impl Flight {
    /// Whether the vehicle was armed in the newest tick at the instant `at`.
    fn is_armed_at(&self, at: Time) -> bool {
        let next = self.samples.partition_point(|sample| sample.telemetry.time <= at);
        next.checked_sub(1).is_some_and(|last| self.samples[last].is_armed())
    }

    /// Number of poses in flight with the same frame number as the previous pose \[-\].
    pub(crate) fn poses_repeated(&self) -> u64 {
        let pairs = self.arrivals.windows(2).filter(|pair| pair[0].frame == pair[1].frame);
        pairs.filter(|pair| self.is_armed_at(pair[1].at)).count() as u64
    }

    /// Number of times that the vehicle received a command of the flight again \[-\].
    pub(crate) fn commands_repeated(&self) -> u64 {
        let pairs = self.applied.windows(2).filter(|pair| pair[0].sequence == pair[1].sequence);
        pairs.filter(|pair| self.is_armed_at(pair[1].stamps.woken_at)).count() as u64
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::code::Mode;
    use oqtal_bus::message::{Stamps, TelemetryV1};
    use oqtal_config::Config;

    use super::*;
    use crate::flight::{AppliedCommand, FlightSample, PoseArrival};
    use crate::latency::OnwardTime;

    #[test]
    fn repetitions_count_from_arming_to_disarming() {
        let mut flight = Flight::new(&Config::default());
        for (tick, mode) in
            [Mode::Disarmed, Mode::Flying, Mode::Landing, Mode::Disarmed].into_iter().enumerate()
        {
            let time = Time::from_nanos(1000 * (tick as u64 + 1));
            let telemetry = TelemetryV1 { time, mode: mode.code(), ..TelemetryV1::default() };
            flight.samples.push(FlightSample { telemetry, truth: None });
            let (sequence, stamps) = (7, Stamps { woken_at: time, ..Stamps::default() });
            let onward = OnwardTime::default();
            flight.applied.push(AppliedCommand { sequence, stamps, onward, battery_v: 0.0 });
            let arrival = PoseArrival {
                captured_at: time,
                at: time,
                frame: 7,
                position: [0.0; 3],
                attitude: [0.0, 0.0, 0.0, 1.0],
                is_tracked: true,
            };
            flight.arrivals.push(arrival);
        }
        assert_eq!((flight.poses_repeated(), flight.commands_repeated()), (2, 2));
    }
}
