//! The flights that a law is judged by, one set for each seed, in one process.

use oqtal_config::{Config, Setting, Vehicle};
use oqtal_runtime::process::Failure;

use crate::mission::Mission;
use crate::simulation;
use oqtal_observe::flight::{Flight, Outcome};

use super::metric::{
    CHIRP, DOUBLET, Figures, HOVER, JITTER, METRICS, OVERSHOOT, POSITION, of_attitude, of_hover,
    of_square,
};

/// A law with its settings, as a configuration understands them.
#[derive(Clone, Debug)]
pub struct Contender {
    /// Its name in the configuration.
    pub controller: &'static str,
    /// What it differs in from the shipped configuration.
    pub settings: Vec<Setting>,
}

/// What the vehicle and the cameras are, where that is not what the law was designed for.
#[derive(Clone, Debug)]
pub struct Plant {
    /// What is different, in words.
    pub name: &'static str,
    /// The difference: keys and values.
    pub settings: &'static [(&'static str, f64)],
    /// The rate authority of the vehicle over that which the law knows.
    pub rate_gain: f64,
}

/// The plant that the laws are designed for.
pub const NOMINAL: Plant = Plant { name: "nominal", settings: &[], rate_gain: 1.0 };

/// Plants that differ from it.
pub const MISMATCHED: [Plant; 5] = [
    Plant { name: "rate gain -20 %", settings: &[], rate_gain: 0.8 },
    Plant { name: "rate gain +20 %", settings: &[], rate_gain: 1.2 },
    Plant { name: "delay +10 ms", settings: &[("vehicle.radio-delay-ms", 30.0)], rate_gain: 1.0 },
    Plant { name: "inner lag 30 ms", settings: &[("vehicle.rate-lag-ms", 30.0)], rate_gain: 1.0 },
    Plant { name: "inner lag 80 ms", settings: &[("vehicle.rate-lag-ms", 80.0)], rate_gain: 1.0 },
];

/// What gains are tuned on: a plant for each training seed, so that no gain relies on one plant being exactly known.
pub const TRAINING: [Plant; 6] = [
    NOMINAL,
    NOMINAL,
    Plant { name: "rate gain -12 %", settings: &[], rate_gain: 0.88 },
    Plant { name: "rate gain +12 %", settings: &[], rate_gain: 1.12 },
    Plant { name: "inner lag 65 ms", settings: &[("vehicle.rate-lag-ms", 65.0)], rate_gain: 1.0 },
    Plant {
        name: "inner lag 40 ms, delay +5 ms",
        settings: &[("vehicle.rate-lag-ms", 40.0), ("vehicle.radio-delay-ms", 25.0)],
        rate_gain: 1.0,
    },
];

/// The flights of one seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    /// The paper's square.
    Square,
    /// 30 s of hover.
    Hover,
    /// A prescribed attitude that swings ever faster.
    Chirp,
    /// A prescribed attitude that steps to and fro.
    Doublet,
}

impl Test {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Square, Self::Hover, Self::Chirp, Self::Doublet];

    /// What it sets.
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
    /// The configuration of a flight.
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
    /// The vehicle as it is.
    vehicle: Vehicle,
}

impl Prepared {
    /// Prepares `contender` for `test` on `plant`.
    ///
    /// # Errors
    /// A setting is wrong.
    pub fn new(contender: &Contender, test: Test, plant: &Plant) -> Result<Self, Failure> {
        let config = contender.config(test, &[])?;
        let different = |(key, value): &(&str, f64)| Setting::flag("plant", key, *value);
        let settings: Vec<Setting> = plant.settings.iter().map(different).collect();
        let mut vehicle = contender.config(test, &settings)?.vehicle;
        for authority in &mut vehicle.rate_authority_rad_s {
            *authority *= plant.rate_gain;
        }
        Ok(Self { config, vehicle })
    }

    /// Flies with `seed`; the flight and its mission, or nothing if it did not land.
    ///
    /// # Errors
    /// An option of the law has no meaning.
    pub fn fly(&self, seed: u64) -> Result<Option<(Flight, Mission)>, Failure> {
        self.fly_by(seed, &mut |mission| simulation::fly(mission))
    }

    /// The same, flown by `pilot`.
    ///
    /// # Errors
    /// An option of the law has no meaning, or what the pilot says.
    pub fn fly_by(
        &self,
        seed: u64,
        pilot: &mut Pilot<'_>,
    ) -> Result<Option<(Flight, Mission)>, Failure> {
        let mut config = self.config.clone();
        config.clock.seed = seed;
        let mission = Mission { plant: Some(self.vehicle.clone()), ..Mission::new(config)? };
        let flight = pilot(&mission)?;
        Ok((flight.outcome == Outcome::Landed).then_some((flight, mission)))
    }
}

/// Whoever flies a mission.
pub type Pilot<'a> = dyn FnMut(&Mission) -> Result<Flight, Failure> + 'a;

/// All tests of a law on one plant.
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
    pub fn new(contender: &Contender, plant: &Plant) -> Result<Self, Failure> {
        let prepare = |test| Prepared::new(contender, test, plant);
        Ok(Self {
            square: prepare(Test::Square)?,
            hover: prepare(Test::Hover)?,
            chirp: prepare(Test::Chirp)?,
            doublet: prepare(Test::Doublet)?,
        })
    }

    /// Flies every test with `seed`: the figures, and the Riccati equations solved in the square.
    ///
    /// # Errors
    /// An option of the law has no meaning.
    pub fn fly(&self, seed: u64) -> Result<(Figures, u64), Failure> {
        self.fly_by(seed, &mut |mission| simulation::fly(mission))
    }

    /// The same, flown by `pilot`.
    ///
    /// # Errors
    /// An option of the law has no meaning, or what the pilot says.
    pub fn fly_by(&self, seed: u64, pilot: &mut Pilot<'_>) -> Result<(Figures, u64), Failure> {
        let mut figures = [f64::INFINITY; METRICS];
        let mut solves = 0;
        if let Some((flight, _)) = self.square.fly_by(seed, pilot)? {
            figures[POSITION..=OVERSHOOT].copy_from_slice(&of_square(&flight));
            solves = flight.samples.last().map_or(0, |sample| sample.telemetry.riccati_solves);
        }
        if let Some((flight, _)) = self.hover.fly_by(seed, pilot)? {
            figures[HOVER..=JITTER].copy_from_slice(&of_hover(&flight));
        }
        if let Some((flight, mission)) = self.chirp.fly_by(seed, pilot)? {
            figures[CHIRP] = of_attitude(&flight, &mission.trajectory)[0];
        }
        if let Some((flight, mission)) = self.doublet.fly_by(seed, pilot)? {
            figures[DOUBLET] = of_attitude(&flight, &mission.trajectory)[1];
        }
        Ok((figures, solves))
    }
}
