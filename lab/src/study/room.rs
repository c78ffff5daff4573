//! Remedy for flights that the fence held or stopped, and for manoeuvres of the attitude that drifted from their reference: the
//! keys of the room, and a size of the trajectory with which they are complete.

use oqtal_bus::code::Cause;
use oqtal_config::{Config, Setting};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::flight::is_of_fence;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;
use toml::Value;

use super::flights::{FlightCondition, Test, config, readable};
use super::law::StudyLaw;
use crate::mission::Mission;
use crate::simulation;

/// Key of the size of a trajectory. During the chirp the position loop is open, and the vehicle drifts further the
/// longer the chirp lasts, at any amplitude.
const SIZES: [(TrajectoryKind, &str); 6] = [
    (TrajectoryKind::Square, "trajectory.square.side-m"),
    (TrajectoryKind::Circle, "trajectory.circle.radius-m"),
    (TrajectoryKind::Lemniscate, "trajectory.lemniscate.half-length-m"),
    (TrajectoryKind::Step, "trajectory.step.angle-deg"),
    (TrajectoryKind::AttitudeChirp, "trajectory.attitude-chirp.sweep-s"),
    (TrajectoryKind::AttitudeDoublet, "trajectory.attitude-doublet.angle-deg"),
];

/// Shares of the configured size that are tried, the greatest first \[-\].
const SHARES: [f64; 8] = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2];

/// Half of the sides of a fence that bounds no flight, and its height \[m\].
const WIDE_M: f64 = 100.0;

/// Difference between the thrust of a hover and that of the model above which it is reported [% of the greatest].
const TOLD_DIFFERENCE: f64 = 5.0;

/// Distances from the reference that are tried as limits \[m\].
const LIMITS_M: [f64; 4] = [3.0, 5.0, 10.0, 20.0];

/// Number of seeds that the text lists for each cause \[-\].
pub(super) const SHOWN_SEEDS: usize = 8;
/// Number of flights with which each change is tried, shared by the groups of flights \[-\].
const TRIED: usize = 60;
/// Least share of a group \[-\].
const LEAST_TRIED: usize = 5;

/// A flight that needed more room.
#[derive(Clone, Copy)]
struct CrampedFlight<'a> {
    law: &'a StudyLaw,
    condition: &'a FlightCondition,
    test: Test,
    /// Whether the fence ended it; otherwise the distance from the reference did.
    of_fence: bool,
}

/// Flights of one trajectory that needed more room, with which changes are tried.
struct CrampedFlights<'a> {
    kind: TrajectoryKind,
    flights: Vec<CrampedFlight<'a>>,
}

/// Flights of one law and test that needed more room, and whether the fence ended them.
pub type CrampedGroup<'a> = ((&'a StudyLaw, &'a [&'a FlightCondition], Test), bool);

/// Whether a flight that ended by `cause`, of [`oqtal_observe::flight::Flight::cause`], needed more room.
pub fn is_cramped(cause: &str) -> bool {
    is_of_fence(cause) || cause.ends_with(&Cause::Tracking.to_string())
}

/// Settings that a remedy may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Changes {
    /// All settings, for a study.
    All,
    /// Sizes of trajectories, by requests to a daemon.
    InFlight,
}

/// Changes with which the flights of `groups` would be complete, one line for each trajectory; empty without groups.
pub fn remedies<'a>(
    groups: impl IntoIterator<Item = CrampedGroup<'a>>,
    changes: Changes,
) -> String {
    let groups: Vec<CrampedGroup<'_>> = groups.into_iter().collect();
    let share = (TRIED / groups.len().max(1)).max(LEAST_TRIED);
    // With the number of all flights that needed more room.
    let mut cramped: Vec<(CrampedFlights<'_>, usize)> = Vec::new();
    for ((law, conditions, test), of_fence) in groups {
        let Ok(first) = config(law, conditions[0], test) else { continue };
        let cramped_flight = |condition| CrampedFlight { law, condition, test, of_fence };
        let own = conditions.iter().take(share).copied().map(cramped_flight);
        let (kind, of) = (first.trajectory.kind, conditions.len());
        match cramped.iter_mut().find(|(others, _)| others.kind == kind) {
            Some((others, all)) => {
                others.flights.extend(own);
                *all += of;
            }
            None => cramped.push((CrampedFlights { kind, flights: own.collect() }, of)),
        }
    }
    let remedy = |(flights, all): &(CrampedFlights<'_>, usize)| {
        let remedy = match changes {
            Changes::All => flights.remedy(),
            Changes::InFlight => flights.remedy_in_flight(),
        };
        let tried = part_tried(flights.flights.len(), *all);
        format!("\n{remedy}{tried}")
    };
    cramped.iter().map(remedy).collect()
}

/// Reservation on a remedy that was tried with a part of all flights; empty if all were tried.
fn part_tried(tried: usize, all: usize) -> String {
    if tried < all {
        format!(" (tried with {tried} of these {all} flights)")
    } else {
        String::new()
    }
}

impl CrampedFlight<'_> {
    /// Cause for which the flight is not complete with these settings; `None` if it is.
    fn cause_with(&self, settings: &[Setting]) -> Option<String> {
        let settings = [&self.condition.settings[..], settings].concat();
        let condition = FlightCondition { settings, ..self.condition.clone() };
        let config = CrampedFlight { condition: &condition, ..*self }.config();
        let flown = config.and_then(|config| simulation::fly(&Mission::new(config)?));
        flown.map_or_else(|failure| Some(failure.message), |flight| flight.cause())
    }

    /// The configuration of the flight.
    fn config(&self) -> Result<Config, Failure> {
        config(self.law, self.condition, self.test)
    }

    /// Seed, and the simulated vehicle unless it is the configured one.
    fn seed(&self) -> String {
        let FlightCondition { seed, plant, .. } = self.condition;
        match plant.changes.is_empty() {
            true => seed.to_string(),
            false => format!("{seed} ({})", plant.name),
        }
    }
}

impl CrampedFlights<'_> {
    /// Whether all of the flights are complete with these settings.
    fn are_complete_with(&self, settings: &[(&str, Value)]) -> bool {
        let settings = as_flags(settings);
        self.flights.par_iter().all(|flight| flight.cause_with(&settings).is_none())
    }

    /// The flights that are complete with these settings, and the others by law and cause.
    fn split_by(&self, settings: &[(&str, Value)]) -> (Self, Vec<(Self, String)>) {
        let settings = as_flags(settings);
        let of = |flights| Self { kind: self.kind, flights };
        let (mut complete, mut failing) = (of(Vec::new()), Vec::<(Self, String)>::new());
        let causes = self.flights.par_iter().map(|flight| flight.cause_with(&settings));
        for (flight, cause) in self.flights.iter().zip(causes.collect::<Vec<_>>()) {
            let Some(cause) = cause else {
                complete.flights.push(*flight);
                continue;
            };
            let is_same = |(others, of): &&mut (Self, String)| {
                others.flights[0].law.name == flight.law.name && *of == cause
            };
            match failing.iter_mut().find(is_same) {
                Some((others, _)) => others.flights.push(*flight),
                None => failing.push((of(vec![*flight]), cause)),
            }
        }
        (complete, failing)
    }

    /// Trajectory and end of the flights.
    fn ended(&self) -> String {
        let name = oqtal_observe::summary::name_of(&self.kind);
        let of_fence = |flight: &CrampedFlight<'_>| flight.of_fence;
        let ends = match [self.flights.iter().any(of_fence), self.flights.iter().all(of_fence)] {
            [true, false] => "ended by the fence or far from the reference",
            [false, _] => "far from the reference",
            [true, true] => "held or stopped by the fence",
        };
        format!("{name}, {ends}")
    }

    /// Laws of the flights, each with its seeds.
    fn named(&self) -> String {
        let mut laws: Vec<(&str, Vec<String>)> = Vec::new();
        for flight in &self.flights {
            match laws.iter_mut().find(|(law, _)| *law == flight.law.name) {
                Some((_, seeds)) => seeds.push(flight.seed()),
                None => laws.push((&flight.law.name, vec![flight.seed()])),
            }
        }
        let law = |(law, seeds): (&str, Vec<String>)| {
            let plural = if seeds.len() == 1 { "" } else { "s" };
            let more = if seeds.len() > SHOWN_SEEDS { ", …" } else { "" };
            format!(
                "{law} with seed{plural} {}{more}",
                seeds[..seeds.len().min(SHOWN_SEEDS)].join(", ")
            )
        };
        laws.into_iter().map(law).collect::<Vec<_>>().join("; ")
    }

    /// Sentence on a plant that hovers with another share of its thrust than the law's model; `None` if they are alike.
    fn difference(&self) -> Option<String> {
        let config = self.flights[0].config().ok()?;
        let gravity_m_s2 = config.vehicle.gravity_m_s2;
        let share = |mass_kg: f64, thrust_n: f64| 100.0 * mass_kg * gravity_m_s2 / thrust_n;
        let (plant, vehicle) = (&config.plant, &config.vehicle);
        let plant = share(plant.mass_kg, plant.max_thrust_n);
        let vehicle = share(vehicle.mass_kg, vehicle.max_thrust_n);
        ((plant - vehicle).abs() > TOLD_DIFFERENCE).then(|| format!(
            "; the simulated vehicle hovers at {plant:.0} % of its thrust, the vehicle that the laws assume ([vehicle]) at {vehicle:.0} %"
        ))
    }

    /// The changes with which, each by itself, the flights are complete, apart from those that more room does not help.
    fn remedy(&self) -> String {
        let unbounded = [&wide_fence()[..], &[limit(WIDE_M)]].concat();
        let (helped, others) = self.split_by(&unbounded);
        let mut lines: Vec<String> =
            others.iter().map(|(it, cause)| it.without_remedy(cause)).collect();
        if !helped.flights.is_empty() {
            let of =
                if others.is_empty() { String::new() } else { format!(", {}", helped.named()) };
            lines.push(format!("  {}{of}: {}", helped.ended(), helped.changes()));
        }
        lines.join("\n")
    }

    /// Line on flights that end by `cause` also with more room.
    fn without_remedy(&self, cause: &str) -> String {
        let (ended, named) = (self.ended(), self.named());
        let difference = self.difference().unwrap_or_default();
        format!(
            "  {ended}, {named}: more room does not help; with a fence of {WIDE_M:.0} m around the start: {cause}{difference}"
        )
    }

    /// The changes with which, each by itself, all of the flights are complete.
    fn changes(&self) -> String {
        let suffices = |settings: &[(&str, Value)]| self.are_complete_with(settings);
        let least_limit = LIMITS_M.into_iter().find(|limit_m| suffices(&[limit(*limit_m)]));
        let without_margin = [("fence.soft-margin-m", Value::Float(0.0))];
        let none = Value::Array(Vec::new());
        let without_force = [("plant.force-n", vec![Value::Float(0.0); 3].into())];
        let all = [
            self.narrow_sides().map(|keys| format!("enlarge the fence ({keys})")),
            suffices(&without_margin).then(|| "set fence.soft-margin-m=0".to_owned()),
            least_limit.map(|limit_m| format!("raise safety.tracking-limit-m to {limit_m}")),
            self.fitting().map(|(key, size)| format!("set {key}={size}")),
            suffices(&without_force).then(|| "set plant.force-n=[0,0,0]".to_owned()),
            suffices(&[("plant.disturb", none)]).then(|| "fly without plant.disturb".to_owned()),
        ];
        let all: Vec<String> = all.into_iter().flatten().collect();
        match all.is_empty() {
            true => "enlarge the fence and raise safety.tracking-limit-m, both".to_owned(),
            false => all.join(", or "),
        }
    }

    /// The fewest keys of the fence with which, enlarged, all of the flights are complete; `None` if a larger fence does not suffice.
    fn narrow_sides(&self) -> Option<String> {
        let all = wide_fence();
        if !self.are_complete_with(&all) {
            return None;
        }
        let has_polygon = |flight: &CrampedFlight<'_>| {
            flight.config().is_ok_and(|config| !config.fence.polygon_m.is_empty())
        };
        // Indices of x-m, y-m, z-m and polygon-m. Without its polygon, a fence has the sides of x-m and y-m.
        let (always, sets): (&[usize], &[&[usize]]) = match self.flights.iter().any(has_polygon) {
            true => (&[0, 1], &[&[2], &[3], &[3, 2]]),
            false => (&[], &[&[0], &[1], &[2], &[0, 1], &[0, 2], &[1, 2], &[0, 1, 2]]),
        };
        let suffices = |set: &&&[usize]| {
            let sides = always.iter().chain(**set).map(|index| all[*index].clone());
            self.are_complete_with(&sides.collect::<Vec<_>>())
        };
        let fewest = sets.iter().find(suffices)?;
        Some(fewest.iter().map(|index| all[*index].0).collect::<Vec<_>>().join(" and "))
    }

    /// The request with which the flights are complete: fence and limits cannot change in flight, the size of the trajectory can.
    fn remedy_in_flight(&self) -> String {
        let name = oqtal_observe::summary::name_of(&self.kind);
        match self.fitting() {
            Some((key, value)) => {
                format!("  {name}: before the search, request `set {key}={value}`")
            }
            None => format!(
                "  {name}: no smaller size suffices; land, and give the daemon more room or a smaller [trajectory.{name}]"
            ),
        }
    }

    /// Key and greatest size with which all of the flights are complete; `None` if there is none.
    fn fitting(&self) -> Option<(&'static str, f64)> {
        let (_, key) = SIZES.iter().find(|(kind, _)| *kind == self.kind)?;
        let size: f64 = self.flights[0].config().ok()?.value(key)?.parse().ok()?;
        let mut sizes = SHARES.map(|share| readable(share * size)).into_iter();
        let size = sizes.find(|size| self.are_complete_with(&[(key, Value::Float(*size))]));
        size.map(|size| (*key, size))
    }
}

/// A limit of the distance from the reference \[m\].
fn limit(limit_m: f64) -> (&'static str, Value) {
    ("safety.tracking-limit-m", Value::Float(limit_m))
}

fn as_flags(settings: &[(&str, Value)]) -> Vec<Setting> {
    let flag = |(key, value): &(&str, Value)| Setting::flag("--set", key, value.clone());
    settings.iter().map(flag).collect()
}

/// A fence that bounds no flight.
fn wide_fence() -> [(&'static str, Value); 4] {
    let range = |from: f64| Value::Array(vec![Value::Float(from), Value::Float(WIDE_M)]);
    [
        ("fence.x-m", range(-WIDE_M)),
        ("fence.y-m", range(-WIDE_M)),
        ("fence.z-m", range(-0.5)),
        ("fence.polygon-m", Value::Array(Vec::new())),
    ]
}

#[cfg(test)]
mod tests;
