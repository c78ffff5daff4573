//! The controller on the bench and in flights in virtual time, and its program.

mod common;
mod cycle;
mod descent;
mod fence;
mod gate;
mod limits;
mod margins;
mod program;
mod reload;
mod setpoint;
mod stop;
mod vehicle;
