//! Studies in virtual time: in-process flights, campaigns, tuning, and the experiments of the paper.
//!
//! | file | subject |
//! |---|---|
//! | `simulation.rs` | an in-process flight |
//! | `faults.rs` | injected faults and disturbances, checked against the processes of a flight |
//! | `mission.rs` | configuration and files of a flight, read and checked |
//! | `study.rs` | the study engine: laws × cases × flights × tests, rows, tables |
//! | `rival.rs` | laws of the literature, `oqtal-rivals`, as external laws of an in-process flight |
//! | `campaign.rs` | `oqtal campaign`: laws over many runs |
//! | `sweep.rs` | `oqtal sweep`: figures over values of any keys |
//! | `tune.rs` | `oqtal tune`: optimisation of gains |
//! | `robustness.rs` | `oqtal robustness`: plants that differ from `[vehicle]` |
//! | `identify.rs` | `oqtal identify`: parameters of a vehicle from its flights |
//! | `reproduce.rs` | `oqtal reproduce`: the experiments of the paper |
//! | `cameras.rs` | `oqtal cameras`: emulated cameras against recordings |
//! | `environment.rs` | an environment for reinforcement learning |
//! | `replay.rs` | `oqtal replay`: a recording replayed through the daemon |
//! | `sheet.rs` | tables of printed and computed figures |
//! | `text_table.rs` | tables for a terminal of 80 columns |
//! | `csv_text.rs` | tables as CSV |
//! | `output.rs` | the output directory `--out` |
//! | `progress.rs` | progress bars |
//! | `journal.rs` | results of an interrupted study |
//! | `random.rs` | random numbers of studies |
//! | `bootstrap.rs` | confidence intervals by resampling |
#![forbid(unsafe_code)]

pub mod bootstrap;
pub mod cameras;
pub mod campaign;
pub mod csv_text;
pub mod environment;
pub mod faults;
pub mod identify;
pub mod journal;
pub mod mission;
pub mod output;
pub mod progress;
mod random;
pub mod replay;
pub mod reproduce;
pub mod rival;
pub mod robustness;
pub mod sheet;
pub mod simulation;
pub mod study;
pub mod sweep;
pub mod text_table;
pub mod tune;
