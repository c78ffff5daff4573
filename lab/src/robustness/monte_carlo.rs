//! The laws on draws of a spread: sets of draws, each a chapter of the page and a key of the JSON document.

use oqtal_config::Setting;
use oqtal_runtime::process::Failure;
use serde_json::{Map, Value};

use super::draws::{self, Draw};
use super::spread::PlantSpread;
use super::tables;
use crate::progress::Progress;
use crate::reproduce::chapter::Chapter;
use crate::sheet::Sheet;
use crate::study::flights::Test;
use crate::study::law::StudyLaw;
use crate::study::{Flown, Study};

/// Set of draws in addition to the first one.
#[derive(Clone, Copy, Debug)]
pub struct DrawSet {
    /// Key in the document.
    pub key: &'static str,
    /// Prefix of the names of its tables.
    pub tables: &'static str,
    /// Heading of the chapter.
    pub title: &'static str,
    /// Description of the draws at the start of the chapter.
    pub draws: &'static str,
    /// Whether the ranges of the spread are doubled.
    pub is_wide: bool,
    /// Whether the laws use the identified vehicle in place of `[vehicle]`.
    pub is_identified: bool,
}

/// The sets of draws, in the order of the page.
pub const SETS: [DrawSet; 3] = [
    DrawSet {
        key: "identified_draws",
        tables: "identified",
        title: "The same plants, identified",
        draws: "The draws from above.",
        is_wide: false,
        is_identified: true,
    },
    DrawSet {
        key: "wide_draws",
        tables: "wide",
        title: "A spread twice as wide",
        draws: "The same number of draws of a spread whose ranges are each twice as wide, about the same middles, cut off at zero.",
        is_wide: true,
        is_identified: false,
    },
    DrawSet {
        key: "wide_identified_draws",
        tables: "wide_identified",
        title: "The plants of the wider spread, identified",
        draws: "The draws of the wider spread.",
        is_wide: true,
        is_identified: true,
    },
];

/// Draws of a further spread.
#[derive(Clone, Debug)]
pub struct OtherSpread {
    /// Name of the spread: a built-in one or a file.
    pub name: String,
    /// The spread.
    pub spread: PlantSpread,
    /// Draws of the spread.
    pub draws: Vec<Draw>,
}

/// A set of draws that was flown.
#[derive(Clone, Debug)]
pub struct FlownDraws {
    /// The draws with figures, as JSON.
    pub document: Value,
    /// Their chapter.
    pub chapter: Chapter,
    /// The row of every law; each set of draws is a case.
    pub flown: Vec<Flown>,
}

/// Laws, settings and progress bars of all sets of draws.
#[derive(Clone, Copy, Debug)]
pub struct MonteCarlo<'a> {
    /// The laws.
    pub laws: &'a [StudyLaw],
    /// The settings of all laws.
    pub common: &'a [Setting],
    /// The tests that are flown.
    pub tests: &'a [Test],
    /// Progress bars in the terminal.
    pub progress: &'a Progress,
}

impl MonteCarlo<'_> {
    /// Flies the draws as the case `name`. Returns draws with figures as JSON, and the row of every law.
    ///
    /// # Errors
    /// A setting is invalid (exit code 78).
    pub fn fly(&self, name: &str, draws: &[Draw]) -> Result<(Value, Vec<Flown>), Failure> {
        let cases = [Draw::case(name, draws).flown_as(self.tests)];
        let flown = Study { name: "draws", laws: self.laws, cases: &cases }.fly(self.progress)?;
        Ok((draws::document(&flown, draws, self.common), flown))
    }

    /// Flies `drawn` as described by `set`.
    ///
    /// # Errors
    /// A setting is invalid (exit code 78).
    pub fn chapter(&self, set: &DrawSet, drawn: &[Draw]) -> Result<FlownDraws, Failure> {
        let (draws, intro) = match set.is_identified {
            false => (drawn.to_vec(), format!("{} Gains are those from above.", set.draws)),
            true => self.identified(set, drawn)?,
        };
        let (document, flown) = self.fly(set.key, &draws)?;
        let sheets = named(set.tables, tables::all(&flown, &draws));
        let chapter =
            Chapter { title: set.title, intro: vec![intro], sheets, ..Chapter::default() };
        Ok(FlownDraws { document, chapter, flown })
    }

    /// Draws with their identified vehicles; a draw that could not be identified keeps its configured vehicle.
    fn identified(&self, set: &DrawSet, drawn: &[Draw]) -> Result<(Vec<Draw>, String), Failure> {
        let found = draws::identified(drawn, self.common, self.progress)?;
        let unidentified = found.iter().filter(|draw| draw.is_none()).count();
        let intro = format!(
            "{} Each plant was first flown and identified as by `oqtal identify --fly --mass`, with its own mass and the law of the \
             configuration; all laws have the identified [vehicle]. Not identified: {unidentified} of {}, which are flown \
             with the [vehicle] from above. The gains are those from above, too.",
            set.draws,
            drawn.len()
        );
        let pairs = found.into_iter().zip(drawn);
        Ok((pairs.map(|(found, draw)| found.unwrap_or_else(|| draw.clone())).collect(), intro))
    }

    /// Flies the draws of further spreads; the document has a key for each.
    ///
    /// # Errors
    /// A setting is invalid (exit code 78).
    pub fn others(&self, others: &[OtherSpread]) -> Result<FlownDraws, Failure> {
        let (mut documents, mut sheets, mut all) = (Map::new(), Vec::new(), Vec::new());
        for OtherSpread { name, spread, draws } in others {
            let (document, flown) = self.fly(name, draws)?;
            documents.insert(name.clone(), document);
            let own = tables::all(&flown, draws).into_iter().chain([tables::spread(spread)]);
            let titled =
                |sheet: Sheet| Sheet { title: format!("{}: {name}", sheet.title), ..sheet };
            sheets.extend(named(name, own.collect()).into_iter().map(titled));
            all.extend(flown);
        }
        let intro = vec![
            "The same number of draws of other spreads. Gains are those from above.".to_owned(),
        ];
        let chapter = Chapter { title: "Other spreads", intro, sheets, ..Chapter::default() };
        Ok(FlownDraws { document: Value::Object(documents), chapter, flown: all })
    }
}

/// Sheets with `of` before their names.
fn named(of: &str, sheets: Vec<Sheet>) -> Vec<Sheet> {
    let named = |sheet: Sheet| Sheet { name: format!("{of}_{}", sheet.name), ..sheet };
    sheets.into_iter().map(named).collect()
}
