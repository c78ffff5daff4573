//! Tests of the studies on whole flights. One program, since each of its modules would link the whole crate otherwise:
//! `cargo test -p oqtal-lab --test studies margins::` executes one module.

mod cameras;
mod external;
mod far_steps;
mod fence;
mod heading;
mod identify;
mod landing;
mod live;
mod live_tuning;
mod margins;
mod metrics;
mod online_tuning;
mod second_lag;
mod steps;
mod untold;
