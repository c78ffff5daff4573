//! Spread of the plants: the keys of the configuration that vary from draw to draw, and how they vary.
//!
//! In TOML, each key of the configuration has one of the forms of [`super::form::Form`]:
//!
//! ```toml
//! [plant]
//! mass-kg = { factor = [0.9, 1.1] }                 # the configured value times one number
//! rate-lag-ms = { between = [35.0, 80.0] }          # a number
//! rate-lag-ratio = { each-factor = [0.9, 1.1] }     # every element times a number of its own
//! rotors.strength = { one-factor = [0.9, 1.0] }     # one element, drawn too, times a number
//! fidelity = { choose = ["eq61", "rotors"] }        # one of these
//! ```

use std::path::Path;

use oqtal_bus::message::{FNV_OFFSET, fnv1a};
use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure};
use toml::{Table, Value};

use crate::random::SplitMix64;
use crate::study::flights::{self, value_at};

use super::form::Form;

/// A key and its form of drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct SpreadKey {
    /// Dotted key of the configuration.
    pub key: String,
    /// Form of drawing.
    pub form: Form,
}

/// The keys that vary from draw to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct PlantSpread {
    /// The keys, in order.
    pub keys: Vec<SpreadKey>,
}

/// Differences of a vehicle from a carefully made model.
const VEHICLE: [(&str, Form); 9] = [
    ("plant.mass-kg", Form::Factor(0.9, 1.1)),
    ("plant.max-thrust-n", Form::Factor(0.9, 1.1)),
    ("plant.rate-authority-rad-s", Form::Factor(0.8, 1.2)),
    ("plant.rate-lag-ms", Form::Between(35.0, 80.0)),
    ("plant.rate-lag-ratio", Form::EachFactor(0.9, 1.1)),
    ("plant.thrust-lag-ms", Form::Between(30.0, 80.0)),
    ("plant.command-delay-ms", Form::Between(15.0, 30.0)),
    ("plant.hidden-delay-ms", Form::Between(0.0, 15.0)),
    ("plant.drag-per-s", Form::Between(0.1, 0.6)),
];

/// Further differences of body and environment. A rotor is at most 3 % weaker: the simulated on-board loop has no integral
/// action, so that the vehicle turns at about 3 deg/s for each 1 %.
const ENVIRONMENT: [(&str, Form); 15] = [
    ("plant.inertia-kg-m2", Form::Factor(0.8, 1.2)),
    ("plant.thrust-exponent", Form::Between(0.95, 1.05)),
    ("plant.gust-sd-m-s2", Form::Factor(0.5, 2.0)),
    ("plant.rotors.strength", Form::OneFactor(0.97, 1.0)),
    ("plant.rotors.lag-ms", Form::Between(10.0, 20.0)),
    ("plant.rotors.drag-coefficient", Form::Between(0.0, 1.2e-4)),
    ("plant.rotors.inflow-coefficient", Form::Between(0.0, 2.4e-4)),
    ("plant.command-jitter-ms", Form::Between(0.0, 4.0)),
    ("plant.command-loss-probability", Form::Between(0.0, 0.02)),
    ("plant.command-loss-burst", Form::Between(2.0, 3.0)),
    ("mocap.position-noise-mm", Form::Factor(0.5, 2.0)),
    ("mocap.attitude-noise-deg", Form::Factor(0.5, 2.0)),
    ("mocap.jitter-ms", Form::Between(0.0, 4.0)),
    ("mocap.dropout-probability", Form::Between(0.0, 0.01)),
    ("mocap.dropout-frames", Form::Between(1.5, 2.5)),
];

/// Keys of the environment of which one value is selected, with the values.
const CHOSEN: [(&str, [&str; 2]); 3] = [
    ("plant.battery.sag", ["false", "true"]),
    ("plant.fidelity", ["eq61", "rotors"]),
    ("plant.rotors.ground-effect", ["false", "true"]),
];

/// An authority of its own for each axis.
const AXES: (&str, Form) = ("plant.rate-authority-rad-s", Form::EachFactor(0.8, 1.2));

/// Noise of the measured attitude from that of the best rooms to that of bad ones \[deg\]; the filters assume the configured one.
const NOISE: (&str, Form) = ("mocap.attitude-noise-deg", Form::Between(0.05, 0.8));

impl PlantSpread {
    /// Built-in spread, the spread of a file, or several of them joined by `+`: of a key that occurs twice, the later form.
    ///
    /// # Errors
    /// See [`read`](Self::read).
    pub fn named(names: &str) -> Result<Self, Failure> {
        if names.contains('+') && Path::new(names).exists() {
            return Self::read(Path::new(names));
        }
        let mut joined = Self { keys: Vec::new() };
        for name in names.split('+') {
            let keys = match name {
                "vehicle" => Self::vehicle().keys,
                "axes" => vec![key(AXES)],
                "noise" => vec![key(NOISE)],
                "room" => vec![chosen("mocap.preset", &["room"])],
                "rotors" => Self::rotors(),
                "everything" => Self::everything().keys,
                file => Self::read(Path::new(file))?.keys,
            };
            joined.keys.retain(|old| keys.iter().all(|new| new.key != old.key));
            joined.keys.extend(keys);
        }
        Ok(joined)
    }

    /// Vehicles that differ from their model.
    pub fn vehicle() -> Self {
        Self { keys: VEHICLE.map(key).to_vec() }
    }

    /// Vehicles that differ from their model, in an environment that differs too.
    pub fn everything() -> Self {
        Self { keys: Self::vehicle().keys.into_iter().chain(environment()).collect() }
    }

    /// Simulated rotors that differ as in [`Self::everything`].
    fn rotors() -> Vec<SpreadKey> {
        let of_rotors = environment().filter(|it| it.key.starts_with("plant.rotors."));
        of_rotors.chain([chosen("plant.fidelity", &["rotors"])]).collect()
    }

    /// Reads a spread from a file.
    ///
    /// # Errors
    /// The file cannot be read, or an entry has none of the forms (exit code 78, with the line).
    pub fn read(file: &Path) -> Result<Self, Failure> {
        let entries = Config::file_settings(&[file])?;
        let mut keys: Vec<SpreadKey> = Vec::new();
        for setting in &entries {
            let key = entry(setting)?;
            if keys.iter().any(|other| other.key == key.key) {
                let reason = format!("{}: `{}` has two forms; give one", setting.origin, key.key);
                return Err(Failure::new(Exit::Config, reason));
            }
            keys.push(key);
        }
        if keys.is_empty() {
            let reason = format!("{}: the spread has no key; docs/robustness.md", file.display());
            return Err(Failure::new(Exit::Config, reason));
        }
        Ok(Self { keys })
    }

    /// Spread with each range doubled about its middle; choices are unchanged. Bounds below zero become zero.
    pub fn twice_as_wide(&self) -> Self {
        let wide = |low: f64, high: f64| {
            let (middle, half) = (0.5 * (low + high), high - low);
            ((middle - half).max(0.0), middle + half)
        };
        // Factors stay above zero, since a factor of zero is not a vehicle.
        let factor = |low: f64, high: f64| {
            let (low, high) = wide(low, high);
            (low.max(0.1), high)
        };
        let bounds = |form: fn(f64, f64) -> Form, (low, high)| form(low, high);
        let widened = |form: &Form| match form {
            Form::Between(low, high) => bounds(Form::Between, wide(*low, *high)),
            Form::Factor(low, high) => bounds(Form::Factor, factor(*low, *high)),
            Form::EachFactor(low, high) => bounds(Form::EachFactor, factor(*low, *high)),
            Form::OneFactor(low, high) => Form::OneFactor((2.0 * low - high).max(0.1), *high),
            Form::Choose(values) => Form::Choose(values.clone()),
        };
        let key = |SpreadKey { key, form }: &SpreadKey| SpreadKey {
            key: key.clone(),
            form: widened(form),
        };
        Self { keys: self.keys.iter().map(key).collect() }
    }

    /// Warning of keys that differ from the shipped values although the draws of a built-in spread replace them.
    ///
    /// # Errors
    /// A setting is invalid.
    pub fn note(&self, common: &[Setting]) -> Result<Option<String>, Failure> {
        if ![Self::vehicle(), Self::everything()].contains(self) {
            return Ok(None);
        }
        let tables = [Config::from_settings(common)?, Config::default()];
        let tables = tables.map(|config| flights::table(&config));
        let replaced = |SpreadKey { key, form }: &SpreadKey| {
            let Form::Between(low, high) = form else { return None };
            let [own, shipped] = tables.each_ref().map(|table| value_at(table, key));
            (own != shipped).then_some(own?).map(|own| {
                format!("{key} from {low} to {high}, whatever its configured value ({own})")
            })
        };
        let replaced: Vec<_> = self.keys.iter().filter_map(replaced).collect();
        Ok((!replaced.is_empty()).then(|| {
            let keys = replaced.join("; ");
            format!("the spread draws {keys}; for others give a --spread of your own (docs/robustness.md)")
        }))
    }

    /// Settings of draw number `run` with the seed `seed`, about the values of `nominal`. Every key has a separate stream of
    /// random numbers: an additional key does not change the draws of other keys.
    ///
    /// # Errors
    /// A key does not exist in the configuration, or a scaled key is not numeric (exit code 78).
    pub fn draw(&self, nominal: &Table, (seed, run): (u64, u64)) -> Result<Vec<Setting>, Failure> {
        let draw = |SpreadKey { key, form }: &SpreadKey| {
            let mut random = SplitMix64::new(stream(key, seed, run));
            let wrong = |problem: &str| {
                let reason = format!("`{key}` of the spread {problem}; see `oqtal check`");
                Failure::new(Exit::Config, reason)
            };
            let nominal = value_at(nominal, key).ok_or_else(|| wrong("does not exist"))?;
            let value = form.value(nominal, &mut random);
            let value = value.ok_or_else(|| wrong("has no value that it can scale"))?;
            Ok(Setting::flag("spread", key, value))
        };
        self.keys.iter().map(draw).collect()
    }
}

fn key((key, form): (&str, Form)) -> SpreadKey {
    SpreadKey { key: key.to_owned(), form }
}

/// Key of which one of `values` is drawn.
fn chosen(key: &str, values: &[&str]) -> SpreadKey {
    let value = |text: &&str| match text.parse() {
        Ok(truth) => Value::Boolean(truth),
        Err(_) => Value::from(*text),
    };
    let form = Form::Choose(values.iter().map(value).collect());
    SpreadKey { key: key.to_owned(), form }
}

/// Keys of body and environment.
fn environment() -> impl Iterator<Item = SpreadKey> {
    let drawn = ENVIRONMENT.map(key).into_iter();
    drawn.chain(CHOSEN.map(|(key, values)| chosen(key, &values)))
}

/// Seed of the random numbers of a key in one draw: FNV-1a over key, seed and run.
fn stream(key: &str, seed: u64, run: u64) -> u64 {
    let of_seed = fnv1a(fnv1a(FNV_OFFSET, key.as_bytes()), &seed.to_le_bytes());
    fnv1a(of_seed, &run.to_le_bytes())
}

/// Sections of keys with which laws are designed.
const KNOWN_TO_LAWS: [&str; 3] = ["vehicle.", "control.", "position."];

fn entry(setting: &Setting) -> Result<SpreadKey, Failure> {
    let wrong = |reason: &str| {
        let forms = "`between`, `factor`, `each-factor`, `one-factor` = [LOW, HIGH], or `choose` = [VALUES]";
        Failure::new(
            Exit::Config,
            format!("{}: `{}`: {reason}; give {forms}", setting.origin, setting.key),
        )
    };
    let (key, name) =
        setting.key.rsplit_once('.').ok_or_else(|| wrong("is not a key of the configuration"))?;
    let values = setting.value.as_array().ok_or_else(|| wrong("is not a list"))?;
    if KNOWN_TO_LAWS.iter().any(|section| key.starts_with(section)) {
        return Err(wrong("is known to the laws; a spread varies keys that they do not know"));
    }
    let key = key.to_owned();
    if name == "choose" && !values.is_empty() {
        return Ok(SpreadKey { key, form: Form::Choose(values.clone()) });
    }
    let number = |value: &Value| value.as_float().or(value.as_integer().map(|whole| whole as f64));
    let bounds: Vec<f64> = values.iter().filter_map(number).collect();
    let [low, high] = bounds[..] else { return Err(wrong("is not a pair of numbers")) };
    if !(low <= high && low.is_finite() && high.is_finite()) {
        return Err(wrong("has its bounds in the wrong order"));
    }
    let form = match name {
        "between" => Form::Between(low, high),
        "factor" => Form::Factor(low, high),
        "each-factor" => Form::EachFactor(low, high),
        "one-factor" => Form::OneFactor(low, high),
        _ => return Err(wrong("has none of the forms")),
    };
    Ok(SpreadKey { key, form })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_the_draws_replace_are_told() {
        let note = |text: &str| {
            let setting = Setting::parse("--set", text).unwrap();
            PlantSpread::everything().note(&[setting]).unwrap()
        };
        assert_eq!(note("vehicle.mass-kg=1.4"), None, "a factor is about the configured value");
        assert_eq!(note("vehicle.rate-lag-ms=50"), None, "the shipped value");
        for section in ["vehicle", "plant"] {
            let replaced = note(&format!("{section}.rate-lag-ms=60")).unwrap();
            let part =
                "draws plant.rate-lag-ms from 35 to 80, whatever its configured value (60.0);";
            assert!(replaced.contains(part), "{replaced}");
        }
    }

    fn nominal() -> Table {
        Config::default().to_toml().parse().unwrap()
    }

    fn value<'a>(draw: &'a [Setting], key: &str) -> &'a Value {
        &draw.iter().find(|setting| setting.key == key).unwrap().value
    }

    #[test]
    fn every_draw_is_a_configuration_and_stays_within_the_bounds() {
        let (nominal, spread) = (nominal(), PlantSpread::everything());
        for run in 0..200 {
            for spread in [&spread, &spread.twice_as_wide()] {
                let draw = spread.draw(&nominal, (7, run)).unwrap();
                Config::from_settings(&draw).unwrap();
            }
            let draw = spread.draw(&nominal, (7, run)).unwrap();
            assert!((0.45..=0.55).contains(&value(&draw, "plant.mass-kg").as_float().unwrap()));
            let weak = value(&draw, "plant.rotors.strength").as_array().unwrap();
            let intact = weak.iter().filter(|share| share.as_float() == Some(1.0)).count();
            assert!(intact >= 3, "{weak:?}");
        }
    }

    #[test]
    fn joined_spreads_have_the_keys_of_all_and_the_later_form_of_a_key() {
        let joined = PlantSpread::named("vehicle+axes+noise+room+rotors").unwrap();
        let keys: Vec<&str> = joined.keys.iter().map(|it| &*it.key).collect();
        let distinct: std::collections::BTreeSet<&str> = keys.iter().copied().collect();
        assert_eq!(distinct.len(), keys.len());
        let draw = joined.draw(&nominal(), (7, 0)).unwrap();
        let config = Config::from_settings(&draw).unwrap();
        let authority = config.plant.rate_authority_rad_s;
        assert!(
            authority[0] != authority[1] && (0.05..0.8).contains(&config.mocap.attitude_noise_deg)
        );
        assert_eq!(config.mocap.preset, "room");
        assert!(PlantSpread::named("vehicle+nothing").is_err());
    }

    #[test]
    fn other_keys_of_the_spread_do_not_change_the_draws_of_a_key() {
        let (nominal, all) = (nominal(), PlantSpread::everything());
        let alone = PlantSpread { keys: all.keys[3..4].to_vec() };
        let key = &alone.keys[0].key;
        let draws: Vec<_> = (0..50)
            .map(|run| {
                let [one, of_all] = [&alone, &all].map(|s| s.draw(&nominal, (3, run)).unwrap());
                assert_eq!(value(&one, key), value(&of_all, key));
                value(&one, key).as_float().unwrap()
            })
            .collect();
        let mean = draws.iter().sum::<f64>() / 50.0;
        assert!((mean - 57.5).abs() < 6.0, "evenly between 35 and 80: {mean}");
        assert_ne!(all.draw(&nominal, (3, 0)).unwrap(), all.draw(&nominal, (4, 0)).unwrap());
    }

    #[test]
    fn a_file_has_the_forms_of_its_keys_and_an_error_has_its_line() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("spread.toml");
        let read = |text: &str| {
            std::fs::write(&file, text).unwrap();
            PlantSpread::read(&file)
        };
        let spread =
            read("[plant]\nmass-kg = { factor = [0.5, 1] }\nbattery.sag = { choose = [true] }\n");
        let keys = spread.unwrap().keys;
        assert_eq!(
            keys[1],
            SpreadKey { key: "plant.mass-kg".to_owned(), form: Form::Factor(0.5, 1.0) }
        );
        assert_eq!(keys[0].form, Form::Choose(vec![Value::Boolean(true)]));
        for wrong in
            ["mass-kg = 3", "mass-kg = { times = [1, 2] }", "mass-kg = { factor = [2, 1] }"]
        {
            let failure = read(&format!("[plant]\n{wrong}\n")).unwrap_err();
            assert!(failure.to_string().contains("spread.toml:2"), "{failure}");
        }
        for wrong in [
            "",
            "[plant]\nmass-kg = { factor = [1, 2], between = [1, 2] }\n",
            "[vehicle]\nmass-kg = { factor = [1, 2] }\n",
        ] {
            assert!(read(wrong).unwrap_err().to_string().contains("spread.toml"), "{wrong}");
        }
        let unknown = read("[plant]\nmas-kg = { factor = [1, 2] }\n").unwrap();
        assert!(unknown.draw(&nominal(), (1, 1)).unwrap_err().to_string().contains("mas-kg"));
    }
}
