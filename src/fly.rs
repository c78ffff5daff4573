//! `oqtal fly`: one flight, from the command line to the report.

mod crew;
mod in_process;
mod observer;
mod output;
mod processes;
mod progress;
mod vehicle;

use std::path::PathBuf;

use clap::Args;
use oqtal_bus::config::{ClockKind, Config, Setting, Vehicle};
use oqtal_bus::process::{CommonArgs, Exit, Failure};
use oqtal_bus::program::print;
use oqtal_bus::time::Span;
use oqtal_control::trajectory::{FlightPlan, Place, Trajectory};
use oqtal_mocap_emu::{Recording, read_recording};

use crate::flight::{Flight, Outcome};
use crate::summary::Summary;

use vehicle::VehicleChoice;

pub use in_process::fly as fly_in_process;
use progress::Interrupts;
pub use vehicle::Way;

/// Beyond its plan a flight may take this long, for the cameras to be believed and the landing to be noticed.
const GRACE_S: f64 = 15.0;

/// What to fly, and how.
#[derive(Args, Clone, Debug)]
pub struct FlyArgs {
    /// pid, lqr, oqtal, oqtal-dt or geometric
    #[arg(long, value_name = "NAME")]
    controller: Option<String>,
    /// hover, step, square, circle, lemniscate, attitude-chirp, attitude-doublet or waypoints
    #[arg(long, value_name = "NAME")]
    trajectory: Option<String>,
    /// Duration of the trajectory itself, without take-off and landing, in seconds
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Seed of all randomness
    #[arg(long, value_name = "N")]
    seed: Option<i64>,
    /// What drives the flight
    #[arg(long, value_enum)]
    clock: Option<ClockKind>,
    /// emulated, or replay:FILE to play a recording
    #[arg(long, value_name = "SOURCE", value_parser = parse_mocap)]
    mocap: Option<MocapSource>,
    /// What flies: `sim[:hummingbird|:spacecraft][,fidelity=eq61|rotors]`; `bridge:asctec[,baud=..][,xbee=..]`, the simulated one
    /// through a bridge and a radio's bytes; `link:LINK`, whatever is at that link
    #[arg(long, value_name = "VEHICLE", value_parser = vehicle::parse)]
    vehicle: Option<VehicleChoice>,
    /// Where the flight is written; flights/INSTANCE-N without
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print the summary as JSON instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Clone, Debug)]
enum MocapSource {
    Emulated,
    Replay(String),
}

fn parse_mocap(text: &str) -> Result<MocapSource, String> {
    match text.split_once(':') {
        None if text == "emulated" => Ok(MocapSource::Emulated),
        Some(("replay", file)) if !file.is_empty() => Ok(MocapSource::Replay(file.to_owned())),
        _ => Err("use `emulated` or `replay:FILE`".to_owned()),
    }
}

/// A clock as a configuration has it.
pub(crate) fn clock_name(clock: ClockKind) -> &'static str {
    match clock {
        ClockKind::Real => "real",
        ClockKind::Lockstep => "lockstep",
        ClockKind::InProcess => "in-process",
    }
}

/// Flights through processes, one after another.
#[derive(Debug)]
pub struct Series {
    interrupts: Interrupts,
    directory: Option<PathBuf>,
}

impl Series {
    /// A series whose flights are written into `directory`; each into `flights/INSTANCE-N` without.
    ///
    /// # Errors
    /// The operating system refuses to hand on signals.
    pub fn begin(directory: Option<PathBuf>) -> Result<Self, Failure> {
        Ok(Self { interrupts: Interrupts::listen()?, directory })
    }

    /// Flies `mission`, which is called `name` in the series.
    ///
    /// # Errors
    /// The flight could not be flown, or an operator ended the series.
    pub fn fly(&self, mission: &Mission, name: &str) -> Result<Flight, Failure> {
        let directory = self.directory.as_ref().map(|directory| directory.join(name));
        let output = output::Output::create(directory.as_deref(), &mission.config)?;
        let flight = processes::fly(mission, &output, &self.interrupts)?;
        if self.interrupts.came() {
            return Err(Failure::new(Exit::Flight, "interrupted"));
        }
        Ok(flight)
    }
}

/// What a flight needs to know before it starts.
#[derive(Debug)]
pub struct Mission {
    /// The effective configuration.
    pub config: Config,
    /// What is flown.
    pub trajectory: Trajectory,
    /// What is played instead of the cameras, if anything.
    pub recording: Option<Recording>,
    /// How commands reach what flies.
    pub way: Way,
    /// What really flies, if it is not what the daemon believes: for studies of robustness, in one process only.
    pub plant: Option<Vehicle>,
}

impl Mission {
    /// Reads what the configuration names.
    ///
    /// # Errors
    /// A waypoint file or a recording is bad (exit code 65), or an option of the law has no meaning (78).
    pub fn new(config: Config) -> Result<Self, Failure> {
        oqtal_daemon::Pilot::new(&config).map_err(|reason| Failure::new(Exit::Config, reason))?;
        let trajectory = oqtal_daemon::trajectory(&config)?;
        let recording = match config.is_replay() {
            true => Some(read_recording(&config.mocap.replay)?),
            false => None,
        };
        Ok(Self { config, trajectory, recording, way: Way::Bus, plant: None })
    }

    /// How long it takes if all goes well.
    #[must_use]
    pub fn expected(&self) -> Span {
        if let Some(recording) = &self.recording {
            let last = recording.poses().last().map_or(0, |pose| pose.time_ns);
            return Span::from_nanos(last.cast_signed());
        }
        let options = &self.config.trajectory;
        let plan = FlightPlan::new(options, self.trajectory.clone(), Place::default());
        Span::from_seconds(plan.end_s())
    }

    /// How long it may take.
    #[must_use]
    pub fn patience(&self) -> Span {
        match self.recording {
            Some(_) => self.expected(),
            None => self.expected() + Span::from_seconds(GRACE_S),
        }
    }

    /// What a flight is called that did not end by itself.
    #[must_use]
    pub fn otherwise(&self) -> Outcome {
        if self.recording.is_some() { Outcome::Replayed } else { Outcome::Timeout }
    }
}

impl FlyArgs {
    /// Flies.
    ///
    /// # Errors
    /// The flight could not be flown; a flight that ended badly is a result.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let mut config = Config::load(self.common.config.as_deref(), &self.settings()?)?;
        let way = Way::open(self.vehicle.as_ref(), &mut config)?;
        let mission = Mission { way, ..Mission::new(config)? };
        let output = output::Output::create(self.out.as_deref(), &mission.config)?;
        let flight = match mission.config.clock.kind {
            ClockKind::InProcess => in_process::fly_with_progress(&mission)?,
            ClockKind::Real | ClockKind::Lockstep => {
                processes::fly(&mission, &output, &Interrupts::listen()?)?
            }
        };
        self.conclude(&flight, &output)
    }

    fn conclude(&self, flight: &Flight, output: &output::Output) -> Result<Exit, Failure> {
        let summary = Summary::of(flight);
        output.write(flight, &summary)?;
        if self.json {
            print(&summary.to_json())?;
        } else {
            output.print(&summary)?;
        }
        match flight.outcome {
            Outcome::Landed | Outcome::Replayed => Ok(Exit::Ok),
            Outcome::Stopped | Outcome::Crashed | Outcome::Timeout => Ok(Exit::Flight),
        }
    }

    /// The flags as settings.
    fn settings(&self) -> Result<Vec<Setting>, Failure> {
        let mut settings = self.common.settings()?;
        let mut set = |flag: &str, key: &str, value: Option<toml::Value>| {
            if let Some(value) = value {
                settings.push(Setting::flag(flag, key, value));
            }
        };
        set("--controller", "control.controller", self.controller.clone().map(Into::into));
        set("--trajectory", "trajectory.kind", self.trajectory.clone().map(Into::into));
        set("--duration", "trajectory.duration-s", self.duration.map(Into::into));
        set("--seed", "clock.seed", self.seed.map(Into::into));
        set("--clock", "clock.kind", self.clock.map(|clock| clock_name(clock).into()));
        let replay = self.mocap.as_ref().map(|source| match source {
            MocapSource::Emulated => "".into(),
            MocapSource::Replay(file) => file.as_str().into(),
        });
        set("--mocap", "mocap.replay", replay);
        if let Some(vehicle) = &self.vehicle {
            vehicle.settings(&mut settings);
        }
        Ok(settings)
    }
}
