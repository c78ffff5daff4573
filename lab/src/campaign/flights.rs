//! The flights by which laws are compared: the configured trajectory (a square), a hover and two prescribed attitudes for each seed.

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::Failure;

use crate::mission::Mission;
use crate::simulation;
use oqtal_observe::flight::{Flight, Outcome};

use super::metric::{
    CHIRP, DOUBLET, Figures, HOVER, JITTER, METRICS, OVERSHOOT, POSITION, of_attitude, of_hover,
    of_path,
};

/// An attitude law with its settings.
#[derive(Clone, Debug)]
pub struct Contender {
    /// Name of the law in the configuration.
    pub controller: &'static str,
    /// Settings that differ from the shipped configuration: those of the study first, then the law's own.
    pub settings: Vec<Setting>,
}

/// A simulated vehicle that may differ from the configured one, as factors of its keys.
#[derive(Clone, Copy, Debug)]
pub struct PlantVariant {
    /// The difference, in words; figures are those of the shipped vehicle.
    pub name: &'static str,
    /// Factor of `plant.rate-authority-rad-s` \[-\].
    pub rate_gain: f64,
    /// Factor of `plant.rate-lag-ms` \[-\].
    pub rate_lag: f64,
    /// Factor of `plant.command-delay-ms` \[-\].
    pub delay: f64,
}

/// The configured plant.
pub const NOMINAL: PlantVariant =
    PlantVariant { name: "nominal", rate_gain: 1.0, rate_lag: 1.0, delay: 1.0 };

impl PlantVariant {
    fn apply(&self, config: &mut Config) {
        let plant = &mut config.plant;
        plant.rate_authority_rad_s.iter_mut().for_each(|authority| *authority *= self.rate_gain);
        plant.rate_lag_ms *= self.rate_lag;
        plant.command_delay_ms *= self.delay;
    }
}

/// Plants that differ from the nominal one.
pub const MISMATCHED: [PlantVariant; 5] = [
    PlantVariant { name: "rate gain -20 %", rate_gain: 0.8, ..NOMINAL },
    PlantVariant { name: "rate gain +20 %", rate_gain: 1.2, ..NOMINAL },
    PlantVariant { name: "delay +10 ms", delay: 1.5, ..NOMINAL },
    PlantVariant { name: "inner lag 30 ms", rate_lag: 0.6, ..NOMINAL },
    PlantVariant { name: "inner lag 80 ms", rate_lag: 1.6, ..NOMINAL },
];

/// The plants that gains are tuned on, one for each training seed, so that no gain relies on one plant being exactly known.
pub const TRAINING: [PlantVariant; 6] = [
    NOMINAL,
    NOMINAL,
    PlantVariant { name: "rate gain -12 %", rate_gain: 0.88, ..NOMINAL },
    PlantVariant { name: "rate gain +12 %", rate_gain: 1.12, ..NOMINAL },
    PlantVariant { name: "inner lag 65 ms", rate_lag: 1.3, ..NOMINAL },
    PlantVariant { name: "inner lag 40 ms, delay +5 ms", rate_lag: 0.8, delay: 1.25, ..NOMINAL },
];

/// One flight of a seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Test {
    /// The configured trajectory, by default the paper's square.
    Path,
    /// 30 s of hover.
    Hover,
    /// A prescribed attitude that swings with rising frequency.
    Chirp,
    /// A prescribed attitude that steps to both sides.
    Doublet,
}

impl Test {
    /// All tests.
    pub const ALL: [Self; 4] = [Self::Path, Self::Hover, Self::Chirp, Self::Doublet];

    /// The name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.trajectory().unwrap_or("path")
    }

    /// The trajectory of the test; `None` for that of the configuration.
    fn trajectory(self) -> Option<&'static str> {
        match self {
            Self::Path => None,
            Self::Hover => Some("hover"),
            Self::Chirp => Some("attitude-chirp"),
            Self::Doublet => Some("attitude-doublet"),
        }
    }
}

impl Contender {
    /// The configuration of a flight of `test`.
    ///
    /// # Errors
    /// A setting is wrong.
    pub fn config(&self, test: Test) -> Result<Config, Failure> {
        let mut settings = self.settings.clone();
        settings.push(Setting::flag("--controllers", "control.controller", self.controller));
        let trajectory = test.trajectory();
        settings.extend(trajectory.map(|name| Setting::flag("campaign", "trajectory.kind", name)));
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
        let mut config = contender.config(test)?;
        plant.apply(&mut config);
        Ok(Self { config })
    }

    /// Flies with `seed`. Returns the flight and its mission, or `None` if the vehicle did not land.
    ///
    /// # Errors
    /// An option of the law is invalid.
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
    path: Prepared,
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
            path: prepare(Test::Path)?,
            hover: prepare(Test::Hover)?,
            chirp: prepare(Test::Chirp)?,
            doublet: prepare(Test::Doublet)?,
        })
    }

    /// Flies every test with `seed`. Returns the figures, and the number of Riccati equations solved on the first.
    ///
    /// # Errors
    /// An option of the law is invalid.
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
        if let Some((flight, _)) = self.path.fly_by(seed, fly)? {
            figures[POSITION..=OVERSHOOT].copy_from_slice(&of_path(&flight));
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
