//! Tests that only root can execute: they become another user or create networks. Another user skips them, with a message. `.ci/run`
//! executes them as root, and all others as an unprivileged user.

mod cables;
mod neighbours;
mod users;
