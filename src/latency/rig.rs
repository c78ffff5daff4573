//! Processes of a measurement: the test chain, and the bare mechanisms for comparison.
//!
//! ```text
//!  camera ─ pose ─▶ daemon ─ command ─▶ vehicle      the same daemon, in an instance of its own
//!       └─ futex, eventfd, ... ─▶ one receiver each     interleaved
//! ```

use std::collections::BTreeMap;
use std::fs;
use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{ClockKind, Config};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::latency::Distribution;
use oqtal_runtime::files;
use oqtal_runtime::flight_marker::FlightMarker;
use oqtal_runtime::process::{Exit, Failure, instance_paths};

use super::bare::{Mechanism, counter, directory, remove_iceoryx2};
use super::record::Record;
use super::{camera, part};
use crate::child::{Child, command};

/// Time-out for a process to start or to write its record.
const PROCESS_TIMEOUT: Span = Span::from_millis(10_000);
/// Duration of the hover flown during a measurement \[s\]; limits the length of a measurement.
const LONGEST_FLIGHT_S: f64 = 3600.0;

/// Latencies of the mechanisms without the bus, and of the camera's absolute sleeps.
#[derive(Debug, Default)]
pub struct Bare {
    /// Time from before the send until after the receive, by mechanism.
    pub mechanisms: BTreeMap<&'static str, Distribution>,
    /// Lateness of the camera after absolute sleeps.
    pub sleep: Distribution,
}

/// Running stand-ins in a separate instance. On drop they are ended and their files removed.
#[derive(Debug)]
pub struct Rig {
    config: Config,
    place: InstancePaths,
    directory: PathBuf,
    receivers: Vec<(Mechanism, Child)>,
    chain: Vec<Child>,
    camera: Option<Child>,
}

impl Rig {
    /// Instance beside the one of `config`, without processes.
    ///
    /// # Errors
    /// The files of the instance cannot be written.
    pub fn new(config: &Config) -> Result<Self, Failure> {
        let mut config = config.clone();
        let root = instance_paths(&config)?.root;
        config.instance.root = root.display().to_string();
        // A separate instance: a running one may control a real vehicle.
        config.instance.name = format!("latency-{}-{:016x}", std::process::id(), unguessable());
        config.clock.kind = ClockKind::Real;
        config.mocap.replay.clear();
        config.safety.observe_only = false;
        config.safety.vehicle_time_out_ms = f64::INFINITY;
        // Its poses stand still, whatever is commanded.
        config.safety.consistency_limit = 1e9;
        config.trajectory.kind = TrajectoryKind::Hover;
        config.trajectory.duration_s = Some(LONGEST_FLIGHT_S);
        let place = instance_paths(&config)?;
        let directory = directory(&config.instance.name);
        let rig = Self {
            config,
            place,
            directory,
            receivers: Vec::new(),
            chain: Vec::new(),
            camera: None,
        };
        let written = files::create_private_directory(&rig.directory)
            .and_then(|()| files::write(&rig.config_file(), rig.config.to_toml()));
        written.map_err(|e| failed(&rig.directory, &e))?;
        Ok(rig)
    }

    /// Configuration of the rig's processes.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Paths and names of the rig's instance.
    pub fn place(&self) -> &InstancePaths {
        &self.place
    }

    /// Directory of the rig's files.
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// Configuration of the rig.
    pub fn config_file(&self) -> PathBuf {
        self.directory.join("config.toml")
    }

    /// Starts the daemon and the stand-in for the vehicle.
    ///
    /// # Errors
    /// One of the processes cannot be started.
    pub fn start_chain(&mut self) -> Result<(), Failure> {
        for (name, words) in [("vehicle", &[part::COMMAND, "vehicle"][..]), ("daemon", &["daemon"])]
        {
            let command = command(words, &self.config_file())?;
            self.chain.push(Child::start(name, command, &self.directory)?);
        }
        Ok(())
    }

    /// Starts the receivers of all mechanisms and, when they are ready, the camera, which feeds them and the chain.
    ///
    /// # Errors
    /// One of the processes cannot be started, or ends at once.
    pub fn start_bare(&mut self) -> Result<(), Failure> {
        let file = self.config_file();
        let counter = counter()?;
        let duplicate =
            || counter.try_clone().map(Stdio::from).map_err(|e| failed(Path::new("eventfd"), &e));
        for mechanism in Mechanism::ALL {
            let mut command = command(&[part::COMMAND, mechanism.name()], &file)?;
            command.stdin(duplicate()?);
            let child = Child::start(mechanism.name(), command, &self.directory)?;
            self.receivers.push((mechanism, child));
        }
        self.wait_until_ready()?;
        let mut command = command(&[part::COMMAND, "camera"], &file)?;
        command.stdin(duplicate()?);
        self.camera = Some(Child::start("camera", command, &self.directory)?);
        Ok(())
    }

    fn wait_until_ready(&mut self) -> Result<(), Failure> {
        let give_up = Time::now() + PROCESS_TIMEOUT;
        for mechanism in Mechanism::ALL {
            let sign = self.directory.join(format!("{}.ready", mechanism.name()));
            while !sign.exists() {
                self.check()?;
                if Time::now() >= give_up {
                    let message = format!("the receiver of {} did not start", mechanism.name());
                    return Err(Failure::new(Exit::System, message));
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        }
        Ok(())
    }

    /// Ends the daemon, then the vehicle.
    pub fn stop_chain(&mut self) {
        while let Some(mut process) = self.chain.pop() {
            process.shut_down();
        }
    }

    /// Checks that all processes run.
    ///
    /// # Errors
    /// One of the processes has ended.
    pub fn check(&mut self) -> Result<(), Failure> {
        let receivers = self.receivers.iter_mut().map(|(_, receiver)| receiver);
        let all = self.camera.iter_mut().chain(&mut self.chain).chain(receivers);
        all.map(Child::failure).find_map(|failure| failure).map_or(Ok(()), Err)
    }

    /// Ends the camera and thereby the receivers, and reads their measurements between `from` and `to`.
    ///
    /// # Errors
    /// One of the processes left no record.
    pub fn finish(&mut self, from: Time, to: Time) -> Result<Bare, Failure> {
        if let Some(mut camera) = self.camera.take() {
            camera.shut_down();
        }
        let mut bare = Bare::default();
        for (mechanism, mut receiver) in self.receivers.drain(..) {
            // The camera's last message ends the receiver.
            receiver.ends_within(PROCESS_TIMEOUT);
            let file = self.directory.join(format!("{}.record", mechanism.name()));
            let spans = read(&file, from, to)?;
            bare.mechanisms.insert(mechanism.name(), spans);
        }
        bare.sleep = read(&self.directory.join(camera::RECORD), from, to)?;
        Ok(bare)
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.camera = None;
        self.stop_chain();
        self.receivers.clear();
        // The last process of an instance removes the shared memory of killed processes.
        drop(Bus::open(&self.place));
        remove_iceoryx2(&self.place);
        // Its poses end before its flight.
        FlightMarker::of(&self.place).remove();
        // A directory that cannot be removed occupies only a few kilobytes.
        let _ = fs::remove_dir_all(&self.directory);
    }
}

/// Unpredictable number, so that another user cannot create the rig's files first.
fn unguessable() -> u64 {
    // Keyed with random bytes of the operating system.
    RandomState::new().hash_one(std::process::id())
}

/// The spans of a record between `from` and `to`.
pub fn read(file: &Path, from: Time, to: Time) -> Result<Distribution, Failure> {
    let mut distribution = Distribution::default();
    for span in Record::load(file)?.within(from, to) {
        distribution.add(span);
    }
    Ok(distribution)
}

/// Failure of an access to the file `path`.
pub fn failed(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::new(Exit::System, format!("{}: {error}", path.display()))
}
