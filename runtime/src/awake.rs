//! Busy polling for an expected arrival. A sleeping process takes some tens of microseconds to wake; a polling one detects the arrival at
//! once, at the cost of processor time.

use std::thread::available_parallelism;

use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_config::Config;

/// Roles that wait awake, the one that gains most first: each needs a processor beside those of the roles before it, and two remain
/// free for the others.
const ROLES: [Role; 3] = [Role::Daemon, Role::Receiver, Role::Bridge];

/// Interval around each expected arrival in which a loop waits awake. Poses are expected at the rate of the cameras, commands at that of the
/// loop.
#[derive(Clone, Debug)]
pub struct AwakeInterval {
    /// Time awake before the expected arrival, and after it.
    sides: [Span; 2],
    period: Span,
    expected: Option<Time>,
}

impl AwakeInterval {
    /// The interval of `role`, which `config` sets by `realtime.warmup-us` and `realtime.awake-us`; `None` without the latter, or with
    /// too few processors.
    pub fn of(config: &Config, role: Role) -> Option<Self> {
        let options = &config.realtime;
        if options.awake_us == 0.0 || !may_stay_awake(role, processors(&options.cpus)) {
            return None;
        }
        let sides = [options.warmup_us, options.awake_us].map(|us| Span::from_seconds(us * 1e-6));
        let rate_hz = match role {
            Role::Bridge => config.loop_rate_hz(),
            _ => config.safety.pose_rate_hz,
        };
        Some(Self { sides, period: Span::period_of(rate_hz), expected: None })
    }

    /// Expects the arrival after the one at `now`.
    pub fn expect_after(&mut self, now: Time) {
        self.expected = Some(now + self.period);
    }

    /// Beginning and end of the interval, unless it is over at `now`.
    pub fn bounds(&self, now: Time) -> Option<[Time; 2]> {
        let [before, after] = self.sides;
        let bounds = self.expected.map(|expected| [expected - before, expected + after]);
        bounds.filter(|[_, end]| *end > now)
    }
}

/// Whether the loop of `role` may occupy one of this many processors while it waits.
fn may_stay_awake(role: Role, processors: usize) -> bool {
    ROLES.iter().position(|it| *it == role).is_some_and(|rank| processors > rank + 2)
}

/// Number of processors of the loops, which `realtime.cpus` lists.
fn processors(cpus: &[usize]) -> usize {
    match cpus {
        [] => available_parallelism().map_or(1, usize::from),
        _ => cpus.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_processors_remain_free() {
        let awake = |processors| ROLES.map(|role| may_stay_awake(role, processors));
        assert_eq!(awake(2), [false, false, false]);
        assert_eq!(awake(3), [true, false, false]);
        assert_eq!(awake(4), [true, true, false]);
        assert_eq!(awake(5), [true, true, true]);
        assert!(!may_stay_awake(Role::Plant, 16));
    }

    #[test]
    fn the_interval_begins_with_the_warm_up_and_ends_after_the_budget() {
        let mut config = Config::default();
        assert!(AwakeInterval::of(&config, Role::Daemon).is_none(), "off by default");
        (config.realtime.awake_us, config.realtime.cpus) = (300.0, vec![0, 1, 2]);
        let mut awake = AwakeInterval::of(&config, Role::Daemon).unwrap();
        let now = Time::VIRTUAL_START;
        assert_eq!(awake.bounds(now), None, "no arrival is expected yet");
        awake.expect_after(now);
        let expected = now + Span::period_of(60.0);
        let bounds = [expected - Span::from_nanos(120_000), expected + Span::from_nanos(300_000)];
        assert_eq!(awake.bounds(now), Some(bounds));
        assert_eq!(awake.bounds(bounds[1]), None, "nothing arrived");
    }
}
