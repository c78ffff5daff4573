//! The protocol of the stop words, wherever the words are. `bus/loom` executes every interleaving of this file.

use crate::atomic::{AtomicU32, Ordering};

/// Number of stops raised so far.
const RAISED: usize = 0;
/// Newest stop lifted by the vehicle's process.
const LIFTED: usize = 1;
/// Newest stop obeyed by the vehicle's process: no command of the daemon reaches the motors.
const OBEYED: usize = 2;
/// Newest stop for which the motors are known to be off.
const MOTORS_OFF: usize = 3;
/// Newest stop obeyed by the daemon: it commands "disarmed".
const DAEMON: usize = 4;
/// Newest stop that is withheld from the motors, because another has control of the vehicle. Equal to [`LIFTED`] once the stop in force
/// reaches them.
const WITHHELD: usize = 5;
/// Number of words.
pub(crate) const WORDS: usize = 6;

/// Confirmations of a stop by the processes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StopReport {
    /// The process of the vehicle does not pass commands to the motors.
    pub vehicle_obeys: bool,
    /// The vehicle's motors are known to be off.
    pub motors_off: bool,
    /// The daemon commands "disarmed".
    pub daemon_obeys: bool,
    /// A pilot or the vehicle itself has control: the stop does not reach the motors.
    pub another_has_control: bool,
}

/// Raises a stop and returns its number.
pub(crate) fn raise(words: &[AtomicU32]) -> u32 {
    words[RAISED].fetch_add(1, Ordering::AcqRel).wrapping_add(1)
}

/// Number of stops raised so far.
fn raised(words: &[AtomicU32]) -> u32 {
    words[RAISED].load(Ordering::Acquire)
}

/// Processes that obey the stop `number` or a later one. A confirmed number above that of the newest stop does not count: the words were
/// overwritten.
pub(crate) fn report(words: &[AtomicU32], number: u32) -> StopReport {
    let reached = |word: usize| {
        let newest = words[word].load(Ordering::Acquire);
        !is_before(newest, number) && !is_before(raised(words), newest)
    };
    let is_lifted = !is_before(words[LIFTED].load(Ordering::Acquire), number);
    let another_has_control = reached(WITHHELD) && !is_lifted;
    StopReport {
        vehicle_obeys: reached(OBEYED) && !another_has_control,
        motors_off: reached(MOTORS_OFF),
        daemon_obeys: reached(DAEMON),
        another_has_control,
    }
}

/// Whether a stop is in force that the vehicle's process does not obey yet.
pub(crate) fn awaits_vehicle(words: &[AtomicU32]) -> bool {
    let newest = raised(words);
    newest != words[LIFTED].load(Ordering::Acquire) && !report(words, newest).vehicle_obeys
}

/// Confirms that the vehicle's process obeys the stop `number`, and whether the motors are known to be off.
pub(crate) fn confirm(words: &[AtomicU32], number: u32, motors_off: bool) {
    words[WITHHELD].store(words[LIFTED].load(Ordering::Acquire), Ordering::Release);
    words[OBEYED].store(number, Ordering::Release);
    if motors_off {
        words[MOTORS_OFF].store(number, Ordering::Release);
    }
}

/// Records that the stop `number` does not reach the motors: another has control of the vehicle.
pub(crate) fn withhold(words: &[AtomicU32], number: u32) {
    words[WITHHELD].store(number, Ordering::Release);
}

/// Ends the stop `number`. A stop that was raised after it stays in force.
pub(crate) fn lift(words: &[AtomicU32], number: u32) {
    words[LIFTED].store(number, Ordering::Release);
}

/// Stop words as the vehicle's process reads them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VehicleView {
    /// Number of stops raised, when it was last read.
    raised: u32,
}

impl VehicleView {
    /// View of a process that starts: a stop that was not lifted is in force.
    pub(crate) fn new(words: &[AtomicU32]) -> Self {
        Self { raised: words[RAISED].load(Ordering::Acquire) }
    }

    /// Number of the stop in force.
    pub(crate) fn in_force(&mut self, words: &[AtomicU32]) -> Option<u32> {
        if is_before(words[RAISED].load(Ordering::Acquire), self.raised) {
            // The file of the words was shortened: a stop may have been in force.
            raise(words);
        }
        self.raised = words[RAISED].load(Ordering::Acquire);
        (self.raised != words[LIFTED].load(Ordering::Acquire)).then_some(self.raised)
    }
}

/// Stop words as the daemon reads them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DaemonView {
    seen: u32,
}

impl DaemonView {
    /// View of a daemon that starts: a stop that was not lifted by the vehicle counts as new.
    pub(crate) fn new(words: &[AtomicU32]) -> Self {
        Self { seen: words[LIFTED].load(Ordering::Acquire) }
    }

    /// Whether a stop was raised since the last call.
    pub(crate) fn is_newly_raised(&mut self, words: &[AtomicU32]) -> bool {
        let raised = words[RAISED].load(Ordering::Acquire);
        std::mem::replace(&mut self.seen, raised) != raised
    }

    /// Confirms that "disarmed" was commanded after the newest seen stop.
    pub(crate) fn confirm(&self, words: &[AtomicU32]) {
        words[DAEMON].store(self.seen, Ordering::Release);
    }
}

/// Whether the stop `number` was raised before the stop `other`. Numbers wrap around: the later of two numbers is less than half of
/// all numbers ahead.
fn is_before(number: u32, other: u32) -> bool {
    number.wrapping_sub(other) >= u32::MAX / 2
}
