//! What a check says.

use oqtal_runtime::process::Exit;
use serde::Serialize;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// As it should be.
    Ok,
    /// It flies, but later or less evenly than it could.
    Advice,
    /// It does not fly.
    Problem,
}

impl Level {
    /// In a word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Advice => "advice",
            Self::Problem => "PROBLEM",
        }
    }
}

/// What was found, why it matters, and what mends it.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub name: &'static str,
    /// How bad it is.
    pub level: Level,
    /// What was found.
    pub found: String,
    /// Why it matters.
    pub why: &'static str,
    /// The command that mends it; `None` where nothing needs mending, or no command can.
    pub remedy: Option<String>,
    /// How the command ends if this is a problem.
    #[serde(skip)]
    pub exit: Exit,
}

impl Finding {
    /// All is well with `name`, so far; `why` it matters.
    #[must_use]
    pub fn ok(name: &'static str, why: &'static str, found: impl Into<String>) -> Self {
        Self { name, level: Level::Ok, found: found.into(), why, remedy: None, exit: Exit::System }
    }

    /// It could be better, if this were done.
    #[must_use]
    pub fn advise(self, remedy: impl Into<String>) -> Self {
        Self { level: Level::Advice, remedy: Some(remedy.into()), ..self }
    }

    /// It could be better, but no command makes it so.
    #[must_use]
    pub fn note(self) -> Self {
        Self { level: Level::Advice, ..self }
    }

    /// It prevents a flight until this is done.
    #[must_use]
    pub fn forbid(self, exit: Exit, remedy: impl Into<String>) -> Self {
        Self { level: Level::Problem, remedy: Some(remedy.into()), exit, ..self }
    }
}
