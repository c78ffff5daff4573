//! `oqtal tune --live`: gains for the vehicle that hovers under a running daemon.

mod excitation;
mod files;
mod hover;
mod requests;

use std::sync::atomic::{AtomicBool, Ordering};

use oqtal_bus::bus::Bus;
use oqtal_bus::paths::{InstancePaths, quoted};
use oqtal_config::{Config, Setting};
use oqtal_lab::progress::Progress;
use oqtal_lab::tune::live::{self, LiveTuning};
use oqtal_lab::tune::trade::{too_little_margin, way_to_more_margin};
use oqtal_lab::tune::tuned::Tuned;
use oqtal_lab::tune::{LiveArgs, TuneArgs};
use oqtal_operator::CtlRequest;
use oqtal_operator::request::{running_bus, silent};
use oqtal_runtime::process::{Exit, Failure, instance_paths, place_settings};
use oqtal_runtime::program::{print, say};

use crate::daemon_config::daemon_config;
use files::LiveTuningFiles;
use hover::{ObservedHover, SETTLE_S};
use requests::{ask, present_settings};

/// Time within which a running daemon publishes a tick \[s\].
const FIRST_TICK_S: f64 = 1.0;
/// Time over which the error of a hover is measured \[s\].
const HOVER_S: f64 = 6.0;

/// Whether the daemon was asked to use the new gains.
static ARE_CHANGED: AtomicBool = AtomicBool::new(false);

/// Tunes the law that flies for the vehicle that hovers, and with `--apply` changes its gains.
///
/// # Errors
/// No daemon answers (exit code 75), the vehicle does not stay in a hover or was not determined, or the gains found have too little
/// margin (1), the vehicle or its law cannot be tuned (64), the recording has flaws (65), or a file cannot be written (71).
pub fn execute(args: &TuneArgs) -> Result<Exit, Failure> {
    let search = (&args.budget(), args.weights()?, &*args.options());
    let LiveArgs { instance, root, apply, least_margin_ratio, .. } = &args.live;
    let place: Vec<_> = place_settings(instance.as_deref(), root.as_deref()).collect();
    let paths = instance_paths(&Config::load(&[], &place)?)?;
    let bus = running_bus(&paths)?;
    let config = daemon_config(&paths).ok_or_else(|| silent(&paths))?;
    let settings = present_settings(&bus)?;
    let present = Config::from_settings(&settings)?;
    live::law_of(&present)?;
    let mut hover = ObservedHover::open(&bus, &config)?;
    hover.follow(FIRST_TICK_S, None)?;
    let files = LiveTuningFiles::begin(args, present.control.controller.name())?;
    handle_interrupts(&paths)?;

    say("oqtal: the vehicle comes to rest");
    ask(&bus, CtlRequest::Hover, &[])?;
    hover.follow(SETTLE_S, None)?;
    let flight = excitation::fly(&bus, &config, &mut hover, &files.recording)?;
    say("oqtal: identifies the vehicle and searches for gains, while it hovers");
    // The daemon may run on this machine: the search must not disturb it. A failure is harmless.
    let _ = rustix::process::nice(19);
    let identification = live::identified(&flight, &settings)?;
    files.write_vehicle(&identification, (&paths, &present))?;
    let kept = files.with_config(&paths, &settings);
    let found = live::tune(identification, &kept, search, &Progress::default())?;
    files.write(&found.tuned)?;
    if found.tuned.objective >= found.tuned.start {
        return Ok(Exit::Ok);
    }
    // Gains for other settings are not proposed.
    require_unchanged(present_settings(&bus), &settings)?;
    if *apply {
        return apply_gains(&found, (&bus, &config), &settings, *least_margin_ratio);
    }
    let objection = objection(&found, *least_margin_ratio);
    propose(&found.tuned, objection.as_deref(), &paths)?;
    Ok(Exit::Ok)
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

/// Fails if there is an [`objection`] to the gains.
fn require_sound(found: &LiveTuning, least: f64) -> Result<(), Failure> {
    match objection(found, least) {
        Some(reason) => Err(Failure::new(Exit::Flight, format!("nothing was applied: {reason}"))),
        None => Ok(()),
    }
}

/// Reason against the gains and remedy: the flight does not determine the vehicle, or the disk margin is below `least` \[-\].
fn objection(found: &LiveTuning, least: f64) -> Option<String> {
    if !found.undetermined.is_empty() {
        return Some(format!(
            "the flight did not determine {}, so the search took the values of [vehicle]; repeat the command with a larger excitation \
             (trajectory.excitation), or check these values before you change the gains",
            found.undetermined.join(", ")
        ));
    }
    let reason = too_little_margin(&found.tuned.components, least)?;
    let way = way_to_more_margin(found.tuned.is_predictive());
    Some(format!("{reason}; {way}; with --apply, --least-disk-margin changes the limit"))
}

/// Fails unless the vehicle is still at the end of the excitation, by the `course` of its flight.
fn require_at_end(course: &str, is_at_rest: bool, place: &str) -> Result<(), Failure> {
    if excitation::is_in(course) && is_at_rest {
        return Ok(());
    }
    let reason = format!(
        "nothing was applied: the course of the flight was changed during the search (now: {course}); `oqtal ctl hover {place}`, then use the \
         command above"
    );
    Err(Failure::new(Exit::Flight, reason))
}

/// Ends the excitation on a signal, tells the operator that the vehicle flies on, and ends the command.
fn handle_interrupts(paths: &InstancePaths) -> Result<(), Failure> {
    let place = paths.flags();
    let text = format!(
        "oqtal: interrupted; a vehicle in flight flies on: `oqtal ctl hover {place}` or `oqtal ctl land {place}`"
    );
    let undo = format!("oqtal: {}", may_be_in_use(paths));
    let paths = paths.clone();
    let handler = move || {
        say(&text);
        if ARE_CHANGED.load(Ordering::Relaxed) {
            say(&undo);
        }
        if let Some(ended) = excitation::end(&paths) {
            say(&format!("oqtal: {ended}"));
        }
        std::process::exit(i32::from(Exit::Flight as u8));
    };
    ctrlc::set_handler(handler)
        .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))
}

/// Text that says how to undo the new gains.
fn undo(paths: &InstancePaths) -> String {
    format!("`oqtal ctl undo {}` takes them back", paths.flags())
}

/// Note on gains that the daemon may have applied.
fn may_be_in_use(paths: &InstancePaths) -> String {
    format!("the new gains may be in use: {}", undo(paths))
}

/// `KEY=VALUE` of each gain.
fn assignments(tuned: &Tuned) -> Vec<String> {
    tuned.values.iter().map(|(key, value)| format!("{key}={value:?}")).collect()
}

/// Prints the command that changes the gains in flight, after the `objection` to them.
fn propose(tuned: &Tuned, objection: Option<&str>, paths: &InstancePaths) -> Result<(), Failure> {
    let settings: Vec<String> = assignments(tuned).iter().map(|text| quoted(text)).collect();
    let (settings, place) = (settings.join(" "), paths.flags());
    let objection = objection.map_or_else(String::new, |reason| format!("warning: {reason}\n"));
    print(&format!("{objection}change them in flight: oqtal ctl set {settings} {place}"))
}

/// Changes the gains in flight, and prints the error of a hover with them and before. Gains that cannot be applied are proposed.
fn apply_gains(
    found: &LiveTuning,
    (bus, config): (&Bus, &Config),
    settings: &[Setting],
    least_margin_ratio: f64,
) -> Result<Exit, Failure> {
    let (tuned, paths) = (&found.tuned, bus.paths());
    // The ticks of the time of the search were overwritten.
    let mut hover = ObservedHover::open(bus, config)?;
    hover.follow(FIRST_TICK_S, None)?;
    let ready = |hover: &ObservedHover| {
        let course = requests::present_course(bus)?;
        require_at_end(&course, hover.is_at_rest(), &paths.flags())
    };
    let before = require_sound(found, least_margin_ratio)
        .and_then(|()| ready(&hover))
        .and_then(|()| error_before(&mut hover))
        .and_then(|before_m| ready(&hover).map(|()| before_m));
    let before_m = match before {
        Ok(before_m) => before_m,
        Err(failure) => {
            propose(tuned, None, paths)?;
            return Err(failure);
        }
    };
    require_unchanged(present_settings(bus), settings)?;
    // Before the request: an interrupt during it must name the undo.
    ARE_CHANGED.store(true, Ordering::Relaxed);
    ask(bus, CtlRequest::Set, &assignments(tuned))
        .map_err(|failure| without_answer(failure, paths))?;
    let undo = undo(paths);
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

/// Error of the hover before the change of the gains \[m\].
fn error_before(hover: &mut ObservedHover) -> Result<f64, Failure> {
    say(&format!(
        "oqtal: measures the error of the hover for {HOVER_S} s, before the change and after"
    ));
    hover.error_m(HOVER_S)
}

/// The failure of the request for the new gains; names the undo unless the daemon refused them.
fn without_answer(Failure { exit, message }: Failure, paths: &InstancePaths) -> Failure {
    match exit {
        Exit::Flight => Failure::new(exit, message),
        _ => Failure::new(exit, format!("{message}; {}", may_be_in_use(paths))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn gains_are_not_applied_in_the_flight_of_another() {
        let is_ready = |course, is_at_rest| require_at_end(course, is_at_rest, "").is_ok();
        assert!(is_ready("law oqtal, trajectory brief-excitation, at its end", true));
        assert!(!is_ready("law oqtal, trajectory brief-excitation", false));
        assert!(!is_ready("law oqtal, trajectory lemniscate", true));
        assert!(!is_ready("law oqtal, references of a planner", true));
    }

    #[test]
    fn gains_whose_request_has_no_answer_can_be_taken_back() {
        let root = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("undo", Some(root.path())).unwrap();
        let told = |exit| without_answer(Failure::new(exit, "reason"), &paths).message;
        assert!(
            told(Exit::Peer).contains("oqtal ctl undo --instance undo"),
            "{}",
            told(Exit::Peer)
        );
        assert_eq!(told(Exit::Flight), "reason", "the daemon refused them");
    }
}
