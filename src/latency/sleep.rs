//! Sleeping until an instant, and a loop that only sleeps.

use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};
use rustix::io::Errno;
use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;

use super::bare::directory;
use super::record::Record;

/// File of the record of [`run`].
pub const RECORD: &str = "periodic.record";
/// Period of the loop: the default of cyclictest.
const PERIOD: Span = Span::from_millis(1);

/// Sleeps until `at`, also if signals arrive.
///
/// # Errors
/// The kernel refuses.
pub fn sleep_until(at: Time) -> rustix::io::Result<()> {
    let nanos = at.nanos();
    let request = Timespec {
        tv_sec: (nanos / 1_000_000_000).cast_signed(),
        tv_nsec: (nanos % 1_000_000_000).cast_signed(),
    };
    loop {
        match clock_nanosleep_absolute(ClockId::Boottime, &request) {
            Err(Errno::INTR) => {}
            result => return result,
        }
    }
}

/// Wakes every millisecond and saves the lateness of each wake-up. Returns when a stop is requested.
///
/// # Errors
/// The kernel refuses.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let mut lateness = Record::with_room();
    context.enter_realtime_as(Role::Daemon);
    let mut next = Time::now() + PERIOD;
    while !context.stop.is_set() {
        sleep_until(next)
            .map_err(|e| Failure::new(Exit::System, format!("sleeping failed: {e}")))?;
        let now = Time::now();
        lateness.add(next, now);
        // Overslept periods are left out, as in cyclictest.
        while next <= now {
            next = next + PERIOD;
        }
    }
    lateness.save(&directory(&context.config.instance.name).join(RECORD))
}
