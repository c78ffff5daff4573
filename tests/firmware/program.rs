//! Firmware executed as a program in a separate network, since some programs listen on every address of the machine.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use super::relay::RelayPorts;
use crate::common::{skipped, wait_for};

/// Description of a firmware and of its start.
pub struct Firmware {
    pub name: &'static str,
    /// Environment variable with the path of the program.
    pub variable: &'static str,
    /// Preset of the vehicle.
    pub preset: &'static str,
    /// Link of the vehicle for the bridge.
    pub link: &'static str,
    /// Link through a relay, and the relay's addresses.
    pub relayed_link: &'static str,
    pub ports: RelayPorts,
    /// Source of the truth for the simulator.
    pub truth: &'static str,
    /// Time from the start until the vehicle can be armed: it levels and checks its sensors.
    pub boot: Duration,
    /// Words before the path of the program.
    pub before: &'static [&'static str],
    /// Whether `oqtal bridge setup --apply` sets the vehicle up, once and before its flights.
    pub is_set_up: bool,
    /// Appends the arguments of the program, which starts in a separate directory.
    pub arguments: fn(&Path, &mut Command),
    /// Parameters that differ from the firmware's defaults, in its own format; written to the file `parameters` of its directory.
    pub parameters: &'static str,
    /// Lines of configuration that make the battery empty in flight.
    pub battery: &'static [&'static str],
}

/// Running firmware and its network; both end on drop.
pub struct FirmwareProcess {
    command: Command,
    child: Option<Child>,
    network: String,
}

impl Firmware {
    /// Path of the program; `None`, with a message, if the variable is not set.
    pub fn path(&self) -> Option<PathBuf> {
        let path = std::env::var_os(self.variable).map(PathBuf::from);
        if path.is_none() {
            skipped(&format!("set {} to the path of the program", self.variable));
        }
        path
    }

    /// Makes a network for the program at `path`, which will start in `directory`.
    pub fn prepare(&self, path: &Path, directory: &Path) -> FirmwareProcess {
        std::fs::create_dir_all(directory).unwrap();
        std::fs::write(directory.join("parameters"), self.parameters).unwrap();
        let network = format!("oqtal-firmware-{}", std::process::id());
        ip(&["netns", "add", &network]);
        ip(&["-n", &network, "link", "set", "lo", "up"]);
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &network]).args(self.before).arg(path);
        (self.arguments)(path, &mut command);
        let log = std::fs::File::create(directory.join("output")).unwrap();
        command.current_dir(directory).stdin(Stdio::null());
        command.stdout(log.try_clone().unwrap()).stderr(log);
        let mut process = FirmwareProcess { command, child: None, network };
        if self.is_set_up {
            process.run();
            wait_for("a vehicle that is set up", || {
                let mut setup = Command::new(env!("CARGO_BIN_EXE_oqtal"));
                let preset = format!("vehicle.preset={}", self.preset);
                setup.args(["bridge", "setup", self.link, "--apply", "--set", &preset]);
                process.beside(&setup).output().unwrap().status.success().then_some(())
            });
            process.end();
        }
        process
    }

    /// Starts the program at `path` in `directory`, and waits until it can be armed.
    pub fn start(&self, path: &Path, directory: &Path) -> FirmwareProcess {
        let mut process = self.prepare(path, directory);
        process.run();
        std::thread::sleep(self.boot);
        process
    }
}

impl FirmwareProcess {
    /// Name of the network.
    pub fn network(&self) -> &str {
        &self.network
    }

    /// Starts the program, or restarts it.
    pub fn run(&mut self) {
        self.end();
        self.child = Some(self.command.spawn().unwrap());
    }

    fn end(&mut self) {
        if let Some(mut child) = self.child.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }

    /// `command` in the network of the firmware.
    pub fn beside(&self, command: &Command) -> Command {
        let mut beside = Command::new("ip");
        beside.args(["netns", "exec", &self.network]).arg(command.get_program());
        beside.args(command.get_args()).stdin(Stdio::null());
        // The paths of programs are not settings of the configuration.
        for name in ["OQTAL_CRAZYFLIE", "OQTAL_ARDUCOPTER", "OQTAL_PX4", "OQTAL_BETAFLIGHT"] {
            beside.env_remove(name);
        }
        for (name, value) in command.get_envs() {
            match value {
                Some(value) => beside.env(name, value),
                None => beside.env_remove(name),
            };
        }
        if let Some(directory) = command.get_current_dir() {
            beside.current_dir(directory);
        }
        beside
    }
}

impl Drop for FirmwareProcess {
    fn drop(&mut self) {
        self.end();
        ip(&["netns", "delete", &self.network]);
    }
}

fn ip(words: &[&str]) {
    let done = Command::new("ip").args(words).status().expect("ip of iproute2");
    assert!(done.success(), "ip {words:?}: only root may create networks");
}
