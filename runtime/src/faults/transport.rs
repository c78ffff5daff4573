//! A transport whose readers inject faults.

use std::rc::Rc;

use oqtal_bus::error::BusError;
use oqtal_bus::message::Message;
use oqtal_bus::stop::StopSwitch;
use oqtal_bus::topic::{COMMAND, POSE, Topic, VEHICLE};
use oqtal_bus::transport::Transport;
use oqtal_config::{ClockKind, Config, Fault, FaultKind, FaultTarget};

use super::clock::FaultClock;
use super::reader::{FaultyReader, Injector};
use super::turn::FaultyTurn;

/// The transport of one process with the faults of its configuration.
#[derive(Debug)]
pub struct FaultyTransport<T: Transport> {
    bus: Rc<T>,
    /// Faults, if there are any.
    faults: Option<Faults<T>>,
}

#[derive(Debug)]
struct Faults<T: Transport> {
    clock: Rc<FaultClock<T>>,
    all: Vec<Fault>,
    seed: u64,
    is_virtual: bool,
}

impl<T: Transport> FaultyTransport<T> {
    /// The ports of `bus` with the faults of `config`.
    ///
    /// # Errors
    /// The transport failed.
    pub fn new(bus: &Rc<T>, config: &Config) -> Result<Self, BusError> {
        let options = &config.fault;
        // A bridge reports a vehicle as real, also an emulated one or a firmware executed as a program.
        let any_vehicle = options.with_real_vehicle || config.plant.is_simulated_behind_bridge();
        let faults = match options.inject.is_empty() {
            true => None,
            false => Some(Faults {
                clock: Rc::new(FaultClock::open(bus.as_ref(), any_vehicle)?),
                all: options.inject.clone(),
                seed: config.clock.seed,
                is_virtual: config.clock.kind != ClockKind::Real,
            }),
        };
        Ok(Self { bus: Rc::clone(bus), faults })
    }

    /// Wraps `turn` of the process `target`, whose ports were opened here.
    pub fn turn<R>(&self, target: FaultTarget, turn: R) -> FaultyTurn<T, R> {
        let Some(faults) = &self.faults else { return FaultyTurn::new(turn, None, Vec::new()) };
        // In virtual time the scheduler delays the turns of a slow process.
        let of_process = faults.all.iter().filter(|f| f.target == target && !faults.is_virtual);
        FaultyTurn::new(turn, Some(Rc::clone(&faults.clock)), of_process.cloned().collect())
    }
}

impl<T: Transport + std::fmt::Debug> Transport for FaultyTransport<T> {
    type Writer<M: Message> = T::Writer<M>;
    type Reader<M: Message> = FaultyReader<T, M>;

    fn writer<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Writer<M>, BusError> {
        self.bus.writer(topic)
    }

    fn reader<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Reader<M>, BusError> {
        let injector = self.faults.as_ref().and_then(|faults| {
            let target = target_of(topic.name)?;
            let all = faults.all.iter().enumerate();
            let own: Vec<_> = all.filter(|(_, fault)| fault.target == target).collect();
            (!own.is_empty()).then(|| Injector::new(&faults.clock, &own, faults.seed))
        });
        Ok(FaultyReader { inner: self.bus.reader(topic)?, injector })
    }

    fn alters<M: Message>(&self, topic: &Topic<M>) -> bool {
        let target = target_of(topic.name);
        let mut all = self.faults.iter().flat_map(|faults| &faults.all);
        all.any(|fault| Some(fault.target) == target && is_altering(fault.kind))
    }

    /// Operator's stop, which is never faulted.
    fn stop_switch(&self) -> Result<StopSwitch, BusError> {
        self.bus.stop_switch()
    }

    /// Observer, which receives the messages as sent.
    fn observer<M: Message>(&self, topic: &Topic<M>) -> Result<Self::Reader<M>, BusError> {
        Ok(FaultyReader { inner: self.bus.observer(topic)?, injector: None })
    }
}

/// Whether a fault changes the content of messages, not only their arrival.
fn is_altering(kind: FaultKind) -> bool {
    use FaultKind::{Drift, FrozenNoise, Garbage, Mirror, Noise, Rotate, Stuck, Wrong};
    matches!(kind, Stuck | Garbage | Wrong | FrozenNoise | Noise | Drift | Mirror | Rotate)
}

/// Target whose faults the reader of a topic injects.
fn target_of(topic: &str) -> Option<FaultTarget> {
    let targets = [
        (POSE.name, FaultTarget::Pose),
        (COMMAND.name, FaultTarget::Command),
        (VEHICLE.name, FaultTarget::Vehicle),
    ];
    targets.iter().find(|(name, _)| *name == topic).map(|(_, target)| *target)
}
