//! Recordings of flights: MCAP files with every topic as it was published and when it was received, together with what is needed
//! to understand them later: configuration, version, machine, events.
//!
//! Messages are encoded as ROS 2 does (CDR), their schemas are written from the field tables of the message definitions, with
//! units in names and comments. Poses come a second time in Foxglove's well-known schemas, for viewers that draw.
//!
//! | file | subject |
//! |---|---|
//! | `cdr.rs` | the encoding of one message, both ways |
//! | `schema.rs` | schemas of messages, from their field tables |
//! | `channel.rs` | the table of recorded channels |
//! | `scene.rs` | poses, transforms and log entries in well-known schemas |
//! | `facts.rs`, `closing.rs` | what is recorded beside the messages |
//! | `fault_schedule.rs` | when faults by hand begin and end |
//! | `truth.rs` | the samples of the truth that are recorded |
//! | `sink.rs` | the sink that records |
//! | `thread.rs` | the thread that writes, and its queue |
//! | `writer.rs` | one MCAP file |
//! | `file.rs` | a recording that is read |
//! | `playback.rs` | a recording as samples for a sink, and as a flight |
//! | `history.rs` | what the daemon took in, turn by turn, from a recording |
//! | `export.rs` | a recording as text |
//! | `overview.rs` | what a recording holds, for people |

mod cdr;
mod channel;
mod closing;
mod export;
mod facts;
mod fault_schedule;
mod file;
mod history;
mod overview;
mod playback;
mod scene;
mod schema;
mod sink;
#[cfg(test)]
mod tests;
mod thread;
mod truth;
mod writer;

pub use cdr::{decode, encode};
pub use closing::ClosingFacts;
pub use export::{CsvExport, Tables, TumExport};
pub use facts::{Facts, WAYPOINTS_FILE};
pub use file::{RecordedChannel, RecordedMessage, RecordingFile, RecordingFileError};
pub use history::{DaemonHistory, InputHistory, RecordedTurn};
pub use overview::{RecordingOverview, TopicOverview};
pub use playback::{config, flight, play};
pub use sink::{McapRecorder, RecordingPlan};
pub use thread::RecordingResult;
