//! Exchange of packets with the vehicles of one radio, and the account of it.

use std::io;

use oqtal_bus::time::{Span, Time};
use oqtal_wire::crtp::{CrtpPacket, CrtpRequest, PackedPose, PackedPoses};
use oqtal_wire::link::RadioSpec;

use super::dongle::RadioDongle;
use super::schedule::{RadioCounts, RadioSchedule, single_pose};

/// Time between two accounts in the log.
const ACCOUNT_PERIOD: Span = Span::from_millis(10_000);

/// Exchange of packets between a radio and its vehicles.
#[derive(Debug)]
pub struct RadioWorker<D> {
    dongle: D,
    vehicles: Vec<RadioSpec>,
    schedule: RadioSchedule,
    packs_poses: bool,
    /// Instant of the last log record about traffic, and the traffic until then.
    account: (Time, Vec<RadioCounts>),
}

impl<D: RadioDongle> RadioWorker<D> {
    /// Worker of `dongle` for `vehicles`, each of which gets up to `packets_per_s` packets other than set-points \[1/s\].
    pub fn new(dongle: D, vehicles: Vec<RadioSpec>, packets_per_s: f64) -> Self {
        let counts = vec![RadioCounts::default(); vehicles.len()];
        let schedule = RadioSchedule::new(vehicles.len(), packets_per_s);
        Self { dongle, vehicles, schedule, packs_poses: false, account: (Time::UNSET, counts) }
    }

    /// Enables packing: two waiting poses for vehicles on one channel are sent in one packet, to the address of all vehicles.
    pub fn pack_poses(&mut self) {
        self.packs_poses = true;
    }

    /// Takes a packet for a vehicle.
    pub fn push(&mut self, now: Time, vehicle: usize, packet: CrtpPacket) {
        self.schedule.push(now, vehicle, packet);
    }

    /// Whether no packet waits after the zero set-points that were sent last and not acknowledged were added again: no newer ones
    /// follow.
    pub fn is_finished(&mut self) -> bool {
        self.schedule.repeat_missed_zero();
        self.schedule.is_empty()
    }

    /// Instant of the next action if nothing is pushed.
    pub fn next_event(&self) -> Option<Time> {
        self.schedule.next_event()
    }

    /// Exchanges the packet that is due, if any; returns the vehicle, and its reply. `clock` is read before and after.
    ///
    /// # Errors
    /// The radio is lost.
    pub fn exchange(
        &mut self,
        clock: &mut dyn FnMut() -> Time,
    ) -> io::Result<Option<(usize, Option<CrtpPacket>)>> {
        let Some((vehicle, packet)) = self.schedule.next(clock()) else { return Ok(None) };
        if let Some(packed) = self.packed(vehicle, &packet) {
            self.dongle.broadcast(&self.vehicles[vehicle], &packed)?;
            self.schedule.broadcast(vehicle);
            return Ok(Some((vehicle, None)));
        }
        let ack = self.dongle.exchange(&self.vehicles[vehicle], &packet)?;
        // A null packet contains no answer.
        let reply = ack.reply.filter(|reply| !reply.is_null());
        let outcome = ack.is_acknowledged.then_some(reply.is_some());
        self.schedule.sent(clock(), vehicle, outcome, ack.repeated);
        Ok(Some((vehicle, reply)))
    }

    /// The packet with the pose in `packet` for `vehicle` and the waiting pose for another vehicle; `None` without such a pose.
    fn packed(&mut self, vehicle: usize, packet: &CrtpPacket) -> Option<CrtpPacket> {
        let pose = single_pose(packet).filter(|_| self.packs_poses)?;
        let Self { vehicles, schedule, .. } = self;
        let own = vehicles[vehicle];
        let receives = |other: usize| {
            (vehicles[other].channel, vehicles[other].rate) == (own.channel, own.rate)
        };
        let id = |index: usize| vehicles[index].vehicle_id();
        let first = PackedPose::of(id(vehicle), &pose)?;
        let (other, pose) = schedule.companion(vehicle, receives)?;
        // If a pose cannot be packed, its vehicle is out of reach: the next pose is sent alone.
        let poses = match PackedPose::of(id(other), &pose) {
            Some(second) => PackedPoses::of(&[first, second]),
            None => PackedPoses::of(&[first]),
        };
        Some(CrtpRequest::Poses(poses).packet())
    }

    /// Traffic with one vehicle since the start.
    pub fn counts(&self, vehicle: usize) -> RadioCounts {
        self.schedule.counts(vehicle)
    }

    /// Logs packets per second and acknowledgements of every vehicle, every ten seconds.
    pub fn give_account(&mut self, now: Time) {
        let (since, before) = &mut self.account;
        if !since.is_set() {
            *since = now;
        }
        let seconds = now.since(*since).seconds();
        if seconds < ACCOUNT_PERIOD.seconds() {
            return;
        }
        *since = now;
        for (index, (vehicle, before)) in self.vehicles.iter().zip(before).enumerate() {
            let counts = self.schedule.counts(index);
            let sent = counts.sent - before.sent;
            let share = (counts.acknowledged - before.acknowledged) as f64 / sent.max(1) as f64;
            tracing::info!(
                "{vehicle}: {:.0} packets/s, of them {:.0} set-points; {:.1} % acknowledged, {} repeated, {} dropped, {} poses in packets of others",
                sent as f64 / seconds,
                (counts.setpoints - before.setpoints) as f64 / seconds,
                100.0 * share,
                counts.repeated - before.repeated,
                counts.dropped - before.dropped,
                counts.packed - before.packed,
            );
            *before = counts;
        }
    }
}
