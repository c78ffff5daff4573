//! `[realtime]`: how the operating system runs the loops.

use serde::{Deserialize, Serialize};

use crate::{Violation, positive};

/// Highest priority a loop may have: what watches over it, and the kernel's own threads, stay above.
const MAX_PRIORITY: u8 = 80;
/// More CPUs than this no set of CPUs can name.
const MAX_CPU: usize = 1023;

/// A warmup earlier than this is forgotten again when the pose comes \[us\].
const LONGEST_LEAD_US: f64 = 5000.0;

/// How a loop is scheduled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheduling {
    /// SCHED_FIFO: runs until it sleeps.
    Fifo,
    /// SCHED_OTHER, like any program.
    Other,
}

/// `[realtime]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Realtime {
    /// How the loops are scheduled.
    pub scheduling: Scheduling,
    /// Priority under SCHED_FIFO, 1 to 80.
    pub priority: u8,
    /// CPUs that the loops may run on; empty for all.
    pub cpus: Vec<usize>,
    /// Whether all memory stays in RAM.
    pub lock_memory: bool,
    /// How much later than asked the kernel may wake a loop that is not under SCHED_FIFO \[us\].
    pub timer_slack_us: f64,
    /// So long before the next pose is expected the daemon runs a turn on a copy of itself, to have it in the caches; 0 for
    /// never \[us\].
    pub rehearsal_us: f64,
}

impl Realtime {
    pub(crate) fn check(&self) -> Result<(), Violation> {
        if !(1..=MAX_PRIORITY).contains(&self.priority) {
            let rule = format!("must lie between 1 and {MAX_PRIORITY}, is {}", self.priority);
            return Err(Violation::new("realtime.priority", rule));
        }
        if let Some(cpu) = self.cpus.iter().find(|&&cpu| cpu > MAX_CPU) {
            let rule = format!("names CPU {cpu}, it must be at most {MAX_CPU}");
            return Err(Violation::new("realtime.cpus", rule));
        }
        if !(0.0..=LONGEST_LEAD_US).contains(&self.rehearsal_us) {
            let rule =
                format!("must lie between 0 and {LONGEST_LEAD_US}, is {}", self.rehearsal_us);
            return Err(Violation::new("realtime.warmup-us", rule));
        }
        positive("realtime.timer-slack-us", self.timer_slack_us)
    }
}
