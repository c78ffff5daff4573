//! Remedy for flights that the fence held or stopped, and for manoeuvres of the attitude that drifted from their reference: the
//! keys of the room, and a size of the trajectory with which they are complete.

use nalgebra::Vector3;
use oqtal_bus::code::Cause;
use oqtal_config::{Config, Setting};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_observe::flight::is_of_fence;
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

/// Half of the sides of a fence that bounds no flight, and its height \[m\].
const WIDE_M: f64 = 100.0;

/// Number of flights of each law, test and cause that are flown again with a smaller size \[-\].
const TRIED: usize = 5;

/// Flights of one trajectory that needed more room.
struct CrampedFlights<'a> {
    kind: TrajectoryKind,
    flights: Vec<(&'a StudyLaw, &'a FlightCondition, Test)>,
    /// Whether the fence ended some, and whether the distance from the reference did.
    of_fence: bool,
    far: bool,
}

/// Flights of one law and test that needed more room, and whether the fence ended them.
pub type CrampedGroup<'a> = ((&'a StudyLaw, &'a [&'a FlightCondition], Test), bool);

/// Whether flights of `test` that ended by `cause`, of [`oqtal_observe::flight::Flight::cause`], needed more room.
pub fn is_cramped(test: Test, cause: &str) -> bool {
    let is_drift = is_open(test) && cause.ends_with(&Cause::Tracking.to_string());
    is_of_fence(cause) || is_drift
}

/// Whether the position is not controlled during the manoeuvre of `test`.
const fn is_open(test: Test) -> bool {
    matches!(test, Test::Chirp | Test::Doublet)
}

/// Changes with which the flights of `groups` would be complete, one line for each trajectory; empty without groups.
pub fn remedies<'a>(groups: impl IntoIterator<Item = CrampedGroup<'a>>) -> String {
    let mut cramped: Vec<CrampedFlights<'_>> = Vec::new();
    for ((law, conditions, test), of_fence) in groups {
        let Ok(first) = config(law, conditions[0], test) else { continue };
        let own = conditions.iter().take(TRIED).map(|condition| (law, *condition, test));
        let kind = first.trajectory.kind;
        let number = cramped.iter().position(|others| others.kind == kind).unwrap_or_else(|| {
            cramped.push(CrampedFlights::new(kind));
            cramped.len() - 1
        });
        let flights = &mut cramped[number];
        flights.flights.extend(own);
        flights.of_fence |= of_fence;
        flights.far |= !of_fence;
    }
    cramped.iter().map(|flights| format!("\n{}", flights.remedy())).collect()
}

impl CrampedFlights<'_> {
    const fn new(kind: TrajectoryKind) -> Self {
        Self { kind, flights: Vec::new(), of_fence: false, far: false }
    }

    /// Cause for which one of the flights is not complete in a room without bounds; `None` if they all are.
    fn cause_with_room(&self) -> Option<String> {
        let wide = |from: f64, to: f64| vec![Value::Float(from), Value::Float(to)];
        let room = [
            ("fence.x-m", wide(-WIDE_M, WIDE_M).into()),
            ("fence.y-m", wide(-WIDE_M, WIDE_M).into()),
            ("fence.z-m", wide(-0.5, WIDE_M).into()),
            ("fence.polygon-m", Value::Array(Vec::new())),
            ("safety.tracking-limit-m", Value::Float(WIDE_M)),
        ];
        let room = room.map(|(key, value)| Setting::flag("--set", key, value));
        self.flights.iter().find_map(|flight| flown_with(*flight, &room).ok().flatten())
    }

    /// Sentence on a plant that hovers with another share of its thrust than the law's model; `None` if they are alike.
    fn difference(&self) -> Option<String> {
        let (law, condition, test) = self.flights[0];
        let config = config(law, condition, test).ok()?;
        let gravity_m_s2 = config.vehicle.gravity_m_s2;
        let share = |mass_kg: f64, thrust_n: f64| 100.0 * mass_kg * gravity_m_s2 / thrust_n;
        let (plant, vehicle) = (&config.plant, &config.vehicle);
        let plant = share(plant.mass_kg, plant.max_thrust_n);
        let vehicle = share(vehicle.mass_kg, vehicle.max_thrust_n);
        ((plant - vehicle).abs() > 5.0).then(|| format!(
            "; the simulated vehicle hovers with {plant:.0} % of its thrust, that of [vehicle], which laws know, with {vehicle:.0} %"
        ))
    }

    /// The keys to change, after flights with more room and with smaller sizes.
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
        let fence = "enlarge [fence] x-m, y-m, z-m, or lower fence.soft-margin-m";
        let limit = "raise safety.tracking-limit-m";
        let (ends, remedies) = match [self.of_fence, self.far] {
            [true, true] => {
                ("ended by the fence or far from the reference", format!("{fence}; {limit}"))
            }
            [false, _] => ("far from the reference", limit.to_owned()),
            [true, false] => ("held or stopped by the fence", fence.to_owned()),
        };
        if let Some(cause) = self.cause_with_room() {
            let difference = self.difference().unwrap_or_default();
            return format!(
                "  {name}, {ends}: more room does not help; with a fence of {WIDE_M:.0} m around the start: {cause}{difference}"
            );
        }
        let drift = self.drift().unwrap_or_default();
        format!("  {name}, {ends}: {remedies}{}{drift}", smaller.unwrap_or_default())
    }

    /// Sentence on the drift of a vehicle whose position is not controlled; `None` if it is.
    fn drift(&self) -> Option<String> {
        let (law, condition, test) = self.flights[0];
        let config = config(law, condition, test).ok().filter(|_| is_open(test))?;
        let (force_n, mass_kg) =
            (Vector3::from(config.plant.force_n).xy().norm(), config.plant.mass_kg);
        let acceleration_m_s2 = force_n / mass_kg;
        (force_n > 0.0).then(|| format!(
            "\n    the position is not controlled in this manoeuvre, and plant.force-n accelerates the vehicle of {mass_kg} kg sideways by {acceleration_m_s2:.2} m/s^2: a smaller force makes it drift less"
        ))
    }

    /// Key and greatest size with which all of the flights are complete; `None` if there is none.
    fn fitting(&self) -> Option<(&'static str, f64)> {
        let (_, key) = SIZES.iter().find(|(kind, _)| *kind == self.kind)?;
        let (law, condition, test) = self.flights[0];
        let size: f64 = config(law, condition, test).ok()?.value(key)?.parse().ok()?;
        let sizes = SHARES.map(|share| readable(share * size));
        sizes.into_iter().map(|size| (*key, size)).find(|(key, size)| {
            let is_complete = |flight: &(&StudyLaw, &FlightCondition, Test)| {
                let size = Setting::flag("--set", key, Value::Float(*size));
                flown_with(*flight, &[size]).is_ok_and(|cause| cause.is_none())
            };
            self.flights.iter().all(is_complete)
        })
    }
}

/// Cause for which a flight with these `settings` is not complete; `None` for a complete one.
fn flown_with(
    (law, condition, test): (&StudyLaw, &FlightCondition, Test),
    settings: &[Setting],
) -> Result<Option<String>, Failure> {
    let settings = [&condition.settings[..], settings].concat();
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
        let remedy = remedies([((&law, &[&condition][..], Test::Chirp), true)]);
        assert!(
            remedy.contains("attitude-chirp, held or stopped by the fence: enlarge [fence]"),
            "{remedy}"
        );
        assert!(remedy.contains("--set trajectory.attitude-chirp.sweep-s="), "{remedy}");
        assert!(remedy.contains("the repeated flight is complete"), "{remedy}");
        assert!(remedy.ends_with("a smaller force makes it drift less"), "{remedy}");
    }

    /// Its thrust at the law's lower limit exceeds the weight: the vehicle climbs through any ceiling.
    #[test]
    fn a_vehicle_much_lighter_than_its_model_is_not_given_more_room() {
        let settings = [
            Setting::flag("test", "vehicle.mass-kg", 1.3),
            Setting::flag("test", "vehicle.max-thrust-n", 30.0),
            Setting::flag("test", "plant.mass-kg", 0.65),
        ];
        let law = StudyLaw::new("geometric", settings.to_vec(), "");
        let condition = FlightCondition { seed: 200, plant: NOMINAL, settings: Vec::new() };
        let remedy = remedies([((&law, &[&condition][..], Test::Hover), true)]);
        assert!(remedy.contains("more room does not help"), "{remedy}");
        assert!(remedy.contains("hovers with 21 % of its thrust"), "{remedy}");
    }
}
