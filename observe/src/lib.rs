//! Observation of flights: the observer of the bus and its sinks (recorder, latency, status), and what is made of a recorded
//! flight: summary, table, report, CSV.
#![forbid(unsafe_code)]

pub mod command_path;
pub mod compare;
pub mod crash;
pub mod csv;
pub mod event;
pub mod explain;
pub mod fault;
pub mod flight;
pub mod flight_sample;
pub mod kernel;
pub mod latency;
pub mod loop_monitor;
pub mod nearest;
pub mod observer;
pub mod page;
pub mod plot;
pub mod provenance;
pub mod recorder;
pub mod recording;
pub mod report;
pub mod sink;
pub mod status;
pub mod summary;
pub mod table;
pub mod wire;
