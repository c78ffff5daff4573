//! The body whose poses this process publishes.

/// Number of the rigid body whose poses are emulated or replayed: there is one.
pub const BODY: u32 = 1;
