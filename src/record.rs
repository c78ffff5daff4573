//! `oqtal record`: records a running instance until it is interrupted.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use oqtal_bus::message::EventV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Role, Sample};
use oqtal_config::Config;
use oqtal_observe::instance_observer::InstanceObserver;
use oqtal_observe::kernel::ThreadScheduling;
use oqtal_observe::law_query::{NoAnswer, changed_before};
use oqtal_observe::recording::{Facts, McapRecorder, RecordingPlan, RecordingResult};
use oqtal_observe::sink::{Reception, Sink, Tee};
use oqtal_operator::request::{silent, waypoints_note};
use oqtal_operator::require_daemon;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths, stop_on_signals};
use oqtal_runtime::program::{print, say};
use oqtal_runtime::stop::StopFlag;

use crate::daemon_config::daemon_config;
use crate::provenance::PROVENANCE;
use crate::recordings;

/// Polling period: the resolution of the reception times.
const POLL_PERIOD: Duration = Duration::from_millis(10);
/// Time after which a recorder without a daemon tells what it waits for.
const WAITS_SILENTLY: Span = Span::from_millis(1000);
/// Highest number of a file `recordings/INSTANCE-N.mcap`.
const MAX_NUMBER: u32 = 100_000;

/// Arguments of `oqtal record`.
#[derive(Args, Debug)]
pub struct RecordArgs {
    /// The recording, or a directory for INSTANCE-N.mcap; further files, after the size or duration of [record], have a
    /// number before .mcap [default: recordings/]
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    /// Fail if no daemon runs, instead of waiting for one
    #[arg(long)]
    attach: bool,
    /// End after this time [s]
    #[arg(long, value_name = "S", value_parser = duration_s, allow_negative_numbers = true)]
    seconds: Option<f64>,
    #[command(flatten)]
    common: CommonArgs,
}

impl RecordArgs {
    /// Records until it is interrupted, and prints what was recorded.
    ///
    /// # Errors
    /// No daemon runs (with `--attach`, exit code 75), a file cannot be written (71), or the bus refuses.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let settings = self.common.settings()?;
        let given = Config::load(&self.common.config, &settings)?;
        let stop = stop_on_signals()?;
        let place = instance_paths(&given)?;
        // A recorder that is given no settings of the flight records those of the daemon, with its own of the recording.
        let is_plain = given.hash() == Config::default().hash();
        let config = match daemon_config(&place).filter(|_| is_plain) {
            Some(_) => {
                Config::load(&[&[place.config()], &*self.common.config].concat(), &settings)?
            }
            None => given,
        };
        let observer = InstanceObserver::open(&place, &McapRecorder::topics(&config))?;
        if self.attach {
            require_daemon(observer.bus(), "record without --attach")?;
        }
        // The file exists once the recorder has all its places.
        let changed = changed_before(observer.bus()).unwrap_or_else(|reason| {
            let told = match reason {
                NoAnswer::NoDaemon => return None,
                NoAnswer::Silent => "the daemon does not answer",
                NoAnswer::Incomplete => "the daemon has changed more settings than an answer names",
            };
            say(&format!("oqtal: {told}: settings that were changed before are not recorded"));
            None
        });
        let recorder = self.begin(&config)?;
        let (result, missed) = self.record(&config, (observer, recorder, changed), &stop)?;
        conclude(&result, missed)
    }

    /// Creates the first file.
    fn begin(&self, config: &Config) -> Result<McapRecorder, Failure> {
        let complain = |message: &str| say(&format!("oqtal: {message}"));
        let out = self.out.as_deref().unwrap_or(Path::new("recordings/"));
        let numbered = recordings::is_directory(out).then_some(out);
        loop {
            let path = match numbered {
                Some(directory) => next_free(directory, &config.instance.name)?,
                None => out.to_owned(),
            };
            if let Some(directory) = path.parent() {
                std::fs::create_dir_all(directory).map_err(|error| failed(directory, &error))?;
            }
            let (provenance, rotates) = (PROVENANCE, true);
            let plan = RecordingPlan { path: path.clone(), config, provenance, rotates, complain };
            match McapRecorder::create(&plan) {
                // Another recorder has just created the file.
                Err(error) if numbered.is_some() && error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(failed(&path, &error)),
                Ok(recorder) => {
                    say(&format!("oqtal: recording into {}; Ctrl-C ends", path.display()));
                    return Ok(recorder);
                }
            }
        }
    }

    /// Records until a stop is requested; returns the result and what the observer missed.
    fn record(
        &self,
        config: &Config,
        parts: (InstanceObserver, McapRecorder, Option<EventV1>),
        stop: &StopFlag,
    ) -> Result<(RecordingResult, Missed), Failure> {
        let (mut observer, mut recorder, changed) = parts;
        let mut daemon = DaemonFacts::default();
        let began = Time::now();
        recorder.note_clock(began);
        if let Some(changed) = changed {
            let reception = Reception { received_at: began, ..Reception::default() };
            recorder.sample(&reception, Sample::Event(&changed));
        }
        let end = self.seconds.map(|seconds| began + Span::from_seconds(seconds));
        let mut is_wait_told = false;
        while !stop.is_set() && !recorder.has_failed() {
            std::thread::sleep(POLL_PERIOD);
            let now = Time::now();
            recorder.note_clock(now);
            observer.poll(now, &mut Tee(&mut recorder, &mut daemon))?;
            daemon.record(config, &mut recorder);
            if !is_wait_told && daemon.pid.is_none() && now.since(began) > WAITS_SILENTLY {
                is_wait_told = true;
                let paths = instance_paths(config)?;
                // It looks for processes for seconds, in which samples would be overwritten.
                std::thread::spawn(move || {
                    say(&format!("oqtal: waits for a daemon: {}", silent(&paths)));
                });
            }
            if end.is_some_and(|end| now >= end) {
                break;
            }
        }
        let is_left_behind = observer.bus().is_lost();
        if daemon.pid.is_none() {
            say("oqtal: no daemon ran during the recording: it contains no flight");
        }
        Ok((recorder.finish(), Missed { samples: daemon.lost, is_left_behind }))
    }
}

/// Samples that a recording does not contain.
#[derive(Clone, Copy, Debug)]
struct Missed {
    /// Number of samples that were overwritten before they were observed \[-\].
    samples: u64,
    /// Whether the observed run of the instance was lost, and no next one has been joined.
    is_left_behind: bool,
}

/// Facts recorded once per daemon.
#[derive(Debug, Default)]
struct DaemonFacts {
    pid: Option<u32>,
    config_hash: Option<u64>,
    recorded_pid: Option<u32>,
    reported_hash: Option<u64>,
    /// Number of samples that were overwritten before they were observed \[-\].
    lost: u64,
}

impl DaemonFacts {
    /// Records the scheduling granted to a new daemon, and reports a configuration that differs.
    fn record(&mut self, config: &Config, recorder: &mut McapRecorder) {
        if self.pid != self.recorded_pid {
            self.recorded_pid = self.pid;
            if let Some(granted) = self.pid.and_then(ThreadScheduling::of) {
                recorder.facts(Facts::of_grants(&granted));
            }
            let edited = instance_paths(config).ok().and_then(|paths| waypoints_note(&paths));
            if let Some(note) = edited {
                say(&format!(
                    "oqtal: the recording may lack the waypoints that the daemon has read: {note}"
                ));
            }
        }
        if self.config_hash != self.reported_hash {
            self.reported_hash = self.config_hash;
            if self.config_hash.is_some_and(|hash| hash != config.hash()) {
                say(
                    "oqtal: the daemon runs with another configuration than is recorded: law, vehicle or settings of the recording are not those that fly; give the daemon's --config and flags, or start the recorder after the daemon",
                );
            }
        }
    }
}

impl Sink for DaemonFacts {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Telemetry(_) => {
                self.pid = Some(reception.header.origin().process());
            }
            Sample::Health(Role::Daemon, health) => self.config_hash = Some(health.config_hash),
            _ => {}
        }
    }

    /// Counts losses; the recorder records them.
    fn lost(&mut self, _: ObservedTopic, count: u64) {
        self.lost += count;
    }
}

/// Prints what was recorded.
fn conclude(result: &RecordingResult, missed: Missed) -> Result<Exit, Failure> {
    let RecordingResult { files, messages, bytes, .. } = result;
    let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    print(&format!("{messages} messages, {:.1} MB: {}", *bytes as f64 * 1e-6, names.join(", ")))?;
    recordings::check(result)?;
    if missed.is_left_behind {
        let message = "files of the instance were removed or moved: processes started since, if any, are not in the recording; record again";
        return Err(Failure::new(Exit::System, message));
    }
    if missed.samples > 0 {
        let lost = missed.samples;
        let message = format!(
            "{lost} samples were overwritten before they were recorded: this machine is overloaded, or the recorder was stopped; the events of the recording name the topics"
        );
        return Err(Failure::new(Exit::System, message));
    }
    Ok(Exit::Ok)
}

/// A duration above zero \[s\].
fn duration_s(text: &str) -> Result<f64, String> {
    let seconds: Option<f64> = text.parse().ok();
    let valid = seconds.filter(|seconds| (0.0..1e9).contains(seconds) && *seconds > 0.0);
    valid.ok_or_else(|| "expected a number of seconds above 0, as in --seconds 60".to_owned())
}

/// The first `INSTANCE-N.mcap` in `directory` that does not exist.
fn next_free(directory: &Path, instance: &str) -> Result<PathBuf, Failure> {
    let paths = (1..MAX_NUMBER).map(|number| directory.join(format!("{instance}-{number}.mcap")));
    paths.into_iter().find(|path| !path.exists()).ok_or_else(|| {
        let message = format!("{} has no free number; give --out FILE", directory.display());
        Failure::new(Exit::System, message)
    })
}

fn failed(path: &Path, error: &std::io::Error) -> Failure {
    let message = format!("{}: {error}; give another file with --out", path.display());
    Failure::new(Exit::System, message)
}
