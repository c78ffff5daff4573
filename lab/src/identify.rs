//! `oqtal identify`: the parameters of a vehicle from its flights.

pub mod camera_figures;
pub mod data;
pub mod estimate;
pub mod finding;
pub mod fit;
pub mod identification;
pub mod inner_loop;
pub mod lifting;
pub mod noise;
pub mod residuals;
pub mod robust;
pub mod rotation;
pub mod timeline;
pub mod translation;
pub mod turning;
