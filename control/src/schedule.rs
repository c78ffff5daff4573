//! Gain scheduling by cells (paper, Section II.F.3): a gain is computed for the cell of the
//! operating space the vehicle is in, and again only when it leaves that cell.
//!
//! The schedule is independent of the law: its arguments are the vector that selects the cell and a function from an
//! operating point to a gain.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// Rule that assigns a value to a cell of width `delta`, and the value that represents the cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cells {
    /// `[(n - 1/2) delta, (n + 1/2) delta)`, represented by `n delta`.
    Centred,
    /// `[n delta, (n + 1) delta)`, represented by `n delta`: the rule printed in the paper. Zero is on a border, so
    /// noise alone changes the cell.
    Floor,
    /// Like [`Cells::Floor`], but mirrored for negative values, so that zero is in the middle of a cell of double width. This rule gives
    /// the number of solutions that the paper reports.
    #[default]
    Truncated,
    /// The cell reaches `delta` to either side of the vector at which the last gain was computed, and that vector
    /// represents it. This gives hysteresis: noise does not move the schedule back and forth.
    Deadband,
}

/// When a gain is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Resolve {
    /// When the cell changes.
    #[default]
    OnCellChange,
    /// In every step, at the vector itself instead of the representative of its cell. Not in the paper.
    EveryTick,
}

/// The cells of an operating space of `D` dimensions and when to compute a gain in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellGrid<const D: usize> {
    /// Rule that divides the space.
    pub cells: Cells,
    /// `delta`, the width of a cell in each dimension \[the unit of that dimension\], positive.
    pub widths: SVector<f64, D>,
    /// When a gain is computed.
    pub resolve: Resolve,
}

impl<const D: usize> CellGrid<D> {
    /// The operating point for `x`, if it differs from `current`.
    #[inline]
    fn next(
        &self,
        x: &SVector<f64, D>,
        current: Option<&SVector<f64, D>>,
    ) -> Option<SVector<f64, D>> {
        if self.resolve == Resolve::EveryTick {
            return Some(*x);
        }
        let widths = &self.widths;
        let point = match (self.cells, current) {
            (Cells::Centred, _) => x.zip_map(widths, |xi, delta| (xi / delta).round() * delta),
            // The unnumbered rule of Section II.F.3: n delta <= xi < (n + 1) delta.
            (Cells::Floor, _) => x.zip_map(widths, |xi, delta| (xi / delta).floor() * delta),
            // A cast truncates as `trunc` does, without a function call.
            (Cells::Truncated, _) => {
                x.zip_map(widths, |xi, delta| (xi / delta) as i64 as f64 * delta)
            }
            (Cells::Deadband, Some(centre))
                if (x - centre).iter().zip(widths).all(|(off, delta)| off.abs() <= *delta) =>
            {
                *centre
            }
            (Cells::Deadband, _) => *x,
        };
        (current != Some(&point)).then_some(point)
    }
}

/// A gain that follows the operating point from cell to cell, over an operating space of `D`
/// dimensions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainSchedule<const D: usize, G> {
    grid: CellGrid<D>,
    operating_point: Option<SVector<f64, D>>,
    gain: G,
    solves: u32,
    failed_solves: u32,
}

impl<const D: usize, G: Default> GainSchedule<D, G> {
    /// A schedule without a gain yet; until one is computed, the gain is the default of its type.
    pub fn new(grid: CellGrid<D>) -> Self {
        Self { grid, operating_point: None, gain: G::default(), solves: 0, failed_solves: 0 }
    }

    /// Returns the gain at `x`. Calls `solve` if the operating point changes; if `solve` fails, the last gain is kept
    /// and the next attempt is made at the next operating point. An `x` that is not finite changes nothing.
    #[inline]
    pub fn gain<E>(
        &mut self,
        x: &SVector<f64, D>,
        solve: impl FnOnce(&SVector<f64, D>) -> Result<G, E>,
    ) -> &G {
        let next = self.grid.next(x, self.operating_point.as_ref());
        if let Some(point) = next.filter(|_| x.iter().all(|xi| xi.is_finite())) {
            self.solves = self.solves.saturating_add(1);
            match solve(&point) {
                Ok(gain) => self.gain = gain,
                Err(_) => self.failed_solves = self.failed_solves.saturating_add(1),
            }
            self.operating_point = Some(point);
        }
        &self.gain
    }

    /// Discards the operating point, so that the next step computes a gain. Counters are kept.
    pub fn reset(&mut self) {
        self.operating_point = None;
    }

    /// Number of gains computed, the first one and failures included \[-\].
    pub fn solves(&self) -> u32 {
        self.solves
    }

    /// Number of failed computations of a gain \[-\].
    pub fn failed_solves(&self) -> u32 {
        self.failed_solves
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector1;

    use super::*;

    /// A schedule whose gain is the operating point it was computed at.
    fn schedule(cells: Cells, resolve: Resolve) -> GainSchedule<1, f64> {
        GainSchedule::new(CellGrid { cells, widths: Vector1::new(0.5), resolve })
    }

    fn gain(schedule: &mut GainSchedule<1, f64>, x: f64) -> f64 {
        *schedule.gain(&Vector1::new(x), |point| Ok::<_, ()>(point.x))
    }

    fn gains(cells: Cells, path: &[f64]) -> Vec<f64> {
        let mut schedule = schedule(cells, Resolve::OnCellChange);
        path.iter().map(|x| gain(&mut schedule, *x)).collect()
    }

    #[test]
    fn each_rule_assigns_a_value_to_its_cell() {
        let path = [-0.76, -0.5, -0.01, 0.0, 0.24, 0.26, 0.49, 0.5, 1.2];
        assert_eq!(gains(Cells::Centred, &path), [-1.0, -0.5, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 1.0]);
        assert_eq!(gains(Cells::Floor, &path), [-1.0, -0.5, -0.5, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0]);
        assert_eq!(gains(Cells::Truncated, &path), [-0.5, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0]);
    }

    #[test]
    fn f24_a_deadband_moves_only_when_it_is_left() {
        assert_eq!(
            gains(Cells::Deadband, &[0.3, 0.7, -0.1, 0.9, 0.45, 1.5]),
            [0.3, 0.3, 0.3, 0.9, 0.9, 1.5]
        );
    }

    #[test]
    fn a_gain_is_computed_once_per_stay_in_a_cell() {
        let mut schedule = schedule(Cells::Truncated, Resolve::OnCellChange);
        assert_eq!(schedule.solves(), 0);
        for x in [0.1, -0.4, 0.3, 0.6, 0.9, 0.1] {
            gain(&mut schedule, x);
        }
        assert_eq!((schedule.solves(), schedule.failed_solves()), (3, 0));
        schedule.reset();
        gain(&mut schedule, 0.1);
        assert_eq!(schedule.solves(), 4);
    }

    #[test]
    fn every_tick_computes_the_gain_at_the_vector_itself() {
        let mut schedule = schedule(Cells::Truncated, Resolve::EveryTick);
        assert_eq!([0.1, 0.1, 0.2].map(|x| gain(&mut schedule, x)), [0.1, 0.1, 0.2]);
        assert_eq!(schedule.solves(), 3);
    }

    /// F23
    #[test]
    fn f23_a_failure_keeps_the_last_gain_and_is_not_repeated_in_the_same_cell() {
        let mut schedule = schedule(Cells::Truncated, Resolve::OnCellChange);
        assert_eq!(gain(&mut schedule, 0.6), 0.5);
        for _ in 0..3 {
            assert_eq!(*schedule.gain(&Vector1::new(1.2), |_| Err(())), 0.5);
        }
        assert_eq!((schedule.solves(), schedule.failed_solves()), (2, 1));
        assert_eq!(gain(&mut schedule, 1.6), 1.5);
    }

    #[test]
    fn a_vector_that_is_not_finite_computes_nothing() {
        for resolve in [Resolve::OnCellChange, Resolve::EveryTick] {
            for cells in [Cells::Centred, Cells::Floor, Cells::Truncated, Cells::Deadband] {
                let mut schedule = schedule(cells, resolve);
                gain(&mut schedule, 0.6);
                let before = schedule;
                for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                    gain(&mut schedule, x);
                    assert_eq!(schedule, before);
                }
            }
        }
    }
}
