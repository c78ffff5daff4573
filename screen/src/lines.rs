//! The model as lines of text: a label, words, and their importance.

use oqtal_bus::code::{ControlHolder, Mode, SafetyState, VehicleLink};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::obstacle::ArmingObstacles;
use oqtal_bus::time::Span;
use oqtal_observe::event::DaemonCondition;
use oqtal_observe::instance::{InstanceModel, Newest, tracking_error_m};
use oqtal_observe::latency::{DistributionSummary, WHOLE};
use oqtal_observe::status::{OLD_POSITION_S, VehicleStatus, trouble_of_receiver};

use crate::look::Weight;
use crate::wrapping::wrapped;

/// Age above which ticks and messages are not shown as the present state.
const STALE: Span = Span::from_millis(1000);

/// Width of the time of an event \[cells\].
const EVENT_INDENT: u16 = 8;

/// A line of the status.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StatusLine {
    /// Subject.
    pub label: &'static str,
    /// Text.
    pub text: String,
    /// Importance.
    pub weight: Weight,
}

fn line(label: &'static str, text: impl Into<String>, weight: Weight) -> StatusLine {
    StatusLine { label, text: text.into(), weight }
}

/// Status of the instance, most important lines first.
pub fn status(model: &InstanceModel) -> Vec<StatusLine> {
    vec![
        state(model),
        problems(model),
        mode(model),
        vehicle(model),
        poses(model),
        tracking(model),
        adaptation(model),
        loop_figures(model),
        processes(model),
    ]
}

/// The newest tick, unless it is stale.
fn present(model: &InstanceModel) -> Option<TelemetryV1> {
    let is_present = model.tick_age().is_some_and(|age| age <= STALE);
    model.tick.filter(|_| is_present).map(|tick| tick.body)
}

fn state(model: &InstanceModel) -> StatusLine {
    let label = "state";
    if let Some(tick) = present(model) {
        let condition = DaemonCondition::of(&tick);
        let weight = match condition.state() {
            Some(SafetyState::Nominal) => Weight::Good,
            Some(state) if !state.ends_flight() => Weight::Warning,
            _ => Weight::Alarm,
        };
        return line(label, condition.state_text(), weight);
    }
    let seen = model
        .tick_age()
        .map_or_else(String::new, |age| format!(", last tick {:.0} s ago", age.seconds()));
    let text = match model.is_alive() {
        true if model.lacks_daemon() => "no daemon: not started, or ended".to_owned(),
        true => format!("no daemon ticks{seen}"),
        false => format!("no process runs{seen}: waiting for the instance"),
    };
    line(label, text, Weight::Alarm)
}

fn mode(model: &InstanceModel) -> StatusLine {
    let label = "mode";
    let Some(tick) = present(model) else { return line(label, "-", Weight::Plain) };
    let mode = DaemonCondition::of(&tick).mode_text();
    let flown = model.law_and_trajectory.iter().map(|text| format!(", {text}")).collect::<String>();
    if tick.mission_s.is_finite() {
        let text = format!("{mode}, mission {:.1} s{flown}", tick.mission_s);
        return line(label, text, Weight::Plain);
    }
    let obstacles = ArmingObstacles::from_bits(tick.obstacles);
    if obstacles.is_empty() || tick.mode == Mode::Flying.code() {
        return line(label, mode + &flown, Weight::Plain);
    }
    line(label, format!("{mode}; no take-off: {obstacles}"), Weight::Warning)
}

fn vehicle(model: &InstanceModel) -> StatusLine {
    let label = "vehicle";
    let Some(Newest { received_at, body }) = model.vehicle else {
        return line(label, "no message of a vehicle was received", Weight::Warning);
    };
    let (age, state) = (model.now.since(received_at), VehicleStatus::new(&body));
    let text = match age > STALE {
        true => format!("{:.0} s ago: {state}", age.seconds()),
        false => state.to_string(),
    };
    let is_well = body.link == VehicleLink::Answers.code() && body.stopped == 0 && age <= STALE;
    line(label, text, if is_well { Weight::Plain } else { Weight::Warning })
}

fn poses(model: &InstanceModel) -> StatusLine {
    let label = "poses";
    let Some(tick) = present(model) else { return line(label, "-", Weight::Plain) };
    let counters = model.figures.counters();
    let age = match tick.pose_age_s.is_finite() {
        true => format!("age {:.1} ms", tick.pose_age_s * 1e3),
        false => "none yet".to_owned(),
    };
    let text = format!("{age}; lost {}, refused {}", counters.poses_lost, counters.poses_refused);
    line(label, text, if tick.fresh == 1 { Weight::Plain } else { Weight::Warning })
}

fn tracking(model: &InstanceModel) -> StatusLine {
    let label = "position";
    let Some(tick) = present(model).filter(|tick| tick.pose_age_s.is_finite()) else {
        return line(label, "-", Weight::Plain);
    };
    if tick.pose_age_s > OLD_POSITION_S {
        let ([x, y, z], age_s) = (tick.position, tick.pose_age_s);
        let text = format!("{x:.2} {y:.2} {z:.2} m, {age_s:.0} s ago");
        return line(label, text, Weight::Warning);
    }
    let [x, y, z] = tick.position;
    let error = tracking_error_m(&tick).map_or_else(
        || "no reference".to_owned(),
        |error| format!("estimate {error:.3} m from reference, max {:.3} m", model.max_error_m),
    );
    line(label, format!("{x:.2} {y:.2} {z:.2} m; {error}"), Weight::Plain)
}

/// Parameters of the vehicle in the adapted model.
fn adaptation(model: &InstanceModel) -> StatusLine {
    let label = "model";
    let flown = present(model).filter(|tick| tick.adapted_rate_lag_s.is_finite());
    let Some(tick) = flown else { return line(label, "as configured", Weight::Plain) };
    let condition = DaemonCondition::of(&tick);
    if condition.fell_back() {
        return line(label, condition.model_text(), Weight::Warning);
    }
    let [roll, pitch, _] = tick.adapted_rate_gain;
    let text = format!(
        "rate x {roll:.2}, {pitch:.2}, lag {:.0} ms, hidden {:.0} ms; thrust x {:.2}, lag {:.0} ms",
        tick.adapted_rate_lag_s * 1e3,
        tick.adapted_delay_s * 1e3,
        tick.adapted_thrust_gain,
        tick.adapted_thrust_lag_s * 1e3
    );
    line(label, text, Weight::Plain)
}

fn loop_figures(model: &InstanceModel) -> StatusLine {
    let counters = model.figures.counters();
    let text = format!(
        "observed: {} ticks, deadlines missed {}, commands lost {}",
        counters.ticks, counters.deadline_misses, counters.commands_lost
    );
    line("loop", text, Weight::Plain)
}

fn processes(model: &InstanceModel) -> StatusLine {
    let names = model.processes().map(|process| {
        let state = if process.is_silent { "SILENT".to_owned() } else { process.pid().to_string() };
        format!("{} {state}", process.role.name())
    });
    let names: Vec<String> = names.collect();
    let text = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    let any_silent = model.processes().any(|process| process.is_silent);
    line("process", text, if any_silent { Weight::Warning } else { Weight::Plain })
}

/// Present problems of processes, vehicle and observation, without injected faults.
fn problems(model: &InstanceModel) -> StatusLine {
    let mut found: Vec<String> =
        model.lacks_daemon().then(|| "no daemon".to_owned()).into_iter().collect();
    for process in model.processes() {
        let name = process.role.name();
        if process.is_silent {
            found.push(format!("{name} silent"));
        } else if let Some(trouble) = trouble_of_receiver(process.role, process.health.cause) {
            found.push(trouble.to_owned());
        } else if process.health.runs_late == 1 {
            found.push(format!("{name} runs late"));
        }
    }
    if model.configs_differ() {
        found.push("configurations differ".to_owned());
    }
    if let Some(Newest { body, .. }) = model.vehicle {
        let taken = body.control == ControlHolder::Another.code();
        let wrong = [
            (!body.answers(), "vehicle silent"),
            (body.stopped == 1, "operator's stop"),
            (taken, "another has control"),
        ];
        found.extend(wrong.into_iter().filter(|(is, _)| *is).map(|(_, text)| text.to_owned()));
    }
    let counters = model.figures.counters();
    if counters.unobserved > 0 {
        found.push(format!("{} samples not observed", counters.unobserved));
    }
    let weight = if found.is_empty() { Weight::Good } else { Weight::Alarm };
    let text = if found.is_empty() { "none".to_owned() } else { found.join(", ") };
    line("problems", text, weight)
}

/// Table of latencies: a heading, the sum of all hops, then every hop.
pub fn hop_table(model: &InstanceModel) -> Vec<String> {
    let head = format!("{:<20}{:>8}{:>8}{:>8}", "hop [ms]", "p50", "p99", "max");
    let rows = model.figures.hops().iter().map(|(name, distribution)| {
        let DistributionSummary { count, p50_ns, p99_ns, max_ns, .. } = distribution.summary();
        let cell = |ns: u64| match count {
            0 => format!("{:>8}", "-"),
            _ => format!("{:>8.3}", ns as f64 * 1e-6),
        };
        (name, format!("{name:<20}{}{}{}", cell(p50_ns), cell(p99_ns), cell(max_ns)))
    });
    let (whole, parts): (Vec<_>, Vec<_>) = rows.partition(|(name, _)| *name == WHOLE);
    let rows = whole.into_iter().chain(parts).map(|(_, row)| row);
    std::iter::once(head).chain(rows).collect()
}

/// The events, oldest first, wrapped to this number of columns \[cells\].
pub fn events(model: &InstanceModel, width: u16) -> Vec<String> {
    let event = |(at, text): &(Span, String)| {
        let begin = std::iter::once(format!("{:>7.1} ", at.seconds()));
        let begins = begin.chain(std::iter::repeat(" ".repeat(usize::from(EVENT_INDENT))));
        let rows = wrapped(text, width.saturating_sub(EVENT_INDENT));
        begins.zip(rows).map(|(begin, row)| begin + &row).collect::<Vec<_>>()
    };
    model.events.iter().flat_map(event).collect()
}
