//! Recordings of flights: MCAP files with every message, its times of publication and reception, configuration, version, machine
//! and events.
//!
//! Messages are encoded as in ROS 2 (CDR). Their schemas are generated from the field tables of the message definitions, with
//! units in names and comments. Poses are additionally recorded in Foxglove's well-known schemas, for graphical viewers.
//!
//! | file | subject |
//! |---|---|
//! | `cdr.rs` | encoding and decoding of one message |
//! | `schema.rs` | schemas of messages, from their field tables |
//! | `channel.rs` | table of the recorded channels |
//! | `scene.rs` | poses, transforms and log entries in well-known schemas |
//! | `facts.rs`, `closing.rs` | facts recorded beside the messages |
//! | `fault_schedule.rs` | beginnings and ends of injected faults and disturbances |
//! | `truth.rs` | selection of the recorded truth samples |
//! | `sink.rs` | the recording sink |
//! | `chunk.rs` | messages collected for the file |
//! | `thread.rs` | the writing thread, and its queue |
//! | `mcap.rs` | the container format |
//! | `writer.rs` | one MCAP file |
//! | `file.rs` | reading of a recording |
//! | `location.rs` | names of recordings on the command line |
//! | `session.rs` | recordings of several flights |
//! | `playback.rs` | a recording as samples for a sink, and as a flight |
//! | `history.rs` | inputs of the daemon, turn by turn |
//! | `cell.rs` | messages as rows of typed cells |
//! | `export.rs` | a recording as text and as columns |
//! | `overview.rs` | contents of a recording: `oqtal info` |

mod cdr;
pub mod cell;
mod channel;
mod chunk;
mod closing;
mod export;
mod facts;
mod fault_schedule;
mod file;
mod history;
mod location;
mod mcap;
mod overview;
mod playback;
mod scene;
mod schema;
mod session;
mod sink;
#[cfg(test)]
mod tests;
mod thread;
mod truth;
mod writer;

pub use cdr::{decode, encode};
pub use export::{ColumnExport, CsvExport, Tables, TumExport};
pub use facts::{Facts, WAYPOINTS_FILE};
pub use file::{RecordedChannel, RecordedMessage, RecordingFile, RecordingFileError, is_recording};
pub use history::{DaemonHistory, InputHistory, RecordedTurn};
pub use location::{RECORDING, SUMMARY, recording_path};
pub use overview::{RecordingOverview, TopicOverview};
pub use playback::{config, flight, play};
pub use session::{ListedFlight, list, numbered, read};
pub use sink::{McapRecorder, RecordingPlan};
pub use thread::RecordingResult;
