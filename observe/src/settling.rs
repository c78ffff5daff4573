//! Settling of an error after the steps of a reference.

use oqtal_control::metrics::Statistics;
use serde::Serialize;

/// Settling after the steps of a reference in the scored window. A step settles if the error stays below a limit until the next one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct StepSettling {
    /// Number of steps \[-\].
    pub count: u64,
    /// Number of steps that settle \[-\].
    pub settled: u64,
    /// Mean time from a step that settles to the last error above the limit \[s\]; NaN if none settles.
    pub settle_s: f64,
    /// Lower bound of the mean settling time \[s\]: a step that does not settle counts with the time until the next one.
    #[serde(skip)]
    pub least_settle_s: f64,
}

impl StepSettling {
    /// Of steps, each with the time from it to the last error above the limit \[s\], and whether it settles; `None` without steps.
    pub(crate) fn of(steps: impl IntoIterator<Item = (f64, bool)>) -> Option<Self> {
        let (mut settle, mut least) = (Statistics::default(), Statistics::default());
        for (after_s, is_settled) in steps {
            least.add(after_s);
            if is_settled {
                settle.add(after_s);
            }
        }
        (least.count() > 0).then(|| Self {
            count: least.count(),
            settled: settle.count(),
            settle_s: if settle.count() > 0 { settle.mean() } else { f64::NAN },
            least_settle_s: least.mean(),
        })
    }

    /// Mean settling time \[s\]; infinite if a step does not settle.
    pub fn of_all_s(&self) -> f64 {
        if self.settled == self.count { self.settle_s } else { f64::INFINITY }
    }

    /// The settling time to within `limit` as text; if not every step settled, how many did.
    pub(crate) fn text(&self, limit: &str) -> String {
        match self.settled {
            0 => format!("none within {limit} before the next"),
            all if all == self.count => format!("within {limit} after {:.2} s", self.settle_s),
            some => format!("{some} within {limit}, after {:.2} s", self.settle_s),
        }
    }
}
