//! What the processes of an instance say of their latencies, heard without a word.

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, TelemetryV1, VehicleV1};
use oqtal_bus::port::Reader;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_observe::latency::{Distribution, HopDistributions};
use serde::Serialize;

/// What was counted while listening.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counters {
    /// Turns of the loop.
    pub ticks: u64,
    /// Turns that acted on a new pose; the others acted on their deadline.
    pub fresh_ticks: u64,
    /// Commands that came later than a period after their pose.
    pub deadline_misses: u64,
    /// Poses missed, by the gaps in their frame numbers.
    pub poses_lost: u64,
    /// Poses that were not believed.
    pub poses_refused: u64,
    /// Commands published.
    pub commands: u64,
    /// Commands that the vehicle missed, by the gaps in their sequence.
    pub commands_lost: u64,
    /// Samples that this observer missed: the figures lack them.
    pub unheard: u64,
}

/// Listens to one instance.
#[derive(Debug)]
pub struct Ears {
    telemetry: Reader<TelemetryV1>,
    vehicles: Reader<VehicleV1>,
    commands: Reader<CommandV1>,
    from: Time,
    first: Option<TelemetryV1>,
    last: TelemetryV1,
    first_lost: Option<u64>,
    unheard_before: u64,
    counters: Counters,
    armed: bool,
    daemon: Option<u64>,
    hops: HopDistributions,
    wakeup: Distribution,
}

impl Ears {
    /// Opens the ears; what was said before `from` does not count.
    ///
    /// # Errors
    /// The bus refuses.
    pub fn open(bus: &Bus, from: Time) -> Result<Self, BusError> {
        Ok(Self {
            telemetry: bus.observer(&TELEMETRY)?,
            vehicles: bus.observer(&VEHICLE)?,
            commands: bus.observer(&COMMAND)?,
            from,
            first: None,
            last: TelemetryV1::default(),
            first_lost: None,
            unheard_before: 0,
            counters: Counters::default(),
            armed: false,
            daemon: None,
            hops: HopDistributions::default(),
            wakeup: Distribution::default(),
        })
    }

    /// Forgets what was heard; what was said before `from` does not count.
    pub fn restart(&mut self, from: Time) {
        self.from = from;
        self.first = None;
        self.first_lost = None;
        self.unheard_before = self.unheard();
        self.counters = Counters::default();
        self.hops = HopDistributions::default();
        self.wakeup = Distribution::default();
    }

    /// Takes in all that was said since the last call.
    ///
    /// # Errors
    /// A topic speaks another version.
    pub fn listen(&mut self) -> Result<(), BusError> {
        while let Some((header, telemetry)) = self.telemetry.receive()? {
            // Whoever joins late is told the last word, however old it is.
            if telemetry.time >= self.from {
                self.daemon = Some(u64::from(header.origin().process()));
                self.hear(&telemetry);
            }
        }
        while let Some((header, vehicle)) = self.vehicles.receive()? {
            if header.stamps.woken_at >= self.from {
                self.armed = vehicle.armed == 1;
                self.hops.add(&header.stamps, Span::from_nanos(vehicle.wire_ns));
                let before = *self.first_lost.get_or_insert(vehicle.lost);
                self.counters.commands_lost = vehicle.lost.saturating_sub(before);
            }
        }
        while let Some((header, _)) = self.commands.receive()? {
            self.counters.commands += u64::from(header.stamps.woken_at >= self.from);
        }
        self.counters.unheard = self.unheard() - self.unheard_before;
        Ok(())
    }

    fn hear(&mut self, telemetry: &TelemetryV1) {
        let first = *self.first.get_or_insert(*telemetry);
        self.last = *telemetry;
        self.wakeup.add(Span::from_nanos(telemetry.wakeup_lateness_ns));
        let counters = &mut self.counters;
        counters.ticks += 1;
        counters.fresh_ticks += u64::from(telemetry.fresh);
        // A daemon that restarted counts from zero.
        counters.deadline_misses = telemetry.deadline_misses.saturating_sub(first.deadline_misses);
        counters.poses_lost = telemetry.poses_lost.saturating_sub(first.poses_lost);
        counters.poses_refused = telemetry.poses_refused.saturating_sub(first.poses_refused);
    }

    fn unheard(&self) -> u64 {
        self.telemetry.lost() + self.vehicles.lost() + self.commands.lost()
    }

    /// The newest turn of the loop; `None` if there was none.
    #[must_use]
    pub fn latest(&self) -> Option<&TelemetryV1> {
        self.first.map(|_| &self.last)
    }

    /// Process id of the daemon, once it was heard.
    #[must_use]
    pub fn daemon(&self) -> Option<u64> {
        self.daemon
    }

    /// Whether the vehicle runs its motors.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// What was counted.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The hops of every command that was applied.
    #[must_use]
    pub fn hops(&self) -> &HopDistributions {
        &self.hops
    }

    /// How late the daemon woke.
    #[must_use]
    pub fn wakeup(&self) -> &Distribution {
        &self.wakeup
    }
}
