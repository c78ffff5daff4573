//! `oqtal fly`: one flight, from the command line to the report.

mod output;
mod process_group;
mod processes;
mod progress;
mod vehicle;

use std::path::PathBuf;

use clap::Args;
use oqtal_config::{ClockKind, Config, Setting};
use oqtal_control::controller::ControllerName;
use oqtal_lab::campaign::FlightSeries;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation;
use oqtal_runtime::process::{CommonArgs, Exit, Failure};
use oqtal_runtime::program::print;

use oqtal_observe::flight::{Flight, Outcome};
use oqtal_observe::summary::Summary;

use vehicle::VehicleChoice;

use progress::{Interrupts, Progress};
use vehicle::VehicleLink;

/// What to fly, and how.
#[derive(Args, Clone, Debug)]
pub struct FlyArgs {
    #[arg(long, value_name = "NAME", help = format!("Attitude law: {}", ControllerName::NAMES.join(", ")))]
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
}

impl FlightSeries for Series {
    fn fly(&self, mission: &Mission, name: &str) -> Result<Flight, Failure> {
        let directory = self.directory.as_ref().map(|directory| directory.join(name));
        let output = output::Output::create(directory.as_deref(), &mission.config)?;
        let flight = processes::fly(mission, &VehicleLink::Bus, (&output, &self.interrupts))?;
        if self.interrupts.came() {
            return Err(Failure::new(Exit::Flight, "interrupted"));
        }
        Ok(flight)
    }
}

impl FlyArgs {
    /// Flies.
    ///
    /// # Errors
    /// The flight could not be flown; a flight that ended badly is a result.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let mut config = Config::load(self.common.config.as_deref(), &self.settings()?)?;
        let link = VehicleLink::open(self.vehicle.as_ref(), &mut config)?;
        let mission = Mission::new(config)?;
        let output = output::Output::create(self.out.as_deref(), &mission.config)?;
        let flight = match mission.config.clock.kind {
            ClockKind::InProcess => fly_in_process(&mission)?,
            ClockKind::Real | ClockKind::Lockstep => {
                processes::fly(&mission, &link, (&output, &Interrupts::listen()?))?
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
        set("--clock", "clock.kind", self.clock.map(|clock| clock.name().into()));
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

/// Flies in this process, with progress in the terminal and Ctrl-C.
fn fly_in_process(mission: &Mission) -> Result<Flight, Failure> {
    let progress = Progress::new(mission.expected());
    let interrupts = Interrupts::listen()?;
    let flight = simulation::fly_watched(mission, |recorder| {
        progress.show(recorder);
        interrupts.next()
    });
    progress.finish();
    flight
}
