//! The receiver process: poses of a real camera system, in place of the emulated one.
#![forbid(unsafe_code)]

pub mod clock;
pub mod gate;
pub mod link;
