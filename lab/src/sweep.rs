//! `oqtal sweep`: figures of laws over values of any keys of the configuration.

mod swept_key;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, UnknownArgumentValueParser};
use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;
use serde_json::{Value, json};

use self::swept_key::{SweptKey, combinations, shown};
use crate::csv_text;
use crate::output::{ExistingArgs, StudyOutput, write_file};
use crate::progress::Progress;
use crate::study::args::{StudyArgs, parse_seeds, refuse_key_of_study, say_notes, warnings};
use crate::study::gains::{self, GainSource};
use crate::study::law::{self, StudyLaw};
use crate::study::metric::{METRIC, METRICS};
use crate::study::table::{mean_of, set_point_note};
use crate::study::{Case, Flown, Run, Study, failure, records};
use crate::text_table;

/// Most combinations of a law whose warnings are looked for before the flights \[-\].
const MOST_TRIED: usize = 16;

/// File of the table.
const FILE: &str = "sweep.csv";

/// Arguments of `oqtal sweep`.
#[derive(Args, Debug)]
pub struct SweepArgs {
    /// Keys of the configuration with their values: KEY=FIRST:LAST:NUMBER, evenly spaced, or KEY=A,B,C; every combination is flown
    #[arg(required = true, value_name = "KEY=FIRST:LAST:NUMBER", value_parser = SweptKey::parse)]
    axes: Vec<SweptKey>,
    /// Laws to fly
    #[arg(long, visible_alias = "controllers", value_name = "A,B,C", value_delimiter = ',', value_parser = PossibleValuesParser::new(law::names()), default_values = law::names())]
    laws: Vec<String>,
    /// Gains of the laws: `configured`, `tuned`, or a directory with a file LAW.toml for each law
    #[arg(long, value_name = "SOURCE", default_value = "configured")]
    gains: GainSource,
    /// Seeds of the flights of each combination (both included)
    #[arg(long, value_name = "FIRST-LAST", value_parser = parse_seeds, default_value = "200-204")]
    seeds: Range<u64>,
    // Known to `campaign`: the error names the option of this command.
    #[arg(long, hide = true, value_parser = UnknownArgumentValueParser::suggest_arg("--seeds"))]
    _runs: Option<String>,
    /// Print one JSON document per row instead of a table
    #[arg(long)]
    json: bool,
    /// File of the table, as FILE.csv, or its directory [default: sweep.csv in results/sweep-N]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    existing: ExistingArgs,
    #[command(flatten)]
    study: StudyArgs,
}

/// A combination of values, flown by one law.
struct SweepRow {
    values: Vec<toml::Value>,
    flown: Flown,
}

impl SweepRow {
    /// Fraction of the seeds for which all flights landed \[0..1\].
    fn landed(&self) -> f64 {
        1e-2 * self.flown.percent(Run::all_landed)
    }

    /// Fraction of the seeds for which all flights landed as planned \[0..1\].
    fn as_planned(&self) -> f64 {
        1e-2 * self.flown.percent(Run::all_as_planned)
    }
}

impl SweepArgs {
    /// Flies every combination with every law and prints the figures.
    ///
    /// # Errors
    /// A key or value is invalid (exit code 78), there are too many combinations or a key is given twice (64), or the file cannot be
    /// written (71).
    pub fn execute(&self) -> Result<Exit, Failure> {
        let settings = self.study.settings()?;
        let config = Config::from_settings(&settings)?;
        let is_file = |out: &&PathBuf| !out.is_dir() && out.extension().is_some();
        let given = self.out.as_ref().filter(is_file);
        let output = match given {
            Some(file) => StudyOutput::beside(std::slice::from_ref(file), &config, self.existing)?,
            None => {
                let directory = self.out.as_deref();
                StudyOutput::begin(("sweep", &config), directory, &[FILE], self.existing)?
            }
        };
        let rows = self.fly(&settings, &output.progress)?;
        let file = given.cloned().unwrap_or_else(|| output.directory.join(FILE));
        write_file(&file, self.csv(&rows)?)?;
        output.complete()?;
        let document = |row| {
            let mut document = self.document(row);
            output.add_provenance(&mut document);
            document.to_string()
        };
        match self.json {
            true => rows.iter().try_for_each(|row| print(&document(row)))?,
            false => print(&format!("{}\ntable: {}", self.text(&rows), file.display()))?,
        }
        Ok(Exit::Ok)
    }

    /// Flies the sweep. Returns the rows grouped by combination.
    fn fly(&self, settings: &[Setting], progress: &Progress) -> Result<Vec<SweepRow>, Failure> {
        self.axes.iter().try_for_each(|axis| refuse_key_of_study(&axis.key, &axis.key))?;
        let combinations = combinations(&self.axes)?;
        let laws = gains::chosen(&self.laws, &self.gains, settings)?;
        let rate_notes = self.rate_notes(&combinations, settings);
        let law_notes =
            laws.iter().filter_map(|law| self.law_note(law, &combinations, &rate_notes));
        say_notes(rate_notes.iter().cloned().chain(law_notes));
        let case = |values: &Vec<toml::Value>| {
            let case = Case::of_seeds(self.name_of(values), self.seeds.clone());
            self.settings_of(values).into_iter().fold(case, Case::with)
        };
        let cases: Vec<Case> = combinations.iter().map(case).collect();
        let flown = Study { name: "sweep", laws: &laws, cases: &cases }.fly(progress)?;
        let row = |(index, values): (usize, &Vec<toml::Value>)| {
            let of_laws = flown[index..].iter().step_by(cases.len());
            let row = |flown: &Flown| SweepRow { values: values.clone(), flown: flown.clone() };
            of_laws.map(row).collect::<Vec<_>>()
        };
        Ok(combinations.iter().enumerate().flat_map(row).collect())
    }

    /// The settings of a combination.
    fn settings_of(&self, values: &[toml::Value]) -> Vec<Setting> {
        let pairs = self.axes.iter().zip(values);
        pairs.map(|(axis, value)| Setting::flag("sweep", &axis.key, value.clone())).collect()
    }

    /// Name of a combination: its keys with their values.
    fn name_of(&self, values: &[toml::Value]) -> String {
        let pairs = self.axes.iter().zip(values);
        let names = pairs.map(|(axis, value)| format!("{}={}", axis.key, shown(value)));
        names.collect::<Vec<_>>().join(" ")
    }

    /// The first warning of `law` that only combinations cause, other than those `told`, with the first of some combinations over the range.
    fn law_note(
        &self,
        law: &StudyLaw,
        all: &[Vec<toml::Value>],
        told: &BTreeSet<String>,
    ) -> Option<String> {
        let warnings =
            |law: &StudyLaw| law.config().map_or_else(|_| Vec::new(), |it| warnings(&it));
        let known = warnings(law);
        let is_new = |warning: &String| !known.contains(warning) && !told.contains(warning);
        let of = |values| warnings(&law.with(&self.settings_of(values))).into_iter().find(is_new);
        let tried = all.iter().step_by(all.len().div_ceil(MOST_TRIED));
        let mut warned = tried.filter_map(|values| Some((self.name_of(values), of(values)?)));
        let (name, warning) = warned.next()?;
        let others = if warned.next().is_some() { " and others" } else { "" };
        Some(format!("{} at {name}{others}: {warning}", law.name))
    }

    /// Notes on combinations in which the loop runs at a rate for which the laws are not designed, unless it does so without them.
    fn rate_notes(&self, all: &[Vec<toml::Value>], settings: &[Setting]) -> BTreeSet<String> {
        let config = |own: &[Setting]| Config::from_settings(&[settings, own].concat()).ok();
        let note = |own: &[Setting]| config(own)?.rate_warning();
        let known = note(&[]);
        let notes = all.iter().filter_map(|values| note(&self.settings_of(values)));
        notes.filter(|told| known.as_ref() != Some(told)).collect()
    }

    fn csv(&self, rows: &[SweepRow]) -> Result<String, Failure> {
        let keys = self.axes.iter().map(|axis| axis.key.as_str());
        let names = keys
            .chain(["controller", "landed", "as_planned"])
            .chain(METRIC.map(|metric| metric.key))
            .map(str::to_owned)
            .chain(METRIC.map(|metric| format!("{}_sd", metric.key)));
        let fields = |row: &SweepRow| {
            let values = row.values.iter().map(shown);
            let shares = [row.landed(), row.as_planned()].map(csv_text::number);
            let own = [row.flown.law.name.clone()].into_iter().chain(shares);
            let figures = row.flown.mean_of_landed().map(csv_text::number);
            let deviations = row.flown.deviation_of_landed().map(csv_text::number);
            values.chain(own).chain(figures).chain(deviations).collect()
        };
        csv_text::table(names, rows.iter().map(fields))
    }

    fn document(&self, row: &SweepRow) -> Value {
        let mut document = json!({
            "controller": row.flown.law.name,
            "landed": row.landed(),
            "as_planned": row.as_planned(),
        });
        for (axis, value) in self.axes.iter().zip(&row.values) {
            document[&axis.key] = json!(value);
        }
        for (metric, figure) in METRIC.iter().zip(row.flown.mean_of_landed()) {
            document[metric.key] = json!(figure);
        }
        let flown = std::slice::from_ref(&row.flown);
        document["tests"] = records::tests(flown);
        document["failures"] = records::failures(flown);
        document["flights"] = records::flights(flown);
        document
    }

    fn text(&self, rows: &[SweepRow]) -> String {
        let keys = self.axes.iter().map(|axis| axis.key.clone());
        let named: Vec<String> = keys.chain(["law".to_owned()]).collect();
        // A figure without a value in any row has no meaning for the trajectory.
        let has_value =
            |metric: &usize| rows.iter().any(|row| !row.flown.landed(*metric).is_empty());
        let metrics: Vec<usize> = (0..METRICS).filter(has_value).collect();
        let titles = metrics.iter().map(|metric| METRIC[*metric].title.to_owned());
        let shares = ["landed", "as planned"].map(str::to_owned);
        let figures: Vec<String> = shares.into_iter().chain(titles).collect();
        let lines = rows.iter().map(|row| {
            let cells = metrics.iter().map(|metric| mean_of(&row.flown.values(*metric)).show());
            let shares = [row.landed(), row.as_planned()].map(|it| format!("{:.0} %", 1e2 * it));
            let values = row.values.iter().map(shown).chain([row.flown.law.name.clone()]);
            (values.collect(), shares.into_iter().chain(cells).collect())
        });
        let table = text_table::blocks(&named, &figures, &lines.collect::<Vec<_>>());
        let flown: Vec<Flown> = rows.iter().map(|row| row.flown.clone()).collect();
        let seeds = self.seeds.clone().count();
        let idle: String = self.idle_keys(rows).iter().map(|line| format!("{line}\n")).collect();
        let failures = failure::text(&flown, &table);
        let head = format!("means over {seeds} seed{}", if seeds == 1 { "" } else { "s" });
        format!("{head} for each row\n{table}\n{idle}{failures}{}", set_point_note(&flown))
    }

    /// The keys whose values make no difference to some laws, one line each.
    fn idle_keys(&self, rows: &[SweepRow]) -> Vec<String> {
        let figures = rows.iter().map(|row| row.flown.mean_of_landed().map(csv_text::number));
        let figures: Vec<_> = figures.collect();
        let is_idle = |k: usize, law: &str| {
            let mut first = BTreeMap::new();
            let mut of_law = rows.iter().zip(&figures).filter(|(row, _)| row.flown.law.name == law);
            of_law.all(|(row, figures)| {
                let mut others: Vec<String> = row.values.iter().map(shown).collect();
                others.remove(k);
                // Without a landing there is nothing to compare.
                let has_landed = figures.iter().any(|figure| !figure.is_empty());
                has_landed && *first.entry(others).or_insert(figures) == figures
            })
        };
        let idle_key = |(k, axis): (usize, &SweptKey)| {
            let laws = self.laws.iter().map(String::as_str).filter(|law| is_idle(k, law));
            let names = laws.collect::<Vec<_>>().join(", ");
            (!names.is_empty()).then(|| format!("{} makes no difference to {names}", axis.key))
        };
        let axes = self.axes.iter().enumerate();
        axes.filter(|(_, axis)| axis.values.len() > 1).filter_map(idle_key).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(words: &[&str]) -> Result<SweepArgs, clap::Error> {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            sweep: SweepArgs,
        }
        let line = [&["sweep"], words].concat();
        <Line as clap::Parser>::try_parse_from(line).map(|line| line.sweep)
    }

    #[test]
    fn a_law_that_oscillates_with_some_of_the_values_is_named_with_the_first() {
        let sweep = parsed(&["vehicle.rate-lag-ms=50,400,500,600"]).unwrap();
        let note = |law, settings: &[Setting]| {
            let all = combinations(&sweep.axes).unwrap();
            sweep.law_note(&StudyLaw::new(law, settings.to_vec(), ""), &all, &BTreeSet::new())
        };
        let told = note("oqtal", &[]).unwrap();
        assert!(told.starts_with("oqtal at vehicle.rate-lag-ms=400 and others: "));
        let always = [Setting::flag("test", "vehicle.rate-lag-ms", 400.0)];
        assert!(note("oqtal", &always).is_none_or(|told| !told.contains("=400")), "known before");
    }

    #[test]
    fn a_key_that_makes_no_difference_is_named_with_the_laws() {
        let sweep = parsed(&["a=1,2", "b=1,2,3", "c=1", "--laws=pid,oqtal"]).unwrap();
        // `a` acts on `oqtal`, `b` on no law.
        let row = |(law, a, b): (&'static str, i64, i64)| SweepRow {
            values: [a, b, 1].map(toml::Value::from).to_vec(),
            flown: crate::study::tests::flown(law, &[if law == "oqtal" { a as f64 } else { 1.0 }]),
        };
        let all = ["pid", "oqtal"].map(|law| [1, 2].map(|a| [1, 2, 3].map(|b| (law, a, b))));
        let rows: Vec<SweepRow> = all.concat().concat().into_iter().map(row).collect();
        let lines = ["a makes no difference to pid", "b makes no difference to pid, oqtal"];
        assert_eq!(sweep.idle_keys(&rows), lines);
    }

    #[test]
    fn a_flight_that_the_fence_held_has_landed_and_not_as_planned() {
        let mut flown = crate::study::tests::flown("pid", &[1.0, 1.0]);
        flown.runs[0].ends[0].cause = Some(oqtal_observe::flight::HELD.to_owned());
        let row = SweepRow { values: Vec::new(), flown };
        assert_eq!((row.landed(), row.as_planned()), (1.0, 0.5));
        let tests = records::tests(std::slice::from_ref(&row.flown));
        assert_eq!((&tests[0]["landed"], &tests[0]["as_planned"]), (&json!(2), &json!(1)));
        assert_eq!(tests[0]["case"], records::flights(&[row.flown])[0]["case"]);
    }

    #[test]
    fn an_option_of_campaign_is_refused_with_the_option_of_a_sweep() {
        let refused = parsed(&["plant.mass-kg=1,2", "--runs", "3"]).unwrap_err().to_string();
        assert!(refused.contains("--seeds"), "{refused}");
    }
}
