//! Observation of flights: the observer of the bus and its sinks (recorder, loop monitor, model of an instance, recording), and the
//! results of a recorded flight: summary, table, report, CSV.
//!
//! | file | subject |
//! |---|---|
//! | `observer.rs` | the observer of the bus |
//! | `sink.rs` | interface of the receivers of samples |
//! | `recorder.rs` | sink: joins every tick with the truth |
//! | `loop_monitor.rs` | sink: latencies and counters of a running instance |
//! | `instance.rs` | sink: model of a running instance |
//! | `instance_observer.rs` | observer of an instance, also after the loss of its files |
//! | `observed_process.rs` | a process of an observed instance, by its health messages |
//! | `status.rs` | status of an instance, as text and as JSON |
//! | `config_file.rs` | configuration of the last daemon of an instance |
//! | `recording.rs` | recordings as MCAP files |
//! | `event.rs` | events as text |
//! | `flight.rs` | a recorded flight |
//! | `flight_sample.rs` | one tick of a flight |
//! | `applied_command.rs` | commands that reached the vehicle, joined with their ticks |
//! | `repeated.rs` | messages that were received more than once |
//! | `law_query.rs` | law, trajectory and changed settings, asked of the daemon |
//! | `nearest.rs` | joins ticks with the samples nearest in time |
//! | `summary.rs` | figures of a flight, `summary.json` |
//! | `latency.rs` | latency by hops, from capture to effect |
//! | `command_path.rs` | path of commands to the vehicle |
//! | `wire.rs` | figures of the wire to a vehicle |
//! | `flight_end.rs`, `crash.rs` | detection of the end of a flight, and of crashes |
//! | `shortfall.rs`, `reservation.rs` | reasons why a flight did not end as planned, and why its figures may be those of another |
//! | `handovers.rs` | hand-overs from a law to its fallback |
//! | `hold.rs` | holds of a flight by the fence |
//! | `corners.rs`, `attitude_steps.rs`, `settling.rs` | figures at the corners of a path, and of a prescribed attitude; settling after steps |
//! | `fault.rs` | faults and disturbances of a flight |
//! | `table.rs` | the closing table in the terminal |
//! | `explain.rs` | explanations of the terms of the closing table |
//! | `report.rs` | the report of a flight, one HTML page |
//! | `compare.rs` | comparison of several flights |
//! | `csv.rs` | `telemetry.csv` |
//! | `mat.rs` | tables as MAT-files |
//! | `page.rs` | HTML pages in one style |
//! | `plot.rs` | plots as SVG |
//! | `kernel.rs` | scheduling and resource use of a process |
//! | `provenance.rs` | the build of the program |
#![forbid(unsafe_code)]

mod applied_command;
pub mod attitude_steps;
pub mod command_path;
pub mod compare;
pub mod config_file;
pub mod corners;
pub mod crash;
pub mod csv;
pub mod event;
pub mod explain;
pub mod fault;
pub mod flight;
mod flight_end;
pub mod flight_sample;
pub mod handovers;
mod hold;
pub mod instance;
pub mod instance_observer;
pub mod kernel;
pub mod latency;
pub mod law_query;
pub mod loop_monitor;
pub mod mat;
pub mod nearest;
pub mod observed_process;
pub mod observer;
pub mod page;
pub mod plot;
pub mod provenance;
pub mod recorder;
pub mod recording;
mod repeated;
pub mod report;
mod reservation;
pub mod settling;
mod shortfall;
pub mod sink;
pub mod status;
pub mod summary;
pub mod table;
pub mod wire;
