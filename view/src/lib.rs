//! Browser page for a running instance or a recording.
//!
//! | file | subject |
//! |---|---|
//! | `row.rs` | a tick and a vehicle message as rows of numbers |
//! | `collect.rs` | sink that converts messages to rows and events |
//! | `scene.rs` | constant description: room, cameras, names of columns and codes |
//! | `history.rs` | history for a page that is opened later |
//! | `live.rs` | updates for the pages of a running instance |
//! | `recorded.rs` | a recording as one document |
//! | `request.rs`, `response.rs` | HTTP, bounded |
//! | `access.rs` | permission to read and to command |
//! | `site.rs` | answers to requests |
//! | `hub.rs` | updates to every open page; a page that does not read is disconnected |
//! | `places.rs` | places of the open connections; token holders have their own |
//! | `server.rs` | sockets with their time-outs |
//! | `assets.rs` | files of the page, compiled into the program |
#![forbid(unsafe_code)]

pub mod access;
mod assets;
pub mod collect;
mod history;
pub mod hub;
pub mod live;
mod places;
pub mod recorded;
mod request;
mod response;
mod row;
pub mod scene;
pub mod server;
pub mod site;
