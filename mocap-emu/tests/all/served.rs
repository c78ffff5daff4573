//! Camera system in a separate process for the tests: `oqtal-mocap-emu serve`.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use serde_json::Value;

/// A running server; killed when dropped.
pub struct Served {
    child: Child,
    report: Value,
}

impl Served {
    /// Starts the server and waits until it prints its endpoints.
    pub fn start(arguments: &[&str]) -> Self {
        let mut child = command(arguments).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let report = serde_json::from_str(&line);
        let report = report.unwrap_or_else(|error| panic!("{arguments:?}: `{line}`: {error}"));
        Self { child, report }
    }

    /// Address of a service, as `127.0.0.1:4000`.
    pub fn address(&self, protocol: &str, service: &str) -> String {
        let endpoints = self.report["endpoints"].as_array().unwrap();
        let found = endpoints.iter().find(|at| at["protocol"] == protocol && at["what"] == service);
        found.expect("an endpoint")["address"].as_str().unwrap().to_owned()
    }

    /// Port of a service.
    pub fn port(&self, protocol: &str, service: &str) -> u16 {
        self.address(protocol, service).rsplit_once(':').unwrap().1.parse().unwrap()
    }

    /// Whether the process runs.
    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The command `serve` with these arguments.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal-mocap-emu"));
    command.args(["serve", "--json"]).args(arguments).stdin(Stdio::null()).stderr(Stdio::null());
    command
}
