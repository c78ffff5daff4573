//! Observation of the status of a running instance.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::obeying::ObeyingProcess;
use oqtal_bus::stop::StopSwitch;
use oqtal_bus::time::Time;
use oqtal_bus::topic::Role;
use oqtal_observe::instance::InstanceModel;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::status::{InstanceStatus, ProcessHealth};
use oqtal_runtime::health::SILENCE;

/// Time between two polls of the instance.
const POLL_PERIOD: Duration = Duration::from_millis(20);

/// Observes the instance until a health message has been received from every process that holds a place, and every running vehicle
/// process and daemon holds a place; at most for [`SILENCE`].
///
/// # Errors
/// A process has another version of the messages.
pub fn observe(bus: &Bus) -> Result<InstanceStatus, BusError> {
    let mut observer = BusObserver::open(bus, &InstanceModel::status_topics())?;
    let mut model = InstanceModel::new(Time::now(), SILENCE);
    let deadline = Time::now() + SILENCE;
    loop {
        observer.poll(Time::now(), &mut model)?;
        let mut status = model.status(Time::now());
        let mut running = Vec::new();
        for (role, process) in Role::PROCESSES.into_iter().zip(&mut status.processes) {
            let holder = bus.holder(&role.health())?;
            if holder.is_some() {
                running.push(role);
            }
            process.note_holder(holder);
        }
        let is_over = Time::now() > deadline;
        if is_over || model.is_complete(&running) {
            // A process without a place is starting, or files of the instance were removed: others may run as well.
            let lacks_process = lacks_process(bus, &status);
            if is_over && lacks_process {
                status.processes.retain(ProcessHealth::is_seen);
            }
            if is_over || !lacks_process {
                let stop = StopSwitch::existing(bus.paths())?;
                status.daemon_config = bus.paths().config();
                status.awaits_stop = stop.is_some_and(|stop| stop.awaits_vehicle());
                return Ok(status);
            }
        }
        std::thread::sleep(POLL_PERIOD);
    }
}

/// Whether a process of the vehicle or a daemon runs that was not seen on the bus.
fn lacks_process(bus: &Bus, status: &InstanceStatus) -> bool {
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
