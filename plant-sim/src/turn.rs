//! One turn of the plant over its ports: integrates to the present instant, executes a stop, takes the command, and publishes
//! truth and vehicle.

use oqtal_bus::error::BusError;
use oqtal_bus::message::{CommandV1, Header, Stamps, TruthV1, VehicleV1};
use oqtal_bus::stop::{StoppedMotors, VehicleStop};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{COMMAND, TRUTH, VEHICLE};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::Config;
use oqtal_runtime::health::{Health, MotorActivity};
use oqtal_runtime::turn::{Turn, TurnClock};

use crate::disturbance::DisturbanceClock;
use crate::plant::{Plant, PlantOutput};

/// Time after which the state of a vehicle without commands is published again.
const PUBLICATION_PERIOD: Span = Span::from_millis(100);

/// Milliseconds of a pause of the process from which every sample of the truth is published \[-\]. Those of a longer pause are
/// thinned: observers, which cannot read within a turn, must lose none.
const MOST_SAMPLED_MS: i64 = TRUTH.quality.buffer as i64 / 4;

/// The instants at which the plant acts without an arrival.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stepping {
    /// At every event: truth samples, and commands that take effect. For virtual time.
    Exact,
    /// At truth samples only; events between two samples are integrated at the next one. For real time.
    Sampled,
}

/// The topics that the plant publishes.
#[derive(Debug)]
struct Outputs<T: Transport> {
    truths: T::Writer<TruthV1>,
    /// Writer of the vehicle's state; `None` for the shadow of a vehicle behind a bridge, whose state the bridge publishes.
    vehicles: Option<T::Writer<VehicleV1>>,
    /// Instant at which the state of the vehicle was last published.
    vehicle_at: Time,
}

impl<T: Transport> Outputs<T> {
    fn publish<C: TurnClock>(
        &mut self,
        output: PlantOutput,
        clock: &mut C,
    ) -> Result<(), BusError> {
        match output {
            PlantOutput::Truth(truth) => {
                self.truths.send(truth.capture, Default::default(), truth)?;
                if truth.capture > 0 {
                    clock.announce(&self.truths)?;
                }
            }
            PlantOutput::Applied(pose_sequence, stamps, vehicle) => {
                if let Some(vehicles) = &mut self.vehicles {
                    self.vehicle_at = clock.now();
                    vehicles.send(pose_sequence, stamps, vehicle)?;
                }
            }
        }
        Ok(())
    }
}

/// Logs the part of a pause of the process that was skipped.
pub(crate) fn log_skipped(skipped: Span) {
    if skipped > Span::ZERO {
        tracing::warn!("the simulation paused: {:.1} s are not simulated", skipped.seconds());
    }
}

/// The turn of the plant.
#[derive(Debug)]
pub struct PlantTurn<T: Transport> {
    commands: T::Reader<CommandV1>,
    /// Commands that faults withheld so far.
    withheld: u64,
    outputs: Outputs<T>,
    stop: VehicleStop,
    plant: Plant,
    stepping: Stepping,
    health: Health,
    disturbances: DisturbanceClock<T>,
}

impl<T: Transport> PlantTurn<T> {
    /// Opens the ports of `plant`, the vehicle of `config`. A shadow of a vehicle behind a bridge does not publish the vehicle's
    /// state.
    ///
    /// # Errors
    /// Another plant or bridge holds a topic, or the transport failed.
    pub fn open(
        bus: &T,
        plant: Plant,
        stepping: Stepping,
        config: &Config,
    ) -> Result<Self, BusError> {
        let is_shadow = config.plant.shadow;
        Ok(Self {
            commands: bus.reader(&COMMAND)?,
            withheld: 0,
            outputs: Outputs {
                truths: bus.writer(&TRUTH)?,
                vehicles: (!is_shadow).then(|| bus.writer(&VEHICLE)).transpose()?,
                vehicle_at: Time::UNSET,
            },
            stop: VehicleStop::new(bus.stop_switch()?),
            plant,
            stepping,
            health: Health::default(),
            disturbances: DisturbanceClock::open(bus, config)?,
        })
    }

    /// Counts the inputs in `health`.
    pub fn counted_in(self, health: Health) -> Self {
        Self { health, ..self }
    }

    /// The plant, in virtual time between two turns.
    pub fn plant(&mut self) -> &mut Plant {
        &mut self.plant
    }

    /// Skips the excess of a long pause in real time: integrating it would take longer than the loop's sleep.
    fn skip_pause(&mut self, now: Time) {
        if self.stepping == Stepping::Sampled {
            log_skipped(self.plant.skip_pause(now));
        }
    }

    /// Executes an operator's stop, and lifts it if `arrival` is a "disarmed" of the daemon. A shadow keeps its motors off as
    /// well, but does not control the vehicle behind the bridge: it neither confirms nor lifts a stop.
    fn obey_stop<C: TurnClock>(
        &mut self,
        arrival: Option<&(Header, CommandV1)>,
        clock: &mut C,
    ) -> Result<(), BusError> {
        let now = clock.now();
        let Self { stop, plant, outputs, .. } = self;
        let mut changed = plant.keep_stopped(stop.is_in_force(now));
        if outputs.vehicles.is_some() {
            stop.confirm(now, StoppedMotors::Off);
            if let Some((header, command)) = arrival {
                stop.receive_command(header, command);
            }
            changed |= plant.keep_stopped(stop.since().is_some());
        }
        // Without commands, a late observer receives a stop, and the state of a vehicle whose daemon hangs.
        let is_due = now.since(outputs.vehicle_at) >= PUBLICATION_PERIOD;
        if changed || is_due {
            let vehicle = plant.vehicle();
            let stamps = Stamps { received_at: now, ..Stamps::default() };
            outputs.publish(PlantOutput::Applied(0, stamps, vehicle), clock)?;
        }
        Ok(())
    }
}

impl<T: Transport> Turn for PlantTurn<T> {
    fn next_event(&self, _now: Time) -> Option<Time> {
        Some(match self.stepping {
            Stepping::Exact => self.plant.next_event(),
            Stepping::Sampled => self.plant.next_sample(),
        })
    }

    fn motors(&self) -> MotorActivity {
        if self.plant.vehicle().armed == 0 { MotorActivity::Off } else { MotorActivity::MayRun }
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        let arrival = self.commands.latest()?;
        // The clock is read after the command was taken, so that no command is received before it was sent.
        let now = clock.now();
        self.plant.disturb(self.disturbances.at(now)?);
        self.skip_pause(now);
        let Self { plant, outputs, .. } = self;
        let overdue_ms = now.since(plant.next_sample()).nanos() / 1_000_000;
        let thinning = 1 + overdue_ms.max(0) / MOST_SAMPLED_MS;
        let (mut published, mut samples) = (Ok(()), 0);
        plant.advance(now, |output| {
            let is_sample = matches!(output, PlantOutput::Truth(_));
            samples += i64::from(is_sample);
            let is_left_out = is_sample && samples % thinning != 0;
            if published.is_ok() && !is_left_out {
                published = outputs.publish(output, clock);
            }
        });
        published?;
        self.obey_stop(arrival.as_ref(), clock)?;
        let withheld = self.commands.withheld();
        let is_tick = arrival.is_some() || withheld != self.withheld;
        self.withheld = withheld;
        let Self { plant, outputs, .. } = self;
        if let Some((header, command)) = arrival {
            self.health.count_input();
            plant.receive(now, header, command, self.commands.lost());
        }
        if is_tick {
            // Truth at the daemon's tick, for the evaluation of the flight.
            outputs.publish(PlantOutput::Truth(plant.truth()), clock)?;
        }
        Ok(())
    }
}
