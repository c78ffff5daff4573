//! `oqtal tune`: optimisation of gains on simulated flights.

pub mod bee_colony;
pub mod gains;
pub mod optimiser;
pub mod outer;
pub mod search;
pub mod shipped;
pub mod space;

use std::fs;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use oqtal_runtime::process::{Exit, Failure};

use crate::progress::Progress;

use optimiser::Optimiser;
use search::{Budget, Tuned};

/// Arguments of `oqtal tune`.
#[derive(Args, Debug)]
pub struct TuneArgs {
    /// Attitude law, tuned with the position loops around it; or `outer`, the position loops alone, one after the other
    #[arg(value_parser = PossibleValuesParser::new(space::NAMES))]
    what: String,
    /// Number of points to evaluate
    #[arg(long, value_name = "N", default_value_t = Budget::default().points)]
    budget: usize,
    /// Seed of the optimiser; the seeds of the flights are fixed
    #[arg(long, value_name = "N", default_value_t = Budget::default().seed)]
    seed: u64,
    /// Optimiser
    #[arg(long, value_enum, default_value_t)]
    optimiser: Optimiser,
    /// File of the tuned configuration
    #[arg(long, value_name = "FILE", default_value = "tuned.toml")]
    out: PathBuf,
}

impl TuneArgs {
    /// Tunes, and writes a configuration with the tuned gains.
    ///
    /// # Errors
    /// The file cannot be written, or a setting in the environment is invalid.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let budget = Budget { points: self.budget, seed: self.seed, optimiser: self.optimiser };
        let tuned = tune(&self.what, budget, &Progress::default())?;
        fs::write(&self.out, tuned.to_toml()).map_err(|error| {
            let name = self.out.display();
            Failure::new(Exit::System, format!("{name}: {error}; give another file with --out"))
        })?;
        println!("{}", tuned.headline());
        for (key, value) in &tuned.values {
            println!("  {key} = {value}");
        }
        println!("configuration: {}", self.out.display());
        Ok(Exit::Ok)
    }
}

/// Tunes a law of [`space::LAWS`], or the outer loops.
///
/// # Errors
/// A setting is invalid.
pub fn tune(what: &str, budget: Budget, progress: &Progress) -> Result<Tuned, Failure> {
    match space::LAWS.iter().find(|law| law.controller == what) {
        Some(law) => search::law(law, budget, progress),
        None => outer::tune(budget, progress),
    }
}
