//! A running instance in a terminal: `oqtal monitor`.
//!
//! Samples of the one observer become a model, the model is drawn into a buffer of cells, and a thin loop shows the buffer. Nothing
//! but the loop knows a clock, a bus or a terminal.
//!
//! | file | subject |
//! |---|---|
//! | `model.rs` | what is known of the instance: a sink |
//! | `processes.rs`, `trend.rs`, `journal.rs` | its parts: processes, curves over time, events |
//! | `lines.rs` | the model as lines of text |
//! | `layout.rs` | what is shown in a terminal of a given size |
//! | `look.rs` | colours and symbols, or words and letters alone |
//! | `draw.rs` | the picture |
//! | `terminal.rs` | the terminal, and how it is left as it was |
//! | `command.rs` | the command and its loop |
#![forbid(unsafe_code)]

mod command;
mod draw;
mod journal;
mod layout;
mod lines;
mod look;
mod model;
mod processes;
mod terminal;
#[cfg(test)]
mod tests;
mod trend;

pub use command::MonitorArgs;
