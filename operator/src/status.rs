//! Observation of the status of a running instance.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::obeying::ObeyingProcess;
use oqtal_bus::time::Time;
use oqtal_bus::topic::Role;
use oqtal_observe::instance::InstanceModel;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::status::{InstanceStatus, ProcessHealth};
use oqtal_runtime::health::SILENCE;

/// Observes the instance until every process that has a place in it was received or counts as silent.
///
/// # Errors
/// A process has another version of the messages.
pub fn observe(bus: &Bus) -> Result<InstanceStatus, BusError> {
    let mut observer = BusObserver::open(bus, &InstanceModel::status_topics())?;
    let mut model = InstanceModel::new(Time::now(), SILENCE);
    let deadline = Time::now() + SILENCE;
    let holders = Role::PROCESSES.map(|role| bus.holder(&role.health()));
    let held = Role::PROCESSES.into_iter().zip(&holders);
    let running: Vec<_> =
        held.filter(|(_, holder)| matches!(holder, Ok(Some(_)))).map(|(role, _)| role).collect();
    while !model.is_complete(&running) && Time::now() < deadline {
        observer.poll(Time::now(), &mut model)?;
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut status = model.status(Time::now());
    for (holder, process) in holders.into_iter().zip(&mut status.processes) {
        process.note_holder(holder?);
    }
    if has_lost_process(bus, &status) {
        // Files of the instance were removed: its other processes may run as well.
        status.processes.retain(ProcessHealth::is_seen);
    }
    Ok(status)
}

/// Whether a process of the vehicle or a daemon runs that was not seen on the bus.
fn has_lost_process(bus: &Bus, status: &InstanceStatus) -> bool {
    let is_seen = |role: Role| {
        status.processes.iter().any(|process| process.name == role.name() && process.is_seen())
    };
    ObeyingProcess::all().iter().any(|process| {
        let roles =
            if process.is_vehicle { &[Role::Plant, Role::Bridge][..] } else { &[Role::Daemon] };
        let is_here =
            process.is_of_instance(&bus.paths().instance) && process.is_under(bus.paths());
        is_here && !roles.iter().any(|role| is_seen(*role))
    })
}
