//! The vehicle's clock, from exchanges of TIMESYNC: offset and rate against ours.
//!
//! A simulated autopilot's clock may run a percent slow, so that no single offset maps its stamps: the filter fits a line through the
//! exchanges of the last seconds that took least time, and forgets the others. An exchange that took long says little: its answer
//! may have waited on either way.

/// Exchanges that are kept \[-\].
const KEPT: usize = 32;
/// An exchange counts that took at most so much longer than the shortest kept \[ns\].
const SLACK_NS: i64 = 1_500_000;
/// Longest exchange that is kept \[ns\].
const LONGEST_NS: i64 = 50_000_000;
/// Oldest exchange that counts \[ns\].
const OLDEST_NS: i64 = 10_000_000_000;
/// Least number of exchanges for an estimate \[-\].
const LEAST: usize = 3;
/// Greatest deviation of the clock's rate that is believed \[-\].
const GREATEST_SKEW: f64 = 0.05;
/// Jump of the offset above which the clock was set, or the vehicle restarted \[ns\].
const JUMP_NS: i64 = 500_000_000;

/// One exchange.
#[derive(Clone, Copy, Debug, Default)]
struct Exchange {
    /// Our clock half-way through it \[ns\].
    local: i64,
    /// The vehicle's clock minus ours \[ns\].
    offset: i64,
    took: i64,
}

/// The vehicle's clock as it is known: `remote = local + offset + skew (local - reference)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockEstimate {
    reference: i64,
    offset: f64,
    skew: f64,
}

impl ClockEstimate {
    /// Our clock \[ns\] when the vehicle's showed `remote` \[ns\].
    #[must_use]
    pub fn local(&self, remote: i64) -> i64 {
        let ahead = (remote - self.reference) as f64 - self.offset;
        self.reference + (ahead / (1.0 + self.skew)) as i64
    }

    /// The vehicle's clock \[ns\] when ours shows `local` \[ns\].
    #[must_use]
    pub fn remote(&self, local: i64) -> i64 {
        let since = (local - self.reference) as f64;
        local + (self.offset + self.skew * since) as i64
    }

    /// By how much the vehicle's clock runs fast \[-\].
    #[must_use]
    pub fn skew(&self) -> f64 {
        self.skew
    }
}

/// Filter of exchanges.
#[derive(Clone, Debug, Default)]
pub struct TimesyncFilter {
    kept: [Exchange; KEPT],
    count: usize,
    next: usize,
}

impl TimesyncFilter {
    /// Takes an exchange: a request sent at `sent`, answered with `remote`, the answer received at `received` \[ns\].
    pub fn add(&mut self, sent: i64, remote: i64, received: i64) {
        let took = received.saturating_sub(sent);
        if !(0..=LONGEST_NS).contains(&took) {
            return;
        }
        let local = sent + took / 2;
        let exchange = Exchange { local, offset: remote.saturating_sub(local), took };
        let jumped = self.newest().is_some_and(|newest| {
            exchange.offset.saturating_sub(newest.offset).saturating_abs() > JUMP_NS
        });
        if jumped {
            *self = Self::default();
        }
        self.kept[self.next] = exchange;
        self.next = (self.next + 1) % KEPT;
        self.count = (self.count + 1).min(KEPT);
    }

    /// The clock as the exchanges show it; `None` before there are some.
    #[must_use]
    pub fn estimate(&self) -> Option<ClockEstimate> {
        let reference = self.newest()?.local;
        let recent = || {
            self.kept[..self.count].iter().filter(move |kept| reference - kept.local <= OLDEST_NS)
        };
        let shortest = recent().map(|kept| kept.took).min()?;
        let good = || recent().filter(move |kept| kept.took <= shortest + SLACK_NS);
        let count = good().count();
        if count < LEAST {
            return None;
        }
        let mean = |of: fn(&Exchange, i64) -> f64| {
            good().map(|kept| of(kept, reference)).sum::<f64>() / count as f64
        };
        let time = mean(|kept, reference| (kept.local - reference) as f64);
        let offset = mean(|kept, _| kept.offset as f64);
        let products = good().map(|kept| {
            let since = (kept.local - reference) as f64 - time;
            (since * (kept.offset as f64 - offset), since * since)
        });
        let (covariance, variance) =
            products.fold((0.0, 0.0), |(c, v), (product, square)| (c + product, v + square));
        let skew = if variance > 0.0 { covariance / variance } else { 0.0 };
        let skew = if skew.abs() <= GREATEST_SKEW { skew } else { 0.0 };
        Some(ClockEstimate { reference, offset: offset - skew * time, skew })
    }

    /// Forgets everything: another vehicle may answer.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    fn newest(&self) -> Option<&Exchange> {
        let newest = (self.next + KEPT - 1) % KEPT;
        self.kept.get(newest).filter(|_| self.count > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;
    const START: i64 = 7_000_000_000_000;

    /// The clock of a vehicle that was switched on 20 s before `START` and runs `skew` fast.
    fn vehicle(local: i64, skew: f64) -> i64 {
        20_000 * MS + ((local - START) as f64 * (1.0 + skew)) as i64
    }

    fn filled(skew: f64, delay: impl Fn(i64) -> (i64, i64)) -> TimesyncFilter {
        let mut filter = TimesyncFilter::default();
        for index in 0..60 {
            let sent = START + index * 125 * MS;
            let (up, down) = delay(index);
            filter.add(sent, vehicle(sent + up, skew), sent + up + down);
        }
        filter
    }

    #[test]
    fn a_clock_that_runs_seven_per_mille_slow_is_mapped_to_a_millisecond() {
        let filter = filled(-0.007, |index| (MS / 2, MS / 2 + (index % 5) * 4 * MS));
        let clock = filter.estimate().unwrap();
        assert!((clock.skew() + 0.007).abs() < 2e-4, "{clock:?}");
        for later in [0, 100, 300] {
            let local = START + (60 * 125 + later) * MS;
            assert!((clock.local(vehicle(local, -0.007)) - local).abs() < MS, "{later} ms later");
            assert!((clock.remote(local) - vehicle(local, -0.007)).abs() < MS);
        }
    }

    #[test]
    fn few_or_slow_exchanges_say_nothing_and_a_restarted_vehicle_is_learned_anew() {
        let mut filter = TimesyncFilter::default();
        filter.add(START, 5, START + MS);
        filter.add(START + 1, 6, START + MS);
        assert!(filter.estimate().is_none());
        filter.add(START, 5, START + 60 * MS);
        filter.add(START, 5, START - MS);
        assert!(filter.estimate().is_none());
        let mut filter = filled(0.0, |_| (MS, MS));
        filter.add(START + 10_000 * MS, 0, START + 10_001 * MS);
        assert!(filter.estimate().is_none());
    }
}
