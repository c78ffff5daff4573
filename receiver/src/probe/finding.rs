//! Findings of a probe, and the verdict that they lead to.

use std::borrow::Cow;
use std::fmt;

use serde::Serialize;

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// Flights are possible, less well than they could be.
    Advice,
    /// No flight.
    Problem,
}

/// A finding: what was found, and what to do.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ProbeFinding {
    /// Name of the check.
    pub name: &'static str,
    /// Severity.
    pub severity: Severity,
    /// Fact found.
    pub found: String,
    /// Remedy.
    pub remedy: Cow<'static, str>,
}

/// Verdict on a camera system.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FitnessVerdict {
    /// Fit to fly with.
    Fit,
    /// Fit, less well than it could be.
    Limited,
    /// No flight.
    #[default]
    Unfit,
}

impl FitnessVerdict {
    /// The verdict that these findings lead to.
    pub fn of(findings: &[ProbeFinding]) -> Self {
        match findings.iter().map(|finding| finding.severity).max() {
            None => Self::Fit,
            Some(Severity::Advice) => Self::Limited,
            Some(Severity::Problem) => Self::Unfit,
        }
    }
}

impl fmt::Display for FitnessVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fit => "fit to fly",
            Self::Limited => "fit to fly with the limits above,",
            Self::Unfit => "not fit to fly",
        })
    }
}

impl fmt::Display for ProbeFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = if self.severity == Severity::Problem { "PROBLEM" } else { "advice" };
        write!(f, "{severity:<10} {}: {}; {}", self.name, self.found, self.remedy)
    }
}

impl ProbeFinding {
    /// The finding of a body that the server does not have; `known` lists those that it has.
    pub fn missing(name: &str, known: &str) -> Self {
        let found = format!("no body `{name}`; {known}");
        let remedy = "name one of these, or define the body in the camera software".into();
        Self { name: "bodies", severity: Severity::Problem, found, remedy }
    }
}
