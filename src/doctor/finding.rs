//! The result of a check.

use oqtal_runtime::process::Exit;
use serde::Serialize;

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// No improvement is possible or needed.
    Ok,
    /// Flights are possible, but with more latency or jitter than necessary.
    Advice,
    /// No flight is possible.
    Problem,
}

impl Level {
    /// Name of the level.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Advice => "advice",
            Self::Problem => "PROBLEM",
        }
    }
}

/// The result of a check: fact, reason and remedy.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// Name of the check.
    pub name: &'static str,
    /// Severity.
    pub level: Level,
    /// Fact found.
    pub found: String,
    /// Reason why it matters.
    pub why: &'static str,
    /// Command that improves it; `None` if none is needed or none exists.
    pub remedy: Option<String>,
    /// Exit code of `oqtal doctor` if this is a problem.
    #[serde(skip)]
    pub exit: Exit,
}

impl Finding {
    /// A finding of level [`Level::Ok`].
    pub fn ok(name: &'static str, why: &'static str, found: impl Into<String>) -> Self {
        Self { name, level: Level::Ok, found: found.into(), why, remedy: None, exit: Exit::System }
    }

    /// The finding as advice with a remedy.
    pub fn advise(self, remedy: impl Into<String>) -> Self {
        Self { level: Level::Advice, remedy: Some(remedy.into()), ..self }
    }

    /// The finding as advice without a remedy.
    pub fn note(self) -> Self {
        Self { level: Level::Advice, ..self }
    }

    /// The finding as a problem that prevents a flight, with a remedy.
    pub fn forbid(self, exit: Exit, remedy: impl Into<String>) -> Self {
        Self { level: Level::Problem, remedy: Some(remedy.into()), exit, ..self }
    }
}
