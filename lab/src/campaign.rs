//! `oqtal campaign`: comparison of the attitude laws over many runs.

pub mod table;

use std::ops::Range;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use oqtal_config::{ClockKind, Setting};
use oqtal_observe::flight::Flight;
use oqtal_observe::summary::name_of;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{print, say};

use crate::csv_text;
use crate::mission::Mission;
use crate::output::{make, write};
use crate::progress::Progress;
use crate::sheet::Sheet;
use crate::study::args::{StudyArgs, parse_seeds};
use crate::study::flights::Test;
use crate::study::gains::{self, GainSource};
use crate::study::law::{self, StudyLaw};
use crate::study::metric::METRIC;
use crate::study::{Case, EVALUATION_SEEDS, Flown, Run, Study};

/// A series of flights through processes, one after another.
pub trait FlightSeries {
    /// Flies `mission` under the name `name`.
    ///
    /// # Errors
    /// A flight could not be flown, or an operator ended the series.
    fn fly(&self, mission: &Mission, name: &str) -> Result<Flight, Failure>;
}

/// Begins a series of flights; writes their results into the directory if one is given.
pub type BeginSeries = dyn Fn(Option<PathBuf>) -> Result<Box<dyn FlightSeries>, Failure>;

/// Arguments of `oqtal campaign`.
#[derive(Args, Debug)]
pub struct CampaignArgs {
    /// Laws to compare
    #[arg(long, visible_alias = "laws", value_name = "A,B,C", value_delimiter = ',', value_parser = PossibleValuesParser::new(law::names()), default_values = law::names())]
    controllers: Vec<String>,
    /// Gains of the laws: `configured`, those of `oqtal fly`; `tuned`, deploy/tuned, found for the shipped vehicle; or a directory
    /// with a file LAW.toml for each law, as written by `oqtal tune`
    #[arg(long, value_name = "SOURCE", default_value = "configured")]
    gains: GainSource,
    /// Runs of each law, one for each seed from 200 on [default: 25]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    runs: Option<u64>,
    /// Seeds of the runs in place of --runs, as in 300-330 (both included)
    #[arg(long, value_name = "FIRST-LAST", value_parser = parse_seeds, conflicts_with = "runs")]
    seeds: Option<Range<u64>>,
    /// Average only the N runs with the smallest position error, as the paper does [default: all runs]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    best: Option<u64>,
    /// Clock of the flights: in-process flies them in parallel, the others one after another through processes
    #[arg(long, value_enum, default_value = "in-process")]
    clock: ClockKind,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Directory of campaign.json, campaign.csv (one row for each run) and the files of flights through processes [default: none]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    study: StudyArgs,
}

impl CampaignArgs {
    /// Flies all runs and prints the comparison.
    ///
    /// # Errors
    /// The directory cannot be written, a setting is invalid, or a flight could not be flown.
    pub fn execute(&self, begin: &BeginSeries) -> Result<Exit, Failure> {
        if let Some(directory) = &self.out {
            make(directory)?;
        }
        let flown = self.fly(begin)?;
        let sheet = self.sheet(&flown);
        let (json, text) = (format!("{:#}\n", sheet.to_json()), sheet.to_text());
        if let Some(directory) = &self.out {
            let runs = runs_csv(&flown, self.seeds())?;
            write(directory, "campaign.json", &json)?;
            write(directory, "campaign.csv", &runs)?;
        }
        print(if self.json { json.trim_end() } else { &text })?;
        Ok(Exit::Ok)
    }

    fn seeds(&self) -> Range<u64> {
        let runs = self.runs.unwrap_or(EVALUATION_SEEDS.end - EVALUATION_SEEDS.start);
        let from_first = EVALUATION_SEEDS.start..EVALUATION_SEEDS.start + runs;
        self.seeds.clone().unwrap_or(from_first)
    }

    fn sheet(&self, flown: &[Flown]) -> Sheet {
        let Range { start, end } = self.seeds();
        let runs = end - start;
        let best = self.best.filter(|best| *best < runs);
        let averaged = match best {
            Some(best) => format!("position, velocity and attitude over the best {best}"),
            None => "means ± standard deviations over all".to_owned(),
        };
        let best = best.unwrap_or(runs) as usize;
        Sheet {
            name: "campaign".to_owned(),
            title: format!("{runs} runs of each law, seeds {start} to {}: {averaged}", end - 1),
            columns: table::COLUMNS.to_vec(),
            rows: flown.iter().map(|flown| table::row(flown, best, None)).collect(),
            ..Sheet::default()
        }
    }

    fn fly(&self, begin: &BeginSeries) -> Result<Vec<Flown>, Failure> {
        let laws = gains::chosen(&self.controllers, &self.gains, &self.study.settings()?)?;
        let cases = [Case::of_seeds("campaign", self.seeds())];
        match self.clock {
            ClockKind::InProcess => {
                let study = Study { name: "campaign", laws: &laws, cases: &cases };
                study.fly(&Progress::default())
            }
            ClockKind::Real | ClockKind::Lockstep => {
                let clock = Setting::flag("--clock", "clock.kind", self.clock.name());
                let laws: Vec<StudyLaw> =
                    laws.iter().map(|law| law.with(std::slice::from_ref(&clock))).collect();
                let study = Study { name: "campaign", laws: &laws, cases: &cases };
                self.fly_in_turn(&study, &*begin(self.out.clone())?)
            }
        }
    }

    /// Flies through processes, one flight after another.
    fn fly_in_turn(
        &self,
        study: &Study<'_>,
        series: &dyn FlightSeries,
    ) -> Result<Vec<Flown>, Failure> {
        let seeds = self.seeds();
        let total = study.laws.len() as u64 * (seeds.end - seeds.start) * Test::ALL.len() as u64;
        let mut number = 0;
        study.fly_in_turn(&mut |mission: &Mission| {
            number += 1;
            let kind = name_of(&mission.config.trajectory.kind);
            let law = name_of(&mission.config.control.controller);
            let seed = mission.config.clock.seed;
            say(&format!("flight {number} of {total}: {law}, {kind}, seed {seed}"));
            series.fly(mission, &format!("{law}-{kind}-{seed}"))
        })
    }
}

/// Formats every run as a row: law, seed, and the metrics by name; empty for a flight that did not land.
fn runs_csv(flown: &[Flown], seeds: Range<u64>) -> Result<String, Failure> {
    let names = ["controller", "seed"].into_iter().chain(METRIC.map(|metric| metric.key));
    let row = |(law, seed, run): (&Flown, u64, &Run)| {
        let named = [law.law.controller.to_owned(), seed.to_string()];
        named.into_iter().chain(run.figures.map(csv_text::number)).collect()
    };
    let runs = flown
        .iter()
        .flat_map(|law| seeds.clone().zip(&law.runs).map(move |(seed, run)| (law, seed, run)));
    csv_text::table(names, runs.map(row))
}
