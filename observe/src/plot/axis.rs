//! Axes: a finite range with ticks at round numbers.

use std::ops::Range;

/// Largest magnitude drawn \[-\]; larger numbers are errors, not measurements, and leave a gap.
const MAX_MAGNITUDE: f64 = 1e9;

/// Whether a plot can show `value`.
pub fn is_drawable(value: f64) -> bool {
    value.abs() <= MAX_MAGNITUDE
}

/// A tick of an axis, with its label.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisTick {
    /// Position \[unit of the axis\].
    pub at: f64,
    /// Label.
    pub label: String,
}

/// One axis of a plot.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Lower and upper end \[unit of the axis\]; never empty.
    pub range: Range<f64>,
    /// Ticks in rising order.
    pub ticks: Vec<AxisTick>,
}

impl Axis {
    /// Linear axis over exactly `range`, with about `count` divisions and `unit` after each number.
    pub fn linear(range: Range<f64>, count: f64, unit: &str) -> Self {
        let range = drawable(range);
        let step = nice_step((range.end - range.start) / count);
        let first = (range.start / step).ceil() as i64;
        let last = (range.end / step).floor() as i64;
        let tick =
            |k: i64| AxisTick { at: k as f64 * step, label: format!("{}{unit}", number(k, step)) };
        Self { ticks: (first..=last).map(tick).collect(), range }
    }

    /// Linear axis that includes all `values`, and zero if they are magnitudes close to it.
    pub fn fitting(values: impl Iterator<Item = f64>) -> Self {
        let Range { start, end } = extent(values);
        let room = 0.07 * (end - start);
        let is_magnitude = start >= 0.0 && start <= 0.5 * end;
        let lower = if is_magnitude { 0.0 } else { start - room };
        Self::linear(lower..end + room, 5.0, "")
    }

    /// Logarithmic axis over the whole decades that include `range`. Its coordinate is the decimal logarithm; `label` formats the
    /// value of a decade.
    pub fn decades(range: Range<f64>, label: impl Fn(i32) -> String) -> Self {
        let first = range.start.floor() as i32;
        let last = (range.end.ceil() as i32).max(first + 1);
        let tick = |decade: i32| AxisTick { at: f64::from(decade), label: label(decade) };
        Self { range: f64::from(first)..f64::from(last), ticks: (first..=last).map(tick).collect() }
    }

    /// Rows of height 1, the first at the top, each with its name.
    pub fn rows<'a>(names: impl ExactSizeIterator<Item = &'a str>) -> Self {
        let count = names.len().max(1);
        let tick = |(row, name): (usize, &str)| AxisTick {
            at: count as f64 - 0.5 - row as f64,
            label: name.to_owned(),
        };
        let mut ticks: Vec<AxisTick> = names.enumerate().map(tick).collect();
        ticks.reverse();
        Self { range: 0.0..count as f64, ticks }
    }
}

/// Smallest range that includes every drawable value.
pub fn extent(values: impl Iterator<Item = f64>) -> Range<f64> {
    let drawable = values.filter(|value| is_drawable(*value));
    let (start, end) = drawable
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(start, end), v| (start.min(v), end.max(v)));
    if start <= end { start..end } else { 0.0..0.0 }
}

/// `range`, widened if it is too narrow to be divided.
fn drawable(range: Range<f64>) -> Range<f64> {
    let (span, middle) = (range.end - range.start, 0.5 * (range.start + range.end));
    if span > 1e-6 * middle.abs() && span > f64::MIN_POSITIVE {
        return range;
    }
    let half = if middle == 0.0 { 1.0 } else { 0.1 * middle.abs() };
    middle - half..middle + half
}

/// Smallest of 1, 2 and 5 times a power of ten that is at least `step`.
fn nice_step(step: f64) -> f64 {
    let decade = 10_f64.powf(step.log10().floor());
    let nice = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * decade);
    nice.into_iter().find(|nice| *nice >= 0.999 * step).unwrap_or(10.0 * decade)
}

/// Text of `k` steps, with as many decimals as a step has.
fn number(k: i64, step: f64) -> String {
    let value = k as f64 * step;
    let decimals = -step.log10().floor();
    if k != 0 && !(-5.0..=5.0).contains(&decimals) {
        return format!("{value:.0e}");
    }
    format!("{value:.*}", decimals.clamp(0.0, 5.0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|tick| tick.label.as_str()).collect()
    }

    #[test]
    fn ticks_lie_where_a_person_would_put_them() {
        assert_eq!(
            labels(&Axis::linear(-0.9..2.1, 6.0, "")),
            ["-0.5", "0.0", "0.5", "1.0", "1.5", "2.0"]
        );
        assert_eq!(
            labels(&Axis::linear(0.0..41.0, 8.0, " s")),
            ["0 s", "10 s", "20 s", "30 s", "40 s"]
        );
        assert_eq!(
            labels(&Axis::decades(-0.3..1.2, |k| format!("1e{k}"))),
            ["1e-1", "1e0", "1e1", "1e2"]
        );
    }

    #[test]
    fn rows_are_read_from_the_top() {
        let axis = Axis::rows(["first", "second"].into_iter());
        assert_eq!(labels(&axis), ["second", "first"]);
        assert_eq!((axis.range, axis.ticks[1].at), (0.0..2.0, 1.5));
    }

    #[test]
    fn magnitudes_start_at_zero_and_positions_do_not() {
        assert_eq!(Axis::fitting([0.1, 3.0].into_iter()).range.start, 0.0);
        assert!(Axis::fitting([-1.0, 3.0].into_iter()).range.start < -1.0);
        assert!(Axis::fitting([11.0, 12.0].into_iter()).range.start > 10.0);
    }

    proptest! {
        #[test]
        fn any_values_make_an_axis_with_few_ticks_inside(values in prop::collection::vec(any::<f64>(), 0..4)) {
            let axis = Axis::fitting(values.into_iter());
            prop_assert!(axis.range.start < axis.range.end && axis.range.end.is_finite());
            prop_assert!((1..=12).contains(&axis.ticks.len()), "{axis:?}");
            let slack = 1e-9 * (axis.range.end - axis.range.start);
            for tick in &axis.ticks {
                prop_assert!(tick.at >= axis.range.start - slack && tick.at <= axis.range.end + slack);
            }
        }
    }
}
