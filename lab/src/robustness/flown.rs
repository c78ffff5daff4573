//! The flights: every law on the same draws.

use std::ops::Range;

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;
use serde_json::{Map, Value as Json, json};
use toml::Value;

use super::spread::{PlantSpread, value_at};
use crate::campaign::flights::{Contender, NOMINAL, Test, Trial};
use crate::campaign::metric::{CHIRP, DOUBLET, Figures, HOVER, METRIC, POSITION};
use crate::progress::Progress;

/// One draw: a plant and the seed of its flights.
#[derive(Clone, Debug)]
pub struct Draw {
    /// Number \[-\].
    pub run: u64,
    /// Seed of the flights: `clock.seed`.
    pub seed: u64,
    /// The drawn values.
    pub settings: Vec<Setting>,
}

/// Most draws \[-\]: flights of different draws, and those on which gains are tuned, have different seeds.
pub const MOST_DRAWS: u64 = 10_000;

/// Seed of the draws on which gains are tuned; laws are judged on others, from 1 on.
pub const TUNING_SEED: u64 = 0;

/// What the filters of `oqtal-dt` are told of the noise follows that of the cameras; the noise of a draw is unknown to them.
const TOLD: [(&str, &str); 2] = [
    ("control.predictive.filter.attitude-noise-deg", "mocap.attitude-noise-deg"),
    ("control.predictive.filter.position-noise-mm", "mocap.position-noise-mm"),
];

impl Draw {
    /// The draws `runs` with `seed` of `spread` about the configuration of `common`.
    ///
    /// # Errors
    /// A key of the spread is none of the configuration.
    pub fn several(
        spread: &PlantSpread,
        common: &[Setting],
        (seed, runs): (u64, Range<u64>),
    ) -> Result<Vec<Self>, Failure> {
        let nominal: toml::Table =
            Config::from_settings(common)?.to_toml().parse().expect("a configuration is TOML");
        let is_drawn = |key: &str| spread.keys.iter().any(|drawn| drawn.key == key);
        let told = TOLD.iter().filter(|(_, followed)| is_drawn(followed)).map(|(key, _)| {
            let value = value_at(&nominal, key).expect("it is a key of every configuration");
            Setting::flag("spread", key, value.clone())
        });
        let told: Vec<Setting> = told.collect();
        let draw = |run: u64| {
            let mut settings = told.clone();
            settings.extend(spread.draw(&nominal, (seed, run))?);
            Config::from_settings(&[common, &settings].concat())?;
            Ok(Self { run, seed: (seed + 1) * MOST_DRAWS + run, settings })
        };
        runs.map(draw).collect()
    }

    /// The drawn value of a key.
    #[must_use]
    pub fn value(&self, key: &str) -> Option<&Value> {
        self.settings.iter().find(|setting| setting.key == key).map(|setting| &setting.value)
    }

    /// The arguments of `oqtal fly` and `oqtal campaign` that make the same plant.
    #[must_use]
    pub fn arguments(&self) -> String {
        let argument = |setting: &Setting| match setting.key.strip_prefix("plant.") {
            Some(key) => format!("--plant {}", word(key, &setting.value)),
            None => format!("--set {}", word(&setting.key, &setting.value)),
        };
        self.settings.iter().map(argument).collect::<Vec<_>>().join(" ")
    }
}

/// `KEY=VALUE` as a shell takes it.
fn word(key: &str, value: &Value) -> String {
    let text = format!("{key}={value}").replace(' ', "");
    let plain = |c: char| c.is_ascii_alphanumeric() || "=.-_".contains(c);
    if text.chars().all(plain) { text } else { format!("'{text}'") }
}

/// A law with its gains.
#[derive(Clone, Debug)]
pub struct Rival {
    /// Name of the law with its surroundings, where they are not its own.
    pub name: String,
    /// Name of the law in the configuration.
    pub controller: &'static str,
    /// Its settings under those of the study.
    pub settings: Vec<Setting>,
    /// Where they come from.
    pub remark: String,
    /// Whether the law flies within the estimation and prediction of `oqtal-dt`.
    pub is_predictive: bool,
}

impl Rival {
    /// The configuration that the law flies with.
    ///
    /// # Errors
    /// A setting is wrong.
    pub fn config(&self) -> Result<Config, Failure> {
        let law = Setting::flag("--laws", "control.controller", self.controller);
        Ok(Config::from_settings(&[&self.settings[..], &[law]].concat())?)
    }
}

/// A law with its figures on every draw.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The law.
    pub rival: Rival,
    /// The figures of each draw, infinite where a flight did not land as planned.
    pub figures: Vec<Figures>,
}

impl Judged {
    /// Whether each test of a draw landed as planned.
    #[must_use]
    pub fn landed(figures: &Figures) -> [(Test, bool); 4] {
        [
            (Test::Path, POSITION),
            (Test::Hover, HOVER),
            (Test::Chirp, CHIRP),
            (Test::Doublet, DOUBLET),
        ]
        .map(|(test, metric)| (test, figures[metric].is_finite()))
    }

    /// Whether every test of a draw landed as planned.
    #[must_use]
    pub fn all_landed(figures: &Figures) -> bool {
        Self::landed(figures).iter().all(|(_, landed)| *landed)
    }

    /// One figure of every draw.
    #[must_use]
    pub fn values(&self, metric: usize) -> Vec<f64> {
        self.figures.iter().map(|figures| figures[metric]).collect()
    }
}

/// Flies every law on every draw, in parallel; the result does not depend on the number of threads.
///
/// # Errors
/// A setting has no meaning.
pub fn fly(rivals: &[Rival], draws: &[Draw], progress: &Progress) -> Result<Vec<Judged>, Failure> {
    let bar = progress.start("draws", rivals.len() * draws.len());
    let cases: Vec<(&Rival, &Draw)> =
        rivals.iter().flat_map(|rival| draws.iter().map(move |draw| (rival, draw))).collect();
    let flown: Result<Vec<Figures>, Failure> = cases
        .into_par_iter()
        .map(|(rival, draw)| {
            let settings = [&rival.settings[..], &draw.settings].concat();
            let contender = Contender { controller: rival.controller, settings };
            let figures = Trial::new(&contender, &NOMINAL)?.fly(draw.seed)?.0;
            bar.inc();
            Ok(figures)
        })
        .collect();
    let flown = flown?;
    let of_each = flown.chunks(draws.len().max(1)).map(<[_]>::to_vec);
    let judged = |(rival, figures): (&Rival, _)| Judged { rival: rival.clone(), figures };
    Ok(rivals.iter().zip(of_each).map(judged).collect())
}

/// Each draw with the figures of every law, as JSON.
#[must_use]
pub fn document(judged: &[Judged], draws: &[Draw]) -> Json {
    let figures = |draw: usize| {
        let of = |law: &Judged| {
            let values = METRIC.iter().zip(law.figures[draw]);
            let values = values.map(|(metric, value)| {
                (metric.key.to_owned(), json!(value.is_finite().then_some(value)))
            });
            (law.rival.name.clone(), Json::Object(values.collect()))
        };
        Json::Object(judged.iter().map(of).collect::<Map<String, Json>>())
    };
    let draw = |(index, draw): (usize, &Draw)| {
        let drawn = draw.settings.iter().map(|setting| (setting.key.clone(), json!(setting.value)));
        json!({
            "draw": draw.run,
            "seed": draw.seed,
            "arguments": draw.arguments(),
            "drawn": Json::Object(drawn.collect()),
            "laws": figures(index),
        })
    };
    draws.iter().enumerate().map(draw).collect()
}
