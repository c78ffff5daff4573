//! Emulated Crazyflie: the plant is flown through CRTP packets.
//!
//! | file | subject |
//! |---|---|
//! | `supervisor.rs` | arming, time limits of set-points, locking: the rules of the firmware's supervisor |
//! | `tables.rs` | its parameters and log variables |
//! | `logs.rs` | log blocks that a host made, and when they are due |
//! | `board.rs` | the on-board computer: packets to set-points, answers |
//! | `vehicle.rs` | the vehicle behind its radio, without a socket, pure |
//! | `socket.rs` | one packet a datagram over UDP |

mod board;
mod logs;
mod socket;
mod supervisor;
mod tables;
mod vehicle;

pub use board::CrazyflieBoard;
pub use socket::run_crazyflie;
pub use supervisor::SupervisorModel;
pub use vehicle::CrtpVehicle;
