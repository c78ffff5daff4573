//! Greatest weight, or gain, of a law before the attitude error rises: "incremented until the system started to lose stability".

use oqtal_config::{Config, Setting};
use oqtal_control::LawStack;
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::campaign::table::MaxQ;
use crate::study::flights::{path, table, value_at};
use crate::study::law::{self, StudyLaw};
use crate::study::metric::{ATTITUDE, of_path};
use crate::tune::space::parameters;

/// Factor by which a weight is raised in each step \[-\].
const RAISE: f64 = std::f64::consts::SQRT_2;
/// Ratio to the least attitude error above which the error counts as risen \[-\].
const RISEN: f64 = 1.25;
/// Greatest number of steps \[-\].
const MOST_RAISES: usize = 16;
/// Seeds of the flights with raised weights.
const RAISED_SEEDS: std::ops::Range<u64> = 200..202;

/// Searches for the greatest weight of `law` on the configured plant: the last one before the error rises, or the last one tried, at
/// which the error had not yet risen.
///
/// # Errors
/// A setting is invalid.
pub fn max_q(law: &StudyLaw) -> Result<MaxQ, Failure> {
    let registered = law::of_name(law.controller).expect("every law is registered");
    let key = &*parameters(registered, LawStack::Default)[0].key;
    let set = law.settings.iter().find(|setting| setting.key == key);
    let start = set.and_then(|setting| setting.value.as_float());
    let shipped = || value_at(&table(&Config::default()), key)?.as_float();
    let start = start.or_else(shipped).expect("a gain is a number of the configuration");
    let weights: Vec<f64> = (0..MOST_RAISES).map(|k| start * RAISE.powi(k as i32)).collect();
    let errors: Result<Vec<f64>, Failure> =
        weights.par_iter().map(|weight| attitude_error(law, key, *weight)).collect();
    let (mut least, mut greatest) = (f64::INFINITY, start);
    for (weight, error) in weights.iter().zip(errors?) {
        least = error.min(least);
        if error > RISEN * least || !error.is_finite() {
            return Ok(MaxQ { weight: greatest, found: "reached" });
        }
        greatest = *weight;
    }
    Ok(MaxQ { weight: greatest, found: "at least" })
}

fn attitude_error(law: &StudyLaw, key: &str, weight: f64) -> Result<f64, Failure> {
    let law = law.with(&[Setting::flag("max q", key, weight)]);
    let mut sum = 0.0;
    for seed in RAISED_SEEDS {
        sum += path(&law, seed)?.map_or(f64::INFINITY, |flight| of_path(&flight)[ATTITUDE]);
    }
    Ok(sum / (RAISED_SEEDS.end - RAISED_SEEDS.start) as f64)
}
