//! Settling of an error after the steps of a reference.

use oqtal_bus::time::Time;
use oqtal_control::metrics::Statistics;
use serde::Serialize;

/// Time by which the scored window may end before its planned end \[s\]: some ticks.
pub(crate) const CUT_OFF_S: f64 = 0.1;

/// Settling after the steps of a reference in the scored window. A step settles if the error stays below a limit until the next one.
/// A step that has not settled when its flight ends before the trajectory is cut off and not evaluated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StepSettling {
    /// Number of steps that are evaluated \[-\].
    pub count: u64,
    /// Number of steps that settle \[-\].
    pub settled: u64,
    /// Number of steps that were cut off \[-\].
    pub cut_off: u64,
    /// Mean time from a step that settles until its error stays within the limit \[s\]; NaN if none settles.
    pub settle_s: f64,
    /// Lower bound of the mean settling time \[s\]: a step that does not settle counts with the time until the next one, one
    /// that was cut off with the time until then.
    #[serde(skip)]
    pub least_settle_s: f64,
}

impl StepSettling {
    /// Evaluates steps. Each has the time from the step until its error stays within the limit, or until its last tick \[s\], and its end.
    /// `None` without steps.
    pub(crate) fn of(steps: impl IntoIterator<Item = (f64, StepEnd)>) -> Option<Self> {
        let (mut settle, mut least) = (Statistics::default(), Statistics::default());
        let mut cut_off = 0;
        for (after_s, end) in steps {
            least.add(after_s);
            match end {
                StepEnd::Settled => settle.add(after_s),
                StepEnd::CutOff => cut_off += 1,
                StepEnd::Unsettled => {}
            }
        }
        (least.count() > 0).then(|| Self {
            count: least.count() - cut_off,
            settled: settle.count(),
            cut_off,
            settle_s: mean(&settle),
            least_settle_s: least.mean(),
        })
    }

    /// Mean settling time \[s\]; infinite if a step does not settle, NaN if every step was cut off.
    pub fn of_all_s(&self) -> f64 {
        if self.settled == self.count { self.settle_s } else { f64::INFINITY }
    }

    /// The settling time to within `limit` as text; if not every step settled, how many did.
    pub(crate) fn text(&self, limit: &str) -> String {
        let settled = match self.settled {
            0 if self.count == 0 => String::new(),
            0 => format!("none within {limit} before the next"),
            all if all == self.count => format!("within {limit} after {:.2} s", self.settle_s),
            some => {
                format!("{some} of {} within {limit}, after {:.2} s", self.count, self.settle_s)
            }
        };
        let comma = if settled.is_empty() { "" } else { ", " };
        match self.cut_off {
            0 => settled,
            cut_off => format!("{settled}{comma}{cut_off} cut off by the end of the flight"),
        }
    }
}

/// Index of the first of `errors`, with their instants, from which on the error stays within `limit`, and the time until it does
/// \[s\]; the number of errors, and the time of the last, if it does not. The error is linear between two ticks: the time does not
/// depend on the rate of the loop.
pub(crate) fn settled(errors: &[(Time, f64)], limit: f64) -> (usize, f64) {
    let Some(last) = errors.iter().rposition(|(_, error)| *error > limit) else { return (0, 0.0) };
    let (from, outside) = errors[last];
    let since_s = from.since(errors[0].0).seconds();
    let rest_s = errors.get(last + 1).map_or(0.0, |(to, inside)| {
        to.since(from).seconds() * (outside - limit) / (outside - inside)
    });
    (last + 1, since_s + rest_s)
}

/// Mean of the values; NaN without a value.
pub(crate) fn mean(values: &Statistics) -> f64 {
    if values.count() > 0 { values.mean() } else { f64::NAN }
}

/// End of the time in which a step can settle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StepEnd {
    /// The error stayed below the limit until the next step, or the end of the trajectory.
    Settled,
    /// The error did not stay below the limit until then.
    Unsettled,
    /// The flight ended before the trajectory, and the error had not stayed below the limit.
    CutOff,
}

impl StepEnd {
    /// The end of a step that `has_settled`, or after which its flight `ends_early`.
    pub(crate) fn of(has_settled: bool, ends_early: bool) -> Self {
        match has_settled {
            true => Self::Settled,
            false if ends_early => Self::CutOff,
            false => Self::Unsettled,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::settled;
    use oqtal_bus::time::{Span, Time};

    #[test]
    fn the_settling_time_does_not_depend_on_the_rate_of_the_loop() {
        for rate_hz in [30.0, 60.0, 120.0, 500.0] {
            let error = |tick: u32| {
                let t_s = f64::from(tick) / rate_hz;
                (Time::VIRTUAL_START + Span::from_seconds(t_s), 10.0 - 20.0 * t_s)
            };
            let errors: Vec<_> = (0..rate_hz as u32).map(error).collect();
            let (first, after_s) = settled(&errors, 3.3);
            assert!((after_s - 0.335).abs() < 1e-6, "{rate_hz} Hz: {after_s}");
            assert!(errors[first].1 <= 3.3 && errors[first - 1].1 > 3.3);
            let (none, until_s) = settled(&errors, -20.0);
            assert_eq!(none, errors.len());
            assert!((until_s - (1.0 - 1.0 / rate_hz)).abs() < 1e-6);
            assert_eq!(settled(&errors, 10.0), (0, 0.0));
        }
    }
}
