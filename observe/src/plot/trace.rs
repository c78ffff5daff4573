//! Points and traces of a plot, thinned to its resolution.

use super::axis::{extent, is_drawable};
use super::palette::Ink;

/// Two coordinates, in the units of the axes.
pub type Point = (f64, f64);

/// Maximum number of points of a trace.
const MOST_POINTS: usize = 2000;

/// Whether a plot can show `point`.
pub fn is_drawable_point(point: &Point) -> bool {
    is_drawable(point.0) && is_drawable(point.1)
}

/// A line with its name.
#[derive(Clone, Debug)]
pub struct Trace {
    /// Name in the legend.
    pub name: &'static str,
    /// Colour.
    pub ink: Ink,
    /// Points in order; a point that cannot be drawn is a gap.
    pub points: Vec<Point>,
}

/// Thins `points` to at most `MOST_POINTS`; minimum and maximum of every segment are kept.
pub fn thin(points: Vec<Point>) -> Vec<Point> {
    if points.len() <= MOST_POINTS {
        return points;
    }
    points.chunks(points.len().div_ceil(MOST_POINTS / 3)).flat_map(extremes).collect()
}

/// Minimum, maximum and first gap of a segment, in order.
fn extremes(segment: &[Point]) -> impl Iterator<Item = Point> {
    let points = || segment.iter().copied().enumerate();
    let drawable = || points().filter(|(_, (_, y))| is_drawable(*y));
    let by_value = |(_, a): &(usize, Point), (_, b): &(usize, Point)| a.1.total_cmp(&b.1);
    let gap = points().find(|(_, (_, y))| !is_drawable(*y)).map(|(at, (x, _))| (at, (x, f64::NAN)));
    let extremes = [drawable().min_by(by_value), drawable().max_by(by_value), gap];
    let mut kept: Vec<_> = extremes.into_iter().flatten().collect();
    kept.sort_by_key(|(at, _)| *at);
    kept.dedup_by_key(|(at, _)| *at);
    kept.into_iter().map(|(_, point)| point)
}

/// Thins the points of a path to at most `MOST_POINTS`: keeps points at a distance from the last one kept. Outliers are kept. A run
/// of points that cannot be drawn becomes one gap if the next point is at a distance.
pub fn thin_path(points: Vec<Point>) -> Vec<Point> {
    let drawable = || points.iter().filter(|point| is_drawable_point(point));
    let (x, y) = (extent(drawable().map(|p| p.0)), extent(drawable().map(|p| p.1)));
    let mut spacing = 1e-3 * (x.end - x.start).max(y.end - y.start);
    let mut kept = spaced(&points, spacing);
    while kept.len() > MOST_POINTS {
        spacing *= 1.5;
        kept = spaced(&kept, spacing);
    }
    kept
}

/// Thins each of `paths`, and joins them with a gap between two.
pub fn thin_paths(paths: impl Iterator<Item = Vec<Point>>) -> Vec<Point> {
    let thinned: Vec<Vec<Point>> = paths.map(thin_path).collect();
    thinned.join(&(f64::NAN, f64::NAN))
}

fn spaced(points: &[Point], spacing: f64) -> Vec<Point> {
    let mut kept: Vec<Point> = Vec::new();
    let (mut last, mut is_gap): (Option<Point>, bool) = (None, false);
    for &(x, y) in points {
        if !is_drawable_point(&(x, y)) {
            is_gap = last.is_some();
        } else if last.is_none_or(|last| (x - last.0).hypot(y - last.1) > spacing) {
            kept.extend(is_gap.then_some((f64::NAN, f64::NAN)));
            kept.push((x, y));
            (last, is_gap) = (Some((x, y)), false);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn thinning_keeps_a_single_spike_and_the_order() {
        let mut points: Vec<Point> = (0..36_000).map(|i| (f64::from(i), 0.0)).collect();
        points[12_345].1 = 7.0;
        points[23_456].1 = -7.0;
        let thinned = thin(points);
        assert!(thinned.len() <= MOST_POINTS);
        assert!(thinned.contains(&(12_345.0, 7.0)) && thinned.contains(&(23_456.0, -7.0)));
        assert!(thinned.is_sorted_by(|a, b| a.0 < b.0));
    }

    #[test]
    fn thinning_keeps_a_gap() {
        let points =
            (0..36_000).map(|i| (f64::from(i), if i / 1000 == 7 { f64::NAN } else { 1.0 }));
        assert!(thin(points.collect()).iter().any(|(_, y)| y.is_nan()));
        // A single one.
        let points = (0..36_000).map(|i| (f64::from(i), if i == 12_345 { f64::NAN } else { 1.0 }));
        assert!(thin(points.collect()).iter().any(|(x, y)| *x == 12_345.0 && y.is_nan()));
    }

    #[test]
    fn a_thinned_path_keeps_an_outlier() {
        let circle = (0..36_000).map(|i| (f64::from(i) * 0.01).sin_cos());
        let mut points: Vec<Point> = circle.collect();
        points[20_000] = (5.0, 5.0);
        let thinned = thin_path(points);
        assert!(thinned.len() <= MOST_POINTS && thinned.contains(&(5.0, 5.0)));
    }

    #[test]
    fn a_thinned_path_keeps_a_gap() {
        let mut points: Vec<Point> = (0..36_000).map(|i| (f64::from(i), 0.0)).collect();
        points[12_000..15_000].fill((f64::NAN, f64::NAN));
        let thinned = thin_path(points);
        assert!(thinned.len() <= MOST_POINTS);
        assert_eq!(thinned.iter().filter(|point| !is_drawable_point(point)).count(), 1);
    }

    #[test]
    fn paths_are_joined_by_a_gap() {
        let joined = thin_paths([vec![(0.0, 0.0), (1.0, 0.0)], vec![(5.0, 5.0)]].into_iter());
        let drawn: Vec<bool> = joined.iter().map(is_drawable_point).collect();
        assert_eq!(drawn, [true, true, false, true]);
    }

    proptest! {
        #[test]
        fn any_points_can_be_thinned(
            points in prop::collection::vec((any::<f64>(), any::<f64>()), 0..3),
            copies in 1_usize..3000,
        ) {
            let many: Vec<Point> = points.iter().copied().cycle().take(points.len() * copies).collect();
            prop_assert!(thin(many.clone()).len() <= MOST_POINTS);
            prop_assert!(thin_path(many).len() <= MOST_POINTS);
        }
    }
}
