//! Tests of the public interface, in one program.

mod common;

mod languages;
mod readiness;
mod safety;
mod turns;
