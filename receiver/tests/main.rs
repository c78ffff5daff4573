//! Tests of the public interface, in one program.

mod clock;
mod clock_recordings;
mod clock_steps;
mod faults;
mod gate;
mod hostile;
