//! The 60 Hz controller process: guard, estimate, position loops, attitude law, limits.
