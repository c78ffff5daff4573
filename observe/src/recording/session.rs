//! Recordings of several flights: one flight of them, `FILE#NUMBER`, and the list of all.

use std::path::{Path, PathBuf};

use comfy_table::{ColumnConstraint, ContentArrangement};
use oqtal_bus::topic::{ObservedTopic, Sample};
use serde::Serialize;

use super::closing;
use super::file::{RecordingFile, RecordingFileError};
use super::overview::utc;
use super::playback::{config, flight, play};
use crate::flight::Flight;
use crate::sink::{Reception, Sink};
use crate::summary::Summary;
use crate::table;

/// Width of the list in a terminal \[columns\]; longer cells are wrapped.
const WIDTH: u16 = 120;
/// Time before the start of a flight from which on messages are of that flight \[ns\].
const BEFORE_NS: u64 = 1_000_000_000;

/// Reads the recording at `path`, or only one of its flights, `FILE#NUMBER`.
///
/// # Errors
/// The file cannot be read, is not a recording, or has no such flight.
pub fn read(path: &Path) -> Result<RecordingFile, RecordingFileError> {
    let (file, number) = numbered(path);
    let whole = RecordingFile::read(&file)?;
    let Some(number) = number else { return Ok(whole) };
    let mut flight = whole.only_flight(number)?;
    flight.path = path.to_path_buf();
    Ok(flight)
}

/// The path and the number of the flight that `path` names; `None` for the whole recording.
pub fn numbered(path: &Path) -> (PathBuf, Option<usize>) {
    let text = path.to_string_lossy();
    let number = |(file, number): (&str, &str)| Some((file.into(), Some(number.parse().ok()?)));
    let whole = || (path.to_path_buf(), None);
    if path.exists() {
        whole()
    } else {
        text.rsplit_once('#').and_then(number).unwrap_or_else(whole)
    }
}

/// Beginning of a flight, and of its record \[ns, time of the file\].
#[derive(Clone, Copy, Debug)]
struct Start {
    armed_ns: u64,
    recorded_ns: u64,
}

/// The starts of the flights of a recording.
#[derive(Debug, Default)]
struct Starts {
    /// Time of the last tick of a flight \[ns\]; `None` before the first.
    last_ns: Option<u64>,
    is_armed: bool,
    all: Vec<Start>,
}

impl Sink for Starts {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        let Sample::Telemetry(tick) = sample else { return };
        let was_armed = std::mem::replace(&mut self.is_armed, tick.is_armed());
        if !self.is_armed {
            return;
        }
        let armed_ns = reception.received_at.nanos();
        if !was_armed {
            // Between two flights in quick succession both have a half: the first ends with its disarmed ticks.
            let middle_ns = self.last_ns.map_or(0, |last| last.midpoint(armed_ns));
            let recorded_ns = armed_ns.saturating_sub(BEFORE_NS).max(middle_ns);
            self.all.push(Start { armed_ns, recorded_ns });
        }
        self.last_ns = Some(armed_ns);
    }
}

impl RecordingFile {
    /// The starts of its flights; none for the record of a daemon that only observes.
    fn starts(&self) -> Result<Vec<Start>, RecordingFileError> {
        let mut starts = Starts::default();
        if !config(self)?.safety.observe_only {
            play(self, &mut starts)?;
        }
        let offset_ns = self.wall_offset_ns();
        let dated = |start: Start| Start {
            armed_ns: start.armed_ns.saturating_add_signed(offset_ns),
            recorded_ns: start.recorded_ns.saturating_add_signed(offset_ns),
        };
        Ok(starts.all.into_iter().map(dated).collect())
    }

    /// The record of flight `number`, from 1 on, up to the next one, with the requests of operators before it.
    ///
    /// # Errors
    /// The recording is of a version with other message definitions, has no valid configuration, or has no such flight.
    pub fn only_flight(&self, number: usize) -> Result<Self, RecordingFileError> {
        let starts = self.starts()?;
        if (1..=starts.len()).contains(&number) {
            return Ok(self.part(&starts, number));
        }
        Err(RecordingFileError::NoFlight { path: self.path.clone(), flights: starts.len() })
    }

    /// The record of flight `number`, from 1 on, of those that begin at `starts`.
    fn part(&self, starts: &[Start], number: usize) -> Self {
        let from_ns = starts[number - 1].recorded_ns;
        let until_ns = starts.get(number).map_or(u64::MAX, |next| next.recorded_ns);
        let event = ObservedTopic::Event.name();
        let requests = self.channels.iter().find(|(_, channel)| channel.topic == event);
        let requests = requests.map(|(id, _)| *id);
        let mut part = self.holding(|message| {
            let is_kept = message.log_time >= from_ns || requests == Some(message.channel);
            is_kept && message.log_time < until_ns
        });
        // The requests count as received at its beginning.
        part.messages.iter_mut().for_each(|it| it.log_time = it.log_time.max(from_ns));
        if number < starts.len() {
            // They are of the last flight.
            closing::remove(&mut part);
        }
        part
    }

    /// The flights, in order.
    ///
    /// # Errors
    /// The recording is of a version with other message definitions, or has no valid configuration.
    pub fn flights(&self) -> Result<Vec<ListedFlight>, RecordingFileError> {
        let is_real = self.wall_offset_ns() != 0;
        let starts = self.starts()?;
        // The number of the only flight that was read.
        let first = numbered(&self.path).1.unwrap_or(1);
        let listed = |(index, start): (usize, &Start)| {
            let flown = flight(&self.part(&starts, index + 1))?;
            Ok(ListedFlight::of(first + index, is_real.then(|| utc(start.armed_ns)), &flown))
        };
        starts.iter().enumerate().map(listed).collect()
    }
}

/// A flight in a list.
#[derive(Clone, Debug, Serialize)]
pub struct ListedFlight {
    /// Number in the recording, from 1 on \[-\].
    pub flight: usize,
    /// Time of the start, UTC; `None` for a flight in virtual time.
    pub began: Option<String>,
    /// Time from arming to the end \[s\].
    pub duration_s: f64,
    /// Law.
    pub controller: String,
    /// Trajectory.
    pub trajectory: String,
    /// Outcome.
    pub outcome: String,
    /// Why it did not end as planned; empty for a complete flight.
    pub cause: String,
}

impl ListedFlight {
    fn of(number: usize, began: Option<String>, flown: &Flight) -> Self {
        let summary = Summary::of(flown);
        Self {
            flight: number,
            began,
            duration_s: summary.duration_s,
            controller: summary.controller,
            trajectory: summary.trajectory,
            outcome: summary.outcome.to_string(),
            cause: flown.shortfall().unwrap_or_default(),
        }
    }
}

/// The flights of recordings as a table: the name by which commands find each of them, time, law, outcome and cause.
pub fn list(recordings: &[(String, Vec<ListedFlight>)]) -> String {
    let header = ["flight", "began", "s", "controller", "trajectory", "outcome", "cause"];
    let mut rows = table::table(&header);
    rows.set_content_arrangement(ContentArrangement::Dynamic).set_width(WIDTH);
    if let Some(names) = rows.column_mut(0) {
        // Names are copied.
        names.set_constraint(ColumnConstraint::ContentWidth);
    }
    for (name, flights) in recordings {
        for it in flights {
            rows.add_row([
                if flights.len() > 1 { format!("{name}#{}", it.flight) } else { name.clone() },
                it.began.clone().unwrap_or_else(|| "virtual time".to_owned()),
                format!("{:.1}", it.duration_s),
                it.controller.clone(),
                it.trajectory.clone(),
                it.outcome.clone(),
                it.cause.clone(),
            ]);
        }
    }
    rows.to_string()
}
