//! The laws on draws of one spread: as drawn, and with what is identified of each plant.

use oqtal_config::Setting;
use oqtal_runtime::process::Failure;
use serde_json::Value;

use super::flown::{self, Draw, Judged, Rival};
use super::identified::{IdentifiedDraws, identified};
use super::tables;
use crate::progress::Progress;
use crate::reproduce::chapter::Chapter;
use crate::sheet::Sheet;

/// What every Monte-Carlo study of a run shares.
#[derive(Clone, Copy, Debug)]
pub struct MonteCarlo<'a> {
    /// The laws.
    pub rivals: &'a [Rival],
    /// The settings of all laws.
    pub common: &'a [Setting],
    /// The bars on the screen.
    pub progress: &'a Progress,
}

/// How the page and the document name a chapter of draws.
#[derive(Clone, Copy, Debug)]
pub struct ChapterNames {
    /// Heading of the chapter.
    pub title: &'static str,
    /// The draws in words: what the chapter's lead begins with.
    pub draws: &'static str,
    /// First part of the names of its tables.
    pub tables: &'static str,
}

impl MonteCarlo<'_> {
    /// Flies the draws. Returns the figures of every law, and draws with figures as JSON.
    ///
    /// # Errors
    /// A setting is invalid (exit code 78).
    pub fn flown(&self, draws: &[Draw]) -> Result<(Value, Vec<Judged>), Failure> {
        let judged = flown::fly(self.rivals, draws, self.progress)?;
        Ok((flown::document(&judged, draws), judged))
    }

    /// Flies the draws. Returns draws with figures as JSON, and their chapter.
    ///
    /// # Errors
    /// A setting is invalid (exit code 78).
    pub fn chapter(
        &self,
        draws: &[Draw],
        names: &ChapterNames,
    ) -> Result<(Value, Chapter), Failure> {
        let (document, judged) = self.flown(draws)?;
        let intro = format!("{} Gains are those from above.", names.draws);
        Ok((document, chapter(names, intro, tables::all(&judged, draws))))
    }

    /// Identifies every plant, and flies the draws with laws that know it so. Returns draws with figures as JSON, and their chapter.
    ///
    /// # Errors
    /// A setting is invalid (exit code 78).
    pub fn identified(
        &self,
        draws: &[Draw],
        names: &ChapterNames,
    ) -> Result<(Value, Chapter), Failure> {
        let IdentifiedDraws { draws, unidentified } =
            identified(draws, self.common, self.progress)?;
        let (document, judged) = self.flown(&draws)?;
        let intro = format!(
            "{} Each plant was first flown and identified as by `oqtal identify --fly --mass`, with its own mass and the law of the \
             configuration; [vehicle] of all laws is what that flight showed. Not identified: {unidentified} of {}, which are flown \
             with the [vehicle] from above. Gains are those from above too.",
            names.draws,
            draws.len()
        );
        Ok((document, chapter(names, intro, tables::all(&judged, &draws))))
    }
}

fn chapter(names: &ChapterNames, intro: String, sheets: Vec<Sheet>) -> Chapter {
    Chapter {
        title: names.title,
        intro: vec![intro],
        sheets: tables::named(names.tables, sheets),
        figures: Vec::new(),
    }
}
