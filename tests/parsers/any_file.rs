//! Arbitrary bytes as a recording and as a configuration, as the commands read them; shared with the fuzz targets.

use std::path::Path;

use oqtal_config::Config;
use oqtal_observe::csv;
use oqtal_observe::recording::{
    CsvExport, RecordingFile, RecordingOverview, TumExport, flight, play,
};

/// Reads a recording and exports it.
pub fn any_recording(bytes: &[u8]) {
    let Ok(file) = RecordingFile::parse(Path::new("r.mcap"), bytes) else { return };
    let _ = play(&file, &mut TumExport::default());
    let _ = play(&file, &mut CsvExport::default());
    if let Ok(flight) = flight(&file) {
        csv::write(&flight, &mut Vec::new()).expect("memory can be written");
    }
    let _ = RecordingOverview::of(&file).to_text();
}

/// Reads a configuration.
pub fn any_configuration(bytes: &[u8]) {
    if let Ok(config) = Config::parse("c.toml", &String::from_utf8_lossy(bytes), &[]) {
        let _ = config.to_toml();
    }
}
