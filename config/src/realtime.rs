//! `[realtime]`: scheduling, memory and wake-up of the loops.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// Highest priority of the daemon under SCHED_FIFO: the bridge has one more; watchdogs and the kernel's own threads are above both.
const MAX_PRIORITY: u8 = 79;
/// Lowest priority of the daemon: cameras and simulator are one and two below it.
const MIN_PRIORITY: u8 = 3;
/// Highest CPU number in the kernel's CPU set.
const MAX_CPU: usize = 1023;

const PRIORITIES: Rule = Rule::Between(MIN_PRIORITY as f64, MAX_PRIORITY as f64);

/// Longest time between cache warm-up and pose \[us\]; after it the caches are cold again.
const MAX_WARMUP_US: f64 = 5000.0;

/// Longest time that a loop waits awake after an expected arrival \[us\].
const MAX_AWAKE_US: f64 = 1000.0;

/// Scheduling of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheduling {
    /// SCHED_FIFO: the loop runs until it sleeps.
    Fifo,
    /// SCHED_OTHER, the scheduling of ordinary programs.
    Other,
}

/// `[realtime]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RealtimeOptions {
    /// Scheduling of the loops.
    pub scheduling: Scheduling,
    /// Priority of the daemon under SCHED_FIFO, 3 to 79; the bridge has one more, the cameras one less, the simulator two less.
    pub priority: u8,
    /// Numbers of the CPUs on which the loops may run; empty for all.
    pub cpus: Vec<usize>,
    /// Whether all memory of a process is locked in RAM.
    pub lock_memory: bool,
    /// Timer slack: greatest delay of a wake-up that the kernel may add to a loop that is not under SCHED_FIFO \[us\].
    pub timer_slack_us: f64,
    /// Time before each expected pose at which the daemon warms its caches by executing a tick on a copy of its state \[us\]; 0 disables
    /// the warm-up.
    pub warmup_us: f64,
    /// Time after each expected arrival until which a loop waits awake, from the instant of the warm-up on, if there are enough
    /// processors \[us\]; 0 for never.
    pub awake_us: f64,
}

impl RealtimeOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        let table = [
            ("priority", f64::from(self.priority), PRIORITIES),
            ("warmup-us", self.warmup_us, Rule::Between(0.0, MAX_WARMUP_US)),
            ("awake-us", self.awake_us, Rule::Between(0.0, MAX_AWAKE_US)),
            ("timer-slack-us", self.timer_slack_us, Rule::Positive),
        ];
        check_options(table).map_err(|error| error.within("realtime"))?;
        match self.cpus.iter().find(|&&cpu| cpu > MAX_CPU) {
            None => Ok(()),
            Some(cpu) => {
                let allowed = format!("a list of CPUs from 0 to {MAX_CPU}");
                let value = format_args!("a list with CPU {cpu}");
                Err(OptionError::new("realtime.cpus", value, allowed))
            }
        }
    }
}
