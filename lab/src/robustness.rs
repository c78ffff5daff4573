//! `oqtal robustness`: every law on plants that differ from the one that it is designed for.

pub mod against;
pub mod cases;
pub mod flown;
pub mod frequency;
pub mod identified;
pub mod impulse;
pub mod linear;
pub mod margins;
pub mod monte_carlo;
pub mod others;
pub mod probed;
pub mod responses;
pub mod spread;
pub mod statistics;
pub mod summary;
pub mod tables;

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{NonEmptyStringValueParser, PossibleValuesParser};
use oqtal_config::Setting;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;
use serde_json::{Value, json};

use crate::campaign::gains::GainSource;
use crate::output::{make, write};
use crate::progress::Progress;
use crate::reproduce::chapter::Chapter;
use crate::reproduce::page::{self, PageHead};
use crate::sheet::Sheet;
use crate::study::StudyArgs;
use crate::tune::space;

use flown::{Draw, MOST_DRAWS, Rival};
use monte_carlo::{ChapterNames, MonteCarlo};
use others::OtherSpread;
use spread::PlantSpread;

/// Arguments of `oqtal robustness`.
#[derive(Args, Debug)]
pub struct RobustnessArgs {
    /// Laws to fly
    #[arg(long, visible_alias = "controllers", value_name = "A,B,C", value_delimiter = ',', value_parser = PossibleValuesParser::new(space::LAW_NAMES), default_values = space::LAW_NAMES)]
    laws: Vec<String>,
    /// Spread of the plants: `vehicle` (mass, thrust, authority, lags, delays, drag), `everything` (its surroundings too), or a
    /// file in TOML with a form of drawing for each key (docs/robustness.md)
    #[arg(long, value_name = "SPREAD", default_value = "vehicle", value_parser = NonEmptyStringValueParser::new())]
    spread: String,
    /// Further spreads, each as for --spread, with as many draws and tables of their own
    #[arg(long, value_name = "SPREADS", value_delimiter = ',', value_parser = NonEmptyStringValueParser::new())]
    other_spreads: Vec<String>,
    /// As many draws as well of the spread with every range twice as wide
    #[arg(long)]
    wide: bool,
    /// Number of draws; every law flies all of them
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=MOST_DRAWS))]
    runs: u64,
    /// Seed of the draws
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seed: u64,
    /// Gains of the laws: `configured`, `tuned`, or a directory with files LAW.toml; several are flown beside each other, a law
    /// that a directory lacks is left out
    #[arg(long, value_name = "SOURCES", value_delimiter = ',', default_value = "tuned")]
    gains: Vec<GainSource>,
    /// Every draw of --spread, and of --wide, as well with what `oqtal identify` finds of its plant from one flight in place of [vehicle]
    #[arg(long)]
    identified: bool,
    /// Some single plants as well: the nominal one, lags and delays at and beyond the edge of the spread
    #[arg(long)]
    plants: bool,
    /// Margins of the attitude loop as well, of the linear model and flown
    #[arg(long)]
    margins: bool,
    /// Responses to a step, a force and a gust as well
    #[arg(long)]
    responses: bool,
    /// Directory of robustness.html, robustness.md and robustness.json
    #[arg(long, value_name = "DIR", default_value = "robustness")]
    out: PathBuf,
    /// Print JSON instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    study: StudyArgs,
}

/// The page.
const PAGE: PageHead = PageHead {
    title: "Robustness",
    lead: "Every law flies the same draws of plants that differ from the model that all laws are designed for. The laws know \
     [vehicle], the same in all draws, and what stamps show; they do not know what is drawn, the noise of the cameras included. \
     `oqtal-dt` and the laws within its prediction adapt the model in flight, but for the gains of deploy/tuned/fixed. \
     Gains of one directory were found alike; those found over such a spread are no yardstick for those found near the model.",
    file: "robustness",
};

/// The first draws, identified.
const IDENTIFIED: ChapterNames = ChapterNames {
    title: "The same plants, identified",
    draws: "The draws from above.",
    tables: "identified",
};

/// The draws of the wider spread.
const WIDE: ChapterNames = ChapterNames {
    title: "A spread twice as wide",
    draws: "As many draws of a spread whose ranges are each twice as wide, about the same middles.",
    tables: "wide",
};

/// The draws of the wider spread, identified.
const WIDE_IDENTIFIED: ChapterNames = ChapterNames {
    title: "The plants of the wider spread, identified",
    draws: "The draws of the wider spread.",
    tables: "wide_identified",
};

impl RobustnessArgs {
    /// Flies all draws, writes the page and prints the tables.
    ///
    /// # Errors
    /// A spread is given twice (exit code 64), a file or setting is invalid (78), or the directory cannot be written (71).
    pub fn execute(&self) -> Result<Exit, Failure> {
        self.check_spreads()?;
        make(&self.out)?;
        let (mut document, chapters) = self.flown()?;
        let sheets: Vec<&Sheet> = chapters.iter().flat_map(|chapter| &chapter.sheets).collect();
        document["tables"] = sheets.iter().map(|sheet| sheet.to_json()).collect();
        let document = format!("{document:#}\n");
        let text: Vec<String> = sheets.iter().map(|sheet| sheet.to_text()).collect();
        self.keep("robustness.html", &page::html(&PAGE, &chapters))?;
        self.keep("robustness.md", &page::markdown(&PAGE, &chapters, &self.command()))?;
        self.keep("robustness.json", &document)?;
        if self.json {
            print(document.trim_end())?;
        } else {
            let page = self.out.join("robustness.html");
            print(&format!("{}\n\npage: {}", text.join("\n\n"), page.display()))?;
        }
        Ok(Exit::Ok)
    }

    /// Flies everything. Returns draws and loops as JSON, and the chapters of the page.
    fn flown(&self) -> Result<(Value, Vec<Chapter>), Failure> {
        let common = self.study.settings()?;
        let rivals = rivals(&self.laws, &self.gains, &common)?;
        let progress = Progress::default();
        let loops = if self.margins { margins::all(&rivals, &progress)? } else { Vec::new() };
        let (mut document, mut chapters) = self.over_draws(&rivals, &common, &progress)?;
        document["loops"] = margins::document(&loops);
        if self.responses {
            chapters.push(responses::chapter(&responses::all(&rivals, &progress)?));
        }
        chapters.extend((!loops.is_empty()).then(|| margins::chapter(&loops)));
        Ok((document, chapters))
    }

    /// The Monte-Carlo studies.
    fn over_draws(
        &self,
        rivals: &[Rival],
        common: &[Setting],
        progress: &Progress,
    ) -> Result<(Value, Vec<Chapter>), Failure> {
        let several =
            |spread: &PlantSpread| Draw::several(spread, common, (self.seed, 0..self.runs));
        let spread = PlantSpread::named(&self.spread)?;
        let draws = several(&spread)?;
        let others = self.others(common)?;
        let wide = self.wide.then(|| several(&spread.twice_as_wide())).transpose()?;
        let study = MonteCarlo { rivals, common, progress };
        let (flown, judged) = study.flown(&draws)?;
        let mut document = json!({ "draws": flown });
        let mut sheets = tables::all(&judged, &draws);
        sheets.push(tables::dependences(&judged, &draws, &spread));
        sheets.push(tables::spread_table(&spread));
        if self.plants {
            sheets.extend(cases::tables(rivals, progress)?);
        }
        let intro = vec![self.intro()];
        let mut chapters =
            vec![Chapter { title: "Monte-Carlo", intro, sheets, figures: Vec::new() }];
        let mut keep = |key: &str, (flown, chapter): (Value, Chapter)| {
            document[key] = flown;
            chapters.push(chapter);
        };
        if self.identified {
            keep("identified_draws", study.identified(&draws, &IDENTIFIED)?);
        }
        if let Some(draws) = wide {
            keep("wide_draws", study.chapter(&draws, &WIDE)?);
            if self.identified {
                keep("wide_identified_draws", study.identified(&draws, &WIDE_IDENTIFIED)?);
            }
        }
        if !others.is_empty() {
            keep("other_draws", others::chapter(&others, rivals, progress)?);
        }
        Ok((document, chapters))
    }

    /// Refuses a spread that `--spread` and `--other-spreads` name twice.
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

    fn others(&self, common: &[Setting]) -> Result<Vec<OtherSpread>, Failure> {
        let other = |name: &String| OtherSpread::new(name, common, (self.seed, 0..self.runs));
        self.other_spreads.iter().map(other).collect()
    }

    fn intro(&self) -> String {
        format!(
            "{} draws, each flown by every law as path, hover, chirp and doublet with the seed of the draw.",
            self.runs
        )
    }

    /// The command line of this run, as far as it decides the draws and the laws.
    fn command(&self) -> String {
        let gains: Vec<String> = self.gains.iter().map(ToString::to_string).collect();
        format!(
            "oqtal robustness --laws {} --gains {} --spread {}{} --runs {} --seed {}{}{}",
            self.laws.join(","),
            gains.join(","),
            self.spread,
            match &self.other_spreads[..] {
                [] => String::new(),
                others => format!(" --other-spreads {}", others.join(",")),
            },
            self.runs,
            self.seed,
            [
                (self.wide, " --wide"),
                (self.identified, " --identified"),
                (self.plants, " --plants"),
                (self.margins, " --margins"),
                (self.responses, " --responses"),
            ]
            .map(|(is_set, flag)| if is_set { flag } else { "" })
            .concat(),
            self.study.words()
        )
    }

    fn keep(&self, name: &str, text: &str) -> Result<(), Failure> {
        write(&self.out, name, text)
    }
}

/// The laws with each source of gains.
///
/// # Errors
/// A source has none of the laws.
pub fn rivals(
    laws: &[String],
    sources: &[GainSource],
    common: &[Setting],
) -> Result<Vec<Rival>, Failure> {
    let mut rivals = Vec::new();
    for source in sources {
        let chosen = space::LAW_NAMES.into_iter().filter(|law| laws.iter().any(|name| name == law));
        let own: Vec<&str> = chosen.filter(|law| source.has(law)).collect();
        if own.is_empty() {
            let reason = format!(
                "{source} has gains of no law of --laws; make them with `oqtal tune LAW --out {source}/LAW.toml`"
            );
            return Err(Failure::new(Exit::Usage, reason));
        }
        for controller in own {
            let (settings, remark) = source.of(controller, common)?;
            // Beside others, the source is in the name.
            let (name, remark) = match sources.len() {
                1 => (controller.to_owned(), remark),
                _ => (format!("{controller}, {source}"), String::new()),
            };
            let mut rival = Rival { name, controller, settings, remark, is_predictive: false };
            rival.is_predictive = rival.config()?.control.is_predictive();
            rivals.push(rival);
        }
    }
    Ok(rivals)
}
