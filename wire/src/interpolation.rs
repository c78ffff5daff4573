//! Straight lines between the points of a table.

/// Coordinate `to` of the table at `value` of the coordinate `from`, both rising \[-\]; beyond the table, that of its nearer end,
/// and 0 for a table without points.
pub(crate) fn interpolate(points: &[[f64; 2]], value: f64, [from, to]: [usize; 2]) -> f64 {
    let upper = points.partition_point(|point| point[from] < value);
    match (upper.checked_sub(1).and_then(|lower| points.get(lower)), points.get(upper)) {
        (Some(low), Some(high)) => {
            let share = (value - low[from]) / (high[from] - low[from]);
            low[to] + share * (high[to] - low[to])
        }
        (Some(end), None) | (None, Some(end)) => end[to],
        (None, None) => 0.0,
    }
}
