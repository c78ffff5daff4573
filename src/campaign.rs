//! `oqtal campaign`: many runs of every law, and what they come to.

pub mod flights;
pub mod metric;
pub mod statistics;
pub mod table;

use std::fs;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use oqtal_bus::process::{Exit, Failure};

use crate::reproduce::progress::Progress;
use crate::reproduce::sheet::{Sheet, Variant};
use crate::tune::space;

use table::{Entrant, Scope};

/// Which laws fly, and how often.
#[derive(Args, Debug)]
pub struct CampaignArgs {
    /// Laws to compare, with their tuned gains
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', value_parser = PossibleValuesParser::new(space::LAW_NAMES), default_values = space::LAW_NAMES)]
    controllers: Vec<String>,
    /// Runs of each law, one for each seed from 200 on
    #[arg(long, value_name = "N", default_value_t = 25, value_parser = clap::value_parser!(u64).range(1..))]
    runs: u64,
    /// Of them, how many with the least position error are averaged
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
    best: u64,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Where campaign.json is written, if anywhere
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl CampaignArgs {
    /// Flies all runs in one process, in parallel.
    ///
    /// # Errors
    /// The directory cannot be written, or a setting in the environment has no meaning.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let sheet = self.fly()?;
        let json = format!("{:#}\n", sheet.to_json());
        if let Some(directory) = &self.out {
            let file = directory.join("campaign.json");
            fs::create_dir_all(directory).and_then(|()| fs::write(&file, &json)).map_err(|e| {
                let name = file.display();
                Failure::new(Exit::System, format!("{name}: {e}; give another --out"))
            })?;
        }
        if self.json {
            print!("{json}")
        } else {
            println!("{}", sheet.to_text())
        }
        Ok(Exit::Ok)
    }

    fn fly(&self) -> Result<Sheet, Failure> {
        let chosen = |entrant: &Entrant| {
            entrant.variant == Variant::Ours
                && self.controllers.iter().any(|name| name == entrant.contender.controller)
        };
        let entrants: Vec<Entrant> = table::entrants().into_iter().filter(chosen).collect();
        let scope = Scope { runs: self.runs, best: self.best as usize, raises_weights: false };
        let rows = table::rows(&entrants, &flights::NOMINAL, &scope, &Progress::default())?;
        Ok(Sheet {
            name: "campaign".to_owned(),
            title: format!("{} runs of each law, the best {} averaged", self.runs, self.best),
            columns: table::COLUMNS.to_vec(),
            rows,
            ..Sheet::default()
        })
    }
}
