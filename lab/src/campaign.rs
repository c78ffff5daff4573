//! `oqtal campaign`: comparison of the attitude laws over many runs.

pub mod table;

use std::ops::Range;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use oqtal_config::{ClockKind, Config, Setting};
use oqtal_control::trajectory::{FlightPlan, TrajectoryKind};
use oqtal_observe::flight::Flight;
use oqtal_observe::summary::name_of;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::{print, say};

use crate::mission::Mission;
use crate::output::{ExistingArgs, StudyOutput};
use crate::sheet::{Column, Sheet, SheetCell, SheetRow};
use crate::study::args::{StudyArgs, parse_seeds, say_notes};
use crate::study::flights::{Test, readable};
use crate::study::gains::{self, GainSource};
use crate::study::law::{self, StudyLaw};
use crate::study::metric::{CHIRP, DOUBLET, HOVER, JITTER, POSITION};
use crate::study::table::{mean_of, set_point_note};
use crate::study::{Case, EVALUATION_SEEDS, Flown, Study, failure, records};

/// A series of flights through processes, one after another.
pub trait FlightSeries {
    /// Flies `mission` under the name `name`.
    ///
    /// # Errors
    /// A flight could not be flown, or an operator ended the series.
    fn fly(&self, mission: &Mission, name: &str) -> Result<Flight, Failure>;
}

/// Begins a series of flights, whose results are written into the directory. The flag is whether it may replace a flight: a series that is
/// resumed, or that replaces results, may.
pub type BeginSeries = dyn Fn(PathBuf, bool) -> Result<Box<dyn FlightSeries>, Failure>;

/// Arguments of `oqtal campaign`.
#[derive(Args, Debug)]
pub struct CampaignArgs {
    /// Laws to compare
    #[arg(long, visible_alias = "controllers", value_name = "A,B,C", value_delimiter = ',', value_parser = PossibleValuesParser::new(law::names()), default_values = law::names())]
    laws: Vec<String>,
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
    /// Directory of campaign.json, campaign.csv (one row for each run) and the files of flights through processes [default:
    /// results/campaign-N]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    existing: ExistingArgs,
    #[command(flatten)]
    study: StudyArgs,
}

/// Files of the results.
const FILES: [&str; 2] = ["campaign.json", "campaign.csv"];
/// Case of every test on the configured trajectory.
const PLAIN: &str = "";
/// Case of a hover with disturbances.
const DISTURBED: &str = "gust and payload";
/// Case of the circle.
const CIRCLE: &str = "circle";
/// Time of the gust, the earlier of the two disturbances, from arming \[s\].
const GUST_S: f64 = 16.0;
/// Time of the payload, from arming \[s\].
const PAYLOAD_S: f64 = 24.0;
/// Payload over the mass of the vehicle \[-\].
const PAYLOAD: f64 = 0.1;

/// Note below the tables with the square.
const NOTE: &str = "\
On a square most of the position error of a law that settles is the way to the
corner: compare settling and overshoot there. For flights of your own begin with
`--controller oqtal-dt`; the default of `fly` is the paper's law, `oqtal`.";

impl CampaignArgs {
    /// Flies all runs and prints the comparison.
    ///
    /// # Errors
    /// The directory cannot be written, a setting is invalid, or a flight could not be flown.
    pub fn execute(&self, begin: &BeginSeries) -> Result<Exit, Failure> {
        let settings = self.study.settings()?;
        let laws = gains::chosen(&self.laws, &self.gains, &settings)?;
        let config = Config::from_settings(&settings)?;
        let cases = self.cases(&config);
        let (best, runs) = (self.best.unwrap_or(0), self.seeds().count() as u64);
        say_notes((best > runs).then(|| format!("--best {best}: all {runs} runs are averaged")));
        let of = ("campaign", &config);
        let output = StudyOutput::begin(of, self.out.as_deref(), &FILES, self.existing)?;
        let flown = self.fly(&laws, &cases, (&output, begin))?;
        let sheet = self.sheet(&flown);
        let mut document = sheet.to_json();
        output.add_provenance(&mut document);
        document["tests"] = records::tests(&flown);
        document["failures"] = records::failures(&flown);
        document["flights"] = records::flights(&flown);
        let json = format!("{document:#}\n");
        let plain = flown.iter().filter(|row| row.case == PLAIN);
        output.write(FILES[0], &json)?;
        output.write(FILES[1], records::runs_csv(plain)?)?;
        output.complete()?;
        match self.json {
            true => print(json.trim_end())?,
            false => {
                let text = self.text(sheet, &flown, &cases);
                print(&format!("{text}\nresults: {}", output.directory.display()))?;
            }
        }
        Ok(Exit::Ok)
    }

    fn seeds(&self) -> Range<u64> {
        let runs = self.runs.unwrap_or(EVALUATION_SEEDS.end - EVALUATION_SEEDS.start);
        let from_first = EVALUATION_SEEDS.start..EVALUATION_SEEDS.start + runs;
        self.seeds.clone().unwrap_or(from_first)
    }

    /// Every test on the configured trajectory; if that is the square, also a circle, and a hover with a gust and a payload unless
    /// disturbances are configured or are outside its scored time.
    fn cases(&self, config: &Config) -> Vec<Case> {
        let mut cases = vec![Case::of_seeds(PLAIN, self.seeds())];
        if config.trajectory.kind != TrajectoryKind::Square {
            return cases;
        }
        let is_disturbed = !config.plant.disturb.is_empty();
        if !is_disturbed && !scores_disturbances(config) {
            say_notes([format!(
                "the hover with gust and payload is left out: the gust begins {GUST_S} s after arming, the payload is added after {PAYLOAD_S} s, and one of them is outside the scored time; change trajectory.duration-s or trajectory.settle-s"
            )]);
        } else if !is_disturbed {
            let payload = readable(PAYLOAD * config.vehicle.mass_kg);
            let loads =
                [format!("gust@{GUST_S}+3=3,0,0m/s"), format!("mass@{PAYLOAD_S}={payload}kg")];
            let loads = Setting::flag("campaign", "plant.disturb", loads.to_vec());
            let hover = Case::of_seeds(DISTURBED, self.seeds()).flown_as(&[Test::Hover]);
            cases.push(hover.with(loads));
        }
        let circle = Setting::flag("campaign", "trajectory.kind", "circle");
        cases.push(Case::of_seeds(CIRCLE, self.seeds()).flown_as(&[Test::Path]).with(circle));
        cases
    }

    /// The table, with the failures and their remedies, for which flights are repeated.
    fn text(&self, sheet: Sheet, flown: &[Flown], cases: &[Case]) -> String {
        let is_chosen = self.best.is_some_and(|best| best < self.seeds().count() as u64);
        let hidden: &[&str] = if is_chosen {
            &["riccati_solves", "runs"]
        } else {
            &["riccati_solves", "runs", "best"]
        };
        let table = sheet.without(hidden).to_text();
        let note = if cases.len() > 1 { format!("\n{NOTE}") } else { String::new() };
        let loads = if cases.iter().any(|case| case.name == DISTURBED) { LOADS } else { "" };
        let failures = failure::text(flown, &table);
        format!("{table}\n{failures}{}{note}{loads}", set_point_note(flown))
    }

    fn sheet(&self, flown: &[Flown]) -> Sheet {
        let Range { start, end } = self.seeds();
        let runs = end - start;
        let best = self.best.filter(|best| *best < runs);
        let averaged = match best {
            Some(best) => format!(": means over the runs; mean errors over the best {best}"),
            None if runs == 1 => String::new(),
            None => ": means over the runs; mean errors ± standard deviation".to_owned(),
        };
        let best = best.unwrap_or(runs) as usize;
        let of = match runs {
            1 => format!("1 run of each law, seed {start}"),
            _ => format!("{runs} runs of each law, seeds {start} to {}", end - 1),
        };
        let plain = flown.iter().filter(|row| row.case == PLAIN);
        Sheet {
            name: "campaign".to_owned(),
            title: format!("{of}{averaged}"),
            columns: in_order(&FIRST.into_iter().chain(table::COLUMNS).collect::<Vec<_>>()),
            rows: plain.map(|row| campaign_row(flown, row, best)).collect(),
            ..Sheet::default()
        }
    }

    fn fly(
        &self,
        laws: &[StudyLaw],
        cases: &[Case],
        (output, begin): (&StudyOutput, &BeginSeries),
    ) -> Result<Vec<Flown>, Failure> {
        if self.clock == ClockKind::InProcess {
            return Study { name: "campaign", laws, cases }.fly(&output.progress);
        }
        let clock = Setting::flag("--clock", "clock.kind", self.clock.name());
        let laws: Vec<StudyLaw> =
            laws.iter().map(|law| law.with(std::slice::from_ref(&clock))).collect();
        let study = Study { name: "campaign", laws: &laws, cases };
        let series = begin(output.directory.clone(), self.existing.resume || self.existing.force)?;
        let flights = |case: &Case| case.conditions.len() * case.tests.len();
        let total = laws.len() * cases.iter().map(flights).sum::<usize>();
        let mut number = 0;
        study.fly_in_turn(&output.progress, &mut |mission: &Mission| {
            number += 1;
            let kind = name_of(&mission.config.trajectory.kind);
            let law = name_of(&mission.config.control.controller);
            let seed = mission.config.clock.seed;
            let is_disturbed = kind == "hover" && !mission.config.plant.disturb.is_empty();
            let kind = if is_disturbed { format!("disturbed-{kind}") } else { kind };
            say(&format!("flight {number} of {total}: {law}, {kind}, seed {seed}"));
            series.fly(mission, &format!("{law}-{kind}-{seed}"))
        })
    }
}

/// Whether the time in which a hover is scored contains both disturbances; also true for an invalid hover, which its flight reports.
fn scores_disturbances(config: &Config) -> bool {
    let mut hover = config.clone();
    hover.trajectory.kind = TrajectoryKind::Hover;
    let Ok(trajectory) = oqtal_daemon::trajectory(&hover) else { return true };
    let plan = FlightPlan::from_origin(&hover.trajectory, &trajectory);
    // A payload at the beginning of the landing has no effect.
    [GUST_S, PAYLOAD_S.next_up()].into_iter().all(|at_s| plan.scored(at_s))
}

/// Columns before those of Table V.
const FIRST: [Column; 3] = [
    ("disturbed_hover_max_mm", "gust, payload: max [mm]"),
    ("disturbed_hover_rms_mm", "RMS [mm]"),
    ("circle_error_m", "circle: mean [m]"),
];

/// Note on the disturbed hover, whose loads begin at [`GUST_S`] and [`PAYLOAD_S`].
const LOADS: &str = "
Gust: 3 m/s along x, from 16 s after arming for 3 s. Payload: a tenth of the
configured mass, from 24 s on.";

/// Row of a law: the disturbed hover and the circle, if they were flown, and Table V.
fn campaign_row(flown: &[Flown], plain: &Flown, best: usize) -> SheetRow {
    let law = |row: &&Flown| row.law.name == plain.law.name;
    let of = |case: &str| flown.iter().find(|row| row.case == case && law(row));
    let metric = |case: &str, metric: usize| {
        of(case).map_or(SheetCell::None, |row| mean_of(&row.values(metric)))
    };
    let first = [
        of(DISTURBED).map_or(SheetCell::None, records::greatest_hover),
        metric(DISTURBED, HOVER),
        metric(CIRCLE, POSITION),
    ];
    let row = table::row(plain, best, None);
    SheetRow { cells: in_order(&first.into_iter().chain(row.cells).collect::<Vec<_>>()), ..row }
}

/// Cells of a row, the figures that distinguish laws most first: disturbed hover, circle, chirp, doublet, hover, jitter.
fn in_order<T: Clone>(cells: &[T]) -> Vec<T> {
    let first = [0, 1, 2].into_iter().chain([CHIRP, DOUBLET, HOVER, JITTER].map(|k| k + 3));
    let first: Vec<usize> = first.collect();
    let others = (0..cells.len()).filter(|index| !first.contains(index));
    first.iter().copied().chain(others).map(|index| cells[index].clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Line {
        #[command(flatten)]
        campaign: CampaignArgs,
    }

    #[test]
    fn a_hover_that_is_not_scored_during_its_loads_is_left_out() {
        let line = <Line as clap::Parser>::parse_from(["campaign"]);
        let settle_s = Config::default().trajectory.settle_s;
        let cases = |duration_s, settle_s| {
            let mut config = Config::default();
            (config.trajectory.duration_s, config.trajectory.settle_s) = (duration_s, settle_s);
            line.campaign.cases(&config).into_iter().map(|case| case.name).collect::<Vec<_>>()
        };
        assert_eq!(cases(None, settle_s), [PLAIN, DISTURBED, CIRCLE]);
        assert_eq!(cases(Some(12.0), settle_s), [PLAIN, CIRCLE]);
        assert_eq!(cases(None, 20.0), [PLAIN, CIRCLE], "scored after the gust");
    }
}
