//! Interpreters for the independent implementations in `tests/peers`.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::skipped;

/// Python interpreter with the packages of `requirements.txt`, named by `OQTAL_PEERS_PYTHON`, with a script; `None`, with a
/// message, if the variable is not set.
pub fn python(script: &str) -> Option<Command> {
    let Some(python) = std::env::var_os("OQTAL_PEERS_PYTHON") else {
        skipped("OQTAL_PEERS_PYTHON names no interpreter; .ci/run installs one");
        return None;
    };
    let mut command = Command::new(python);
    command.arg(script_path(script));
    Some(command)
}

/// Node.js with the packages of `package.json` in the directory named by `OQTAL_PEERS_NODE`, with a script; `None`, with a
/// message, if the variable is not set.
pub fn node(script: &str) -> Option<Command> {
    let Some(packages) = std::env::var_os("OQTAL_PEERS_NODE") else {
        skipped("OQTAL_PEERS_NODE names no directory of packages; .ci/run installs them");
        return None;
    };
    let mut command = Command::new("node");
    command.env("NODE_PATH", Path::new(&packages).join("node_modules")).arg(script_path(script));
    Some(command)
}

/// The path of a file in `tests/peers`.
pub fn script_path(script: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(script)
}
