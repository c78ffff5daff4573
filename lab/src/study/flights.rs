//! Flights by which laws are compared: the configured trajectory (a square), a hover and two prescribed attitudes.

use oqtal_config::{Config, Setting};
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_runtime::process::Failure;
use toml::{Table, Value};

use super::law::StudyLaw;
use super::metric::{
    CHIRP, DOUBLET, Figures, HOVER, JITTER, METRICS, OVERSHOOT, POSITION, of_attitude, of_hover,
    of_path,
};
use crate::mission::Mission;
use crate::simulation;

/// Conditions of one flight of every test.
#[derive(Clone, Debug)]
pub struct FlightCondition {
    /// Seed of the flights: `clock.seed`.
    pub seed: u64,
    /// Simulated vehicle.
    pub plant: PlantVariant,
    /// Settings in addition to those of the law.
    pub settings: Vec<Setting>,
}

/// Flights of one law in one condition: one per test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run {
    /// Figures; infinite for a test whose flight did not land as planned.
    pub figures: Figures,
    /// Number of Riccati equations solved on the path \[-\].
    pub riccati_solves: u64,
}

impl Run {
    /// Whether the flight of `test` landed as planned.
    pub fn has_landed(&self, test: Test) -> bool {
        self.figures[test.figure()].is_finite()
    }

    /// Whether every flight landed as planned.
    pub fn all_landed(&self) -> bool {
        Test::ALL.iter().all(|test| self.has_landed(*test))
    }

    /// Whether all figures are finite: every flight landed as planned, and its path has corners.
    pub fn is_complete(&self) -> bool {
        self.figures.iter().all(|figure| figure.is_finite())
    }
}

/// Simulated vehicle that differs from the configured one.
#[derive(Clone, Copy, Debug)]
pub struct PlantVariant {
    /// Description of the difference; figures refer to the shipped vehicle.
    pub name: &'static str,
    /// Changed keys of `[plant]`.
    pub changes: &'static [Change],
}

/// Change of a key of the configuration.
#[derive(Clone, Copy, Debug)]
pub enum Change {
    /// Value of the key \[unit of the key\].
    To(&'static str, f64),
    /// Factor of the configured value, or of every element of a list \[-\].
    Times(&'static str, f64),
}

/// Key of the greatest commanded rates.
pub const AUTHORITY: &str = "plant.rate-authority-rad-s";
/// Key of the lag of the rate loop.
pub const RATE_LAG: &str = "plant.rate-lag-ms";
/// Key of the delay of commands.
pub const DELAY: &str = "plant.command-delay-ms";

/// The configured plant.
pub const NOMINAL: PlantVariant = PlantVariant { name: "nominal", changes: &[] };

/// Plants that differ from the nominal one.
pub const MISMATCHED: [PlantVariant; 5] = [
    PlantVariant { name: "rate gain -20 %", changes: &[Change::Times(AUTHORITY, 0.8)] },
    PlantVariant { name: "rate gain +20 %", changes: &[Change::Times(AUTHORITY, 1.2)] },
    PlantVariant { name: "delay +10 ms", changes: &[Change::Times(DELAY, 1.5)] },
    PlantVariant { name: "inner lag 30 ms", changes: &[Change::Times(RATE_LAG, 0.6)] },
    PlantVariant { name: "inner lag 80 ms", changes: &[Change::Times(RATE_LAG, 1.6)] },
];

/// One flight of a condition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    /// The configured trajectory, by default the paper's square.
    Path,
    /// 30 s of hover.
    Hover,
    /// Prescribed attitude: oscillation with rising frequency.
    Chirp,
    /// Prescribed attitude: steps to both sides.
    Doublet,
}

impl Test {
    /// All tests.
    pub const ALL: [Self; 4] = [Self::Path, Self::Hover, Self::Chirp, Self::Doublet];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        self.trajectory().unwrap_or("path")
    }

    /// Trajectory of the test; `None` for the configured one.
    fn trajectory(self) -> Option<&'static str> {
        match self {
            Self::Path => None,
            Self::Hover => Some("hover"),
            Self::Chirp => Some("attitude-chirp"),
            Self::Doublet => Some("attitude-doublet"),
        }
    }

    /// Index of the first figure of the test.
    pub fn figure(self) -> usize {
        match self {
            Self::Path => POSITION,
            Self::Hover => HOVER,
            Self::Chirp => CHIRP,
            Self::Doublet => DOUBLET,
        }
    }
}

/// The configuration of a flight of `test`.
///
/// # Errors
/// A setting is invalid.
pub fn config(law: &StudyLaw, condition: &FlightCondition, test: Test) -> Result<Config, Failure> {
    let changes = changed(law, condition.plant)?;
    let mut settings = [&law.settings[..], &condition.settings, &changes].concat();
    settings.push(law.setting());
    let trajectory = test.trajectory();
    settings.extend(trajectory.map(|name| Setting::flag("campaign", "trajectory.kind", name)));
    let mut config = Config::from_settings(&settings)?;
    config.clock.seed = condition.seed;
    Ok(config)
}

/// Changes of `plant` as settings, relative to the configuration of the law.
fn changed(law: &StudyLaw, plant: PlantVariant) -> Result<Vec<Setting>, Failure> {
    if plant.changes.is_empty() {
        return Ok(Vec::new());
    }
    let nominal = table(&Config::from_settings(&law.settings)?);
    let setting = |change: &Change| match *change {
        Change::To(key, value) => Setting::flag("plant", key, value),
        Change::Times(key, factor) => {
            let value = value_at(&nominal, key).expect("a plant changes keys of the configuration");
            let value = scaled(value, &|number| number * factor);
            Setting::flag("plant", key, value.expect("a plant scales numbers"))
        }
    };
    Ok(plant.changes.iter().map(setting).collect())
}

/// A configuration as a table.
pub fn table(config: &Config) -> Table {
    config.to_toml().parse().expect("a configuration is written as TOML")
}

/// The value of a dotted key of a configuration as a table.
pub fn value_at<'a>(table: &'a Table, key: &str) -> Option<&'a Value> {
    let (path, name) = key.rsplit_once('.').unwrap_or(("", key));
    let mut section = table;
    for part in path.split('.').filter(|part| !part.is_empty()) {
        section = section.get(part)?.as_table()?;
    }
    section.get(name)
}

/// `value` with `scale` applied to every number; `None` if it contains anything but numbers.
pub fn scaled(value: &Value, scale: &impl Fn(f64) -> f64) -> Option<Value> {
    match value {
        Value::Float(number) => Some(Value::Float(scale(*number))),
        Value::Integer(number) => Some(Value::Float(scale(*number as f64))),
        Value::Array(values) => {
            let values: Option<Vec<_>> = values.iter().map(|value| scaled(value, scale)).collect();
            values.map(Value::from)
        }
        _ => None,
    }
}

/// `value` rounded to four significant digits, so that its text is short and reproduces it exactly.
pub fn readable(value: f64) -> f64 {
    format!("{value:.3e}").parse().expect("a number just written")
}

/// Flies a mission, in this process or in separate processes.
pub type FlyMission<'a> = dyn FnMut(&Mission) -> Result<Flight, Failure> + 'a;

/// Flies `config` using `fly`. Returns the flight and its mission, or `None` if the vehicle did not land as planned.
///
/// # Errors
/// An option of the law is invalid, or `fly` failed.
pub fn landed(
    config: Config,
    fly: &mut FlyMission<'_>,
) -> Result<Option<(Flight, Mission)>, Failure> {
    let mission = Mission::new(config)?;
    let flight = fly(&mission)?;
    let is_complete = flight.outcome == Outcome::Landed && flight.shortfall().is_none();
    Ok(is_complete.then_some((flight, mission)))
}

/// Flies the configured trajectory on the configured plant; `None` if the vehicle did not land as planned.
///
/// # Errors
/// A setting is invalid.
pub fn path(law: &StudyLaw, seed: u64) -> Result<Option<Flight>, Failure> {
    let condition = FlightCondition { seed, plant: NOMINAL, settings: Vec::new() };
    let flown =
        landed(config(law, &condition, Test::Path)?, &mut |mission| simulation::fly(mission))?;
    Ok(flown.map(|(flight, _)| flight))
}

/// Flights of a law in one condition: one configuration per test in [`Test::ALL`].
pub(super) struct TestFlights([Config; Test::ALL.len()]);

impl TestFlights {
    pub(super) fn new(law: &StudyLaw, condition: &FlightCondition) -> Result<Self, Failure> {
        let [path, hover, chirp, doublet] = Test::ALL.map(|test| config(law, condition, test));
        Ok(Self([path?, hover?, chirp?, doublet?]))
    }

    /// Flies every test using `fly`.
    pub(super) fn fly(self, fly: &mut FlyMission<'_>) -> Result<Run, Failure> {
        let mut figures = [f64::INFINITY; METRICS];
        let mut riccati_solves = 0;
        for (test, config) in Test::ALL.into_iter().zip(self.0) {
            let Some((flight, mission)) = landed(config, fly)? else { continue };
            match test {
                Test::Path => {
                    figures[POSITION..=OVERSHOOT].copy_from_slice(&of_path(&flight));
                    let last = flight.samples.last();
                    riccati_solves = last.map_or(0, |sample| sample.telemetry.riccati_solves);
                }
                Test::Hover => figures[HOVER..=JITTER].copy_from_slice(&of_hover(&flight)),
                Test::Chirp => figures[CHIRP] = of_attitude(&flight, &mission.trajectory)[0],
                Test::Doublet => figures[DOUBLET] = of_attitude(&flight, &mission.trajectory)[1],
            }
        }
        Ok(Run { figures, riccati_solves })
    }
}
