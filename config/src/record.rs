//! `[record]`: selection of recordings, and division into files.

use oqtal_control::options::{OptionError, Rule, check_options};
use serde::{Deserialize, Serialize};

/// The flights of `oqtal fly` that are recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RecordedFlights {
    /// None.
    None,
    /// Flights through processes, in real time and in lockstep.
    Processes,
    /// Also in-process flights, which become slower.
    All,
}

/// `[record]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct RecordOptions {
    /// The flights of `oqtal fly` that are recorded.
    pub flights: RecordedFlights,
    /// Rate at which the truth is recorded \[Hz\], in addition to the sample nearest to each tick of the daemon.
    pub truth_hz: f64,
    /// Size of a file above which `oqtal record` starts another one \[MB\].
    pub file_mb: f64,
    /// Duration of a file above which `oqtal record` starts another one \[min\].
    pub file_min: f64,
}

impl RecordOptions {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([
            ("truth-hz", self.truth_hz, Rule::Between(0.0, 1000.0)),
            ("file-mb", self.file_mb, Rule::Between(0.1, f64::MAX)),
            ("file-min", self.file_min, Rule::Positive),
        ])
        .map_err(|error| error.within("record"))
    }
}
