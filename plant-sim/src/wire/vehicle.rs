//! Emulated vehicle behind its link: plant, model of the link, on-board computer. Pure: time is an argument.

use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_runtime::faults::RadioDisturbance;

use super::link::{LinkDirection, LinkModel, Traffic};
use crate::disturbance::SceneDisturbance;
use crate::plant::{Plant, PlantOutput};

/// Measurements of the on-board computer.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Motion of the vehicle; the vehicle's own sensors but for the gyroscope are perfect.
    pub truth: TruthV1,
    /// Body rate by the gyroscope \[rad/s, body\]; NaN if it has none.
    pub rate: [f64; 3],
    /// Battery voltage \[V\].
    pub battery_v: f64,
}

/// Counters of frames received by an on-board computer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Valid frames \[-\].
    pub read: u64,
    /// Damaged frames \[-\].
    pub damaged: u64,
}

/// On-board computer: protocol of the host, rules of the firmware, and the resulting command to the vehicle.
pub trait OnBoardComputer {
    /// Instant at which the computer acts without an arrival; `None` for never.
    fn next_event(&self) -> Option<Time>;

    /// Executes bytes, or one packet, that arrived at `now`, and queues the replies.
    fn receive(&mut self, now: Time, bytes: &[u8], measured: &Measured);

    /// Applies time-outs at `now`, and queues the telemetry that is due.
    fn tick(&mut self, now: Time, measured: &Measured);

    /// Passes the queued replies to `send`, frame by frame.
    fn reply(&mut self, send: &mut dyn FnMut(&[u8]));

    /// Command that the vehicle follows in the state `truth`; "disarmed" while the motors are stopped.
    fn command(&self, now: Time, truth: &TruthV1) -> CommandV1;

    /// Frames received so far.
    fn counters(&self) -> FrameCounters;
}

/// Traffic of a link.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinkCounters {
    /// Frames that the vehicle received.
    pub frames: FrameCounters,
    /// Traffic from the host.
    pub up: Traffic,
    /// Traffic to the host.
    pub down: Traffic,
}

/// Emulated vehicle with the on-board computer `B`, controlled through the link `L`.
#[derive(Debug)]
pub struct EmulatedVehicle<L, B> {
    plant: Plant,
    link: L,
    pub(super) board: B,
    /// Scratch memory for bytes that have arrived at one end of the link.
    arrived: Vec<u8>,
}

impl<L: LinkModel, B: OnBoardComputer> EmulatedVehicle<L, B> {
    pub(super) fn with_parts(plant: Plant, link: L, board: B) -> Self {
        Self { plant, link, board, arrived: Vec::with_capacity(1024) }
    }

    /// The on-board computer.
    pub fn board(&self) -> &B {
        &self.board
    }

    /// The simulated vehicle.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Instant of the next event.
    pub fn next_event(&self) -> Time {
        let down = self.link.next_arrival(LinkDirection::Down);
        down.into_iter().fold(self.next_instant(), Time::min)
    }

    /// The next instant at which the vehicle acts.
    fn next_instant(&self) -> Time {
        let events = [self.link.next_arrival(LinkDirection::Up), self.board.next_event()];
        events.into_iter().flatten().fold(self.plant.next_sample(), Time::min)
    }

    /// Whether the link accepts bytes of the host; otherwise the host must wait.
    pub fn has_room(&self, now: Time) -> bool {
        self.link.has_room(LinkDirection::Up, now)
    }

    /// Disturbs vehicle and link from now on.
    pub fn disturb(&mut self, disturbance: SceneDisturbance) {
        self.link.disturb(disturbance.radio);
        // Commands come over the link, not over the plant's own radio.
        self.plant.disturb(SceneDisturbance { radio: RadioDisturbance::default(), ..disturbance });
    }

    /// Skips the excess of a pause of the process that ends at `now`; see [`Plant::skip_pause`].
    pub fn skip_pause(&mut self, now: Time) -> Span {
        self.plant.skip_pause(now)
    }

    /// Takes bytes, or a packet, sent by the host in one write.
    pub fn host_writes(&mut self, now: Time, bytes: &[u8]) {
        self.link.send(LinkDirection::Up, now, bytes);
    }

    /// Passes the bytes, or each packet, that have arrived at the host by `now` to `use_bytes`.
    pub fn host_reads(&mut self, now: Time, mut use_bytes: impl FnMut(&[u8])) {
        while self.host_reads_next(now, &mut use_bytes).is_some() {}
    }

    /// Passes the bytes, or the next packet, that have arrived at the host by `now` to `use_bytes`, and returns its result; `None` if
    /// nothing has arrived.
    pub fn host_reads_next<T>(
        &mut self,
        now: Time,
        use_bytes: impl FnOnce(&[u8]) -> T,
    ) -> Option<T> {
        self.arrived.clear();
        let has_arrived = self.link.receive(LinkDirection::Down, now, &mut self.arrived);
        has_arrived.then(|| use_bytes(&self.arrived))
    }

    /// Integrates to `until` and passes the outputs to `out`. A command takes effect at the instant at which its last byte
    /// arrives.
    pub fn advance(&mut self, until: Time, mut out: impl FnMut(PlantOutput)) {
        loop {
            let next = self.next_instant().min(until);
            self.plant.advance(next, &mut out);
            self.act(next);
            if next >= until {
                return;
            }
        }
    }

    /// Executes the bytes that have arrived, advances the on-board computer, sends replies, and commands the vehicle.
    fn act(&mut self, now: Time) {
        let Self { plant, link, board, arrived } = self;
        let rate = plant.measured_rate().unwrap_or([f64::NAN; 3]);
        let measured = Measured { truth: plant.truth(), rate, battery_v: plant.battery_v() };
        arrived.clear();
        while link.receive(LinkDirection::Up, now, arrived) {
            board.receive(now, arrived, &measured);
            arrived.clear();
        }
        board.tick(now, &measured);
        board.reply(&mut |bytes| link.send(LinkDirection::Down, now, bytes));
        plant.apply_command(&board.command(now, &measured.truth));
    }

    /// Traffic since the start.
    pub fn counters(&self) -> LinkCounters {
        let traffic = |direction| self.link.traffic(direction);
        let (up, down) = (traffic(LinkDirection::Up), traffic(LinkDirection::Down));
        LinkCounters { frames: self.board.counters(), up, down }
    }
}
