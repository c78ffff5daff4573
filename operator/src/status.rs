//! Observation of the status of a running instance.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::time::Time;
use oqtal_bus::topic::Role;
use oqtal_observe::instance::InstanceModel;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::status::InstanceStatus;
use oqtal_runtime::health::SILENCE;

/// Observes the instance until every process was received or counts as silent.
///
/// # Errors
/// A process has another version of the messages.
pub fn observe(bus: &Bus) -> Result<InstanceStatus, BusError> {
    let mut observer = BusObserver::open(bus, &InstanceModel::status_topics())?;
    let mut model = InstanceModel::new(Time::now(), SILENCE);
    let deadline = Time::now() + SILENCE;
    while !model.is_complete() && Time::now() < deadline {
        observer.poll(Time::now(), &mut model)?;
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut status = model.status(Time::now());
    for (role, process) in Role::PROCESSES.into_iter().zip(&mut status.processes) {
        process.note_holder(bus.holder(&role.health())?);
    }
    Ok(status)
}
