//! The plant process: 6DoF vehicles under a radio delay, in place of a real one.
