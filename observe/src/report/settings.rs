//! Section of the settings, sufficient to repeat the flight.

use maud::{Markup, html};

use crate::flight::Flight;
use crate::summary::Summary;

use crate::page::section;
use crate::plot::unit::MISSING;

/// The section of the settings.
pub fn settings(flight: &Flight, summary: &Summary) -> Markup {
    let or_missing = |fact: Option<String>| fact.unwrap_or_else(|| MISSING.to_owned());
    let facts = [
        ("Clock", summary.clock.clone()),
        ("Seed", summary.seed.to_string()),
        ("Ticks", summary.ticks.to_string()),
        ("States", summary.states()),
        ("Answers", or_missing(summary.answers.map(|answers| answers.to_string()))),
        ("Hand-overs", or_missing(summary.handovers.as_ref().map(ToString::to_string))),
        ("Changed before the take-off", or_missing(summary.settings.changed())),
        ("Configuration hash", summary.settings.config_hash.clone()),
        ("Trajectory hash", or_missing(summary.trajectory_hash.clone())),
    ];
    section(
        "Settings",
        html! {
            dl.wide { @for (name, value) in facts { div { dt { (name) } dd { (value) } } } }
            details.wide {
                summary { "The effective configuration at the take-off" }
                pre { (flight.config_at_arming().to_toml()) }
            }
        },
    )
}
