//! System tests of the program: flights in virtual time, real processes, faults, recordings, documents. One program, since each of its
//! modules would link the whole workspace otherwise: `cargo test --test system chaos::` executes one module.
#![allow(clippy::disallowed_methods, reason = "tests have time-outs")]

mod common;

mod bad_use;
mod blocked_output;
mod bridge;
mod bridge_flights;
mod bridge_noise;
mod budget;
mod camera_trouble;
mod chaos;
mod clocks;
mod command_lines;
mod crazyflie;
mod data;
mod disturbances;
mod doctor;
mod documents;
mod early_interrupts;
mod external_law;
mod faults;
mod faults_injected;
mod firmware;
mod flights;
mod gateway;
mod identify;
mod kills;
mod latency;
mod live_tuning;
mod lost_files;
mod mavlink;
mod mavlink_flights;
mod monitor;
mod msp_flights;
mod one_name;
mod open_loop;
mod operators;
mod places;
mod pose_faults;
mod prediction;
mod privileged;
mod receiver;
mod recordings;
mod replays;
mod reproduce;
mod robustness;
mod soak;
mod stop;
mod stop_paths;
mod structure;
mod studies;
mod view;
