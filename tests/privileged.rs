//! Tests that only root can execute: they change users or create networks. They are skipped, with a message, for another user.
//! `.ci/run` executes them as root, and all others as an unprivileged user.

mod cables;
mod neighbours;
mod users;
