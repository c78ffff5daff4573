//! Control stacks: everything between accepted poses and the command to the vehicle.
//!
//! | file | subject |
//! |---|---|
//! | `flight_stack.rs` | the interface of a control stack |
//! | `paper.rs` | the paper's: the outer loops of Fig. 16, then an attitude law |
//! | `predictive.rs` | estimation, prediction and `oqtal-dt` |
//! | `control_stack.rs` | the one that a configuration asks for |

mod control_stack;
mod flight_stack;
mod paper;
mod predictive;

pub use control_stack::ControlStack;
pub use flight_stack::{ControlOutput, ControlStep, FlightStack};
