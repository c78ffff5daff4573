//! `oqtal fly`: one flight, from the command line to the report.

mod cameras;
mod directory;
mod fault;
mod flight_record;
mod landing;
mod paths;
mod process_group;
mod processes;
mod progress;
mod recording;
mod vehicle;
mod watch;

use std::path::{Path, PathBuf};

use clap::Args;
use oqtal_config::{ClockKind, Config, Fault, Setting, TimedDisturbance};
use oqtal_control::controller::ControllerName;
use oqtal_control::trajectory::{FlightPlan, TrajectoryKind};
use oqtal_lab::campaign::FlightSeries;
use oqtal_lab::faults;
use oqtal_lab::mission::Mission;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, PlantKeyArgs, check_instance};
use oqtal_runtime::program::{print, say};

use oqtal_observe::explain;
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_observe::summary::Summary;
use oqtal_observe::table;

use crate::provenance::PROVENANCE;
use crate::recordings;

use cameras::{MocapSource, PosePath};
use directory::FlightDirectory;
pub use directory::REPORT;
use paths::FlightPaths;
use processes::BusFlight;
use progress::Interrupts;
use vehicle::{CommandLink, VehicleChoice};

/// Number of loop periods above which a pose interval is a gap for the daemon, so that its state never becomes `Nominal` \[-\].
const MAX_POSE_INTERVAL_PERIODS: f64 = 3.5;

/// Arguments of `oqtal fly`.
#[derive(Args, Clone, Debug)]
pub struct FlyArgs {
    #[arg(long, value_name = "NAME", help = format!("Attitude law: {}, or external, a law in a process of its own", ControllerName::NAMES.join(", ")))]
    controller: Option<String>,
    /// Trajectory: hover, step, square, circle, lemniscate, attitude-chirp, attitude-doublet, excitation,
    /// brief-excitation or waypoints
    #[arg(long, value_name = "NAME")]
    trajectory: Option<String>,
    /// Duration of the trajectory without take-off and landing [s]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    duration: Option<f64>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<i64>,
    /// Clock of the flight: real time, or virtual time through processes or in this process
    #[arg(long, value_enum)]
    clock: Option<ClockKind>,
    /// Source of the poses: emulated; replay:FILE, a recording; qtm, vrpn or natnet, emulated cameras over the network; or
    /// link:LINK, real cameras, as in link:qtm:HOST,body=NAME
    #[arg(long, value_name = "SOURCE", value_parser = cameras::parse)]
    mocap: Option<MocapSource>,
    /// Vehicle: simulated, sim[:PRESET][,fidelity=eq61|rotors], where PRESET is hummingbird, spacecraft, crazyflie-2.1,
    /// ardupilot-quad, px4-quad or betaflight-quad; simulated behind a bridge and its protocol, bridge:asctec[,baud=N][,xbee=MODE],
    /// bridge:mavlink[,autopilot=px4|ardupilot], bridge:crtp or bridge:msp; or at a link, link:LINK, as link:asctec:PATH,
    /// link:mavlink:udpin:HOST:PORT, link:crtp:radio:CHANNEL/RATE/ADDRESS, link:msp:tcp:HOST:PORT
    #[arg(long, value_name = "VEHICLE", value_parser = vehicle::parse)]
    vehicle: Option<VehicleChoice>,
    /// True motion of the vehicle at a link, where it is a firmware that runs as a program, for the emulated cameras:
    /// crazyflie-sitl:udp:HOST:PORT[,crtp=HOST:PORT], betaflight-sitl:udp:HOST:PORT[,state=HOST:PORT], or mavlink:udpin:HOST:PORT
    #[arg(long, value_name = "SOURCE")]
    truth: Option<String>,
    /// Run receiver and daemon as one process, `oqtal chain`, which sends the commands to the port of the bridge
    #[arg(long)]
    chain: bool,
    #[arg(long = "fault", value_name = "TARGET:KIND[=VALUE]@TIME[+DURATION]", help = fault::HELP)]
    faults: Vec<Fault>,
    #[arg(long = "disturb", value_name = "KIND@TIME[+DURATION]=VALUE", help = fault::DISTURB_HELP)]
    disturb: Vec<TimedDisturbance>,
    #[command(flatten)]
    plant: PlantKeyArgs,
    /// Directory of the results [default: flights/INSTANCE-N]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace the files of a flight that the directory of --out holds
    #[arg(long, requires = "out")]
    force: bool,
    /// Print the summary as JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Explain each figure of the table in a line
    #[arg(long, conflicts_with = "json")]
    explain: bool,
    #[command(flatten)]
    common: CommonArgs,
}

/// A series of flights through processes, one after another.
#[derive(Debug)]
pub struct BusFlightSeries {
    interrupts: Interrupts,
    directory: PathBuf,
    replaces: bool,
}

impl BusFlightSeries {
    /// Series of flights written into `directory`. With `replaces`, of a resumed study or `--force`, flights that are there already are overwritten.
    ///
    /// # Errors
    /// The operating system refuses the signal handler.
    pub fn begin(directory: PathBuf, replaces: bool) -> Result<Self, Failure> {
        Ok(Self { interrupts: Interrupts::listen()?, directory, replaces })
    }
}

impl FlightSeries for BusFlightSeries {
    fn fly(&self, mission: &Mission, name: &str) -> Result<Flight, Failure> {
        let directory = Some(self.directory.join(name));
        let directory = match self.replaces {
            true => FlightDirectory::create_or_replace(directory.as_deref(), &mission.config)?,
            false => FlightDirectory::create(directory.as_deref(), &mission.config)?,
        };
        let (paths, interrupts) = (&FlightPaths::default(), &self.interrupts);
        let bus_flight = BusFlight { mission, paths, directory: &directory, interrupts };
        let (flight, recording) = bus_flight.fly()?;
        if interrupts.any() {
            return Err(Failure::new(Exit::Flight, "interrupted"));
        }
        recording.as_ref().map_or(Ok(()), recordings::check)?;
        Ok(flight)
    }
}

impl FlyArgs {
    /// Flies, prints the figures and writes the results.
    ///
    /// # Errors
    /// The flight could not be flown, or its results could not be written. A flight with a bad outcome gives an exit code, not an
    /// error.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let mut config = Config::load(&self.common.config, &self.settings()?)?;
        check_instance(&config)?;
        let commands = CommandLink::open(self.vehicle.as_ref(), &mut config)?;
        let poses = PosePath::open(self.mocap.as_ref(), &commands, &mut config)?;
        let paths = &FlightPaths { commands, poses, is_chain: self.chain };
        paths.check()?;
        faults::check(&config, &paths.roles(&config), ["--fault", "--disturb"])?;
        let mission = Mission::new(config)?;
        check_pose_rate(&mission)?;
        let warnings = oqtal_daemon::warnings(&mission.config, &mission.trajectory);
        let warnings = warnings.into_iter().chain(unscored_hover(&mission));
        warnings.for_each(|warning| say(&format!("oqtal: warning: {warning}")));
        if !self.json && has_default_law(&mission.config) {
            say("oqtal: flies the paper's law; for your own flights use --controller oqtal-dt");
        }
        let directory = match self.force {
            true => FlightDirectory::create_or_replace(self.out.as_deref(), &mission.config)?,
            false => FlightDirectory::create(self.out.as_deref(), &mission.config)?,
        };
        let interrupts = &Interrupts::listen()?;
        let bus_flight = BusFlight { mission: &mission, paths, directory: &directory, interrupts };
        let (flight, recording) = match mission.config.clock.kind {
            ClockKind::InProcess => bus_flight.fly_in_process()?,
            ClockKind::Real | ClockKind::Lockstep => bus_flight.fly()?,
        };
        let recorded = recording.as_ref().and_then(|recording| recording.files.first());
        let exit = self.conclude(&flight, &directory, recorded.map(PathBuf::as_path))?;
        if let Some(path) = recorded.filter(|path| **path != directory.recording()) {
            say(&format!("oqtal: the recording is now {}", path.display()));
        }
        recording.as_ref().map_or(Ok(()), recordings::check).map(|()| exit)
    }

    /// Prints the figures and writes the files: each also if the other fails, since the disk is full or the terminal was closed.
    fn conclude(
        &self,
        flight: &Flight,
        directory: &FlightDirectory,
        recorded: Option<&Path>,
    ) -> Result<Exit, Failure> {
        let summary = Summary::of(flight);
        let mut figures =
            if self.json { summary.to_json(PROVENANCE) } else { table::closing(&summary) };
        if self.explain {
            figures += &format!("\n\n{}\n", explain::text(&explain::terms(flight, &summary)));
        }
        let printed = print(&figures);
        directory.write(flight, &summary, recorded)?;
        printed?;
        if !self.json {
            print(&format!("report: {}", directory.report().display()))?;
        }
        if let Some(shortfall) = &summary.shortfall {
            say(&format!("oqtal: {shortfall}"));
            // A landing that the operator requested is a success: the flight ended as last asked for.
            let is_requested = flight.outcome == Outcome::Landed
                && flight.landing_on_request().as_ref() == Some(shortfall);
            return Ok(if is_requested { Exit::Ok } else { Exit::Flight });
        }
        match flight.outcome {
            Outcome::Landed | Outcome::Replayed | Outcome::Observed => Ok(Exit::Ok),
            Outcome::Stopped | Outcome::Crashed | Outcome::Timeout | Outcome::Unfinished => {
                Ok(Exit::Flight)
            }
        }
    }

    /// The flags as settings of the configuration.
    fn settings(&self) -> Result<Vec<Setting>, Failure> {
        let mut settings = self.common.settings()?;
        settings.extend(self.plant.settings()?);
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
        let faults: Vec<String> = self.faults.iter().map(ToString::to_string).collect();
        set("--fault", "fault.inject", (!faults.is_empty()).then(|| faults.into()));
        let loads: Vec<String> = self.disturb.iter().map(ToString::to_string).collect();
        set("--disturb", "plant.disturb", (!loads.is_empty()).then(|| loads.into()));
        if let Some(source) = &self.mocap {
            source.settings(&mut settings);
        }
        if let Some(vehicle) = &self.vehicle {
            vehicle.settings(&mut settings);
        }
        if let Some(truth) = &self.truth {
            settings.push(Setting::flag(
                "--truth",
                "plant.truth",
                toml::Value::from(truth.as_str()),
            ));
        }
        Ok(settings)
    }
}

/// Whether nothing but the built-in configuration chose the law of the paper.
fn has_default_law(config: &Config) -> bool {
    let is_chosen = config.is_set("control.controller");
    !is_chosen && config.control.controller == ControllerName::Oqtal && !config.is_replay()
}

/// Warning of a hover in real time that is too short to be scored, which its table would say only after the flight.
fn unscored_hover(Mission { config, trajectory, .. }: &Mission) -> Option<String> {
    let plan = FlightPlan::from_origin(&config.trajectory, trajectory);
    let is_short =
        config.trajectory.kind == TrajectoryKind::Hover && !plan.scored(plan.planned_landing_s());
    (is_short && config.clock.kind == ClockKind::Real).then(|| {
        "nothing of this flight is scored: scoring of a hover begins 10 s after it is reached; give a longer --duration".to_owned()
    })
}

/// Fails if the pose rate of a recording is too low for a single tick of the loop.
fn check_pose_rate(mission: &Mission) -> Result<(), Failure> {
    let Some(recording) = &mission.recording else { return Ok(()) };
    let (poses_hz, loop_hz) = (recording.nominal_rate_hz(), mission.config.control.rate_hz);
    if loop_hz <= MAX_POSE_INTERVAL_PERIODS * poses_hz {
        return Ok(());
    }
    let message = format!(
        "{}: its poses arrive at {poses_hz:.1} Hz, too rarely for a loop at {loop_hz} Hz, which would not make one tick; \
         play it with --set control.rate-hz={}",
        mission.config.mocap.replay,
        poses_hz.round().max(1.0)
    );
    Err(Failure::new(Exit::Config, message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hover_in_real_time_without_a_scored_part_is_told() {
        let told = |seconds: f64, clock: &str| {
            let settings = [
                Setting::flag("test", "trajectory.kind", "hover"),
                Setting::flag("test", "trajectory.hover.duration-s", seconds),
                Setting::flag("test", "clock.kind", clock),
            ];
            let config = Config::from_settings(&settings).unwrap();
            unscored_hover(&Mission::new(config).unwrap()).is_some()
        };
        assert!(told(3.0, "real") && !told(30.0, "real") && !told(3.0, "in-process"));
    }

    #[test]
    fn only_a_file_that_chooses_a_law_is_a_choice_of_the_law() {
        let with = |text: &str| has_default_law(&Config::parse("my.toml", text, &[]).unwrap());
        assert!(with("[vehicle]\nrate-lag-ms = 55.0\n"));
        assert!(!with("[control]\ncontroller = \"oqtal\"\n"));
        assert!(!with("[control]\ncontroller = \"pid\"\n"));
    }
}
