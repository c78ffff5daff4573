//! The flights by which laws are compared: a square, a hover and two prescribed attitudes for each seed.

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::Failure;

use crate::mission::Mission;
use crate::simulation;
use oqtal_observe::flight::{Flight, Outcome};

use super::metric::{
    CHIRP, DOUBLET, Figures, HOVER, JITTER, METRICS, OVERSHOOT, POSITION, of_attitude, of_hover,
    of_square,
};

/// An attitude law with its settings.
#[derive(Clone, Debug)]
pub struct Contender {
    /// Name of the law in the configuration.
    pub controller: &'static str,
    /// Settings that differ from the shipped configuration.
    pub settings: Vec<Setting>,
}

/// A simulated vehicle that may differ from the one that the laws are designed for.
#[derive(Clone, Copy, Debug)]
pub struct PlantVariant {
    /// The difference, in words.
    pub name: &'static str,
    /// The difference, as settings `KEY=VALUE` of `[plant]`.
    pub settings: &'static [&'static str],
}

/// The plant that the laws are designed for.
pub const NOMINAL: PlantVariant = PlantVariant { name: "nominal", settings: &[] };

/// Plants that differ from the nominal one.
pub const MISMATCHED: [PlantVariant; 5] = [
    PlantVariant {
        name: "rate gain -20 %",
        settings: &["plant.rate-authority-rad-s=[1.6, 1.6, 1.6]"],
    },
    PlantVariant {
        name: "rate gain +20 %",
        settings: &["plant.rate-authority-rad-s=[2.4, 2.4, 2.4]"],
    },
    PlantVariant { name: "delay +10 ms", settings: &["plant.command-delay-ms=30.0"] },
    PlantVariant { name: "inner lag 30 ms", settings: &["plant.rate-lag-ms=30.0"] },
    PlantVariant { name: "inner lag 80 ms", settings: &["plant.rate-lag-ms=80.0"] },
];

/// The plants that gains are tuned on, one for each training seed, so that no gain relies on one plant being exactly known.
pub const TRAINING: [PlantVariant; 6] = [
    NOMINAL,
    NOMINAL,
    PlantVariant {
        name: "rate gain -12 %",
        settings: &["plant.rate-authority-rad-s=[1.76, 1.76, 1.76]"],
    },
    PlantVariant {
        name: "rate gain +12 %",
        settings: &["plant.rate-authority-rad-s=[2.24, 2.24, 2.24]"],
    },
    PlantVariant { name: "inner lag 65 ms", settings: &["plant.rate-lag-ms=65.0"] },
    PlantVariant {
        name: "inner lag 40 ms, delay +5 ms",
        settings: &["plant.rate-lag-ms=40.0", "plant.command-delay-ms=25.0"],
    },
];

/// One flight of a seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    /// The paper's square.
    Square,
    /// 30 s of hover.
    Hover,
    /// A prescribed attitude that swings with rising frequency.
    Chirp,
    /// A prescribed attitude that steps to both sides.
    Doublet,
}

impl Test {
    /// All tests.
    pub const ALL: [Self; 4] = [Self::Square, Self::Hover, Self::Chirp, Self::Doublet];

    /// The settings of the test.
    fn settings(self) -> Vec<(&'static str, toml::Value)> {
        match self {
            Self::Square => vec![("trajectory.kind", "square".into())],
            Self::Hover => vec![("trajectory.kind", "hover".into())],
            Self::Chirp => vec![("trajectory.kind", "attitude-chirp".into())],
            Self::Doublet => vec![("trajectory.kind", "attitude-doublet".into())],
        }
    }
}

impl Contender {
    /// The configuration of a flight of `test`, with `extra` settings.
    ///
    /// # Errors
    /// A setting is wrong.
    pub fn config(&self, test: Test, extra: &[Setting]) -> Result<Config, Failure> {
        let mut settings = vec![Setting::flag("campaign", "control.controller", self.controller)];
        settings.extend(self.settings.iter().cloned());
        let ours = test.settings().into_iter();
        settings.extend(ours.map(|(key, value)| Setting::flag("campaign", key, value)));
        settings.extend_from_slice(extra);
        Ok(Config::from_settings(&settings)?)
    }
}

/// A law ready to fly one test on one plant with any seed.
#[derive(Clone, Debug)]
pub struct Prepared {
    config: Config,
}

impl Prepared {
    /// Prepares `contender` for `test` on `plant`.
    ///
    /// # Errors
    /// A setting is wrong.
    pub fn new(contender: &Contender, test: Test, plant: &PlantVariant) -> Result<Self, Failure> {
        let settings: Result<Vec<Setting>, _> =
            plant.settings.iter().map(|text| Setting::parse("plant", text)).collect();
        Ok(Self { config: contender.config(test, &settings?)? })
    }

    /// Flies with `seed`. Returns the flight and its mission, or `None` if the vehicle did not land.
    ///
    /// # Errors
    /// An option of the law has no meaning.
    pub fn fly(&self, seed: u64) -> Result<Option<(Flight, Mission)>, Failure> {
        self.fly_by(seed, &mut |mission| simulation::fly(mission))
    }

    /// As [`Self::fly`], with the flight flown by `fly`.
    ///
    /// # Errors
    /// An option of the law is not allowed, or `fly` failed.
    pub fn fly_by(
        &self,
        seed: u64,
        fly: &mut FlyMission<'_>,
    ) -> Result<Option<(Flight, Mission)>, Failure> {
        let mut config = self.config.clone();
        config.clock.seed = seed;
        let mission = Mission::new(config)?;
        let flight = fly(&mission)?;
        let is_complete = flight.outcome == Outcome::Landed && flight.shortfall().is_none();
        Ok(is_complete.then_some((flight, mission)))
    }
}

/// Flies a mission, in this process or through processes of their own.
pub type FlyMission<'a> = dyn FnMut(&Mission) -> Result<Flight, Failure> + 'a;

/// All tests of a law on one plant, ready to be flown with any seed.
#[derive(Clone, Debug)]
pub struct Trial {
    square: Prepared,
    hover: Prepared,
    chirp: Prepared,
    doublet: Prepared,
}

impl Trial {
    /// Prepares `contender` for every test on `plant`.
    ///
    /// # Errors
    /// A setting is wrong.
    pub fn new(contender: &Contender, plant: &PlantVariant) -> Result<Self, Failure> {
        let prepare = |test| Prepared::new(contender, test, plant);
        Ok(Self {
            square: prepare(Test::Square)?,
            hover: prepare(Test::Hover)?,
            chirp: prepare(Test::Chirp)?,
            doublet: prepare(Test::Doublet)?,
        })
    }

    /// Flies every test with `seed`. Returns the figures, and the number of Riccati equations solved in the square.
    ///
    /// # Errors
    /// An option of the law has no meaning.
    pub fn fly(&self, seed: u64) -> Result<(Figures, u64), Failure> {
        self.fly_by(seed, &mut |mission| simulation::fly(mission))
    }

    /// As [`Self::fly`], with the flight flown by `fly`.
    ///
    /// # Errors
    /// An option of the law is not allowed, or `fly` failed.
    pub fn fly_by(&self, seed: u64, fly: &mut FlyMission<'_>) -> Result<(Figures, u64), Failure> {
        let mut figures = [f64::INFINITY; METRICS];
        let mut solves = 0;
        if let Some((flight, _)) = self.square.fly_by(seed, fly)? {
            figures[POSITION..=OVERSHOOT].copy_from_slice(&of_square(&flight));
            solves = flight.samples.last().map_or(0, |sample| sample.telemetry.riccati_solves);
        }
        if let Some((flight, _)) = self.hover.fly_by(seed, fly)? {
            figures[HOVER..=JITTER].copy_from_slice(&of_hover(&flight));
        }
        if let Some((flight, mission)) = self.chirp.fly_by(seed, fly)? {
            figures[CHIRP] = of_attitude(&flight, &mission.trajectory)[0];
        }
        if let Some((flight, mission)) = self.doublet.fly_by(seed, fly)? {
            figures[DOUBLET] = of_attitude(&flight, &mission.trajectory)[1];
        }
        Ok((figures, solves))
    }
}
