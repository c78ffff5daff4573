//! Common parts of all processes of oqtal: context, real-time set-up, loop clock, virtual clock, health, logs, signals, exit codes.
//!
//! | file | subject |
//! |---|---|
//! | `process.rs` | a process from its command line to its exit code |
//! | `args.rs` | command line common to all processes |
//! | `context.rs` | context of a running process: configuration, role, stop flag, health |
//! | `exit.rs` | exit codes, and the failures that cause them |
//! | `program.rs` | frame of every program: panics, output to a closed pipe |
//! | `process_loop.rs` | the loop: wait, turn, heartbeat, a safe output at the end |
//! | `turn.rs` | one turn of a process, and the clock during it |
//! | `loop_clock.rs` | wait for the next event of a process |
//! | `virtual_clock.rs` | the scheduler of virtual time |
//! | `lockstep.rs` | virtual time between processes |
//! | `realtime.rs` | scheduling, processors, locked memory |
//! | `overrun.rs` | late turns |
//! | `awake.rs` | when a loop waits awake |
//! | `background.rs` | the thread for work that may block |
//! | `handoff.rs` | bounded queues between both threads |
//! | `reopener.rs` | opening of a lost port or connection, on a thread of its own |
//! | `health.rs` | health record and heartbeat |
//! | `log.rs` | the log, written by a separate thread |
//! | `lost_files.rs` | removed files of the instance, and the end of a process after a loss |
//! | `watches.rs` | watches over the files of the joined instances |
//! | `service.rs` | notifications to the service manager |
//! | `stop.rs` | stop flag of a process |
//! | `faults.rs` | injected faults, as decorators of ports and turns |
//! | `random.rs` | repeatable random numbers |
//! | `pose_source.rs` | sources of poses |
//! | `actuation.rs` | kind of command by the interface of a vehicle |
//! | `flight_marker.rs` | files that a daemon leaves to the next one: against an automatic take-off, and of a flight under way |
//! | `packet_socket.rs` | socket at which other processes of this user connect |
//! | `files.rs` | files and directories protected against other users |
//! | `kept_file.rs` | files by which others find a process, made again after a removal |
#![forbid(unsafe_code)]

pub mod actuation;
mod args;
pub mod awake;
pub mod background;
mod context;
mod exit;
pub mod faults;
pub mod files;
pub mod flight_marker;
pub mod handoff;
pub mod health;
pub mod kept_file;
mod lockstep;
mod log;
pub mod loop_clock;
mod lost_files;
pub mod overrun;
pub mod packet_socket;
pub mod pose_source;
pub mod process;
pub mod process_loop;
pub mod program;
pub mod random;
pub mod realtime;
pub mod reopener;
mod service;
pub mod stop;
pub mod turn;
pub mod virtual_clock;
mod watches;
