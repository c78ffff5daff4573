//! Studies in virtual time: flights in one process, campaigns, tuning, and the experiments of the paper.
#![forbid(unsafe_code)]

pub mod cameras;
pub mod campaign;
pub mod csv_text;
pub mod identify;
pub mod mission;
pub mod progress;
pub mod replay;
pub mod reproduce;
pub mod robustness;
pub mod sheet;
pub mod simulation;
pub mod study;
pub mod sweep;
pub mod text_table;
pub mod tune;
