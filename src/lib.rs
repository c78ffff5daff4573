//! The `oqtal` program's library: one module per command.
#![forbid(unsafe_code)]

pub mod chain;
pub mod check;
mod child;
pub mod cli;
pub mod compare;
pub mod ctl;
mod daemon_config;
pub mod doctor;
pub mod export;
pub mod fly;
pub mod gateway;
pub mod info;
pub mod latency;
mod live_tuning;
mod manual;
mod provenance;
pub mod record;
mod recordings;
pub mod replay;
pub mod report;
mod token;
pub mod view;
