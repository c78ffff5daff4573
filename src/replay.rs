//! `oqtal replay FILE`: executes the daemon on the inputs of a recording.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args;
use oqtal_bus::code::{Actuation, Cause};
use oqtal_bus::message::CommandV1;
use oqtal_bus::time::Time;
use oqtal_config::{ClockKind, Config, Setting};
use oqtal_lab::replay::{RecordedWaypoints, ReplayResult, ReplayedTick, replay};
use oqtal_observe::recording::{DaemonHistory, InputHistory, RecordingFile, play, recording_path};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{print, say};
use serde::{Serialize, Serializer};
use toml::Table;

use crate::recordings::{self, failure};

/// Maximum number of listed differences.
const LISTED: usize = 10;

/// Arguments of `oqtal replay`.
#[derive(Args, Debug)]
pub struct ReplayArgs {
    /// The recording: a file, the directory of a flight, or `latest`
    #[arg(value_parser = recording_path)]
    file: PathBuf,
    /// Replay with another attitude law (open loop)
    #[arg(long, value_name = "NAME")]
    controller: Option<String>,
    /// Replay with another value of the configuration (open loop); may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Write recorded and replayed commands, a row for each tick in both
    #[arg(long, value_name = "FILE.csv")]
    out: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// Printed result of a replay.
#[derive(Debug, Serialize)]
struct ReplayReport {
    daemons: usize,
    turns: u64,
    requests: u64,
    ticks: usize,
    identical: usize,
    /// Ticks that were recorded but not replayed, or replayed but not recorded \[-\].
    unmatched: usize,
    /// Ticks that were recorded and not replayed \[-\].
    not_replayed: usize,
    /// Instant and cause at which the replayed daemon stopped motors that ran in the recording.
    own_stop: Option<OwnStop>,
    /// Messages missing in the recording \[-\].
    missing: u64,
    /// Whether settings were changed, so that the replay shows the commands that the daemon would have sent.
    open_loop: bool,
    deadline_misses: u64,
    /// Greatest difference between corresponding numbers of the commands \[unit of the number\].
    greatest_difference: f64,
    /// Texts of the first differences, with number and time since arming \[s\].
    differences: Vec<String>,
}

/// Stop of the replayed daemon.
#[derive(Clone, Copy, Debug, Serialize)]
struct OwnStop {
    /// Time since arming \[s\].
    t_s: f64,
    #[serde(serialize_with = "as_text")]
    cause: Cause,
}

fn as_text<S: Serializer>(cause: &Cause, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(cause)
}

impl ReplayArgs {
    /// Replays every daemon of the recording and prints the comparison of the commands.
    ///
    /// # Errors
    /// The file is not a recording or is incomplete, or a setting is invalid.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let out = self.free_out()?;
        recordings::require_whole(&self.file)?;
        let file = recordings::read(&self.file)?;
        let config = self.config(&file)?;
        let mut histories = InputHistory::default();
        play(&file, &mut histories).map_err(failure)?;
        let histories = histories.finish();
        self.check(&histories)?;
        let waypoints = RecordedWaypoints::of(&file)?;
        let mut results = Vec::new();
        for history in &histories {
            results.push(replay(&config, &waypoints, history)?);
        }
        if let Some(path) = &out {
            recordings::write(path, csv(&results))?;
        }
        let report = ReplayReport::new(&results, self.is_open_loop());
        print(&if self.json { report.to_json() } else { report.to_text() })?;
        let is_identical = results.iter().all(ReplayResult::is_identical);
        if !is_identical && !report.open_loop {
            let flight = recordings::read_flight(&self.file).ok();
            let reservation = flight.and_then(|flight| flight.reservation());
            reservation.iter().for_each(|told| {
                say(&format!("oqtal: possible reason for the difference: {told}"))
            });
        }
        Ok(if is_identical || report.open_loop { Exit::Ok } else { Exit::Flight })
    }

    /// The file of `--out`, in a directory `replay.csv`; refused if it exists. A recording is refused when it is written.
    fn free_out(&self) -> Result<Option<PathBuf>, Failure> {
        let Some(out) = &self.out else { return Ok(None) };
        let file = if out.is_dir() { out.join("replay.csv") } else { out.clone() };
        if file.exists() && file.extension().is_none_or(|end| end != "mcap") {
            let reason = format!("{} exists already; give another --out", file.display());
            return Err(Failure::new(Exit::Usage, reason));
        }
        Ok(Some(file))
    }

    fn is_open_loop(&self) -> bool {
        self.controller.is_some() || !self.settings.is_empty()
    }

    /// Configuration of the recording, with the flags applied.
    fn config(&self, file: &RecordingFile) -> Result<Config, Failure> {
        let name = format!("{} (config.toml)", self.file.display());
        let recorded = file.config_text().map_err(failure)?;
        let with = |settings: &[Setting]| Config::parse(&name, &recorded, settings);
        let before = with(&[])?;
        let acting = of_daemon(&before);
        let mut settings = Vec::new();
        for text in &self.settings {
            let setting = Setting::parse("--set", text)?;
            if with(std::slice::from_ref(&setting)).is_ok_and(|it| of_daemon(&it) == acting) {
                say(&format!(
                    "oqtal: {text} has no effect: it is the recorded value, or acts on the daemon's inputs alone, which are those of the recording"
                ));
            }
            settings.push(setting);
        }
        if let Some(name) = &self.controller {
            settings.push(Setting::flag("--controller", "control.controller", name.clone()));
        }
        let config = with(&settings)?;
        let note = note_on_budget(&before, &config);
        note.iter().for_each(|note| say(&format!("oqtal: {note}")));
        Ok(config)
    }

    /// Fails unless every daemon was recorded from its start without a gap.
    fn check(&self, histories: &[DaemonHistory]) -> Result<(), Failure> {
        let reason = match histories.iter().find(|history| !history.is_complete()) {
            None if histories.is_empty() => "has no input of a daemon".to_owned(),
            None => return Ok(()),
            Some(history) if history.missing > 0 => {
                format!("lacks {} records of what the daemon took in", history.missing)
            }
            Some(_) => "begins after the start of its daemon".to_owned(),
        };
        let path = self.file.display();
        let remedy = "a replay needs everything from the daemon's start: of a recording in several files give the first, or start `oqtal record` before the daemon, with its --config and flags, or use `oqtal fly`";
        Err(Failure::new(Exit::Data, format!("{path} {reason}; {remedy}")))
    }
}

/// Note on a budget of `next` that recorded answers cannot follow; `None` for a shorter one in real time, under which answers that
/// took longer are late.
fn note_on_budget(recorded: &Config, next: &Config) -> Option<String> {
    let (from_us, to_us) = (recorded.external.budget_us, next.external.budget_us);
    if from_us == to_us || !next.control.is_external() {
        return None;
    }
    if recorded.clock.kind != ClockKind::Real {
        return Some(
            "external.budget-us has no effect: in virtual time no answer is late".to_owned(),
        );
    }
    (to_us > from_us).then(|| {
        format!(
            "external.budget-us = {to_us} is longer than that of the recording, {from_us}: answers that would have come later than that are not known, and their questions stay without an answer"
        )
    })
}

/// The numbers of a command, in the order of [`NAMES`].
fn numbers(command: &CommandV1) -> [f64; 11] {
    let CommandV1 { sticks: s, torque: t, attitude: q, thrust, .. } = *command;
    [s[0], s[1], s[2], t[0], t[1], t[2], q[0], q[1], q[2], q[3], thrust]
}

/// Sections whose keys have no effect on the commands that the daemon computes from its inputs, except where a key of another section
/// follows them.
const OF_OTHERS: [&str; 8] =
    ["bridge", "fault", "log", "mocap", "plant", "realtime", "receiver", "record"];

/// The sections of `config` that act on the commands.
fn of_daemon(config: &Config) -> Table {
    let mut table: Table = config.to_toml().parse().expect("it was written as TOML");
    table.retain(|section, _| OF_OTHERS.iter().all(|other| section != *other));
    table
}

/// Names of the numbers of a command.
const NAMES: [&str; 11] = [
    "stick_roll",
    "stick_pitch",
    "stick_yaw",
    "torque_x_nm",
    "torque_y_nm",
    "torque_z_nm",
    "attitude_x",
    "attitude_y",
    "attitude_z",
    "attitude_w",
    "thrust",
];

/// Zero of the times, as in the tables of an export: the first tick recorded with running motors, or the first one.
fn origin(results: &[ReplayResult]) -> Time {
    let is_armed = |tick: &&ReplayedTick| tick.recorded.actuation != Actuation::Disarmed.code();
    let mut ticks = results.iter().flat_map(|result| &result.ticks);
    ticks.clone().find(is_armed).or(ticks.next()).map(|tick| tick.time).unwrap_or_default()
}

/// One row per tick that was recorded and replayed: time, then every number as recorded and as replayed.
fn csv(results: &[ReplayResult]) -> String {
    let pair = |name: &&str| format!(",{name},replayed_{name}");
    let mut text = format!("t_s{}\n", NAMES.iter().map(pair).collect::<String>());
    let origin = origin(results);
    for tick in results.iter().flat_map(|result| &result.ticks) {
        let _ = write!(text, "{}", tick.time.since(origin).seconds());
        for (recorded, replayed) in numbers(&tick.recorded).iter().zip(numbers(&tick.command)) {
            let _ = write!(text, ",{recorded},{replayed}");
        }
        text.push('\n');
    }
    text
}

impl ReplayReport {
    fn new(results: &[ReplayResult], open_loop: bool) -> Self {
        let ticks: Vec<&ReplayedTick> = results.iter().flat_map(|result| &result.ticks).collect();
        let origin = origin(results);
        let differing = ticks.iter().filter(|tick| !tick.is_identical);
        let unmatched = results.iter().flat_map(|result| &result.unmatched);
        let unmatched_text = unmatched.clone().map(|tick| {
            let at_s = tick.time.since(origin).seconds();
            format!("t = {at_s:.4} s: a tick was made in the recording or in the replay alone")
        });
        let differences = differing.clone().map(|tick| difference(tick, origin));
        let distance = |tick: &&ReplayedTick| {
            let pairs = numbers(&tick.recorded).into_iter().zip(numbers(&tick.command));
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        let misses = |result: &ReplayResult| {
            result.ticks.last().map_or(0, |tick| tick.telemetry.deadline_misses)
        };
        Self {
            daemons: results.len(),
            turns: results.iter().map(|result| result.turns).sum(),
            requests: results.iter().map(|result| result.requests).sum(),
            ticks: ticks.len(),
            identical: ticks.len() - differing.count(),
            not_replayed: unmatched.clone().filter(|tick| tick.is_recorded).count(),
            unmatched: unmatched.count(),
            own_stop: results.iter().find_map(ReplayResult::own_stop).map(|tick| OwnStop {
                t_s: tick.time.since(origin).seconds(),
                cause: Cause::from_code(tick.telemetry.cause).unwrap_or(Cause::None),
            }),
            missing: results.iter().map(|result| result.missing).sum(),
            open_loop,
            deadline_misses: results.iter().map(misses).sum(),
            greatest_difference: ticks.iter().map(distance).fold(0.0, f64::max),
            differences: differences.chain(unmatched_text).take(LISTED).collect(),
        }
    }

    fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a report holds only what JSON can say")
    }

    fn to_text(&self) -> String {
        let Self { daemons, turns, requests, ticks, identical, deadline_misses, .. } = self;
        let mut text = format!(
            "daemon started {daemons} x: {turns} turns, {ticks} ticks of the recording, {requests} requests, {deadline_misses} deadlines missed since the daemon's start\n\
             {identical} of {ticks} ticks: command and telemetry identical to the last bit"
        );
        if self.open_loop {
            text += &format!(
                "\nopen loop: poses and requests, also changes of law and gains in flight, are those of the recording; greatest difference of \
                 a command {:.4}",
                self.greatest_difference
            );
        }
        text += &self.own_stop.map_or_else(String::new, OwnStop::to_text);
        if self.open_loop && self.not_replayed > 0 {
            let (without, all) = (self.not_replayed, ticks + self.not_replayed);
            text += &format!("\n{without} of {all} recorded ticks have no counterpart");
        }
        if self.missing > 0 {
            text += &format!(
                "\n{} messages that the daemon received or sent are not in the recording",
                self.missing
            );
        }
        for line in self.differences.iter().filter(|_| !self.open_loop) {
            text += &format!("\n{line}");
        }
        text
    }
}

impl OwnStop {
    fn to_text(self) -> String {
        let Self { t_s, cause } = self;
        let follows = match cause {
            Cause::Relabel => "; the recorded vehicle does not follow the replayed commands",
            _ => "",
        };
        format!("\nthe replayed daemon stopped the motors at t = {t_s:.2} s: {cause}{follows}")
    }
}

/// First number that differs in a tick, as text.
fn difference(tick: &ReplayedTick, origin: Time) -> String {
    let (number, at_s) = (tick.telemetry.tick, tick.time.since(origin).seconds());
    let mut pairs =
        NAMES.iter().zip(numbers(&tick.recorded).into_iter().zip(numbers(&tick.command)));
    let found = pairs.find(|(_, (a, b))| a.to_bits() != b.to_bits());
    let what = match found {
        Some((name, (recorded, replayed))) => {
            format!("{name} {recorded} recorded, {replayed} replayed")
        }
        None => "stamps or telemetry differ".to_owned(),
    };
    format!("tick {number}, t = {at_s:.4} s: {what}")
}

#[cfg(test)]
mod tests {
    use oqtal_bus::message::TelemetryV1;
    use oqtal_bus::time::Span;

    use super::*;

    #[test]
    fn a_setting_acts_if_a_key_of_the_daemon_is_it_or_follows_it() {
        let of = |text: &str| {
            let setting = Setting::parse("--set", text).unwrap();
            of_daemon(&Config::from_settings(&[setting]).unwrap())
        };
        let recorded = of_daemon(&Config::default());
        for text in ["mocap.latency-ms=60", "plant.mass-kg=0.6", "bridge.air-latency-ms=9"] {
            assert_eq!(of(text), recorded, "{text}");
        }
        for text in ["mocap.attitude-noise-deg=0.3", "vehicle.mass-kg=0.6"] {
            assert_ne!(of(text), recorded, "{text}");
        }
    }

    #[test]
    fn times_count_from_arming() {
        let tick = |ms: i64, actuation: Actuation| ReplayedTick {
            time: Time::VIRTUAL_START + Span::from_millis(ms),
            telemetry: TelemetryV1::default(),
            command: CommandV1::default(),
            recorded: CommandV1 { actuation: actuation.code(), ..CommandV1::default() },
            is_identical: true,
        };
        let ticks = vec![tick(0, Actuation::Disarmed), tick(95, Actuation::Sticks)];
        let results = [ReplayResult { ticks, ..ReplayResult::default() }];
        assert_eq!(origin(&results), Time::VIRTUAL_START + Span::from_millis(95));
        assert!(csv(&results).contains("\n-0.095,"), "{}", csv(&results));
    }

    #[test]
    fn a_longer_budget_than_the_recorded_one_has_a_note_and_a_shorter_one_has_none() {
        let config = |clock: &str, budget_us: &str| {
            let law = Setting::flag("test", "control.controller", "external");
            let clock = Setting::flag("test", "clock.kind", clock);
            let budget = Setting::parse("test", &format!("external.budget-us={budget_us}"));
            Config::from_settings(&[law, clock, budget.unwrap()]).unwrap()
        };
        let note = |clock, next| note_on_budget(&config(clock, "3000.0"), &config(clock, next));
        assert_eq!((note("real", "3000.0"), note("real", "500.0")), (None, None));
        assert!(
            note("real", "5000.0").unwrap().contains("longer than that of the recording, 3000")
        );
        assert!(note("lockstep", "500.0").unwrap().contains("no effect"));
    }
}
