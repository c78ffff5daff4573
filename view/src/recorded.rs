//! A recording as one document: rows and events of the whole flight, thinned to the resolution of a page.

use std::collections::BTreeSet;
use std::ops::Range;

use oqtal_config::Config;
use oqtal_observe::flight::Flight;
use oqtal_observe::recording::{RecordingFile, RecordingFileError, config, flight, play};
use serde::Serialize;

use crate::collect::{Collected, Collector, EventMood, ViewedEvent, omitted};
use crate::row;
use crate::scene::SceneDescription;

/// Maximum number of rows of a kind in a document: ten minutes at 60 Hz.
const MOST_ROWS: usize = 36_000;
/// Maximum number of events in a document; the first ones are kept, the others counted.
const MOST_EVENTS: usize = 10_000;
/// Time between two rows above which they are not joined by a line, as in `store.js` \[s\].
const GAP_S: f64 = 0.25;

/// Recording for display.
#[derive(Clone, Debug)]
pub struct RecordedView {
    /// Constant description.
    pub scene: SceneDescription,
    /// Rows and events as JSON.
    pub document: String,
}

#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    collected: &'a Collected,
    /// Thinning: about one row in this many is shown, among them the extremes of every curve.
    thinning: usize,
    /// Reason why the file ends before its index.
    cut_off: Option<&'a str>,
}

impl RecordedView {
    /// The view of a recording.
    ///
    /// # Errors
    /// The recording is of a version with other message definitions, or has no valid configuration.
    pub fn of(file: &RecordingFile) -> Result<Self, RecordingFileError> {
        let config: Config = config(file)?;
        let mut collector = Collector::of_recording(&config);
        play(file, &mut collector)?;
        let mut collected = collector.finish();
        shift(&mut collected, collector.armed_at_s().unwrap_or(0.0));
        let thinning = collected.ticks.len().div_ceil(MOST_ROWS).max(1);
        collected.ticks = thinned(&collected.ticks, thinning, row::TICK_CURVES);
        collected.vehicles = thinned(&collected.vehicles, thinning, row::VEHICLE_CURVES);
        truncate_events(&mut collected.events);
        let cut_off = file.cut_off.as_deref();
        let document = Document { collected: &collected, thinning, cut_off };
        let name = file.path.file_name().unwrap_or_default().to_string_lossy();
        // The heading is that of the flight, whose settings may have been changed before the take-off.
        let flight = flight(file).ok();
        let flown = flight.as_ref().map_or(config, Flight::config_at_arming);
        let mut scene = SceneDescription::of_recording(&flown, &name);
        scene.controller = flight.map_or(scene.controller, |flight| flight.laws());
        Ok(Self {
            scene,
            document: serde_json::to_string(&document).expect("rows and events are plain JSON"),
        })
    }
}

/// Makes the tick of arming the origin of the time axis.
fn shift(collected: &mut Collected, origin_s: f64) {
    let shifted = |t_s: f64| ((t_s - origin_s) * 1e4).round() / 1e4;
    collected.ticks.iter_mut().for_each(|row| row[0] = shifted(row[0]));
    collected.vehicles.iter_mut().for_each(|row| row[0] = shifted(row[0]));
    collected.events.iter_mut().for_each(|event| event.t_s = shifted(event.t_s));
}

/// Puts the events in order; a line takes the place of those beyond `MOST_EVENTS`.
fn truncate_events(events: &mut Vec<ViewedEvent>) {
    events.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    let count = events.len().saturating_sub(MOST_EVENTS);
    events.truncate(MOST_EVENTS);
    if let Some(t_s) = events.last().filter(|_| count > 0).map(|last| last.t_s) {
        events.push(ViewedEvent { t_s, mood: EventMood::Warning, text: omitted(count) });
    }
}

/// About one row in `thinning`: half at a regular spacing; half are the extremes of each column in `curves`, per segment. A row without
/// values marks a time without rows.
fn thinned<const N: usize>(
    rows: &[[f64; N]],
    thinning: usize,
    curves: Range<usize>,
) -> Vec<[f64; N]> {
    if thinning == 1 {
        return rows.to_vec();
    }
    let segment = 2 * thinning * 2 * curves.len();
    let mut kept: BTreeSet<usize> = (0..rows.len()).step_by(2 * thinning).collect();
    for (number, part) in rows.chunks(segment).enumerate() {
        let of_part = curves.clone().flat_map(|column| extremes(part, column));
        kept.extend(of_part.map(|row| number * segment + row));
    }
    let is_before_gap = |row: usize| rows[row + 1][0] - rows[row][0] > GAP_S;
    let before_gaps: Vec<usize> =
        (0..rows.len().saturating_sub(1)).filter(|row| is_before_gap(*row)).collect();
    kept.extend(before_gaps.iter().flat_map(|row| [*row, row + 1]));
    let mut shown: Vec<[f64; N]> = kept.into_iter().map(|row| rows[row]).collect();
    for row in before_gaps {
        let mut gap = rows[row];
        gap[0] += 1e-4;
        gap[curves.clone()].fill(f64::NAN);
        shown.push(gap);
    }
    shown.sort_by(|a, b| a[0].total_cmp(&b[0]));
    shown
}

/// Rows of the minimum and the maximum of a column.
fn extremes<const N: usize>(rows: &[[f64; N]], column: usize) -> impl Iterator<Item = usize> {
    let known = || (0..rows.len()).filter(|row| !rows[*row][column].is_nan());
    let by_value = |a: &usize, b: &usize| rows[*a][column].total_cmp(&rows[*b][column]);
    [known().min_by(by_value), known().max_by(by_value)].into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::row::TickRow;

    #[test]
    fn thinned_rows_keep_peaks_and_gaps_but_not_every_row_without_a_value() {
        let mut rows: Vec<TickRow> = (0..MOST_ROWS * 4).map(|i| [i as f64 / 60.0; _]).collect();
        rows.iter_mut().for_each(|row| row[1..].fill(1.0));
        let curve = row::TICK_CURVES.start;
        (rows[1001][curve], rows[2003][curve]) = (9.0, -9.0);
        // A row without a value in every segment, and a second of them.
        rows.iter_mut().skip(6).step_by(104).for_each(|row| row[curve] = f64::NAN);
        rows[9000..9060].iter_mut().for_each(|row| row[curve] = f64::NAN);
        // Half a second without ticks.
        rows.drain(4001..4030);
        let at = (rows[4000][0], rows[4001][0]);
        let shown = thinned(&rows, 4, row::TICK_CURVES);
        assert!(shown.len() < MOST_ROWS + 4, "{}", shown.len());
        assert!(shown.is_sorted_by(|a, b| a[0] < b[0]));
        let has = |wanted: fn(f64) -> bool| shown.iter().any(|row| wanted(row[curve]));
        assert!(has(|value| value == 9.0) && has(|value| value == -9.0));
        let gap = shown.iter().position(|row| row[0] == at.0).unwrap() + 1;
        assert!(shown[gap][curve].is_nan() && shown[gap][1] == 1.0 && shown[gap + 1][0] == at.1);
        let empty = shown.iter().filter(|row| row[curve].is_nan());
        let empty: Vec<f64> = empty.map(|row| row[0]).filter(|t_s| *t_s > at.1).collect();
        assert!(
            empty.len() >= 7 && empty.iter().all(|t_s| (150.0..152.0).contains(t_s)),
            "{empty:?}"
        );
    }

    #[test]
    fn events_that_are_not_shown_are_counted() {
        let event = |t_s| ViewedEvent { t_s, mood: EventMood::Neutral, text: String::new() };
        let mut events: Vec<_> = (0..MOST_EVENTS + 7).map(|i| event(i as f64)).collect();
        truncate_events(&mut events);
        assert_eq!(events.len(), MOST_EVENTS + 1);
        assert!(events[MOST_EVENTS].text.contains("7 more"), "{:?}", events[MOST_EVENTS]);
    }
}
