//! `oqtal identify`: the parameters of a vehicle from its flights, by prediction errors.
//!
//! | file | subject |
//! |---|---|
//! | `data.rs`, `timeline.rs` | poses and commands of a flight, and the times at which commands take effect |
//! | `inner_loop.rs`, `rotation.rs`, `translation.rs` | prediction from pose to pose |
//! | `turning.rs`, `lifting.rs`, `estimate.rs` | the fits of rotation and translation, and their order |
//! | `fit.rs`, `noise.rs`, `robust.rs`, `residuals.rs` | least squares, noise, outliers, tests |
//! | `finding.rs`, `flown_motion.rs`, `camera_figures.rs`, `identification.rs` | estimates of parameters, and the rules for accepting them |
//! | `overview.rs`, `vehicle_toml.rs`, `page.rs`, `frequency_response.rs` | text, configuration, page |
//! | `excitation_flight.rs`, `hidden_plants.rs` | the excitation flight; errors of identifications |
//! | `command.rs` | the command line |

pub mod camera_figures;
pub mod command;
pub mod data;
pub mod estimate;
pub mod excitation_flight;
pub mod finding;
pub mod fit;
pub mod flown_motion;
pub mod frequency_response;
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
