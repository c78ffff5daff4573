//! Status of a running instance, for `oqtal ctl status`.

use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::time::Time;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::status::{InstanceStatus, StatusMonitor};
use oqtal_runtime::health::SILENCE;

/// Observes the instance until every process was received, or must be silent.
///
/// # Errors
/// A process speaks another version.
pub fn observe(bus: &Bus) -> Result<InstanceStatus, BusError> {
    let mut observer = BusObserver::open(bus, &StatusMonitor::TOPICS)?;
    let mut monitor = StatusMonitor::new(SILENCE);
    let deadline = Time::now() + SILENCE;
    while !monitor.is_complete() && Time::now() < deadline {
        observer.poll(Time::now(), &mut monitor)?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(monitor.status(Time::now()))
}
