//! Remedy for flights that the fence held: the keys of the room, and a size of the trajectory that is not held.

use oqtal_config::{Config, Setting};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_runtime::process::Failure;
use toml::Value;

use super::flights::{FlightCondition, Test, config, readable};
use super::law::StudyLaw;
use crate::mission::Mission;
use crate::simulation;

/// Key of the size of a trajectory.
const SIZES: [(TrajectoryKind, &str); 6] = [
    (TrajectoryKind::Square, "trajectory.square.side-m"),
    (TrajectoryKind::Circle, "trajectory.circle.radius-m"),
    (TrajectoryKind::Lemniscate, "trajectory.lemniscate.half-length-m"),
    (TrajectoryKind::Step, "trajectory.step.angle-deg"),
    (TrajectoryKind::AttitudeChirp, "trajectory.attitude-chirp.amplitude-deg"),
    (TrajectoryKind::AttitudeDoublet, "trajectory.attitude-doublet.angle-deg"),
];

/// Shares of the configured size that are tried, the greatest first \[-\].
const SHARES: [f64; 8] = [0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2];

/// Number of held flights of each law that are flown again with a smaller size \[-\].
const TRIED: usize = 3;

/// The held flights of one trajectory.
struct HeldFlights<'a> {
    kind: TrajectoryKind,
    flights: Vec<(&'a StudyLaw, &'a FlightCondition, Test)>,
}

/// Flights of one law and test that the fence held.
pub type HeldGroup<'a> = (&'a StudyLaw, &'a [&'a FlightCondition], Test);

/// Changes with which the flights of `groups` would not be held, one line for each trajectory; empty without groups.
pub fn remedies<'a>(groups: impl IntoIterator<Item = HeldGroup<'a>>) -> String {
    let mut held: Vec<HeldFlights<'_>> = Vec::new();
    for (law, conditions, test) in groups {
        let Ok(first) = config(law, conditions[0], test) else { continue };
        let own = conditions.iter().take(TRIED).map(|condition| (law, *condition, test));
        match held.iter_mut().find(|held| held.kind == first.trajectory.kind) {
            Some(held) => held.flights.extend(own),
            None => held.push(HeldFlights { kind: first.trajectory.kind, flights: own.collect() }),
        }
    }
    held.iter().map(|held| format!("\n{}", held.remedy())).collect()
}

impl HeldFlights<'_> {
    /// The keys to change, after flights with smaller sizes.
    fn remedy(&self) -> String {
        let name = oqtal_observe::summary::name_of(&self.kind);
        let smaller = self.fitting().map(|(key, size)| {
            let count = self.flights.len();
            format!("; with --set {key}={size} none of {count} flights that were repeated is held")
        });
        format!(
            "  {name}, held by the fence: enlarge [fence] x-m, y-m, z-m, or lower fence.soft-margin-m{}",
            smaller.unwrap_or_default()
        )
    }

    /// Key and greatest size with which none of the flights is held; `None` if there is none.
    fn fitting(&self) -> Option<(&'static str, f64)> {
        let (_, key) = SIZES.iter().find(|(kind, _)| *kind == self.kind)?;
        let (law, condition, test) = self.flights[0];
        let size: f64 = config(law, condition, test).ok()?.value(key)?.parse().ok()?;
        let sizes = SHARES.map(|share| readable(share * size));
        sizes.into_iter().map(|size| (*key, size)).find(|(key, size)| {
            let is_free = |flight: &(&StudyLaw, &FlightCondition, Test)| {
                flown_with(*flight, key, *size).is_ok_and(|cause| cause.is_none())
            };
            self.flights.iter().all(is_free)
        })
    }
}

/// Cause for which a flight with this size is not complete; `None` for a complete one.
fn flown_with(
    (law, condition, test): (&StudyLaw, &FlightCondition, Test),
    key: &str,
    size: f64,
) -> Result<Option<String>, Failure> {
    let size = Setting::flag("--set", key, Value::Float(size));
    let settings = [&condition.settings[..], &[size]].concat();
    let condition = FlightCondition { settings, ..condition.clone() };
    let config: Config = config(law, &condition, test)?;
    Ok(simulation::fly(&Mission::new(config)?)?.cause())
}
