//! Tests of the public interface, in one program.

mod common;

mod protocols;
mod readiness;
mod restart;
mod safety;
mod tenant;
mod turns;
