//! The structure of laws, loops and testbed, Figs. 3 to 5, 15 and 16.

use super::chapter::Chapter;
use super::figures::architecture;

const INTRO: &str = "The block diagrams of the paper, with the equations that each box computes, corrected as docs/errata.md \
     says; in that of the testbed, the processes that stand for its parts.";

/// The diagrams.
#[must_use]
pub fn chapter() -> Chapter {
    Chapter {
        title: "Architecture",
        intro: vec![INTRO.to_owned()],
        figures: architecture::all(),
        ..Chapter::default()
    }
}
