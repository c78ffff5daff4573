//! Schedule of one Crazyradio among its vehicles. Pure: time is an argument.
//!
//! A vehicle sends only in the acknowledgement of a received packet, so the radio also sends empty packets. Set-points have
//! priority, first that of the vehicle that has waited longest; then follow other packets, then null packets to vehicles that may
//! have data to send. Only the newest set-point of a vehicle waits, and none older than [`MAX_AGE`] is ever sent. A set-point
//! without acknowledgement is not repeated by the schedule, because a newer one follows. Apart from set-points, a vehicle gets no
//! more packets than its share of the radio's time.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpPacket, CrtpPort, CrtpPose, CrtpRequest};

/// Age above which a packet is never sent.
pub const MAX_AGE: Span = Span::from_millis(50);
/// Most packets that wait for one vehicle, its set-point aside \[-\].
const MAX_WAITING: usize = 8;
/// Attempts at a packet other than a set-point, each repeated by the radio itself \[-\].
const ATTEMPTS: u32 = 3;
/// Time between two null packets to a vehicle that had no data to send.
const IDLE_POLL: Span = Span::from_millis(10);

/// Packet that waits.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    since: Time,
    packet: CrtpPacket,
    attempts: u32,
}

/// Traffic with one vehicle since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RadioCounts {
    /// Packets sent \[-\].
    pub sent: u64,
    /// Of those, acknowledged \[-\].
    pub acknowledged: u64,
    /// Set-points sent \[-\].
    pub setpoints: u64,
    /// Packets that were not sent in time, or found the queue full \[-\].
    pub dropped: u64,
    /// Repetitions by the radio itself \[-\].
    pub repeated: u64,
    /// Poses that went in the packet of another vehicle's pose \[-\].
    pub packed: u64,
}

/// Packets that wait for one vehicle.
#[derive(Clone, Debug)]
struct RadioVehicle {
    setpoint: Option<Waiting>,
    others: VecDeque<Waiting>,
    /// Instant from which the next packet other than a set-point may be sent.
    free_at: Time,
    poll_at: Time,
    on_air: Option<Waiting>,
    counts: RadioCounts,
}

/// Schedule of one radio.
#[derive(Clone, Debug)]
pub struct RadioSchedule {
    vehicles: Vec<RadioVehicle>,
    spacing: Span,
    /// Vehicle whose turn it is first.
    first: usize,
}

impl RadioSchedule {
    /// Schedule for this number of vehicles, each of which gets up to `packets_per_s` packets other than set-points \[1/s\].
    pub fn new(vehicles: usize, packets_per_s: f64) -> Self {
        let vehicle = RadioVehicle {
            setpoint: None,
            others: VecDeque::with_capacity(MAX_WAITING),
            free_at: Time::UNSET,
            poll_at: Time::UNSET,
            on_air: None,
            counts: RadioCounts::default(),
        };
        let spacing = Span::period_of(packets_per_s);
        Self { vehicles: vec![vehicle; vehicles], spacing, first: 0 }
    }

    /// Takes a packet for a vehicle.
    pub fn push(&mut self, now: Time, vehicle: usize, packet: CrtpPacket) {
        let Some(vehicle) = self.vehicles.get_mut(vehicle) else { return };
        let waiting = Waiting { since: now, packet, attempts: 0 };
        if is_setpoint(&packet) {
            vehicle.counts.dropped += u64::from(vehicle.setpoint.replace(waiting).is_some());
        } else {
            if vehicle.others.len() >= MAX_WAITING {
                vehicle.others.pop_front();
                vehicle.counts.dropped += 1;
            }
            vehicle.others.push_back(waiting);
        }
    }

    /// The packet to be sent at `now`, and its vehicle; `None` if nothing is due. [`RadioSchedule::sent`] follows.
    pub fn next(&mut self, now: Time) -> Option<(usize, CrtpPacket)> {
        self.vehicles.iter_mut().for_each(|vehicle| vehicle.drop_old(now));
        let index = self.whose_turn(now)?;
        self.first = (index + 1) % self.vehicles.len();
        let spacing = self.spacing;
        let vehicle = &mut self.vehicles[index];
        let waiting = vehicle.take(now);
        vehicle.counts.sent += 1;
        vehicle.counts.setpoints += u64::from(is_setpoint(&waiting.packet));
        vehicle.free_at = now + spacing;
        vehicle.on_air = Some(waiting);
        Some((index, waiting.packet))
    }

    fn whose_turn(&self, now: Time) -> Option<usize> {
        let count = self.vehicles.len();
        let order = || (0..count).map(|step| (self.first + step) % count);
        let with_setpoint = order()
            .filter_map(|index| self.vehicles[index].setpoint.map(|waiting| (waiting.since, index)))
            .min_by_key(|(since, _)| *since)
            .map(|(_, index)| index);
        let free = |index: &usize| self.vehicles[*index].free_at <= now;
        let with_other = || order().filter(free).find(|i| !self.vehicles[*i].others.is_empty());
        let to_poll = || order().filter(free).find(|i| self.vehicles[*i].poll_at <= now);
        with_setpoint.or_else(with_other).or_else(to_poll)
    }

    /// Removes the newest waiting pose for another vehicle from the schedule, to be sent in the same packet as the pose for
    /// `vehicle`; `receives` states whether a vehicle receives that packet. Returns the vehicle and its pose.
    pub fn companion(
        &mut self,
        vehicle: usize,
        receives: impl Fn(usize) -> bool,
    ) -> Option<(usize, CrtpPose)> {
        for (index, other) in self.vehicles.iter_mut().enumerate() {
            if index == vehicle || !receives(index) {
                continue;
            }
            if let Some(pose) = other.take_pose() {
                other.counts.packed += 1;
                return Some((index, pose));
            }
        }
        None
    }

    /// Records that the packet that went to `vehicle` was sent to several, so that none acknowledges it.
    pub fn broadcast(&mut self, vehicle: usize) {
        if let Some(vehicle) = self.vehicles.get_mut(vehicle) {
            vehicle.on_air = None;
        }
    }

    /// Takes the outcome of the sent packet: whether it was acknowledged, whether the vehicle sent data in the
    /// acknowledgement, how often the radio repeated it.
    pub fn sent(&mut self, now: Time, vehicle: usize, ack: Option<bool>, repeated: u32) {
        let Some(vehicle) = self.vehicles.get_mut(vehicle) else { return };
        vehicle.counts.repeated += u64::from(repeated);
        vehicle.counts.acknowledged += u64::from(ack.is_some());
        // A vehicle that sent data may have more.
        vehicle.poll_at = if ack == Some(true) { now } else { now + IDLE_POLL };
        let again = vehicle.on_air.take().filter(|waiting| {
            let is_other = !is_setpoint(&waiting.packet) && !waiting.packet.is_null();
            ack.is_none() && is_other && waiting.attempts + 1 < ATTEMPTS
        });
        if let Some(waiting) = again {
            let attempts = waiting.attempts + 1;
            vehicle.others.push_front(Waiting { attempts, ..waiting });
        }
    }

    /// Instant of the next action if nothing is pushed.
    pub fn next_event(&self) -> Option<Time> {
        self.vehicles.iter().map(RadioVehicle::due_at).min()
    }

    /// Traffic with one vehicle.
    pub fn counts(&self, vehicle: usize) -> RadioCounts {
        self.vehicles.get(vehicle).map(|vehicle| vehicle.counts).unwrap_or_default()
    }
}

impl RadioVehicle {
    fn due_at(&self) -> Time {
        if self.setpoint.is_some() {
            return Time::UNSET;
        }
        let wanted = if self.others.is_empty() { self.poll_at } else { Time::UNSET };
        wanted.max(self.free_at)
    }

    fn drop_old(&mut self, now: Time) {
        let is_old = |waiting: &Waiting| now.since(waiting.since) > MAX_AGE;
        let before = self.others.len() + usize::from(self.setpoint.is_some());
        self.setpoint = self.setpoint.filter(|waiting| !is_old(waiting));
        self.others.retain(|waiting| !is_old(waiting));
        let after = self.others.len() + usize::from(self.setpoint.is_some());
        self.counts.dropped += (before - after) as u64;
    }

    /// Takes the newest pose that waits; an older one is dropped.
    fn take_pose(&mut self) -> Option<CrtpPose> {
        let mut newest = None;
        let before = self.others.len();
        self.others.retain(|waiting| match single_pose(&waiting.packet) {
            Some(pose) => {
                newest = Some(pose);
                false
            }
            None => true,
        });
        let poses = (before - self.others.len()) as u64;
        self.counts.dropped += poses.saturating_sub(1);
        newest
    }

    fn take(&mut self, now: Time) -> Waiting {
        let null = Waiting { since: now, packet: CrtpPacket::NULL, attempts: 0 };
        self.setpoint.take().or_else(|| self.others.pop_front()).unwrap_or(null)
    }
}

/// The pose in a packet of one pose; `None` for any other packet.
pub fn single_pose(packet: &CrtpPacket) -> Option<CrtpPose> {
    match CrtpRequest::read(packet)? {
        CrtpRequest::Pose(pose) => Some(pose),
        CrtpRequest::Poses(poses) => match poses.poses() {
            [pose] => Some(pose.pose()),
            _ => None,
        },
        _ => None,
    }
}

/// Whether only the newest of such packets counts: set-points of either kind.
fn is_setpoint(packet: &CrtpPacket) -> bool {
    let is_generic = packet.port() == CrtpPort::GenericCommander as u8 && packet.channel() == 0;
    packet.port() == CrtpPort::Commander as u8 || is_generic
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_wire::crtp::LegacySetpoint;

    const EXCHANGE: Span = Span::from_nanos(1_200_000);

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    fn setpoint(thrust: u16) -> CrtpPacket {
        CrtpRequest::Setpoint(LegacySetpoint { thrust, ..LegacySetpoint::ZERO }).packet()
    }

    fn thrust(packet: &CrtpPacket) -> Option<u16> {
        match CrtpRequest::read(packet) {
            Some(CrtpRequest::Setpoint(setpoint)) => Some(setpoint.thrust),
            _ => None,
        }
    }

    #[test]
    fn the_newest_set_point_is_sent_first_and_no_old_packet_is_sent() {
        let mut schedule = RadioSchedule::new(1, 250.0);
        schedule.push(at(0), 0, CrtpRequest::Source.packet());
        schedule.push(at(1), 0, setpoint(1));
        schedule.push(at(2), 0, setpoint(2));
        let (_, packet) = schedule.next(at(3)).unwrap();
        assert_eq!(thrust(&packet), Some(2));
        schedule.sent(at(4), 0, None, 3);
        assert!(schedule.next(at(4)).is_none(), "its share: 4 ms between packets");
        schedule.push(at(40), 0, setpoint(3));
        let (_, packet) = schedule.next(at(91)).unwrap();
        assert!(packet.is_null(), "set-point and request are old");
        assert_eq!(schedule.counts(0).dropped, 3);
    }

    #[test]
    fn a_request_is_repeated_a_few_times_and_a_set_point_never() {
        let mut schedule = RadioSchedule::new(1, 1000.0);
        schedule.push(at(0), 0, CrtpRequest::Source.packet());
        schedule.push(at(0), 0, setpoint(1));
        let mut sent = Vec::new();
        for millis in 0..30 {
            if let Some((_, packet)) = schedule.next(at(millis)) {
                schedule.sent(at(millis), 0, None, 0);
                sent.push(packet);
            }
        }
        let source = CrtpRequest::Source.packet();
        assert_eq!(sent.iter().filter(|packet| **packet == source).count(), 3);
        assert_eq!(sent.iter().filter_map(thrust).count(), 1);
    }

    /// Vehicles that each get set-points and poses at 60 Hz and echoes at 10 Hz, and report with every third packet.
    fn busy(vehicles: usize) -> (RadioSchedule, Span) {
        let mut schedule = RadioSchedule::new(vehicles, 250.0);
        let (mut now, mut worst) = (at(0), Span::ZERO);
        let (mut ticks, mut sent) = (0, 0);
        while now < at(10_000) {
            while at(0) + Span::from_nanos(16_666_667).scaled(f64::from(ticks)) <= now {
                for vehicle in 0..vehicles {
                    schedule.push(now, vehicle, setpoint(1));
                    schedule.push(now, vehicle, CrtpRequest::Echo(0).packet());
                }
                ticks += 1;
            }
            let waits = schedule.vehicles.iter().filter_map(|v| v.setpoint.map(|w| w.since));
            worst = waits.map(|since| now.since(since)).fold(worst, Span::max);
            match schedule.next(now) {
                Some((vehicle, _)) => {
                    sent += 1;
                    now = now + EXCHANGE;
                    schedule.sent(now, vehicle, Some(sent % 3 == 0), 0);
                }
                None => now = now + Span::from_nanos(100_000),
            }
        }
        (schedule, worst + EXCHANGE)
    }

    #[test]
    fn two_vehicles_at_sixty_hertz_are_within_the_budget_of_one_radio() {
        let (schedule, worst) = busy(2);
        for vehicle in 0..2 {
            let counts = schedule.counts(vehicle);
            assert!(counts.setpoints >= 599 && counts.dropped == 0, "{counts:?}");
            // The share of the vehicle, and set-points.
            assert!(counts.sent <= 2500 + counts.setpoints, "{counts:?}");
        }
        // Behind the exchange that runs, and the other vehicle's set-point.
        assert!(worst <= EXCHANGE.scaled(3.0) + Span::from_nanos(200_000), "{worst:?}");
    }

    #[test]
    fn more_vehicles_than_a_radio_carries_share_it_evenly_and_get_nothing_old() {
        let (schedule, worst) = busy(16);
        let counts: Vec<u64> = (0..16).map(|i| schedule.counts(i).setpoints).collect();
        let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
        assert!(most - least <= 2, "{counts:?}");
        assert!(worst <= MAX_AGE + EXCHANGE);
    }
}
