//! The motion-capture process: six cameras as noise, latency and dropouts, or a recording.

pub mod recording;
