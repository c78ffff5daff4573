//! `oqtal robustness`: every law on plants that differ from its design model.

pub mod against;
pub mod cases;
pub mod draws;
pub mod form;
pub mod frequency;
pub mod impulse;
pub mod linear;
pub mod margins;
pub mod monte_carlo;
pub mod probed;
pub mod responses;
pub mod spread;
pub mod tables;

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{NonEmptyStringValueParser, PossibleValuesParser};
use oqtal_config::{Config, Setting};
use oqtal_observe::explain::wrapped;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;
use serde_json::Value;

use crate::output::{ExistingArgs, StudyOutput};
use crate::progress::Progress;
use crate::reproduce::chapter::Chapter;
use crate::reproduce::page::PageHead;
use crate::sheet::Sheet;
use crate::study::args::{StudyArgs, say_notes};
use crate::study::flights::Test;
use crate::study::gains::{self, GainSource};
use crate::study::law::{self, STUDY_DEFAULT, StudyLaw};
use crate::study::{Flown, failure, records};

use draws::{Draw, MOST_DRAWS};
use monte_carlo::{FlownDraws, MonteCarlo, OtherSpread, SETS};
use spread::PlantSpread;
use tables::FAILURES;

/// Arguments of `oqtal robustness`.
#[derive(Args, Debug)]
pub struct RobustnessArgs {
    /// Laws to fly
    #[arg(long, visible_alias = "controllers", value_name = "A,B,C", value_delimiter = ',', value_parser = PossibleValuesParser::new(law::names()), default_values = law::names())]
    laws: Vec<String>,
    /// Spread of the plants: `vehicle` (mass, thrust, authority, lags, delays, drag), `axes` (an authority for each axis), `noise`
    /// (of the attitude, 0.05 to 0.8 deg, unknown to the laws), `room` (cameras of that preset), `rotors` (simulated rotors),
    /// `everything` (vehicle and environment), a file in TOML with a form of drawing for each key (docs/robustness.md), or
    /// several of these joined by +
    #[arg(long, value_name = "SPREAD", default_value = "vehicle", value_parser = NonEmptyStringValueParser::new())]
    spread: String,
    /// Further spreads, each as for --spread, with the same number of draws and tables of their own
    #[arg(long, value_name = "SPREADS", value_delimiter = ',', value_parser = NonEmptyStringValueParser::new())]
    other_spreads: Vec<String>,
    /// Also the same number of draws of the spread with every range twice as wide
    #[arg(long)]
    wide: bool,
    /// Tests that are flown in each draw
    #[arg(long, value_name = "TESTS", value_delimiter = ',', value_parser = PossibleValuesParser::new(Test::ALL.map(Test::name)), default_values = Test::ALL.map(Test::name))]
    tests: Vec<String>,
    /// Number of draws; every law flies all of them
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=MOST_DRAWS))]
    runs: u64,
    /// Seed of the draws
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seed: u64,
    /// Gains of the laws: `configured`, `tuned`, a folder of deploy/tuned, or a directory with files LAW.toml; several sources are
    /// flown beside each other, without the laws that a source lacks
    #[arg(
        long,
        value_name = "SOURCES",
        value_delimiter = ',',
        default_value = "tuned,spread,shipped"
    )]
    gains: Vec<GainSource>,
    /// Also every draw of --spread, and of --wide, with the vehicle that `oqtal identify` finds from one flight in place of [vehicle]
    #[arg(long)]
    identified: bool,
    /// Also some single plants: the nominal one, lags and delays at and beyond the edge of the spread
    #[arg(long)]
    plants: bool,
    /// Also margins in hover, and of the attitude loop alone, of the linear model and flown
    #[arg(long)]
    margins: bool,
    /// Also responses to a step, a force and a gust
    #[arg(long)]
    responses: bool,
    /// Directory of robustness.html, robustness.md and robustness.json [default: results/robustness-N]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    existing: ExistingArgs,
    /// Print JSON instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    study: StudyArgs,
}

/// Key in the document, and name as a case, of the draws of `--spread`.
const DRAWS: &str = "draws";

/// Setting of the study unless it is given, or is one of the gains of a law: with the shipped limit, the integrators of the laws on
/// the default stack cannot hold the heaviest vehicles, and their hover errors are three to four times as large.
const INTEGRAL_LIMIT: (&str, f64) = ("position.velocity-integral-limit-m-s2", 4.0);

/// The page.
const PAGE: PageHead = PageHead {
    title: "Robustness",
    lead: "Every law flies the same draws of plants that differ from the model that all laws are designed for, `[vehicle]`. The \
     laws do not know the drawn values, except for delays that stamps show. `oqtal-dt` and the laws on its stack adapt the \
     model in flight, except with the gains of deploy/tuned/fixed. Gains found over such a spread cannot be compared with \
     gains found near the model.",
    file: "robustness",
};

/// The settings under which all draws are flown: `given`, over the one of the study itself.
pub fn with_defaults(given: Vec<Setting>) -> Vec<Setting> {
    let mut common = vec![Setting::flag(STUDY_DEFAULT, INTEGRAL_LIMIT.0, INTEGRAL_LIMIT.1)];
    common.extend(given);
    common
}

/// Draws of a spread by seed and range of numbers, under settings of [`with_defaults`]. Each contains the setting of the study, so that
/// it can be flown again alone.
///
/// # Errors
/// A draw is not a valid configuration.
pub fn draw_plants(
    spread: &PlantSpread,
    common: &[Setting],
    numbers: (u64, std::ops::Range<u64>),
) -> Result<Vec<Draw>, Failure> {
    let mut draws = Draw::several(spread, common, numbers)?;
    let of_study = common.iter().rfind(|setting| setting.key == INTEGRAL_LIMIT.0);
    if let Some(setting) = of_study.filter(|setting| setting.origin == STUDY_DEFAULT) {
        draws.iter_mut().for_each(|draw| draw.settings.insert(0, setting.clone()));
    }
    Ok(draws)
}

impl RobustnessArgs {
    /// Flies all draws, writes the page and prints the tables.
    ///
    /// # Errors
    /// A spread is given twice (exit code 64), a file or setting is invalid (78), or the directory cannot be written (71).
    pub fn execute(&self) -> Result<Exit, Failure> {
        self.check_spreads()?;
        let common = with_defaults(self.study.settings()?);
        let config = Config::from_settings(&common)?;
        say_notes(self.gains.iter().find_map(|source| source.note(&config)));
        let of = ("robustness", &config);
        let output = StudyOutput::begin(of, self.out.as_deref(), &PAGE.files(), self.existing)?;
        let FlownStudy { mut document, chapters, flown } = self.flown(&common, &output.progress)?;
        let sheets = || chapters.iter().flat_map(|chapter| &chapter.sheets);
        document["tables"] = sheets().map(Sheet::to_json).collect();
        output.add_provenance(&mut document);
        document["failures"] = records::failures(&flown);
        let document = format!("{document:#}\n");
        let page = PAGE.write(&output, &chapters, &document)?;
        if self.json {
            print(document.trim_end())?;
        } else {
            let text = text(&sheets().collect::<Vec<_>>(), &flown);
            print(&format!("{text}\n\npage, with details: {}", page.display()))?;
        }
        Ok(Exit::Ok)
    }

    /// Flies all parts of the study.
    fn flown(&self, common: &[Setting], progress: &Progress) -> Result<FlownStudy, Failure> {
        let laws = laws(&self.laws, &self.gains, common)?;
        say_notes(law::warnings(&laws));
        let loops = if self.margins { margins::all(&laws, progress)? } else { Vec::new() };
        let tests: Vec<Test> = Test::ALL
            .into_iter()
            .filter(|it| self.tests.iter().any(|name| name == it.name()))
            .collect();
        let study = MonteCarlo { laws: &laws, common, tests: &tests, progress };
        let mut flown = self.over_draws(&study)?;
        flown.document["loops"] = margins::document(&loops);
        if self.responses {
            flown.chapters.push(responses::chapter(&responses::all(&laws, progress)?));
        }
        flown.chapters.extend((!loops.is_empty()).then(|| margins::chapter(&loops)));
        Ok(flown)
    }

    /// The Monte-Carlo studies.
    fn over_draws(&self, study: &MonteCarlo<'_>) -> Result<FlownStudy, Failure> {
        let several = |spread: &PlantSpread| self.draws(spread, study.common);
        let spread = PlantSpread::named(&self.spread)?;
        say_notes(spread.note(study.common)?);
        let draws = several(&spread)?;
        let other = |name: &String| {
            let spread = PlantSpread::named(name)?;
            say_notes(spread.note(study.common)?.map(|note| format!("{name}: {note}")));
            let draws = several(&spread)?;
            Ok(OtherSpread { name: name.clone(), spread, draws })
        };
        let others: Result<Vec<OtherSpread>, Failure> =
            self.other_spreads.iter().map(other).collect();
        let others = others?;
        let wide = if self.wide { several(&spread.twice_as_wide())? } else { Vec::new() };
        let mut all = FlownStudy::default();
        all.keep(DRAWS, self.first_chapter(study, (&spread, &draws))?);
        let is_asked = |is_part: bool, is_asked: bool| is_asked || !is_part;
        for set in SETS.iter().filter(|set| {
            is_asked(set.is_wide, self.wide) && is_asked(set.is_identified, self.identified)
        }) {
            all.keep(set.key, study.chapter(set, if set.is_wide { &wide } else { &draws })?);
        }
        if !others.is_empty() {
            all.keep("other_draws", study.others(&others)?);
        }
        Ok(all)
    }

    fn draws(&self, spread: &PlantSpread, common: &[Setting]) -> Result<Vec<Draw>, Failure> {
        draw_plants(spread, common, (self.seed, 0..self.runs))
    }

    /// Draws of `--spread`, and the single plants.
    fn first_chapter(
        &self,
        study: &MonteCarlo<'_>,
        (spread, draws): (&PlantSpread, &[Draw]),
    ) -> Result<FlownDraws, Failure> {
        let (document, mut flown) = study.fly(DRAWS, draws)?;
        let mut sheets = tables::all(&flown, draws);
        sheets.push(tables::dependences(&flown, draws, spread));
        sheets.push(tables::spread(spread));
        if self.plants {
            let plants = cases::fly(study.laws, study.progress)?;
            sheets.extend(cases::tables(&plants));
            flown.extend(plants);
        }
        let intro = format!(
            "{} draws, each flown by every law as {} with the seed of the draw.",
            self.runs,
            study.tests.iter().map(|test| test.name()).collect::<Vec<_>>().join(", ")
        );
        let title = "Monte-Carlo";
        // A reader of the page has not seen the terminal.
        let notes = spread.note(study.common)?.into_iter();
        let notes = notes.chain(gains::replaced(study.laws, study.common));
        let intro = std::iter::once(intro).chain(notes.map(|note| format!("Warning: {note}.")));
        let chapter = Chapter { title, intro: intro.collect(), sheets, ..Chapter::default() };
        Ok(FlownDraws { document, chapter, flown })
    }

    /// Refuses a spread that occurs in both `--spread` and `--other-spreads`.
    fn check_spreads(&self) -> Result<(), Failure> {
        let mut named = BTreeSet::from([&self.spread]);
        match self.other_spreads.iter().find(|name| !named.insert(*name)) {
            Some(name) => {
                let reason = format!("--other-spreads: `{name}` is given twice; leave it out");
                Err(Failure::new(Exit::Usage, reason))
            }
            None => Ok(()),
        }
    }
}

/// All flown parts of the study.
#[derive(Debug, Default)]
struct FlownStudy {
    /// Draws and loops as JSON.
    document: Value,
    /// Chapters of the page.
    chapters: Vec<Chapter>,
    /// The row of every law on every set of draws.
    flown: Vec<Flown>,
}

impl FlownStudy {
    /// Adds a set of draws.
    fn keep(&mut self, key: &str, draws: FlownDraws) {
        self.document[key] = draws.document;
        self.chapters.push(draws.chapter);
        self.flown.extend(draws.flown);
    }
}

/// The tables without details, which are on the page, and the flights that failed, with the remedies from their tables.
fn text(sheets: &[&Sheet], flown: &[Flown]) -> String {
    let notes = |sheet: &Sheet| sheet.notes.iter().map(|note| wrapped(note, 2)).collect::<Vec<_>>();
    let shown = sheets.iter().filter(|sheet| !sheet.is_detail && !sheet.rows.is_empty());
    let tables = shown.map(|sheet| [&[sheet.to_text()], &notes(sheet)[..]].concat().join("\n"));
    let remedies = sheets.iter().filter(|sheet| sheet.name.ends_with(FAILURES));
    let of = match flown.iter().any(cases::is_single_plant) {
        true => "in the draws and on the single plants",
        false => "in the draws",
    };
    let failures = [format!("{of}, {}", failure::listed(flown, ""))].into_iter();
    let failures = failures.chain(remedies.flat_map(|sheet| notes(sheet)));
    tables.chain([failures.collect::<Vec<_>>().join("\n")]).collect::<Vec<_>>().join("\n\n")
}

/// Note on the laws `lacking` in `source`, unless another one of `sources` has them, beside which the sets of the program are flown
/// with the laws that they have.
fn not_flown(source: &GainSource, lacking: &[&str], sources: &[GainSource]) -> Option<String> {
    let is_set = matches!(source, GainSource::Set(_));
    let is_told = |law: &&str| !is_set || sources.iter().all(|source| !source.has(law));
    let told: Vec<&str> = lacking.iter().copied().filter(is_told).collect();
    (!told.is_empty()).then(|| format!("not flown: {}", source.lacks(&told)))
}

/// Laws with each source of gains.
///
/// # Errors
/// A source has no gains for any of the laws.
pub fn laws(
    names: &[String],
    sources: &[GainSource],
    common: &[Setting],
) -> Result<Vec<StudyLaw>, Failure> {
    let mut laws = Vec::new();
    for source in sources {
        let (own, lacking): (Vec<&str>, Vec<&str>) =
            law::named(names).partition(|law| source.has(law));
        say_notes(not_flown(source, &lacking, sources).filter(|_| !own.is_empty()));
        if own.is_empty() && matches!(source, GainSource::Set(_)) && sources.len() > 1 {
            continue;
        }
        if own.is_empty() {
            let reason = source.lacks(&law::named(names).collect::<Vec<_>>());
            return Err(Failure::new(Exit::Usage, reason));
        }
        for controller in own {
            let law = source.law(controller, common)?;
            // With several sources, the name includes the source.
            laws.push(match sources.len() {
                1 => law,
                _ => StudyLaw {
                    name: format!("{controller}, {source}"),
                    remark: String::new(),
                    ..law
                },
            });
        }
    }
    say_notes(gains::replaced(&laws, common));
    Ok(laws)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::tests::flown;

    #[test]
    fn a_law_of_which_a_source_has_no_gains_is_named() {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("pid.toml"), "").unwrap();
        let own = GainSource::Directory(directory.path().into());
        let set = GainSource::Set("shipped");
        let lacking = ["geometric", "pid"].into_iter().filter(|law| !own.has(law));
        let note = not_flown(&own, &lacking.collect::<Vec<_>>(), &[own.clone(), set.clone()]);
        let note = note.unwrap();
        assert!(
            note.starts_with("not flown: ") && note.contains("no gains of geometric;"),
            "{note}"
        );
        assert_eq!(
            not_flown(&set, &["pid"], &[own, set.clone()]),
            None,
            "flown with another source"
        );
        assert!(not_flown(&set, &["pid"], std::slice::from_ref(&set)).is_some());
    }

    #[test]
    fn failed_flights_are_below_the_tables_with_seeds_command_and_remedy() {
        let mut row = flown("pid", &[1.0, f64::INFINITY]);
        row.case = DRAWS.to_owned();
        row.law.settings.push(Setting::flag("--set", "mocap.latency-ms", 12.0));
        let table = Sheet { title: "table".to_owned(), ..Sheet::default() };
        let details = Sheet { name: FAILURES.to_owned(), is_detail: true, ..table.clone() };
        let details = details.with_note("remedy");
        let text = text(&[&table, &details], &[row.clone()]);
        let command = "seed 1; again: oqtal fly --clock in-process --controller pid --seed 1 --set mocap.latency-ms=12.0";
        for part in ["4 of 8 flights did not land as planned", "pid, draws, path: 1 of 2", command]
        {
            assert!(text.contains(part), "{part} in\n{text}");
        }
        assert!(text.ends_with("remedy"), "{text}");
        assert_eq!(records::failures(&[row.clone()])[0]["seeds"], serde_json::json!([1]));
        assert!(text.contains("in the draws, 4"), "{text}");
        row.case = crate::study::flights::NOMINAL.name.to_owned();
        let text = super::text(&[&table], &[row]);
        assert!(text.contains("in the draws and on the single plants, 4 of 8"), "{text}");
    }
}
