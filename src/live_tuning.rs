//! `oqtal tune --live`: gains for the vehicle that hovers under a running daemon.

mod hover;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::EventV1;
use oqtal_bus::origin::Origin;
use oqtal_bus::paths::{InstancePaths, quoted};
use oqtal_bus::time::Time;
use oqtal_config::{Config, Interface, Setting};
use oqtal_control::trajectory::{TrajectoryKind, TrajectoryOptions};
use oqtal_lab::identify::identification::Identification;
use oqtal_lab::identify::{overview, vehicle_toml};
use oqtal_lab::output::{CONFIG, check_free, make, next_free, write_file};
use oqtal_lab::progress::Progress;
use oqtal_lab::tune::live::{self, LiveTuning};
use oqtal_lab::tune::trade::too_little_margin;
use oqtal_lab::tune::tuned::Tuned;
use oqtal_lab::tune::{LiveArgs, TuneArgs, page};
use oqtal_observe::law_query::{NoAnswer, changed_before};
use oqtal_observe::recording::{McapRecorder, RecordingPlan};
use oqtal_operator::request::{running_bus, silent, unanswered};
use oqtal_operator::{AddressedInstance, CtlRequest, execute as execute_request};
use oqtal_runtime::process::{Exit, Failure, instance_paths, place_settings};
use oqtal_runtime::program::{print, say};

use crate::daemon_config::daemon_config;
use crate::provenance::PROVENANCE;
use crate::recordings;
use hover::ObservedHover;

/// Time in which a running daemon publishes a tick \[s\].
const FIRST_TICK_S: f64 = 1.0;
/// Time in which the vehicle comes to rest, or settles with other gains \[s\].
const SETTLE_S: f64 = 3.0;
/// Time over which the error of a hover is measured \[s\].
const HOVER_S: f64 = 6.0;

/// Whether the daemon was asked to use the new gains.
static ARE_CHANGED: AtomicBool = AtomicBool::new(false);

/// Tunes the law that flies for the vehicle that hovers, and with `--apply` changes its gains.
///
/// # Errors
/// No daemon answers (exit code 75), the vehicle does not stay in a hover, or the gains found have too
/// little margin (1), the vehicle or its law cannot be
/// tuned (64), or a file cannot be written (71).
pub fn execute(args: &TuneArgs) -> Result<Exit, Failure> {
    let search = (&args.budget(), args.weights()?, &*args.options());
    let LiveArgs { instance, root, apply, least_margin_ratio, .. } = &args.live;
    let place: Vec<_> = place_settings(instance.as_deref(), root.as_deref()).collect();
    let paths = instance_paths(&Config::load(&[], &place)?)?;
    let bus = running_bus(&paths)?;
    let config = daemon_config(&paths).ok_or_else(|| silent(&paths))?;
    let present = present_settings(&bus)?;
    let law = Config::from_settings(&present)?.control.controller.name();
    let mut hover = ObservedHover::open(&bus, &config)?;
    hover.follow(FIRST_TICK_S, None)?;
    let files = LiveTuningFiles::begin(args, law)?;
    tell_on_interrupt(&paths)?;

    say(&format!("oqtal: stops, and measures the error of its hover for {HOVER_S} s"));
    ask(&bus, CtlRequest::Hover, &[])?;
    hover.follow(SETTLE_S, None)?;
    let before_m = hover.error_m(HOVER_S)?;
    fly_excitation(&bus, &config, &mut hover, &files.recording)?;
    let flight = recordings::read_flight(&files.recording)?;
    require_undisturbed(&flight.changes)?;
    say("oqtal: identifies the vehicle and searches for gains, while it hovers");
    // The daemon may run on this machine: the search must not disturb it. A failure is harmless.
    let _ = rustix::process::nice(19);
    let identification = live::identified(&flight, &present)?;
    files.write_vehicle(&identification, (&paths, &Config::from_settings(&present)?))?;
    let kept = files.with_config(&paths, &present);
    let found = live::tune(identification, &kept, search, &Progress::default())?;
    files.write(&found)?;
    let tuned = &found.tuned;
    match (tuned.objective < tuned.start, *apply) {
        (false, _) => Ok(Exit::Ok),
        (true, false) => propose(tuned, &paths),
        (true, true) => {
            require_unchanged(present_settings(&bus), &present)?;
            // Margins are known of vehicles that are commanded by rates.
            if config.vehicle.interface == Interface::Rate {
                require_margin(tuned, *least_margin_ratio, &paths)?;
            }
            apply_gains(tuned, (&bus, &config), before_m)
        }
    }
}

/// Fails unless the settings `now` are those `before` the search.
fn require_unchanged(
    now: Result<Vec<Setting>, Failure>,
    before: &[Setting],
) -> Result<(), Failure> {
    match now {
        Ok(now) if now == before => Ok(()),
        Ok(_) => Err(Failure::new(
            Exit::Flight,
            "settings were changed during the search; nothing was applied, repeat the command",
        )),
        Err(Failure { exit, message }) => Err(Failure::new(
            exit,
            format!(
                "nothing was applied: settings may have been changed during the search: {message}"
            ),
        )),
    }
}

/// Fails if `tuned` has a disk margin below `least` \[-\], and proposes it instead.
fn require_margin(tuned: &Tuned, least: f64, paths: &InstancePaths) -> Result<(), Failure> {
    let Some(reason) = too_little_margin(&tuned.components, least) else { return Ok(()) };
    propose(tuned, paths)?;
    let remedy = "search for softer gains with a greater weight of the jitter (--weights), or lower --least-disk-margin";
    Err(Failure::new(Exit::Flight, format!("nothing was applied: {reason}; {remedy}")))
}

/// Tells the operator on a signal that the vehicle flies on, and ends the command.
fn tell_on_interrupt(paths: &InstancePaths) -> Result<(), Failure> {
    let place = paths.flags();
    let text = format!(
        "oqtal: interrupted; a vehicle in flight flies on: `oqtal ctl hover {place}` or `oqtal ctl land {place}`"
    );
    let undo =
        format!("oqtal: the new gains may be in use: `oqtal ctl undo {place}` takes them back");
    let handler = move || {
        say(&text);
        if ARE_CHANGED.load(Ordering::Relaxed) {
            say(&undo);
        }
        std::process::exit(i32::from(Exit::Flight as u8));
    };
    ctrlc::set_handler(handler)
        .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))
}

/// The files of the results.
struct LiveTuningFiles {
    recording: PathBuf,
    gains: PathBuf,
    page: PathBuf,
    vehicle: PathBuf,
    /// Copy of the daemon's configuration, which its directory loses when it ends.
    config: PathBuf,
}

impl LiveTuningFiles {
    /// The files for the gains of `law`, in a directory that is made; none of them may exist.
    fn begin(args: &TuneArgs, law: &str) -> Result<Self, Failure> {
        if args.out.as_ref().is_some_and(|out| out.extension().is_some_and(|end| end == "toml")) {
            let reason = "--out: with --live, give a directory";
            return Err(Failure::new(Exit::Usage, reason));
        }
        let directory = args.out.clone().map_or_else(|| next_free("tune"), Ok)?;
        let within = |name: &str| directory.join(name);
        let files = Self {
            recording: within("excitation.mcap"),
            gains: within(&format!("{law}.toml")),
            page: within(&format!("{law}.html")),
            vehicle: within("vehicle.toml"),
            config: within(CONFIG),
        };
        let Self { recording, gains, page, vehicle, config } = &files;
        check_free(&[recording, gains, page, vehicle, config].map(Clone::clone))?;
        make(&directory)?;
        Ok(files)
    }

    /// Writes and prints the identified vehicle, and keeps the daemon's configuration.
    fn write_vehicle(
        &self,
        identification: &Identification,
        (paths, config): (&InstancePaths, &Config),
    ) -> Result<(), Failure> {
        let text = std::fs::read_to_string(paths.config()).map_err(|_| silent(paths))?;
        write_file(&self.config, text)?;
        write_file(&self.vehicle, vehicle_toml::toml(identification, config))?;
        let (found, vehicle) = (overview::text(identification), self.vehicle.display());
        print(&format!("{found}\nvehicle: {vehicle}, as identified"))
    }

    /// `settings` with the copy of the configuration as the origin of those in the configuration of the instance.
    fn with_config(&self, paths: &InstancePaths, settings: &[Setting]) -> Vec<Setting> {
        let (from, to) = (paths.config(), self.config.display());
        let from = from.display().to_string();
        let kept = |setting: &Setting| match setting.origin.strip_prefix(&from) {
            Some(line) => Setting { origin: format!("{to}{line}"), ..setting.clone() },
            None => setting.clone(),
        };
        settings.iter().map(kept).collect()
    }

    /// Writes and prints the gains.
    fn write(&self, LiveTuning { tuned, .. }: &LiveTuning) -> Result<(), Failure> {
        write_file(
            &self.gains,
            tuned.to_toml(&[], "for the vehicle of excitation.mcap beside it"),
        )?;
        write_file(&self.page, page::html(tuned))?;
        let [page, gains] = [&self.page, &self.gains].map(|path| path.display());
        print(&format!(
            "{tuned}page: {page}\ngains: {gains}\nthe margins above, and the laws that predict, are based on the [vehicle] of the daemon; to use the \
             identified values, start the daemon with vehicle.toml"
        ))
    }
}

/// Fails if the excitation that this process requested was not the last of the `changes` of the flight.
fn require_undisturbed(changes: &[(Time, EventV1)]) -> Result<(), Failure> {
    let last = changes.last().map(|(_, change)| (change.command, change.process));
    if last == Some((OperatorCommand::Trajectory.code(), Origin::own().bits())) {
        return Ok(());
    }
    let reason = "another request ended the excitation, or changed the flight meanwhile; nothing was changed";
    Err(Failure::new(Exit::Flight, reason))
}

/// `KEY=VALUE` of each gain.
fn assignments(tuned: &Tuned) -> Vec<String> {
    tuned.values.iter().map(|(key, value)| format!("{key}={value:?}")).collect()
}

/// Prints the command that changes the gains in flight.
fn propose(tuned: &Tuned, paths: &InstancePaths) -> Result<Exit, Failure> {
    let settings: Vec<String> = assignments(tuned).iter().map(|text| quoted(text)).collect();
    let (settings, place) = (settings.join(" "), paths.flags());
    print(&format!("change them in flight: oqtal ctl set {settings} {place}"))?;
    Ok(Exit::Ok)
}

/// Changes the gains in flight, and prints the error of a hover with them and before, `before_m` \[m\].
fn apply_gains(
    tuned: &Tuned,
    (bus, config): (&Bus, &Config),
    before_m: f64,
) -> Result<Exit, Failure> {
    // The ticks of the time of the search were overwritten.
    let mut hover = ObservedHover::open(bus, config)?;
    hover.follow(FIRST_TICK_S, None)?;
    // Before the request: an interrupt during it must name the undo.
    ARE_CHANGED.store(true, Ordering::Relaxed);
    ask(bus, CtlRequest::Set, &assignments(tuned))?;
    let place = bus.paths().flags();
    let undo = format!("`oqtal ctl undo {place}` takes them back");
    let after_m = hover.follow(SETTLE_S, None).and_then(|()| hover.error_m(HOVER_S));
    let after_m = after_m.map_err(|Failure { exit, message }| {
        Failure::new(exit, format!("{message}; the new gains are in use: {undo}"))
    })?;
    let [before_mm, after_mm] = [before_m, after_m].map(|error_m| error_m * 1e3);
    print(&format!(
        "hover, RMS over {HOVER_S} s: {before_mm:.1} mm before, {after_mm:.1} mm with the new gains; {undo}"
    ))?;
    Ok(Exit::Ok)
}

/// The settings with which the daemon flies now.
///
/// # Errors
/// The daemon does not answer (exit code 75) or has changed too many settings (1), or the copy of its configuration cannot be read.
fn present_settings(bus: &Bus) -> Result<Vec<Setting>, Failure> {
    let mut settings = Config::file_settings(&bus.paths().config())?;
    let changed = changed_before(bus).map_err(|reason| match reason {
        NoAnswer::Incomplete => Failure::new(
            Exit::Flight,
            "tune --live: more settings were changed in flight than the daemon's answer names; start it with them",
        ),
        NoAnswer::NoDaemon | NoAnswer::Silent => unanswered(bus),
    })?;
    let changed = changed.as_ref().map_or("", |event| event.text.as_str());
    for line in changed.lines().filter(|line| line.contains('=')) {
        settings.push(Setting::parse("daemon", line)?);
    }
    Ok(settings)
}

/// Makes a request of an operator; it must not be refused.
fn ask(bus: &Bus, command: CtlRequest, arguments: &[String]) -> Result<(), Failure> {
    let address = AddressedInstance::at(bus.paths());
    execute_request(&address, (command, arguments), None, |request| request).map(drop)
}

/// Flies the excitation from where the vehicle is, and records it into `file`.
fn fly_excitation(
    bus: &Bus,
    config: &Config,
    hover: &mut ObservedHover,
    file: &Path,
) -> Result<(), Failure> {
    let options = TrajectoryOptions {
        kind: TrajectoryKind::BriefExcitation,
        duration_s: None,
        ..config.trajectory.clone()
    };
    let duration_s = options.trajectory(None).map_or(0.0, |excitation| excitation.duration_s());
    let place = bus.paths().flags();
    say(&format!(
        "oqtal: flies the excitation for {duration_s:.0} s; `oqtal ctl hover {place}` ends it"
    ));
    let plan = RecordingPlan {
        path: file.to_owned(),
        config,
        provenance: PROVENANCE,
        rotates: false,
        complain: |message| say(&format!("oqtal: {message}")),
    };
    let recorder = McapRecorder::create(&plan);
    let mut recorder = recorder.map_err(|error| {
        let reason = format!("{}: {error}; give another directory with --out", file.display());
        Failure::new(Exit::System, reason)
    })?;
    let asked = ask(bus, CtlRequest::Fly, &["brief-excitation".to_owned()]);
    let flown = asked.and_then(|()| hover.follow(duration_s + SETTLE_S, Some(&mut recorder)));
    let recorded = recorder.finish();
    if flown.is_err() {
        // Ignored: the failure of the flight is reported.
        let _ = std::fs::remove_file(file);
    }
    flown?;
    recordings::check(&recorded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_trajectory_that_another_requests_disturbs_the_excitation() {
        let fly = |process| {
            let command = OperatorCommand::Trajectory.code();
            (Time::VIRTUAL_START, EventV1 { command, process, ..EventV1::default() })
        };
        let own = Origin::own().bits();
        assert!(require_undisturbed(&[fly(own + 1), fly(own)]).is_ok());
        assert!(require_undisturbed(&[fly(own), fly(own + 1)]).is_err());
    }

    #[test]
    fn gains_are_applied_only_to_the_settings_that_are_known_to_be_those_of_the_search() {
        let settings = |text| vec![Setting::parse("daemon", text).unwrap()];
        let before = settings("control.controller=mpc");
        assert!(require_unchanged(Ok(before.clone()), &before).is_ok());
        let other = require_unchanged(Ok(settings("control.controller=indi")), &before);
        assert_eq!(other.unwrap_err().exit, Exit::Flight);
        let silent = Err(Failure::new(Exit::Peer, "no answer"));
        let unknown = require_unchanged(silent, &before).unwrap_err();
        assert!(unknown.exit == Exit::Peer && unknown.message.starts_with("nothing was applied"));
    }
}
