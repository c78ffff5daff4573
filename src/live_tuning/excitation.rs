//! The excitation of a vehicle that hovers under a running daemon.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::EventV1;
use oqtal_bus::origin::Origin;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_control::trajectory::{TrajectoryKind, TrajectoryOptions};
use oqtal_observe::flight::Flight;
use oqtal_observe::recording::{McapRecorder, RecordingPlan};
use oqtal_operator::CtlRequest;
use oqtal_operator::request::running_bus;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;

use super::hover::{ObservedHover, SETTLE_S};
use super::requests::{ask, present_course};
use crate::provenance::PROVENANCE;
use crate::recordings;

/// Name of the trajectory.
const NAME: &str = "brief-excitation";

/// Whether the excitation was requested and may still be flown.
static MAY_FLY: AtomicBool = AtomicBool::new(false);

/// Flies the excitation from where the vehicle is, records it into `file`, and returns the flight. After a failure the vehicle is
/// requested to hover.
///
/// # Errors
/// The vehicle does not stay in the state Nominal, or another request changes the flight (exit code 1); the daemon is silent (75); the
/// recording fails (71) or has flaws (65).
pub fn fly(
    bus: &Bus,
    config: &Config,
    hover: &mut ObservedHover,
    file: &Path,
) -> Result<Flight, Failure> {
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
    let mut recorder = recorder(config, file)?;
    // Before the request: an interrupt during it must end the excitation.
    MAY_FLY.store(true, Ordering::Relaxed);
    let asked = ask(bus, CtlRequest::Fly, &[NAME.to_owned()]);
    let flown = asked.and_then(|()| hover.follow(duration_s + SETTLE_S, Some(&mut recorder)));
    let ended = if flown.is_err() { end(bus.paths()) } else { None };
    MAY_FLY.store(false, Ordering::Relaxed);
    let recorded = recorder.finish();
    if let Err(Failure { exit, message }) = flown {
        // Ignored: the failure of the flight is reported.
        let _ = std::fs::remove_file(file);
        let ended = ended.map_or_else(String::new, |ended| format!("; {ended}"));
        return Err(Failure::new(exit, message + &ended));
    }
    recordings::check(&recorded)?;
    let flight = recordings::read_flight(file)?;
    require_undisturbed(&flight.changes)?;
    require_complete(&flight)?;
    Ok(flight)
}

/// Requests a hover if the excitation may still be flown; returns the result as text, `None` without an excitation.
pub fn end(paths: &InstancePaths) -> Option<String> {
    if !MAY_FLY.swap(false, Ordering::Relaxed) {
        return None;
    }
    let asked = running_bus(paths).and_then(|bus| match present_course(&bus) {
        // A landing, or the flight of another, is not interrupted.
        Ok(course) if !is_in(&course) => Ok(false),
        _ => ask(&bus, CtlRequest::Hover, &[]).map(|()| true),
    });
    match asked {
        Ok(has_asked) => has_asked
            .then(|| "a hover was requested and accepted, which ends the excitation".to_owned()),
        Err(failure) => Some(format!(
            "a hover was requested and not accepted, so the excitation may continue: {failure}"
        )),
    }
}

/// Whether the `course` of a flight, as text of the daemon, is the excitation.
pub fn is_in(course: &str) -> bool {
    course.contains(NAME)
}

fn recorder(config: &Config, file: &Path) -> Result<McapRecorder, Failure> {
    let plan = RecordingPlan {
        path: file.to_owned(),
        config,
        provenance: PROVENANCE,
        rotates: false,
        complain: |message| say(&format!("oqtal: {message}")),
    };
    McapRecorder::create(&plan).map_err(|error| {
        let reason = format!("{}: {error}; give another directory with --out", file.display());
        Failure::new(Exit::System, reason)
    })
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

/// Fails if the record of the flight has flaws: the vehicle would be identified from another motion.
fn require_complete(flight: &Flight) -> Result<(), Failure> {
    let flaws = flight.record_flaws();
    if flaws.is_empty() {
        return Ok(());
    }
    let remedy = match flight.has_other_config {
        true => "restart every process with one configuration, then repeat the command",
        false => "repeat the command with less load on this machine",
    };
    let reason = format!("nothing was changed: {}; {remedy}", flaws.join("; "));
    Err(Failure::new(Exit::Data, reason))
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
    fn a_vehicle_is_not_identified_from_a_recording_with_flaws() {
        let whole = Flight::new(&Config::default());
        assert!(require_complete(&whole).is_ok());
        let other = require_complete(&Flight { has_other_config: true, ..whole }).unwrap_err();
        assert!(other.exit == Exit::Data && other.message.contains("restart every process"));
    }

    #[test]
    fn no_hover_is_requested_without_an_excitation() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("excitation", Some(root.path())).unwrap();
        assert_eq!(end(&paths), None);
    }
}
