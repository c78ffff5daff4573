//! The laws on draws of further spreads.

use std::ops::Range;

use oqtal_config::Setting;
use oqtal_runtime::process::Failure;
use serde_json::{Map, Value};

use super::flown::{self, Draw, Rival};
use super::spread::PlantSpread;
use super::tables;
use crate::progress::Progress;
use crate::reproduce::chapter::Chapter;
use crate::sheet::Sheet;

/// A further spread with its draws.
#[derive(Clone, Debug)]
pub struct OtherSpread {
    name: String,
    spread: PlantSpread,
    draws: Vec<Draw>,
}

impl OtherSpread {
    /// The draws with this seed and these numbers, of the spread `name`: a built-in one or a file.
    ///
    /// # Errors
    /// The spread, or a setting, is invalid (exit code 78).
    pub fn new(name: &str, common: &[Setting], runs: (u64, Range<u64>)) -> Result<Self, Failure> {
        let spread = PlantSpread::named(name)?;
        let draws = Draw::several(&spread, common, runs)?;
        Ok(Self { name: name.to_owned(), spread, draws })
    }
}

/// Flies all draws. Returns those of each spread with the figures of every law, as JSON, and their chapter.
///
/// # Errors
/// A setting is invalid (exit code 78).
pub fn chapter(
    others: &[OtherSpread],
    rivals: &[Rival],
    progress: &Progress,
) -> Result<(Value, Chapter), Failure> {
    let (mut documents, mut sheets) = (Map::new(), Vec::new());
    for OtherSpread { name, spread, draws } in others {
        let judged = flown::fly(rivals, draws, progress)?;
        documents.insert(name.clone(), flown::document(&judged, draws));
        let own = tables::all(&judged, draws).into_iter().chain([tables::spread_table(spread)]);
        let titled = |sheet: Sheet| Sheet { title: format!("{}: {name}", sheet.title), ..sheet };
        sheets.extend(tables::named(name, own.collect()).into_iter().map(titled));
    }
    let intro = vec!["As many draws of other spreads. Gains are those from above.".to_owned()];
    let chapter = Chapter { title: "Other spreads", intro, sheets, figures: Vec::new() };
    Ok((Value::Object(documents), chapter))
}
