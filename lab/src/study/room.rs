//! Remedy for flights that the fence held or stopped: the keys of the room, and a size of the trajectory with which they are
//! complete.

use oqtal_config::{Config, Setting};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_runtime::process::Failure;
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

/// Number of flights of each law, test and cause that are flown again with a smaller size \[-\].
const TRIED: usize = 5;

/// Flights of one trajectory that the fence held or stopped.
struct FenceFlights<'a> {
    kind: TrajectoryKind,
    flights: Vec<(&'a StudyLaw, &'a FlightCondition, Test)>,
}

/// Flights of one law and test that the fence held or stopped.
pub type FenceGroup<'a> = (&'a StudyLaw, &'a [&'a FlightCondition], Test);

/// Changes with which the flights of `groups` would be complete, one line for each trajectory; empty without groups.
pub fn remedies<'a>(groups: impl IntoIterator<Item = FenceGroup<'a>>) -> String {
    let mut held: Vec<FenceFlights<'_>> = Vec::new();
    for (law, conditions, test) in groups {
        let Ok(first) = config(law, conditions[0], test) else { continue };
        let own = conditions.iter().take(TRIED).map(|condition| (law, *condition, test));
        match held.iter_mut().find(|held| held.kind == first.trajectory.kind) {
            Some(held) => held.flights.extend(own),
            None => held.push(FenceFlights { kind: first.trajectory.kind, flights: own.collect() }),
        }
    }
    held.iter().map(|held| format!("\n{}", held.remedy())).collect()
}

impl FenceFlights<'_> {
    /// The keys to change, after flights with smaller sizes.
    fn remedy(&self) -> String {
        let name = oqtal_observe::summary::name_of(&self.kind);
        let smaller = self.fitting().map(|(key, size)| {
            let count = self.flights.len();
            let are_complete = match count {
                1 => "the repeated flight is complete".to_owned(),
                _ => format!("all {count} repeated flights are complete"),
            };
            format!("; with --set {key}={size} {are_complete}")
        });
        format!(
            "  {name}, held or stopped by the fence: enlarge [fence] x-m, y-m, z-m, or lower fence.soft-margin-m{}",
            smaller.unwrap_or_default()
        )
    }

    /// Key and greatest size with which all of the flights are complete; `None` if there is none.
    fn fitting(&self) -> Option<(&'static str, f64)> {
        let (_, key) = SIZES.iter().find(|(kind, _)| *kind == self.kind)?;
        let (law, condition, test) = self.flights[0];
        let size: f64 = config(law, condition, test).ok()?.value(key)?.parse().ok()?;
        let sizes = SHARES.map(|share| readable(share * size));
        sizes.into_iter().map(|size| (*key, size)).find(|(key, size)| {
            let is_complete = |flight: &(&StudyLaw, &FlightCondition, Test)| {
                flown_with(*flight, key, *size).is_ok_and(|cause| cause.is_none())
            };
            self.flights.iter().all(is_complete)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::flights::NOMINAL;

    /// In a small room the vehicle drifts to the fence during the chirp, also without amplitude.
    #[test]
    fn a_chirp_that_the_fence_held_has_a_duration_that_fits() {
        let settings = [
            Setting::flag("test", "fence.x-m", vec![-2.5, 2.5]),
            Setting::flag("test", "fence.y-m", vec![-2.5, 2.5]),
            Setting::flag("test", "fence.z-m", vec![-0.5, 3.0]),
            Setting::flag("test", "plant.force-n", vec![0.06, 0.0, 0.0]),
        ];
        let law = StudyLaw::new("px4", settings.to_vec(), "");
        let condition = FlightCondition { seed: 200, plant: NOMINAL, settings: Vec::new() };
        let remedy = remedies([(&law, &[&condition][..], Test::Chirp)]);
        assert!(
            remedy.contains("attitude-chirp, held or stopped by the fence: enlarge [fence]"),
            "{remedy}"
        );
        assert!(remedy.contains("--set trajectory.attitude-chirp.sweep-s="), "{remedy}");
        assert!(remedy.ends_with("the repeated flight is complete"), "{remedy}");
    }
}
