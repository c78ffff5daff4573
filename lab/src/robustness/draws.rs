//! Draws of a spread: plants flown by every law, as drawn or as identified.

use std::ops::Range;

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure};
use serde_json::{Map, Value as Json, json};
use toml::Value;

use super::spread::PlantSpread;
use crate::identify::hidden_plants;
use crate::progress::Progress;
use crate::study::args::words_of;
use crate::study::flights::{NOMINAL, table, value_at};
use crate::study::metric::METRIC;
use crate::study::{Case, FlightCondition, Flown};

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

/// Greatest number of draws \[-\]: different draws, and the draws used for tuning, have different flight seeds.
pub const MOST_DRAWS: u64 = 10_000;

/// Seed of the draws used for tuning; laws are compared on other seeds, from 1 on.
pub const TUNING_SEED: u64 = 0;

/// Noise assumed by the filters of `oqtal-dt`: that of the configured cameras. The noise of a draw is unknown to the filters.
const ASSUMED: [(&str, &str); 2] = [
    ("control.predictive.filter.attitude-noise-deg", "mocap.attitude-noise-deg"),
    ("control.predictive.filter.position-noise-mm", "mocap.position-noise-mm"),
];

impl Draw {
    /// Draws `runs` with `seed` of `spread` about the configuration of `common`.
    ///
    /// # Errors
    /// A number is too great (exit code 64), or a key of the spread does not exist in the configuration.
    pub fn several(
        spread: &PlantSpread,
        common: &[Setting],
        (seed, runs): (u64, Range<u64>),
    ) -> Result<Vec<Self>, Failure> {
        if runs.end > MOST_DRAWS {
            let reason = format!("draws of a spread have the numbers 0 to {}", MOST_DRAWS - 1);
            return Err(Failure::new(Exit::Usage, reason));
        }
        let nominal = table(&Config::from_settings(common)?);
        let is_drawn = |key: &str| spread.keys.iter().any(|drawn| drawn.key == key);
        let assumed = ASSUMED.iter().filter(|(_, followed)| is_drawn(followed)).map(|(key, _)| {
            let value = value_at(&nominal, key).expect("it is a key of every configuration");
            Setting::flag("spread", key, value.clone())
        });
        let assumed: Vec<Setting> = assumed.collect();
        let draw = |run: u64| {
            let mut settings = assumed.clone();
            settings.extend(spread.draw(&nominal, (seed, run))?);
            Config::from_settings(&[common, &settings].concat())?;
            Ok(Self { run, seed: (seed + 1) * MOST_DRAWS + run, settings })
        };
        runs.map(draw).collect()
    }

    /// The draw with the vehicle of `found`. The noise that was found is left out: it is unknown to the filters in all draws.
    fn with_vehicle(&self, mut found: Vec<Setting>) -> Self {
        found.retain(|setting| setting.key.starts_with("vehicle."));
        Self { settings: [&self.settings[..], &found].concat(), ..self.clone() }
    }

    /// The draws as one case of a study.
    pub fn case(name: &str, draws: &[Self]) -> Case {
        let condition = |draw: &Self| FlightCondition {
            seed: draw.seed,
            plant: NOMINAL,
            settings: draw.settings.clone(),
        };
        Case::of(name, draws.iter().map(condition).collect())
    }

    /// Drawn value of a key.
    pub fn value(&self, key: &str) -> Option<&Value> {
        self.settings.iter().find(|setting| setting.key == key).map(|setting| &setting.value)
    }

    /// Arguments of `oqtal fly` that give the same plant and vehicle, under the settings `common` of the study.
    pub fn arguments(&self, common: &[Setting]) -> String {
        words_of(&[common, &self.settings].concat()).trim_start().to_owned()
    }
}

/// Flies and identifies the plant of every draw. The law of `common` uses `[vehicle]` only; the weighed mass is given. Returns
/// the draws with the identified vehicle; `None` for a draw whose flight failed or was insufficient.
///
/// # Errors
/// A setting is invalid.
pub fn identified(
    draws: &[Draw],
    common: &[Setting],
    progress: &Progress,
) -> Result<Vec<Option<Draw>>, Failure> {
    let identify = |draw: &Draw| {
        let mut config = Config::from_settings(&[common, &draw.settings].concat())?;
        config.clock.seed = draw.seed;
        let identification = hidden_plants::identified(&config).ok();
        Ok(identification.map(|identification| draw.with_vehicle(identification.settings())))
    };
    progress.each("identification", draws, identify)
}

/// Draws under the settings `common`, with the figures of every law, as JSON.
pub fn document(flown: &[Flown], draws: &[Draw], common: &[Setting]) -> Json {
    let figures = |draw: usize| {
        let of = |law: &Flown| {
            let values = METRIC.iter().zip(law.runs[draw].figures);
            let values = values.map(|(metric, value)| (metric.key.to_owned(), json!(value)));
            (law.law.name.clone(), Json::Object(values.collect()))
        };
        Json::Object(flown.iter().map(of).collect::<Map<String, Json>>())
    };
    let draw = |(index, draw): (usize, &Draw)| {
        let drawn = draw.settings.iter().map(|setting| (setting.key.clone(), json!(setting.value)));
        json!({
            "draw": draw.run,
            "seed": draw.seed,
            "arguments": draw.arguments(common),
            "drawn": Json::Object(drawn.collect()),
            "laws": figures(index),
        })
    };
    draws.iter().enumerate().map(draw).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identified_draw_has_the_vehicle_that_was_found_and_not_the_noise() {
        let drawn = vec![Setting::flag("spread", "plant.mass-kg", 0.6)];
        let draw = Draw { run: 0, seed: 0, settings: drawn };
        let found = ["vehicle.mass-kg", ASSUMED[0].0, ASSUMED[1].0];
        let found = found.map(|key| Setting::flag("identify", key, 0.6));
        let keys = draw.with_vehicle(found.to_vec()).settings.into_iter().map(|it| it.key);
        assert_eq!(keys.collect::<Vec<_>>(), ["plant.mass-kg", "vehicle.mass-kg"]);
    }

    #[test]
    fn flight_seeds_of_different_draws_differ() {
        let spread = PlantSpread::named("vehicle").unwrap();
        let draw = |runs| Draw::several(&spread, &[], (TUNING_SEED, runs));
        let last = draw(MOST_DRAWS - 1..MOST_DRAWS).unwrap();
        assert!(last[0].seed < 2 * MOST_DRAWS, "{}", last[0].seed);
        assert_eq!(draw(MOST_DRAWS..MOST_DRAWS + 1).unwrap_err().exit, Exit::Usage);
    }
}
