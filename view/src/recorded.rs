//! A recording as one document: rows and events of the whole flight, thinned to the resolution of a page.

use oqtal_config::Config;
use oqtal_observe::flight::Flight;
use oqtal_observe::recording::{RecordingFile, RecordingFileError, config, flight, play};
use serde::Serialize;

use crate::collect::{Collected, Collector};
use crate::scene::SceneDescription;

/// Maximum number of rows of a kind in a document: ten minutes at 60 Hz.
const MOST_ROWS: usize = 36_000;
/// Maximum number of events in a document; the first ones are kept.
const MOST_EVENTS: usize = 2000;

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
    /// Thinning: one row in this many is shown.
    thinning: usize,
    /// Reason why the file ends before its index.
    cut_off: Option<&'a str>,
}

impl RecordedView {
    /// The view of a recording.
    ///
    /// # Errors
    /// The recording has other message definitions or no valid configuration.
    pub fn of(file: &RecordingFile) -> Result<Self, RecordingFileError> {
        let config: Config = config(file)?;
        let mut collector = Collector::new(&config);
        play(file, &mut collector)?;
        let mut collected = collector.finish();
        shift(&mut collected, collector.armed_at_s().unwrap_or(0.0));
        let thinning = collected.ticks.len().div_ceil(MOST_ROWS).max(1);
        keep_one_in(&mut collected.ticks, thinning);
        keep_one_in(&mut collected.vehicles, thinning);
        collected.events.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        collected.events.truncate(MOST_EVENTS);
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

fn keep_one_in<T: Copy>(rows: &mut Vec<T>, thinning: usize) {
    *rows = rows.iter().step_by(thinning).copied().collect();
}
