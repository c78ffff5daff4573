//! Processes of a laboratory: an emulated vehicle behind its radio, bridge, cameras and daemon.

use std::path::Path;
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, OperatorCommand};
use oqtal_bus::control::ControlClient;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::time::Span;
use rustix::process::Signal;

use super::resources::{Resources, usage};
use crate::common::random::Random;
use crate::common::{Running, Testbed, is_alive, stderr, wait_for};

/// Processes, in start order.
pub const PROCESSES: [&str; 4] = ["plant-sim", "mocap-emu", "bridge", "daemon"];

/// Index of the bridge.
const BRIDGE: usize = 2;

pub struct Laboratory {
    testbed: Testbed,
    config: std::path::PathBuf,
    running: [Option<Running>; 4],
    client: ControlClient,
    pub bus: Bus,
}

impl Laboratory {
    /// Starts all processes, with faults of the topics for `seconds` of flight.
    pub fn new(random: &mut Random, seconds: u64) -> Self {
        let testbed = Testbed::new("soak");
        let link = format!("asctec:{}", testbed.path("wire").display());
        let mut faults = Vec::new();
        let mut at_s = 4.0;
        while at_s < seconds as f64 {
            faults.push(format!("\"{}\"", topic_fault(random, at_s)));
            at_s += random.between(1.0, 6.0);
        }
        let text = format!(
            "clock.seed = 7\nplant.wire.link = \"{link}\"\nbridge.link = \"{link}\"\n\
             safety.allow-emulated-poses = true\nbridge.vehicle-time-out-ms = 1000.0\n\
             trajectory.kind = \"hover\"\ntrajectory.duration-s = 600.0\n\
             fault.inject = [{}]\n",
            faults.join(", ")
        );
        let config = testbed.write("soak.toml", &text);
        let bus = testbed.bus();
        let client = bus.control_client().unwrap();
        let mut laboratory = Self { testbed, config, running: [const { None }; 4], client, bus };
        for process in 0..PROCESSES.len() {
            laboratory.start(process);
        }
        laboratory
    }

    pub fn start(&mut self, process: usize) {
        let config = self.config.display().to_string();
        let mut command = self.testbed.oqtal(&[PROCESSES[process], "run", "--config", &config]);
        let log = self.testbed.path(&format!("{}.log", PROCESSES[process]));
        let log = std::fs::File::options().create(true).append(true).open(log).unwrap();
        self.running[process] = Some(Running::start_with_stderr(&mut command, log.into()));
        if process == 0 {
            self.wait_for_the_wire();
        }
    }

    /// The bridge does not start without its port.
    fn wait_for_the_wire(&self) {
        let link = self.testbed.path("wire");
        wait_for("the wire", || Path::new(&std::fs::read_link(&link).ok()?).exists().then_some(()));
    }

    pub fn kill(&mut self, process: usize) {
        let killed = self.running[process].take().unwrap();
        killed.signal(Signal::KILL);
        let output = killed.wait();
        let code = output.status.code();
        let by_itself = code.is_some() && !is_without_port(process, code);
        assert!(!by_itself, "{} ended by itself: {}", PROCESSES[process], self.log(process));
    }

    pub fn pause(&self, process: usize, duration: Duration) {
        let process = self.running[process].as_ref().unwrap();
        process.signal(Signal::STOP);
        std::thread::sleep(duration);
        process.signal(Signal::CONT);
    }

    /// Restarts the simulator, which returns the vehicle to its start.
    pub fn restart_plant(&mut self) {
        let plant = self.running[0].take().unwrap();
        plant.signal(Signal::TERM);
        let output = plant.wait();
        assert!(output.status.success(), "{}", stderr(&output));
        self.start(0);
    }

    /// Restarts the bridge, like a service manager, if it found no port while the plant was being replaced.
    pub fn revive(&mut self) {
        let ended = self.running[BRIDGE].as_ref().is_some_and(|bridge| !is_alive(bridge.id()));
        if ended {
            self.kill(BRIDGE);
            self.start(BRIDGE);
        }
    }

    /// Sends an operator's command; false if it is refused or not answered.
    pub fn ask(&self, command: OperatorCommand) -> bool {
        let request = ControlRequestV1::of(command);
        let answer = self.client.ask(request, Span::from_millis(1000)).unwrap();
        answer.is_some_and(|answer| answer.answer != Answer::Refused.code())
    }

    /// Log of a process.
    fn log(&self, process: usize) -> String {
        let log = self.testbed.path(&format!("{}.log", PROCESSES[process]));
        std::fs::read_to_string(log).unwrap_or_default()
    }

    /// Present resource use of the processes; all must be running.
    pub fn resources(&self) -> Resources {
        for (process, running) in self.running.iter().enumerate() {
            let is_alive = running.as_ref().is_some_and(|running| is_alive(running.id()));
            assert!(is_alive, "{} ended by itself: {}", PROCESSES[process], self.log(process));
        }
        let pids = self.running.iter().map(|process| process.as_ref().unwrap().id());
        Resources { shared: self.testbed.remains().len(), processes: pids.map(usage).collect() }
    }

    /// Ends all processes and checks that no files remain.
    pub fn end(mut self) {
        for process in self.running.iter_mut().rev().filter_map(Option::take) {
            process.signal(Signal::TERM);
            let output = process.wait();
            assert!(output.status.success(), "{:?}", output.status);
        }
        let Self { testbed, client, bus, .. } = self;
        drop(client);
        drop(bus);
        assert!(testbed.remains().is_empty(), "{:?}", testbed.remains());
    }
}

/// Whether a process is a bridge that found no port at its start.
fn is_without_port(process: usize, code: Option<i32>) -> bool {
    process == BRIDGE && code == Some(oqtal_runtime::process::Exit::System as i32)
}

/// A short fault of a topic or of the radio at a time of the flight.
fn topic_fault(random: &mut Random, at_s: f64) -> String {
    let target = random.pick(&["pose", "pose", "command", "vehicle", "radio"]);
    let kinds: &[&str] = match target {
        "pose" => &[
            "off",
            "stuck",
            "garbage",
            "wrong=0.4m",
            "frozen-noise",
            "noise",
            "drift=1m/s",
            "mirror",
            "rotate",
            "slow=20Hz",
            "delayed=40ms",
            "intermittent",
        ],
        "radio" => &["off", "delayed=40ms", "intermittent"],
        _ => &["off", "stuck", "garbage", "wrong", "slow=20Hz", "delayed=40ms", "intermittent"],
    };
    let duration_s = random.pick(&[0.03, 0.05, 0.1, 0.15]);
    format!("{target}:{}@{at_s:.3}+{duration_s}", random.pick(kinds))
}
