//! Emulated Crazyflie: CRTP packets control the plant.
//!
//! | file | subject |
//! |---|---|
//! | `supervisor.rs` | arming, time limits of set-points, locking: the rules of the firmware's supervisor |
//! | `tables.rs` | parameters and log variables |
//! | `logs.rs` | log blocks of a host, with their schedules |
//! | `board.rs` | the on-board computer: packets to set-points, answers |
//! | `vehicle.rs` | the vehicle behind its radio, without its port; pure |

mod board;
mod logs;
mod supervisor;
mod tables;
mod vehicle;

pub use board::CrazyflieBoard;
pub use vehicle::CrtpVehicle;
