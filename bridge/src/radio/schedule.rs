//! Schedule of one Crazyradio among its vehicles. Pure: time is an argument.
//!
//! A vehicle sends only in the acknowledgement of a received packet, so the radio also sends empty packets. Stops (disarming and the
//! emergency stop) go first. Then follow set-points, first that of the vehicle that has waited longest; then other packets, then
//! null packets to vehicles that may have data to send. Only the newest set-point of a vehicle waits, and none older than
//! [`MAX_AGE`] is ever sent. A set-point without acknowledgement is not repeated by the schedule, because a newer one follows;
//! [`RadioSchedule::repeat_missed_zero`] repeats the last one of a bridge that has ended. A stop is repeated until it is
//! acknowledged. Apart from stops and set-points, a vehicle gets no more packets than its share of the radio's time.

use std::collections::VecDeque;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{
    CrtpPacket, CrtpPort, CrtpPose, CrtpRequest, LegacySetpoint, SupervisorCommand,
};

/// Age above which a packet is never sent, stops aside.
pub const MAX_AGE: Span = Span::from_millis(50);
/// Age above which a stop is not sent: a vehicle that has received nothing for this time has stopped its motors and locked itself, and
/// one that was restarted since must not be locked again.
const MAX_STOP_AGE: Span = Span::from_millis(2000);
/// Time between two attempts at a stop.
const STOP_PERIOD: Span = Span::from_millis(10);
/// Most packets that wait for one vehicle, its stop and its set-point aside \[-\].
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
    /// Packets sent and acknowledged \[-\].
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
    /// Emergency stop, or else disarming.
    stop: Option<Waiting>,
    /// Instant from which the stop may be sent.
    stop_at: Time,
    setpoint: Option<Waiting>,
    /// Last set-point, if it had no thrust and was not acknowledged.
    missed_zero: Option<Waiting>,
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
            stop: None,
            stop_at: Time::UNSET,
            setpoint: None,
            missed_zero: None,
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
        let is_emergency = vehicle.stop.is_some_and(|stop| is_emergency_stop(&stop.packet));
        match supervisor_command(&packet) {
            // The emergency stop that waits includes disarming.
            Some(SupervisorCommand::Arm(false)) if is_emergency => return,
            // The newest of two opposite requests counts.
            Some(SupervisorCommand::Arm(true)) if !is_emergency => vehicle.stop = None,
            _ => {}
        }
        if is_stop(&packet) {
            (vehicle.stop, vehicle.stop_at) = (Some(waiting), now);
            vehicle.others.retain(|other| !is_arming(&other.packet));
        } else if is_setpoint(&packet) {
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
        let with_stop = order().find(|index| self.vehicles[*index].is_stop_due(now));
        let with_setpoint = order()
            .filter_map(|index| self.vehicles[index].setpoint.map(|waiting| (waiting.since, index)))
            .min_by_key(|(since, _)| *since)
            .map(|(_, index)| index);
        let free = |index: &usize| self.vehicles[*index].free_at <= now;
        let with_other = || order().filter(free).find(|i| !self.vehicles[*i].others.is_empty());
        let to_poll = || order().filter(free).find(|i| self.vehicles[*i].poll_at <= now);
        with_stop.or(with_setpoint).or_else(with_other).or_else(to_poll)
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
        let Some(waiting) = vehicle.on_air.take() else { return };
        let missed = Some(waiting).filter(|_| ack.is_none());
        if is_stop(&waiting.packet) {
            (vehicle.stop, vehicle.stop_at) = (missed, now + STOP_PERIOD);
        } else if is_setpoint(&waiting.packet) {
            vehicle.missed_zero = missed.filter(|missed| is_zero(&missed.packet));
        } else if let Some(missed) = missed
            && !missed.packet.is_null()
            && missed.attempts + 1 < ATTEMPTS
        {
            vehicle.others.push_front(Waiting { attempts: missed.attempts + 1, ..missed });
        }
    }

    /// Repeats the zero set-points that were sent last and not acknowledged: no newer ones follow.
    pub fn repeat_missed_zero(&mut self) {
        for vehicle in &mut self.vehicles {
            vehicle.setpoint = vehicle.setpoint.or(vehicle.missed_zero.take());
        }
    }

    /// Whether no packet waits, null packets aside.
    pub fn is_empty(&self) -> bool {
        let waits =
            |v: &RadioVehicle| v.stop.is_some() || v.setpoint.is_some() || !v.others.is_empty();
        !self.vehicles.iter().any(waits)
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
        let due_at = wanted.max(self.free_at);
        if self.stop.is_some() { due_at.min(self.stop_at) } else { due_at }
    }

    fn is_stop_due(&self, now: Time) -> bool {
        self.stop.is_some() && self.stop_at <= now
    }

    fn drop_old(&mut self, now: Time) {
        let is_old = |waiting: &Waiting| now.since(waiting.since) > MAX_AGE;
        let before = self.others.len() + usize::from(self.setpoint.is_some());
        self.stop = self.stop.filter(|stop| now.since(stop.since) <= MAX_STOP_AGE);
        self.missed_zero = self.missed_zero.filter(|waiting| !is_old(waiting));
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
        let stop = if self.is_stop_due(now) { self.stop.take() } else { None };
        stop.or_else(|| self.setpoint.take()).or_else(|| self.others.pop_front()).unwrap_or(null)
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

/// The supervisor's command in a packet; `None` for any other packet.
fn supervisor_command(packet: &CrtpPacket) -> Option<SupervisorCommand> {
    match CrtpRequest::read(packet)? {
        CrtpRequest::Supervisor(command) | CrtpRequest::LegacySupervisor(command) => Some(command),
        _ => None,
    }
}

fn is_stop(packet: &CrtpPacket) -> bool {
    is_emergency_stop(packet) || supervisor_command(packet) == Some(SupervisorCommand::Arm(false))
}

fn is_arming(packet: &CrtpPacket) -> bool {
    supervisor_command(packet) == Some(SupervisorCommand::Arm(true))
}

fn is_emergency_stop(packet: &CrtpPacket) -> bool {
    supervisor_command(packet) == Some(SupervisorCommand::EmergencyStop)
}

/// Whether a packet is the zero set-point.
fn is_zero(packet: &CrtpPacket) -> bool {
    *packet == CrtpRequest::Setpoint(LegacySetpoint::ZERO).packet()
}

/// Whether only the newest of such packets counts: set-points of either kind.
fn is_setpoint(packet: &CrtpPacket) -> bool {
    let is_generic = packet.port() == CrtpPort::GenericCommander as u8 && packet.channel() == 0;
    packet.port() == CrtpPort::Commander as u8 || is_generic
}

#[cfg(test)]
mod tests;
