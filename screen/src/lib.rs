//! A running instance in a terminal: `oqtal monitor`.
//!
//! Samples from the observer update a model, the model is drawn into cells, and a loop shows the cells. Only the loop uses a
//! clock, a bus or a terminal.
//!
//! | file | subject |
//! |---|---|
//! | `model.rs` | a sink: the model of the instance, and quantities over time |
//! | `trend.rs` | a quantity over time |
//! | `lines.rs` | the model as lines of text |
//! | `layout.rs` | layout of the parts in a terminal of a given size |
//! | `look.rs` | colours and symbols, or words and letters alone |
//! | `picture.rs` | cells of a terminal |
//! | `draw.rs` | the picture of the model |
//! | `wrapping.rs` | texts in lines of limited width |
//! | `keys.rs` | meaning of keys, and the line of a request |
//! | `requests.rs` | requests, executed beside the picture |
//! | `terminal.rs` | the terminal, and its restoration |
//! | `command.rs` | the command and its loop |
#![forbid(unsafe_code)]

mod command;
mod draw;
mod keys;
mod layout;
mod lines;
mod look;
mod model;
mod picture;
mod requests;
mod terminal;
#[cfg(test)]
mod tests;
mod trend;
mod wrapping;

pub use command::MonitorArgs;
