//! The draws once more, with what `oqtal identify` finds of each plant in place of what the laws assume of it.

use oqtal_config::{Config, Setting};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use super::flown::Draw;
use crate::identify::hidden_plants;
use crate::progress::Progress;

/// The draws with what was found of them.
#[derive(Clone, Debug)]
pub struct IdentifiedDraws {
    /// The draws; one that could not be identified is as it was.
    pub draws: Vec<Draw>,
    /// Number of draws that could not be identified, since their flight failed or showed nothing \[-\].
    pub unidentified: usize,
}

/// Flies and identifies the plant of every draw, with the law of `common` that knows `[vehicle]` alone, and the mass as weighed.
///
/// # Errors
/// A setting is wrong.
pub fn identified(
    draws: &[Draw],
    common: &[Setting],
    progress: &Progress,
) -> Result<IdentifiedDraws, Failure> {
    let bar = progress.start("identification", draws.len());
    let found: Result<Vec<Option<Draw>>, Failure> = draws
        .par_iter()
        .map(|draw| {
            let mut config = Config::from_settings(&[common, &draw.settings].concat())?;
            config.clock.seed = draw.seed;
            let identification = hidden_plants::identified(&config).ok();
            bar.inc();
            Ok(identification.map(|identification| {
                let settings = [&draw.settings[..], &identification.settings()].concat();
                Draw { settings, ..draw.clone() }
            }))
        })
        .collect();
    let found = found?;
    let unidentified = found.iter().filter(|draw| draw.is_none()).count();
    let pairs = found.into_iter().zip(draws);
    let draws = pairs.map(|(found, draw)| found.unwrap_or_else(|| draw.clone())).collect();
    Ok(IdentifiedDraws { draws, unidentified })
}
