//! `oqtal tune --live`: gains for the vehicle that hovers under a running daemon.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Mode, OperatorCommand, SafetyState};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::obeying::quoted;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_config::{Config, Setting};
use oqtal_control::trajectory::{TrajectoryKind, TrajectoryOptions};
use oqtal_lab::identify::identification::Identification;
use oqtal_lab::identify::{overview, vehicle_toml};
use oqtal_lab::output::{CONFIG, check_free, make, next_free, write_file};
use oqtal_lab::progress::Progress;
use oqtal_lab::tune::live::{self, LiveTuning};
use oqtal_lab::tune::tuned::Tuned;
use oqtal_lab::tune::{LiveArgs, TuneArgs, page};
use oqtal_observe::flight::Flight;
use oqtal_observe::law_query::changed_before;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recording::{McapRecorder, RecordingPlan};
use oqtal_observe::sink::{Reception, Sink, Tee};
use oqtal_operator::request::{place, running_bus, silent};
use oqtal_operator::{AddressedInstance, CtlRequest, execute as execute_request};
use oqtal_runtime::process::{Exit, Failure, instance_paths, place_settings};
use oqtal_runtime::program::{print, say};

use crate::daemon_config::daemon_config;
use crate::provenance::PROVENANCE;
use crate::recordings;

/// Polling period.
const POLL_PERIOD: Duration = Duration::from_millis(10);
/// Time in which a running daemon publishes a tick \[s\].
const FIRST_TICK_S: f64 = 1.0;
/// Time without a tick after which the daemon is silent.
const SILENT: Span = Span::from_millis(500);
/// Time in which the vehicle comes to rest, or settles with other gains \[s\].
const SETTLE_S: f64 = 3.0;
/// Time over which the error of a hover is measured \[s\].
const HOVER_S: f64 = 6.0;

/// Whether the daemon was asked to use the new gains.
static ARE_CHANGED: AtomicBool = AtomicBool::new(false);

/// Tunes the law that flies for the vehicle that hovers, and with `--apply` changes its gains.
///
/// # Errors
/// No daemon answers (exit code 75), the vehicle does not hover or does not go on hovering (1), the vehicle or its law cannot be
/// tuned (64), or a file cannot be written (71).
pub fn execute(args: &TuneArgs) -> Result<Exit, Failure> {
    let search = (&args.budget(), args.weights()?, &*args.options());
    let LiveArgs { instance, root, apply, .. } = &args.live;
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
    require_undisturbed(&flight)?;
    say("oqtal: identifies the vehicle and searches for gains, while it hovers");
    // The daemon may run on this machine: the search must not disturb it. A failure is harmless.
    let _ = rustix::process::nice(19);
    let identification = live::identified(&flight, &present)?;
    files.write_vehicle(&identification, (&paths, &config))?;
    let kept = files.with_config(&paths, &present);
    let found = live::tune(identification, &kept, search, &Progress::default())?;
    files.write(&found)?;
    let tuned = &found.tuned;
    match (tuned.objective < tuned.start, *apply) {
        (false, _) => Ok(Exit::Ok),
        (true, false) => propose(tuned, &paths),
        (true, true) if present_settings(&bus)? != present => Err(Failure::new(
            Exit::Flight,
            "settings were changed during the search; nothing was applied, repeat the command",
        )),
        (true, true) => apply_gains(tuned, (&bus, &config), before_m),
    }
}

/// Tells the operator on a signal that the vehicle flies on, and ends the command.
fn tell_on_interrupt(paths: &InstancePaths) -> Result<(), Failure> {
    let place = place(paths);
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

/// Fails if the excitation of `flight` was not the last request.
fn require_undisturbed(flight: &Flight) -> Result<(), Failure> {
    let last = flight.changes.last().map(|(_, change)| change.command);
    if last == Some(OperatorCommand::Trajectory.code()) {
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
    let (settings, place) = (settings.join(" "), place(paths));
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
    let place = place(bus.paths());
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
fn present_settings(bus: &Bus) -> Result<Vec<Setting>, Failure> {
    let mut settings = Config::file_settings(&bus.paths().config())?;
    let changed = changed_before(bus);
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
    let place = place(bus.paths());
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

/// Observer of a vehicle that is to go on flying.
struct ObservedHover {
    observer: BusObserver,
    ticks: ObservedTicks,
}

/// The newest tick with the instant of its reception, and the squared position error of each tick \[m^2\].
#[derive(Default)]
struct ObservedTicks {
    newest: Option<(Time, TelemetryV1)>,
    squares: Vec<f64>,
}

impl Sink for ObservedTicks {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        if let Sample::Telemetry(tick) = sample {
            let pairs = tick.position.iter().zip(tick.reference_position);
            self.squares.push(pairs.map(|(at, reference)| (at - reference).powi(2)).sum());
            self.newest = Some((reception.received_at, *tick));
        }
    }

    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}

impl ObservedHover {
    fn open(bus: &Bus, config: &Config) -> Result<Self, Failure> {
        let bus = Bus::open(bus.paths())?.for_observer();
        let observer = BusObserver::open(&bus, &McapRecorder::topics(config))?;
        Ok(Self { observer, ticks: ObservedTicks::default() })
    }

    /// Observes the vehicle for `seconds`, and records its flight; fails as soon as it does not fly on undisturbed.
    fn follow(
        &mut self,
        seconds: f64,
        mut recorder: Option<&mut McapRecorder>,
    ) -> Result<(), Failure> {
        let began = Time::now();
        let end = began + Span::from_seconds(seconds);
        while Time::now() < end {
            std::thread::sleep(POLL_PERIOD);
            let now = Time::now();
            match recorder.as_deref_mut() {
                Some(recorder) => {
                    recorder.note_clock(now);
                    self.observer.poll(now, &mut Tee(recorder, &mut self.ticks))?;
                }
                None => self.observer.poll(now, &mut self.ticks)?,
            }
            if let Some((_, tick)) = &self.ticks.newest {
                require_nominal(tick)?;
            }
            let newest_at =
                self.ticks.newest.map_or(began, |(received_at, _)| received_at.max(began));
            if now.since(newest_at) > SILENT {
                let reason = "the daemon publishes no ticks; see `oqtal ctl status`";
                return Err(Failure::new(Exit::Peer, reason));
            }
        }
        Ok(())
    }

    /// Root mean square of the position error over `seconds` \[m\].
    fn error_m(&mut self, seconds: f64) -> Result<f64, Failure> {
        self.ticks.squares.clear();
        self.follow(seconds, None)?;
        let squares = &self.ticks.squares;
        Ok((squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
    }
}

/// Fails unless the vehicle flies in the state Nominal.
fn require_nominal(tick: &TelemetryV1) -> Result<(), Failure> {
    let (mode, state) = (Mode::from_code(tick.mode), SafetyState::from_code(tick.state));
    if mode != Some(Mode::Flying) {
        let reason =
            "the vehicle does not fly; `oqtal ctl arm`, and `oqtal ctl hover` where it has room";
        return Err(Failure::new(Exit::Flight, reason));
    }
    if state != Some(SafetyState::Nominal) {
        let state = state.map_or_else(|| "unknown".to_owned(), |state| state.to_string());
        let reason = format!(
            "the daemon is in the state {state}, tuning needs Nominal; see `oqtal ctl status`"
        );
        return Err(Failure::new(Exit::Flight, reason));
    }
    Ok(())
}
