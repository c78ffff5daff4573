//! `oqtal tune`: optimisation of gains on simulated flights.

pub mod bee_colony;
mod cma_es;
pub mod live;
mod objective;
pub mod online;
pub mod optimiser;
pub mod outer;
pub mod page;
mod quasi_newton;
pub mod search;
pub mod space;
pub mod trade;
mod training;
pub mod tuned;

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::Args;
use clap::builder::PossibleValuesParser;
use oqtal_bus::paths::quoted;
use oqtal_config::{Config, Setting};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;

use crate::output::{ExistingArgs, StudyOutput, check_file, write_file};
use crate::progress::Progress;
use crate::robustness::draws::{Draw, TUNING_SEED};
use crate::robustness::spread::PlantSpread;
use crate::study::TRAINING_SEEDS;
use crate::study::args::{StudyArgs, is_of_file, parse_seeds, say_notes};
use crate::study::law::{self, StudyLaw};

use optimiser::Optimiser;
use search::{Budget, TrainingFlights, Tuned};
use trade::MetricWeights;

/// Arguments of `oqtal tune`.
#[derive(Args, Debug)]
pub struct TuneArgs {
    /// Attitude laws, each tuned with the position loops around it; `all`, every law; or `outer`, the position loops alone, one
    /// after the other
    #[arg(required_unless_present = "live", id = "what", value_name = "WHAT", value_parser = PossibleValuesParser::new(space::names()))]
    targets: Vec<String>,
    /// Greatest number of points to evaluate for each law: the first, and whole generations of the search
    #[arg(long, value_name = "N", default_value_t = Budget::default().points, value_parser = parse_points)]
    budget: usize,
    /// Seed of the optimiser; `quasi-newton` has no use for one
    #[arg(long, value_name = "N", default_value_t = Budget::default().seed)]
    seed: u64,
    /// Seeds of the flights (both included)
    #[arg(long, value_name = "FIRST-LAST", value_parser = parse_seeds, default_value = "101-106")]
    seeds: Range<u64>,
    /// Evaluate gains on draws of a spread, one for each of --seeds, in place of six plants near the configured one: `vehicle`,
    /// `everything` or a file (docs/robustness.md)
    #[arg(long, value_name = "SPREAD")]
    spread: Option<String>,
    /// Optimiser [default: cma-es; with --live, quasi-newton]
    #[arg(long, value_enum)]
    optimiser: Option<Optimiser>,
    /// Weights of the components of the objective; those not given keep their defaults, which the table at the end shows
    #[arg(long, value_name = "KEY=W,...", value_delimiter = ',')]
    weights: Vec<String>,
    /// File NAME.toml of the tuned configuration of one law, or a directory of files LAW.toml; with --live, a directory
    /// [default: results/tune-N]
    #[arg(long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    existing: ExistingArgs,
    #[command(flatten)]
    study: StudyArgs,
    /// Arguments of a search for a vehicle in flight.
    #[command(flatten)]
    pub live: LiveArgs,
}

/// Least disk margin in hover with which gains are applied \[-\]: less than that of any gains in deploy/tuned, and enough for a change
/// of gain by 16 %, or a lag of 8 deg.
const LEAST_DISK_MARGIN: f64 = 0.15;

/// Arguments of `oqtal tune --live`.
#[derive(Args, Debug)]
pub struct LiveArgs {
    /// Tune the active law for the vehicle that hovers under a running daemon; the vehicle first flies an excitation of 20 s from
    /// where it is
    #[arg(long, conflicts_with_all = ["what", "seeds", "spread", "config", "set", "trajectory", "plant", "resume", "force"])]
    pub live: bool,
    /// With --live: change the gains in flight, and compare the hover before and after
    #[arg(long, requires = "live")]
    pub apply: bool,
    /// With --apply: disk margin in hover below which gains are not applied, unless the present ones have even less
    #[arg(long = "least-disk-margin", value_name = "ALPHA", requires = "apply", default_value_t = LEAST_DISK_MARGIN, value_parser = parse_margin)]
    pub least_margin_ratio: f64,
    /// With --live: name of the instance
    #[arg(long, value_name = "NAME", requires = "live")]
    pub instance: Option<String>,
    /// With --live: directory of the instance's files
    #[arg(long, value_name = "DIR", requires = "live")]
    pub root: Option<PathBuf>,
}

impl TuneArgs {
    /// Tunes, and writes a configuration with the tuned gains for each law.
    ///
    /// # Errors
    /// A file cannot be written, or a setting is invalid.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let names = self.names();
        let mut flights = self.flights()?;
        flights.weights = self.weights()?;
        flights.options = self.options();
        let given = self.out.as_ref().filter(|out| out.extension().is_some_and(|e| e == "toml"));
        if let Some(file) = given.filter(|_| names.len() > 1) {
            let reason = format!(
                "--out: {} is the file of one law, and {} are tuned; give a directory",
                file.display(),
                names.len()
            );
            return Err(Failure::new(Exit::Usage, reason));
        }
        let config = Config::from_settings(&flights.settings)?;
        // The files of one law are named after it, so that several `oqtal tune LAW` can share a directory.
        let own = self.out.as_ref().filter(|_| names.len() == 1);
        let own = own.map(|directory| directory.join(format!("{}.toml", names[0])));
        let output = match given.or(own.as_ref()) {
            Some(file) => StudyOutput::beside(&with_page(file), &config, self.existing)?,
            None => {
                let files = names.iter().map(|name| PathBuf::from(format!("{name}.toml")));
                let files: Vec<PathBuf> = files.flat_map(|file| with_page(&file)).collect();
                StudyOutput::begin(("tune", &config), self.out.as_deref(), &files, self.existing)?
            }
        };
        self.tune_each(&names, given, (&flights, &output))
    }

    /// Tunes the laws `names`, each into the file `given` or one of its own. A search that finds nothing does not prevent the other
    /// searches.
    fn tune_each(
        &self,
        names: &[&str],
        given: Option<&PathBuf>,
        (flights, output): (&TrainingFlights, &StudyOutput),
    ) -> Result<Exit, Failure> {
        let mut failed: Vec<(&str, Failure)> = Vec::new();
        for name in names {
            let own = output.directory.join(format!("{name}.toml"));
            let file = given.cloned().unwrap_or(own);
            match self.tune_into(&file, name, (flights, output)) {
                Err(failure) if failure.exit == Exit::Flight && output.progress.check().is_ok() => {
                    say_notes((names.len() > 1).then(|| failure.message.clone()));
                    failed.push((name, failure));
                }
                result => result?,
            }
        }
        if failed.len() < names.len() {
            output.complete()?;
        } else {
            // A repeated search would find nothing again.
            output.discard()?;
        }
        conclude(failed, names.len())
    }

    /// Tunes the law `name`, and writes its configuration into `file` and the page beside it.
    fn tune_into(
        &self,
        file: &Path,
        name: &str,
        (flights, output): (&TrainingFlights, &StudyOutput),
    ) -> Result<(), Failure> {
        check_file(file)?;
        let tuned = tune(name, &self.budget(), flights, &output.progress)?;
        let fly = self.flown_with(file, &flights.settings, &tuned);
        let note = fly.as_ref().map(|fly| format!("for a flight with the same settings: {fly}"));
        write_file(file, tuned.to_toml(&flights.settings, &note.unwrap_or_default()))?;
        let [_, page] = with_page(file);
        write_file(&page, page::html(&tuned))?;
        let (page, file) = (page.display(), file.display());
        let fly = fly.map_or(String::new(), |fly| format!("\nfly with them: {fly}"));
        print(&format!("{tuned}page: {page}\ngains: {file}{fly}"))
    }

    fn flights(&self) -> Result<TrainingFlights, Failure> {
        let settings = self.study.settings()?;
        let laws = self.names().into_iter().filter(|name| *name != "outer");
        let laws = laws.map(|name| StudyLaw::new(name, settings.clone(), ""));
        say_notes(law::warnings(&laws.collect::<Vec<_>>()));
        training(settings, self.seeds.clone(), self.spread.as_deref())
    }

    /// Arguments that select flights and weights, where they are not the default ones, each preceded by a space.
    pub fn options(&self) -> String {
        let flights = Some(options_of(&self.seeds, self.spread.as_deref()));
        let weights = Some(self.weights.join(",")).filter(|weights| !weights.is_empty());
        let weights = weights.map(|weights| format!(" --weights {}", quoted(&weights)));
        let study = (!self.live.live).then(|| self.study.words());
        [flights, weights, study].into_iter().flatten().collect()
    }

    /// Weights of the objective.
    ///
    /// # Errors
    /// A weight is invalid (exit code 64).
    pub fn weights(&self) -> Result<MetricWeights, Failure> {
        trade::parse_weights(&self.weights)
            .map_err(|reason| Failure::new(Exit::Usage, format!("--weights: {reason}")))
    }

    /// Budget of the search.
    pub fn budget(&self) -> Budget {
        let default = if self.live.live { live::OPTIMISER } else { Optimiser::default() };
        let optimiser = self.optimiser.unwrap_or(default);
        Budget { points: self.budget, seed: self.seed, optimiser }
    }

    /// Laws to be tuned, without duplicates, and `outer`.
    fn names(&self) -> Vec<&'static str> {
        let is_asked = |name: &&str| self.targets.iter().any(|target| target == name);
        let all = is_asked(&"all");
        let laws = law::names().filter(|name| all || is_asked(name));
        laws.chain(["outer"].into_iter().filter(is_asked)).collect()
    }

    /// Command that flies with the settings of the search and the gains of `file`; `None` without settings.
    fn flown_with(&self, file: &Path, settings: &[Setting], tuned: &Tuned) -> Option<String> {
        let words = Some(self.study.words()).filter(|words| !words.is_empty())?;
        let gains = quoted(&file.display().to_string());
        // A flag has precedence over the file of the gains.
        let is_flag = |key: &str| settings.iter().any(|it| it.key == key && !is_of_file(it));
        let flags = tuned.values.iter().filter(|(key, _)| is_flag(key));
        let flags: String = flags.map(|(key, value)| format!(" --set {key}={value}")).collect();
        Some(format!("oqtal fly{words} --config {gains}{flags}"))
    }
}

/// Flights with these settings and seeds: on plants near the configured one, or on draws of the spread `spread`.
///
/// # Errors
/// The spread or a setting is invalid.
pub fn training(
    settings: Vec<Setting>,
    seeds: Range<u64>,
    spread: Option<&str>,
) -> Result<TrainingFlights, Failure> {
    let Some(spread) = spread else { return Ok(TrainingFlights::near(settings, seeds)) };
    let spread = PlantSpread::named(spread)?;
    say_notes(spread.note(&settings)?);
    let draws = Draw::several(&spread, &settings, (TUNING_SEED, seeds))?;
    Ok(TrainingFlights::over(settings, &draws))
}

/// Arguments that select seeds and spread, where they are not the default ones, each preceded by a space.
pub fn options_of(seeds: &Range<u64>, spread: Option<&str>) -> String {
    let Range { start, end } = seeds;
    let seeds = (*seeds != TRAINING_SEEDS).then(|| format!(" --seeds {start}-{}", end - 1));
    let spread = spread.map(|spread| format!(" --spread {}", quoted(spread)));
    [seeds, spread].into_iter().flatten().collect()
}

/// Result of a command with these failed searches, of `all`.
fn conclude(mut failed: Vec<(&str, Failure)>, all: usize) -> Result<Exit, Failure> {
    match failed.len() {
        0 => Ok(Exit::Ok),
        1 if all == 1 => Err(failed.remove(0).1),
        count => {
            let names: Vec<&str> = failed.iter().map(|(name, _)| *name).collect();
            let reason = format!(
                "tune: {count} of {all} searches found no gains, for the reasons above: {}",
                names.join(", ")
            );
            Err(Failure::new(Exit::Flight, reason))
        }
    }
}

fn parse_points(text: &str) -> Result<usize, String> {
    let points: usize = text.parse().map_err(|_| "not a number".to_owned())?;
    if (1..=1_000_000).contains(&points) { Ok(points) } else { Err("not from 1 to 1000000".into()) }
}

fn parse_margin(text: &str) -> Result<f64, String> {
    let margin = text.parse().ok().filter(|margin| (0.0..=2.0).contains(margin));
    margin.ok_or_else(|| "not from 0 to 2".to_owned())
}

/// The file of tuned gains, and its page beside it.
fn with_page(file: &Path) -> [PathBuf; 2] {
    [file.to_owned(), file.with_extension("html")]
}

/// Tunes a law, or the outer loops, on `flights`.
///
/// # Errors
/// A setting is invalid.
pub fn tune(
    target: &str,
    budget: &Budget,
    flights: &TrainingFlights,
    progress: &Progress,
) -> Result<Tuned, Failure> {
    match law::of_name(target) {
        Some(law) => search::law(law, budget, flights, progress),
        None if flights.weights != trade::default_weights() => Err(Failure::new(
            Exit::Usage,
            "the objectives of the outer loops have no weights; leave out --weights, or tune a law",
        )),
        None if flights.draws == 0 => outer::tune(budget, flights, progress),
        None => Err(Failure::new(
            Exit::Usage,
            "the outer loops are tuned one at a time on the configured plant; leave out --spread",
        )),
    }
}
