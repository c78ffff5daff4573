//! Flights by which laws are compared: the configured trajectory (a square), a hover and two prescribed attitudes.

use std::ops::RangeInclusive;

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::{FNV_OFFSET, fnv1a};
use oqtal_config::{Config, Setting};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_daemon::LawPort;
use oqtal_observe::corners::CornerFigures;
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_observe::recorder::Recorder;
use oqtal_runtime::process::Failure;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::law::StudyLaw;
use super::metric::{
    CHIRP, DOUBLET, Figures, HOVER, JITTER, METRICS, OVERSHOOT, POSITION, SETTLE, of_attitude,
    of_hover, of_path,
};
use crate::mission::Mission;
use crate::progress::Progress;
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

/// End of the flight of one test.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TestEnd {
    /// The test.
    pub test: Test,
    /// Outcome of the flight.
    pub outcome: Outcome,
    /// Reason why the flight does not count; `None` if it landed as planned.
    pub cause: Option<String>,
}

impl TestEnd {
    /// The cause, or `landed`.
    pub fn cause_or_landed(&self) -> &str {
        self.cause.as_deref().unwrap_or("landed")
    }
}

/// Flights of one law in one condition: one per test of the case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "KeptRun", try_from = "KeptRun")]
pub struct Run {
    /// Figures; infinite for a test that was not flown or whose flight did not land as planned, and for a settling time that was
    /// not reached; NaN where they have no meaning.
    pub figures: Figures,
    /// Settling time on the path and after the steps of the doublet, with the time until the next step for one that did not
    /// settle \[s\]: the objective of tuning is finite there.
    pub least_settle_s: [f64; 2],
    /// Greatest position error in hover \[mm\].
    pub hover_max_mm: f64,
    /// Number of Riccati equations solved on the path \[-\].
    pub riccati_solves: u64,
    /// End of each flight.
    pub ends: Vec<TestEnd>,
}

impl Run {
    /// Whether the flight of `test` landed as planned.
    pub fn is_as_planned(&self, test: Test) -> bool {
        self.ends.iter().any(|end| end.test == test && end.cause.is_none())
    }

    /// Whether every flight landed as planned.
    pub fn all_as_planned(&self) -> bool {
        self.ends.iter().all(|end| end.cause.is_none())
    }

    /// Whether every flight landed, as planned or not: one that the fence held for a time has landed, too.
    pub fn all_landed(&self) -> bool {
        self.ends.iter().all(|end| end.outcome == Outcome::Landed)
    }

    /// A figure, with the time until the next step for a step that did not settle.
    pub fn bounded(&self, metric: usize) -> f64 {
        match metric {
            SETTLE => self.least_settle_s[0],
            DOUBLET => self.least_settle_s[1],
            _ => self.figures[metric],
        }
    }

    /// Whether a flight of `test` landed as planned and a step in it did not settle.
    pub fn is_unsettled(&self, test: Test) -> bool {
        let settling = match test {
            Test::Path => SETTLE,
            Test::Doublet => DOUBLET,
            Test::Hover | Test::Chirp => return false,
        };
        self.is_as_planned(test) && self.figures[settling] == f64::INFINITY
    }
}

/// Run in a journal: floating-point numbers as their bits, so that a resumed study has the result of an uninterrupted one.
#[derive(Serialize, Deserialize)]
struct KeptRun {
    /// The figures, followed by the least settling times and the greatest hover error.
    bits: Vec<u64>,
    riccati_solves: u64,
    ends: Vec<TestEnd>,
}

impl From<Run> for KeptRun {
    fn from(run: Run) -> Self {
        let figures = run.figures.into_iter().chain(run.least_settle_s).chain([run.hover_max_mm]);
        let Run { riccati_solves, ends, .. } = run;
        Self { bits: figures.map(f64::to_bits).collect(), riccati_solves, ends }
    }
}

impl TryFrom<KeptRun> for Run {
    type Error = &'static str;

    fn try_from(kept: KeptRun) -> Result<Self, Self::Error> {
        let KeptRun { bits, riccati_solves, ends } = kept;
        let values: Vec<f64> = bits.into_iter().map(f64::from_bits).collect();
        let wrong = "another number of figures";
        let (figures, [path_s, doublet_s, hover_max_mm]) =
            values.split_last_chunk().ok_or(wrong)?;
        let figures = figures.try_into().map_err(|_| wrong)?;
        let (least_settle_s, hover_max_mm) = ([*path_s, *doublet_s], *hover_max_mm);
        Ok(Self { figures, least_settle_s, hover_max_mm, riccati_solves, ends })
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
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
    pub fn trajectory(self) -> Option<&'static str> {
        match self {
            Self::Path => None,
            Self::Hover => Some("hover"),
            Self::Chirp => Some("attitude-chirp"),
            Self::Doublet => Some("attitude-doublet"),
        }
    }

    /// Indices of the figures of the test.
    pub fn figures(self) -> RangeInclusive<usize> {
        match self {
            Self::Path => POSITION..=OVERSHOOT,
            Self::Hover => HOVER..=JITTER,
            Self::Chirp => CHIRP..=CHIRP,
            Self::Doublet => DOUBLET..=DOUBLET,
        }
    }
}

/// The configuration of a flight of `test`.
///
/// # Errors
/// A setting is invalid.
pub fn config(law: &StudyLaw, condition: &FlightCondition, test: Test) -> Result<Config, Failure> {
    let changes = changed(law, condition.plant)?;
    let mut settings = [law.settings_under(&condition.settings), changes].concat();
    settings.push(law.setting());
    let trajectory = test.trajectory();
    settings.extend(trajectory.map(|name| Setting::flag("campaign", "trajectory.kind", name)));
    let mut config = Config::from_settings(&settings)?;
    config.clock.seed = condition.seed;
    Ok(config)
}

/// Changes of `plant` as settings, relative to the configuration of the law.
pub(super) fn changed(law: &StudyLaw, plant: PlantVariant) -> Result<Vec<Setting>, Failure> {
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
    Table::try_from(config).expect("a configuration holds only what TOML can say")
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

/// Flies the configured trajectory on the configured plant; `None` if the vehicle did not land as planned.
///
/// # Errors
/// A setting is invalid.
pub fn path(law: &StudyLaw, seed: u64) -> Result<Option<Flight>, Failure> {
    let condition = FlightCondition { seed, plant: NOMINAL, settings: Vec::new() };
    let flight = simulation::fly(&Mission::new(config(law, &condition, Test::Path)?)?)?;
    Ok(Some(flight).filter(|flight| flight.cause().is_none()))
}

/// Flights of a law in one condition: one configuration for each test.
pub(super) struct TestFlights(Vec<(Test, Config)>);

impl TestFlights {
    pub(super) fn new(
        law: &StudyLaw,
        condition: &FlightCondition,
        tests: &[Test],
    ) -> Result<Self, Failure> {
        let configs = tests.iter().map(|test| Ok((*test, config(law, condition, *test)?)));
        configs.collect::<Result<_, Failure>>().map(Self)
    }

    /// Key of these flights in a journal: equal for equal tests, configurations and waypoints.
    pub(super) fn key(&self) -> u64 {
        self.0.iter().fold(FNV_OFFSET, |hash, (test, config)| {
            let hash = fnv1a(fnv1a(hash, test.name().as_bytes()), &config.hash().to_le_bytes());
            let file = config.trajectory.waypoints_file.as_ref();
            match file.filter(|_| config.trajectory.kind == TrajectoryKind::Waypoints) {
                // A file that cannot be read ends the study.
                Some(file) => fnv1a(hash, &std::fs::read(file).unwrap_or_default()),
                None => hash,
            }
        })
    }

    /// Flies every test in this process. An interrupt of the study ends the flight in progress.
    pub(super) fn fly_here(self, progress: &Progress) -> Result<Run, Failure> {
        let watch = |_: &Recorder| progress.check().is_err().then_some(OperatorCommand::Stop);
        self.fly(&mut |mission| {
            let (flight, _) = simulation::fly_recorded(mission, None, LawPort::default(), watch)?;
            progress.check().map(|()| flight)
        })
    }

    /// Flies every test using `fly`.
    pub(super) fn fly(self, fly: &mut FlyMission<'_>) -> Result<Run, Failure> {
        let mut run = Run {
            figures: [f64::INFINITY; METRICS],
            least_settle_s: [f64::INFINITY; 2],
            hover_max_mm: f64::INFINITY,
            riccati_solves: 0,
            ends: Vec::with_capacity(self.0.len()),
        };
        for (test, config) in self.0 {
            let mission = Mission::new(config)?;
            let flight = fly(&mission)?;
            let end = TestEnd { test, outcome: flight.outcome, cause: flight.cause() };
            if end.cause.is_none() {
                run.note(test, &flight);
            }
            run.ends.push(end);
        }
        Ok(run)
    }
}

impl Run {
    /// Adds the figures of a flight that landed as planned.
    fn note(&mut self, test: Test, flight: &Flight) {
        match test {
            Test::Path => {
                self.figures[test.figures()].copy_from_slice(&of_path(flight));
                let corners = CornerFigures::of(flight);
                self.least_settle_s[0] = corners.map_or(f64::NAN, |it| it.settling.least_settle_s);
                let last = flight.samples.last();
                self.riccati_solves = last.map_or(0, |sample| sample.telemetry.riccati_solves);
            }
            Test::Hover => {
                self.figures[test.figures()].copy_from_slice(&of_hover(flight));
                let errors = flight.scored().map(|sample| sample.position_error().norm());
                // NaN without a scored sample.
                self.hover_max_mm = 1e3 * errors.fold(f64::NAN, f64::max);
            }
            Test::Chirp => self.figures[CHIRP] = of_attitude(flight)[0],
            Test::Doublet => {
                [_, self.figures[DOUBLET], self.least_settle_s[1]] = of_attitude(flight);
            }
        }
    }
}
