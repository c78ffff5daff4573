//! `oqtal campaign`: comparison of the attitude laws over many runs.

pub mod flights;
pub mod interval;
pub mod metric;
pub mod statistics;
pub mod table;

use std::fs;
use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use oqtal_config::{ClockKind, Setting};
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::say;

use crate::mission::Mission;
use crate::progress::Progress;
use crate::sheet::{Sheet, Variant};
use crate::tune::space;
use oqtal_observe::flight::Flight;
use oqtal_observe::summary::name_of;

use flights::Test;
use statistics::{EVALUATION_SEEDS, Runs};
use table::{Entrant, Flown, Scope};

/// A series of flights through processes, one after another.
pub trait FlightSeries {
    /// Flies `mission` under the name `name`.
    ///
    /// # Errors
    /// The flight could not be flown, or an operator ended the series.
    fn fly(&self, mission: &Mission, name: &str) -> Result<Flight, Failure>;
}

/// Begins a series of flights, whose results are written into a directory if one is given.
pub type BeginSeries = dyn Fn(Option<PathBuf>) -> Result<Box<dyn FlightSeries>, Failure>;

/// Arguments of `oqtal campaign`.
#[derive(Args, Debug)]
pub struct CampaignArgs {
    /// Laws to compare, with their tuned gains
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', value_parser = PossibleValuesParser::new(space::LAW_NAMES), default_values = space::LAW_NAMES)]
    controllers: Vec<String>,
    /// Runs of each law, one for each seed from 200 on
    #[arg(long, value_name = "N", default_value_t = 25, value_parser = clap::value_parser!(u64).range(1..))]
    runs: u64,
    /// Number of runs, those with the smallest position error, whose figures are averaged
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
    best: u64,
    /// Clock of the flights: in-process flies them in parallel, the others one after another through processes
    #[arg(long, value_enum, default_value = "in-process")]
    clock: ClockKind,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
    /// Directory of campaign.json and of the logs of flights through processes [default: none]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl CampaignArgs {
    /// Flies all runs and prints the comparison.
    ///
    /// # Errors
    /// The directory cannot be written, a setting in the environment is invalid, or a flight could not be flown.
    pub fn execute(&self, begin: &BeginSeries) -> Result<Exit, Failure> {
        let sheet = self.fly(begin)?;
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

    fn fly(&self, begin: &BeginSeries) -> Result<Sheet, Failure> {
        let chosen = |entrant: &Entrant| {
            entrant.variant == Variant::Ours
                && self.controllers.iter().any(|name| name == entrant.contender.controller)
        };
        let entrants: Vec<Entrant> = table::entrants().into_iter().filter(chosen).collect();
        let flown = match self.clock {
            ClockKind::InProcess => {
                let scope = Scope { runs: self.runs, raises_weights: false };
                table::fly(&entrants, &flights::NOMINAL, &scope, &Progress::default())?
            }
            ClockKind::Real | ClockKind::Lockstep => {
                self.fly_in_turn(entrants, &*begin(self.out.clone())?)?
            }
        };
        let rows = table::rows(&flown, self.best as usize);
        Ok(Sheet {
            name: "campaign".to_owned(),
            title: format!("{} runs of each law, the best {} averaged", self.runs, self.best),
            columns: table::COLUMNS.to_vec(),
            rows,
            ..Sheet::default()
        })
    }

    /// Flies through processes, one flight after another.
    fn fly_in_turn(
        &self,
        entrants: Vec<Entrant>,
        series: &dyn FlightSeries,
    ) -> Result<Vec<Flown>, Failure> {
        let total = entrants.len() as u64 * self.runs * Test::ALL.len() as u64;
        let mut number = 0;
        let mut fly_mission = |mission: &Mission| {
            number += 1;
            let kind = name_of(&mission.config.trajectory.kind);
            let law = name_of(&mission.config.control.controller);
            let seed = mission.config.clock.seed;
            say(&format!("flight {number} of {total}: {law}, {kind}, seed {seed}"));
            series.fly(mission, &format!("{law}-{kind}-{seed}"))
        };
        let fly = |mut entrant: Entrant| {
            let clock = Setting::flag("--clock", "clock.kind", self.clock.name());
            entrant.contender.settings.push(clock);
            let seeds = EVALUATION_SEEDS.start..EVALUATION_SEEDS.start + self.runs;
            let runs =
                Runs::fly_in_turn(&entrant.contender, &flights::NOMINAL, seeds, &mut fly_mission)?;
            Ok(Flown::new(entrant, runs))
        };
        entrants.into_iter().map(fly).collect()
    }
}
