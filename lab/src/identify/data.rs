//! Data of a flight for an identification: commands as sent and poses as measured, without the truth and without the instants at
//! which commands took effect.

use std::ops::RangeInclusive;

use nalgebra::Vector3;
use oqtal_bus::time::{Span, Time};
use oqtal_control::quaternion::Attitude;
use oqtal_control::statistics::median;
use oqtal_control::trajectory::Phase;
use oqtal_observe::flight::{Flight, FlightSample};

/// Height above the floor above which a flight is used \[m\]: below it, the floor exerts forces.
const CLEAR_M: f64 = 0.3;
/// Share of acknowledged commands above which a command without acknowledgement counts as lost \[-\].
const ACKNOWLEDGED_SHARE: f64 = 0.5;

/// Thrust that is not at an end of its range \[0..1\].
const INNER_THRUST: RangeInclusive<f64> = 0.01..=0.99;

/// A measured pose.
#[derive(Clone, Copy, Debug)]
pub struct PoseRecord {
    /// Capture, by the stamp of the pose \[s\].
    pub captured_s: f64,
    /// Time from capture to publication \[s\].
    pub latency_s: f64,
    /// Position \[m, world\].
    pub position: Vector3<f64>,
    /// Attitude, body to world.
    pub attitude: Attitude,
}

/// A sent command.
#[derive(Clone, Copy, Debug)]
pub struct CommandRecord {
    /// Instant of its publication \[s\].
    pub sent_s: f64,
    /// Sticks \[-1..1, body\].
    pub sticks: Vector3<f64>,
    /// Collective thrust, as a fraction of the vehicle's maximum \[0..1\].
    pub thrust: f64,
}

/// Data of one flight.
#[derive(Clone, Debug, Default)]
pub struct FlightData {
    /// Poses on the floor before the motors ran.
    pub rest: Vec<PoseRecord>,
    /// Poses in the air, except near the floor.
    pub air: Vec<PoseRecord>,
    /// All commands of the flight, in order of time.
    pub commands: Vec<CommandRecord>,
    /// Instants of the ticks \[s\] with the attitude that the trajectory prescribes: roll and pitch, 0 where it prescribes none, and the
    /// heading \[rad\]. It does not depend on measurements.
    pub prescribed: Vec<(f64, Vector3<f64>)>,
    /// Median time from the publication of a command to its effect, by its stamps \[s\]; `None` without such stamps.
    pub stamped_delay_s: Option<f64>,
}

impl FlightData {
    /// The data of `flight`.
    pub fn of(flight: &Flight) -> Self {
        let poses = poses(flight);
        let (commands, stamped_delay_s) = commands(flight);
        let [rest_s, armed_s, until_s] = longest_flight(flight);
        let is_rest = |pose: &PoseRecord| pose.captured_s > rest_s && pose.captured_s < armed_s;
        let rest: Vec<_> = poses.iter().copied().filter(is_rest).collect();
        let floor_m = median(rest.iter().map(|pose| pose.position.z)).unwrap_or(0.0);
        let is_clear = |pose: &PoseRecord| {
            (armed_s..until_s).contains(&pose.captured_s) && pose.position.z > floor_m + CLEAR_M
        };
        let first = poses.iter().position(is_clear).unwrap_or(poses.len());
        let last = poses.iter().rposition(is_clear).map_or(first, |last| last + 1);
        let air = poses[first..last].to_vec();
        Self { rest, air, commands, prescribed: prescribed(flight), stamped_delay_s }
    }
}

/// Share of the commands in the air whose thrust is at an end of its range \[0..1\]; 0 without commands.
pub fn saturated_share(flights: &[FlightData]) -> f64 {
    let in_air = flights.iter().flat_map(|data| {
        let [first, last] = [data.air.first(), data.air.last()];
        let from_s = first.map_or(f64::INFINITY, |pose| pose.captured_s);
        let until_s = last.map_or(f64::NEG_INFINITY, |pose| pose.captured_s);
        data.commands.iter().filter(move |it| (from_s..=until_s).contains(&it.sent_s))
    });
    let is_saturated = |command: &&CommandRecord| !INNER_THRUST.contains(&command.thrust);
    let count = in_air.clone().filter(is_saturated).count();
    count as f64 / in_air.count().max(1) as f64
}

/// Number of residuals per axis of each flight: one for every pose in the air except the first.
pub fn series(flights: &[FlightData]) -> Vec<usize> {
    flights.iter().flat_map(|data| [data.air.len().saturating_sub(1); 3]).collect()
}

/// Instants of the longest of the flights in a recording \[s\]: the end of the flight before it, and its first and last tick with motors
/// on; the first two are before every pose if the recording begins in it.
fn longest_flight(flight: &Flight) -> [f64; 3] {
    let at_s = |sample: &FlightSample| sample.telemetry.time.seconds();
    let ends_s = |ticks: &[FlightSample]| [at_s(&ticks[0]), at_s(&ticks[ticks.len() - 1])];
    let flights: Vec<_> = flight.flights().collect();
    let longest = (0..flights.len()).max_by_key(|index| flights[*index].len());
    let Some(index) = longest else { return [f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY] };
    let before_s = index.checked_sub(1).map_or(f64::NEG_INFINITY, |it| ends_s(flights[it])[1]);
    let [from_s, until_s] = ends_s(flights[index]);
    let is_cut = index == 0 && flight.begins_in_flight();
    [before_s, if is_cut { f64::NEG_INFINITY } else { from_s }, until_s]
}

/// The poses that the daemon used, each once, in the order of their capture, and, if the cameras are faster than the controller, those
/// captured between the poses of two successive ticks. The noise of a pose that the law used is correlated with the command; that of
/// the others is not.
fn poses(flight: &Flight) -> Vec<PoseRecord> {
    let mut arrivals = flight.arrivals.iter().filter(|arrival| arrival.is_tracked).peekable();
    let mut poses: Vec<PoseRecord> = Vec::new();
    let (mut last_captured, mut last_tick) = (Time::UNSET, 0);
    for (tick, FlightSample { telemetry, .. }) in flight.samples.iter().enumerate() {
        let captured = telemetry.pose_captured_at;
        if !captured.is_set() || captured <= last_captured {
            continue;
        }
        let is_successive = last_captured.is_set() && tick == last_tick + 1;
        while let Some(between) = arrivals.next_if(|arrival| arrival.captured_at < captured) {
            if is_successive && between.captured_at > last_captured {
                let stamps = [between.captured_at, between.at];
                poses.extend(pose_record(stamps, between.position, between.attitude));
            }
        }
        let stamps = [captured, telemetry.pose_published_at];
        poses.extend(pose_record(stamps, telemetry.pose_position, telemetry.pose_attitude));
        (last_captured, last_tick) = (captured, tick);
    }
    poses
}

/// The pose captured at the first and published at the second instant; `None` if it is not finite.
fn pose_record(
    [captured, published]: [Time; 2],
    position: [f64; 3],
    attitude: [f64; 4],
) -> Option<PoseRecord> {
    let attitude = Attitude::from_xyzw(attitude)?;
    let position = Vector3::from(position);
    let latency_s = published.since(captured).seconds();
    let is_finite = position.iter().all(|number| number.is_finite());
    is_finite.then(|| PoseRecord { captured_s: captured.seconds(), latency_s, position, attitude })
}

/// The attitudes that the trajectory prescribes.
fn prescribed(flight: &Flight) -> Vec<(f64, Vector3<f64>)> {
    let options = &flight.config_of_longest_flight().trajectory;
    let start_s = options.start_s();
    // Waypoints prescribe no attitude.
    let trajectory = options.trajectory(None);
    let at = |FlightSample { telemetry, .. }: &FlightSample| {
        let is_flown = telemetry.phase == Phase::Trajectory as u8;
        let trajectory = trajectory.as_ref().filter(|_| is_flown);
        let reference = trajectory.and_then(|t| t.sample(telemetry.mission_s - start_s).attitude);
        let tilt = reference.map_or_else(Vector3::zeros, |reference| {
            Attitude::LEVEL.rotation_to(&reference.attitude)
        });
        (telemetry.time.seconds(), tilt.xy().push(telemetry.reference_yaw))
    };
    flight.samples.iter().map(at).collect()
}

/// The commands that were not lost, and the median delay by their stamps \[s\].
fn commands(flight: &Flight) -> (Vec<CommandRecord>, Option<f64>) {
    let mut sent_commands: Vec<(CommandRecord, bool)> = Vec::new();
    let mut delays_s = Vec::new();
    for (FlightSample { telemetry, .. }, applied) in flight.samples_with_commands() {
        let stamps = applied.map(|command| command.stamps);
        let onward = applied.map_or(Span::ZERO, |it| it.onward.wire + it.onward.air);
        let sent = stamps.map(|s| s.command_published_at).filter(|at| at.is_set());
        let sent_s = sent.unwrap_or(telemetry.time).seconds();
        if let Some(stamps) = stamps.filter(|stamps| stamps.applied_at.is_set()) {
            // Behind a bridge the stamp is that of the hand-over.
            delays_s.push((stamps.applied_at + onward).seconds() - sent_s);
        }
        let sticks = Vector3::from(telemetry.sticks);
        let command = CommandRecord { sent_s, sticks, thrust: telemetry.thrust };
        sent_commands.push((command, stamps.is_some()));
    }
    let acknowledged = sent_commands.iter().filter(|(_, is_acknowledged)| *is_acknowledged).count();
    let shows_losses = acknowledged as f64 > ACKNOWLEDGED_SHARE * sent_commands.len() as f64;
    let kept =
        sent_commands.into_iter().filter(|(_, is_acknowledged)| *is_acknowledged || !shows_losses);
    (kept.map(|(command, _)| command).collect(), median(delays_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::message::{Stamps, TelemetryV1};
    use oqtal_config::Config;
    use oqtal_observe::flight::AppliedCommand;
    use oqtal_observe::latency::OnwardTime;

    #[test]
    fn commands_of_a_later_daemon_that_counts_from_one_again_are_acknowledged() {
        let mut flight = Flight::new(&Config::default());
        for tick in 0..200 {
            let time = Time::VIRTUAL_START + Span::from_millis(20 * tick);
            // The second daemon starts after half of the ticks.
            let sequence = tick.unsigned_abs() % 100 + 1;
            let telemetry = TelemetryV1 { time, command_sequence: sequence, ..Default::default() };
            flight.samples.push(FlightSample { telemetry, truth: None });
            let applied_at = time + Span::from_millis(if tick < 100 { 20 } else { 30 });
            let stamps = Stamps {
                woken_at: time,
                command_published_at: time,
                applied_at,
                ..Default::default()
            };
            let onward = OnwardTime { air: Span::from_millis(5), ..OnwardTime::default() };
            flight.applied.push(AppliedCommand { sequence, stamps, onward, battery_v: 11.0 });
        }
        let (commands, delay_s) = commands(&flight);
        assert_eq!(commands.len(), 200);
        assert!((delay_s.unwrap() - 0.030).abs() < 1e-6, "{delay_s:?}");
    }
}
