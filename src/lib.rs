//! The front door of oqtal: flies, judges and shows.
#![forbid(unsafe_code)]

pub mod campaign;
pub mod check;
pub mod cli;
pub mod csv;
pub mod ctl;
pub mod flight;
pub mod fly;
pub mod recorder;
pub mod report;
pub mod reproduce;
pub mod summary;
pub mod table;
pub mod tune;
