//! `oqtal reproduce`: the experiments of the paper, compared with its printed figures and with this project's own laws.
//!
//! Each experiment has a file with its settings, runs and rows. Shared code makes the tables ([`crate::sheet`]) and figures
//! ([`figures`]).

pub mod architecture;
pub mod body;
pub mod chapter;
pub mod claims;
pub mod comparison;
pub mod expression;
pub mod figures;
pub mod lander;
pub mod online;
pub mod options;
pub mod page;
pub mod recovery;
pub mod roster;
pub mod step;
pub mod sweep;
pub mod table_3;
pub mod table_4;
pub mod table_5;
pub mod text;

use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use oqtal_config::Config;
use oqtal_observe::explain::wrapped;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::program::print;
use serde_json::{Value, json};

use crate::output::{ExistingArgs, StudyOutput};
use crate::sheet::Sheet;

use chapter::{Chapter, ExperimentContext};
use claims::{Claim, claims};
use lander::Lander;
use page::PAPER;

/// One experiment: its name, its figures, and the function that runs it.
struct Experiment {
    name: &'static str,
    figures: &'static [&'static str],
    run: fn(&ExperimentContext) -> Result<Chapter, Failure>,
}

/// The experiments, in the order of the page.
const EXPERIMENTS: [Experiment; 9] = [
    Experiment {
        name: "architecture",
        figures: &["figure-3", "figure-4", "figure-5", "figure-15", "figure-16"],
        run: |_| Ok(architecture::chapter()),
    },
    Experiment {
        name: "table-4",
        figures: &["figure-10", "figure-11", "figure-12", "figure-13", "figure-14"],
        run: |context| table_4::chapter(&context.lander, &context.output.progress),
    },
    Experiment {
        name: "table-3",
        figures: &[],
        run: |context| table_3::chapter(&context.lander, &context.output.progress),
    },
    Experiment {
        name: "sweep",
        figures: &["figure-6", "figure-7", "figure-8", "figure-9"],
        run: |context| sweep::chapter(&context.lander, &context.output.progress),
    },
    Experiment {
        name: "step",
        figures: &[],
        run: |context| step::chapter(&context.lander, &context.output.progress),
    },
    Experiment {
        name: "table-5",
        figures: &["figure-17", "figure-18", "figure-19", "figure-20", "figure-21", "figure-22"],
        run: table_5::chapter,
    },
    Experiment {
        name: "outer-in-flight",
        figures: &[],
        run: |context| online::chapter(&context.output.progress),
    },
    Experiment {
        name: "options",
        figures: &[],
        run: |context| options::chapter(&context.lander, &context.output.progress),
    },
    Experiment {
        name: "recovery",
        figures: &[],
        run: |context| recovery::chapter(&context.lander, &context.output.progress),
    },
];

/// Name that selects all experiments.
const ALL: &str = "all";

/// Arguments of `oqtal reproduce`.
#[derive(Args, Debug)]
pub struct ReproduceArgs {
    /// Tables, experiments and figures to reproduce
    #[arg(value_parser = PossibleValuesParser::new(targets()), default_value = ALL)]
    what: Vec<String>,
    /// Tune the gains of Table V again instead of using the shipped ones; takes minutes for each law
    #[arg(long)]
    retune: bool,
    /// Directory of reproduction.html, reproduction.md and reproduction.json [default: results/reproduce-N]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    existing: ExistingArgs,
    /// Print all rows as JSON instead of tables
    #[arg(long)]
    json: bool,
}

fn targets() -> Vec<&'static str> {
    let of = |experiment: &'static Experiment| {
        std::iter::once(experiment.name).chain(experiment.figures.iter().copied())
    };
    std::iter::once(ALL).chain(EXPERIMENTS.iter().flat_map(of)).collect()
}

impl ReproduceArgs {
    /// Runs the experiments, writes the page and prints the tables.
    ///
    /// # Errors
    /// The directory cannot be written, or a setting in the environment is invalid.
    pub fn execute(&self) -> Result<Exit, Failure> {
        // Each experiment sets what the paper names, over the built-in values.
        let of = ("reproduce", &Config::default());
        let output = StudyOutput::begin(of, self.out.as_deref(), &PAPER.files(), self.existing)?;
        let (lander, retune) = (Lander::new()?, self.retune);
        let context = ExperimentContext { lander, retune, output };
        let selected = EXPERIMENTS.iter().filter(|experiment| self.selects(experiment));
        let chapters: Result<Vec<Chapter>, Failure> =
            selected.map(|experiment| (experiment.run)(&context)).collect();
        let chapters = chapters?;
        let mut json = to_json(&chapters);
        context.output.add_provenance(&mut json);
        let json = format!("{json:#}\n");
        let page = PAPER.write(&context.output, &chapters, &json)?;
        if self.json {
            print(json.trim_end())?;
        } else {
            for sheet in chapters.iter().flat_map(|chapter| &chapter.sheets) {
                print(&format!("{}\n", sheet.to_text()))?;
            }
            for Claim { claim, verdict, found, .. } in claims(&chapters) {
                print(&wrapped(&format!("{}: {claim}: {found}.", verdict.shown()), 2))?;
            }
            print(&format!("\npage: {}", page.display()))?;
        }
        Ok(Exit::Ok)
    }

    fn selects(&self, experiment: &Experiment) -> bool {
        let named = |name: &&String| {
            [ALL, experiment.name].contains(&name.as_str())
                || experiment.figures.contains(&name.as_str())
        };
        self.what.iter().any(|name| named(&name))
    }
}

/// One table as a JSON object, several as a list.
fn to_json(chapters: &[Chapter]) -> Value {
    let mut sheets: Vec<Value> =
        chapters.iter().flat_map(|chapter| &chapter.sheets).map(Sheet::to_json).collect();
    // The paper's table of a chapter comes first, followed by further tables.
    match chapters {
        [_] if !sheets.is_empty() => {
            let mut first = sheets.remove(0);
            if !sheets.is_empty() {
                first["tables"] = json!(sheets);
            }
            first
        }
        _ => json!({ "tables": sheets }),
    }
}
