//! The background thread of the daemon: logs, health, operator requests.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Mode, OperatorCommand};
use oqtal_bus::control::ControlServer;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{EventV1, HealthV1, PoseV1, Stamps};
use oqtal_bus::obeying::starting_command;
use oqtal_bus::port::{Reader, Writer};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{EVENT, POSE, Role};
use oqtal_bus::transport::{Publish, Subscribe, Transport};
use oqtal_config::{
    CHAIN_COMMENT, COPY_COMMENT, flight_comment, kept_source_comments, source_comments,
};
use oqtal_runtime::background::BackgroundWorker;
use oqtal_runtime::files;
use oqtal_runtime::health::{Health, Heartbeat};
use oqtal_runtime::kept_file::KeptFile;
use oqtal_runtime::process::{Failure, ProcessContext};

use crate::condition::Condition;
use crate::cycle::FirstFlight;
use crate::flight_marker::InFlightMarker;
use crate::law_socket::{ConnectionSlot, LawListener};
use crate::live::LiveSettings;
use crate::operator::OperatorRequests;
use crate::pose_rate::PoseRate;

/// The processes whose configuration must be that of the daemon.
const PEERS: [Role; 4] = [Role::Plant, Role::Mocap, Role::Receiver, Role::Bridge];
/// Time after which the health of a process that ended no longer counts.
const PEER_TIMEOUT: Span = Span::from_millis(3000);
/// Number of authors whose last request is compared with their next one \[-\].
const MOST_AUTHORS: usize = 16;

/// Health of another process of the instance.
struct Peer {
    reader: Reader<HealthV1>,
    last: Option<HealthV1>,
}

impl Peer {
    fn open(bus: &Bus, role: Role) -> Result<Self, BusError> {
        Ok(Self { reader: bus.reader(&role.health())?, last: None })
    }

    /// Whether the process is alive and has another configuration than the one with `hash`. A message that cannot be read counts as
    /// missing.
    fn has_other_config(&mut self, hash: u64) -> bool {
        if let Ok(Some((_, health))) = self.reader.latest() {
            self.last = Some(health);
        }
        self.last.is_some_and(|health| {
            let is_other = health.compared_config().is_some_and(|other| other != hash);
            is_other && Time::now().since(health.time) < PEER_TIMEOUT
        })
    }
}

/// The file with the configuration of the daemon; observers read it, so that they do not need the daemon's flags.
struct ConfigFile {
    file: KeptFile,
    /// Comment lines of the files that were read again in flight, and of the waypoint file.
    comments: String,
    text: String,
}

impl ConfigFile {
    /// Writes the file. Its comments name the files from which the configuration was read; a copy names the files of its original.
    /// `is_chain`: the daemon is part of `oqtal chain run`.
    fn begin(path: PathBuf, context: &ProcessContext, comments: String, is_chain: bool) -> Self {
        let sources = if context.is_child {
            starting_command(std::process::id()).as_deref().map_or_else(String::new, flight_comment)
        } else {
            // This file is written again: the edits that count are those of its sources.
            let (copy, others): (Vec<_>, Vec<_>) =
                context.files.iter().cloned().partition(|file| *file == path);
            let kept = match copy.is_empty() {
                true => String::new(),
                false => kept_source_comments(&std::fs::read_to_string(&path).unwrap_or_default()),
            };
            let copy = if is_copy(context, &path) { COPY_COMMENT } else { "" };
            kept + &source_comments(&others) + copy
        };
        let chain = if is_chain { CHAIN_COMMENT } else { "" };
        let text = format!("{chain}{sources}{}", context.config.to_toml());
        let mut file = Self { file: KeptFile::new(path), comments, text };
        file.write();
        file
    }

    /// Writes the file again if it was removed, or could not be written, while the instance is whole. After a loss nothing is written: the
    /// path may belong to another run.
    fn keep(&mut self, bus: &Bus) {
        if self.file.is_due(Time::now()) && !bus.is_lost() {
            self.write();
        }
    }

    /// Records which files were read again, by their `comments`; after a loss nothing is written, as in [`ConfigFile::keep`].
    fn note_files(&mut self, comments: String, bus: &Bus) {
        if self.comments != comments && !bus.is_lost() {
            self.comments = comments;
            self.write();
        }
    }

    fn write(&mut self) {
        let Self { file, comments, text } = self;
        let write = |path: &Path| files::write(path, format!("{comments}{text}"));
        file.renew(write, |line| tracing::warn!("{line}"));
    }
}

/// Whether the daemon was started with the copy of an earlier one's configuration, at `path`.
fn is_copy(context: &ProcessContext, path: &Path) -> bool {
    matches!(&context.files[..], [file] if file == path)
}

/// The background thread of the daemon: logs, health, operator requests.
pub struct DaemonWorker {
    requests: OperatorRequests,
    server: ControlServer,
    heartbeat: Heartbeat,
    health: Health,
    config_hash: u64,
    peers: Vec<Peer>,
    events: Writer<EventV1>,
    poses: Reader<PoseV1>,
    pose_rate: PoseRate,
    law: Option<LawListener>,
    file: ConfigFile,
    in_flight: InFlightMarker,
    log: RequestLog,
    // The ports live as long as the bus they were opened on.
    bus: Bus,
}

impl DaemonWorker {
    /// Opens the control service and the health topic; `is_chain`: the daemon is part of `oqtal chain run`.
    ///
    /// # Errors
    /// Another daemon serves the instance, or the bus refuses.
    pub fn open(
        context: &ProcessContext,
        requests: OperatorRequests,
        connected: ConnectionSlot,
        is_chain: bool,
    ) -> Result<Self, Failure> {
        let bus = context.bus()?;
        let is_external = context.config.control.is_external();
        let law = is_external.then(|| LawListener::open(context.paths()?.law(), connected));
        let law = law.transpose()?;
        // A copy lacks what changed in flight, and edits of the file that it was made from.
        let path = context.paths()?.config();
        let files =
            if context.is_child || is_copy(context, &path) { &[] } else { &context.files[..] };
        let settings = LiveSettings::new(&context.config, files);
        let comments = settings.file_comments();
        let config_hash = context.config.hash();
        let mut requests = requests.with_settings(config_hash, settings);
        // Until the loop reports.
        requests.last.first_flight = if context.is_child {
            FirstFlight::Expected
        } else if context.config.safety.arm_at_start {
            FirstFlight::Pending
        } else {
            FirstFlight::None
        };
        let (server, heartbeat) = (bus.control_server()?, context.heartbeat(&bus)?);
        let peers = PEERS.iter().map(|role| Peer::open(&bus, *role)).collect::<Result<_, _>>()?;
        let (health, events) = (context.health.clone(), bus.writer(&EVENT)?);
        let poses = bus.reader(&POSE)?;
        let file = ConfigFile::begin(path, context, comments, is_chain);
        Ok(Self {
            requests,
            server,
            heartbeat,
            health,
            config_hash,
            peers,
            events,
            poses,
            pose_rate: PoseRate::default(),
            law,
            file,
            in_flight: InFlightMarker::of(bus.paths(), &context.config.safety, context.is_child),
            log: RequestLog::default(),
            bus,
        })
    }

    /// Compares the rate of the poses with the configured one; a warning is logged when it begins. Unreadable poses are counted by the
    /// loop.
    fn watch_poses(&mut self) {
        let Self { requests, poses, pose_rate, .. } = self;
        let config = requests.settings.as_ref().map(LiveSettings::present);
        let (Ok(Some((header, _))), Some(config)) = (poses.latest(), config) else { return };
        pose_rate.take(Time::now(), &header, config);
        let warning = pose_rate.warning();
        if let (Some(warning), None) = (warning, &requests.warning) {
            tracing::warn!("{warning}");
        }
        requests.warning = warning.cloned();
    }
}

impl BackgroundWorker for DaemonWorker {
    fn poll(&mut self) {
        self.file.keep(&self.bus);
        self.watch_poses();
        let Self { requests, server, heartbeat, health, config_hash, peers, .. } = self;
        let Self { events, law, log, file, in_flight, bus, .. } = self;
        requests.take_changes();
        law.iter_mut().for_each(LawListener::poll);
        requests.lacks_law = law.as_ref().is_some_and(|law| !law.has_law());
        // Every peer is checked, so that none keeps an old message.
        let others =
            peers.iter_mut().filter_map(|peer| peer.has_other_config(*config_hash).then_some(()));
        requests.note_configs_differ(others.count() > 0);
        if let Some((text, ..)) = requests.last.text() {
            health.set_status(text);
        }
        let mut publish = |event: EventV1| {
            log.event(&event);
            if let Err(error) = events.send(0, Stamps::default(), event) {
                tracing::warn!("{error}");
            }
        };
        let served = server.serve(|request| {
            let response = requests.ask(request, &mut publish);
            // Before the answer, whose reader may look at the file.
            let comments = requests.settings.as_ref().map(LiveSettings::file_comments);
            file.note_files(comments.unwrap_or_default(), bus);
            response
        });
        if let Err(error) = served {
            tracing::warn!("{error}");
        }
        let Condition { mode, state, cause, obstacles, unlogged, .. } = requests.last;
        let is_flying = Mode::from_code(mode).is_some_and(Mode::commands_motors);
        in_flight.note(is_flying, bus.is_lost());
        let health = HealthV1 { state, mode, cause, obstacles, unlogged, ..HealthV1::default() };
        if let Err(error) = heartbeat.beat(health) {
            tracing::warn!("{error}");
        }
    }
}

/// Log of requests. A refusal that an author receives repeatedly for the same reason is logged once.
#[derive(Debug, Default)]
struct RequestLog {
    /// The last authors, each with its last request as it was logged.
    logged: VecDeque<(String, String)>,
}

impl RequestLog {
    /// Logs a request.
    fn event(&mut self, event: &EventV1) {
        let Some(what) = described(event) else { return };
        let (author, refusal) = (event.author(), event.refusal());
        let reason = refusal.as_ref().map_or_else(String::new, |refusal| format!(": {refusal}"));
        let text = format!("{what}, by {author}{reason}");
        let is_new = self.note(author, &text);
        match refusal {
            None => tracing::info!("{text}"),
            Some(_) if is_new => tracing::warn!("{text}"),
            Some(_) => {}
        }
    }

    /// Records the last request of `author`; returns whether `text` differs from the one before.
    fn note(&mut self, author: String, text: &str) -> bool {
        let place = self.logged.iter().position(|(known, _)| *known == author);
        let before = place.and_then(|place| self.logged.remove(place));
        let is_new = before.is_none_or(|(_, before)| before != text);
        self.logged.truncate(MOST_AUTHORS - 1);
        self.logged.push_front((author, text.to_owned()));
        is_new
    }
}

/// The command of a request with its content; `None` for one of another version.
fn described(event: &EventV1) -> Option<String> {
    let EventV1 { text, point: [x, y, z], yaw, .. } = event;
    let command = OperatorCommand::from_code(event.command)?;
    Some(match command {
        OperatorCommand::Goto if yaw.is_nan() => format!("{command} {x} {y} {z}"),
        OperatorCommand::Goto => {
            // Degrees as they were given, without the rounding of radians.
            let degrees = (yaw.to_degrees() * 1e6).round() / 1e6;
            format!("{command} {x} {y} {z}, yaw {degrees} deg")
        }
        _ => format!("{command} {}", text.as_str().replace('\n', " ")).trim_end().to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_refusals_of_several_authors_in_turn_are_logged_once_each() {
        let mut log = RequestLog::default();
        let mut note = |author: &str, text| log.note(author.to_owned(), text);
        assert!(note("a", "arm: moving") && note("b", "arm: moving"));
        assert!(!note("a", "arm: moving") && !note("b", "arm: moving"));
        assert!(note("a", "arm: tilted") && note("a", "arm: moving"));
    }
}
