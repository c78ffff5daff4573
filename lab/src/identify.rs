//! `oqtal identify`: the parameters of a vehicle from its flights.

pub mod camera_figures;
pub mod command;
pub mod data;
pub mod digits;
pub mod estimate;
pub mod excitation_flight;
pub mod finding;
pub mod fit;
pub mod hidden_plants;
pub mod identification;
pub mod inner_loop;
pub mod lifting;
pub mod noise;
pub mod overview;
pub mod page;
pub mod residuals;
pub mod robust;
pub mod rotation;
pub mod timeline;
pub mod translation;
pub mod turning;
pub mod vehicle_toml;
