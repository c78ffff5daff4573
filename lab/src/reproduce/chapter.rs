//! A chapter of the reproduction: the result of one experiment, and the context shared by all experiments.

use maud::Markup;
use oqtal_control::options::OptionError;
use oqtal_runtime::process::{Exit, Failure};

use crate::output::StudyOutput;
use crate::sheet::Sheet;

use super::lander::Lander;

/// The result of one experiment: a chapter of the page.
#[derive(Clone, Debug, Default)]
pub struct Chapter {
    /// Heading.
    pub title: &'static str,
    /// Introduction, one item per paragraph.
    pub intro: Vec<String>,
    /// Tables.
    pub sheets: Vec<Sheet>,
    /// Figures: drawings with their captions.
    pub figures: Vec<Markup>,
}

/// Context shared by the experiments of one run.
#[derive(Debug)]
pub struct ExperimentContext {
    /// The spacecraft.
    pub lander: Lander,
    /// Whether gains are tuned again.
    pub retune: bool,
    /// Directory of the results, and progress.
    pub output: StudyOutput,
}

/// Failure for an invalid option of an experiment. The options are constants, so it is a fault of the program.
pub fn invalid(error: OptionError) -> Failure {
    Failure::new(Exit::Internal, error.to_string())
}
