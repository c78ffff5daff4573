//! Section of the settings, sufficient to repeat the flight.

use maud::{Markup, html};

use crate::flight::Flight;
use crate::summary::Summary;

use crate::page::section;
use crate::plot::unit::MISSING;

/// The section of the settings.
pub fn settings(flight: &Flight, summary: &Summary) -> Markup {
    let answers = summary.answers.map(|answers| answers.to_string());
    let handovers = summary.handovers.as_ref().map(ToString::to_string);
    let facts = [
        ("Clock", summary.clock.clone()),
        ("Seed", summary.seed.to_string()),
        ("Ticks", summary.ticks.to_string()),
        ("States", summary.states()),
        ("Answers", answers.unwrap_or_else(|| MISSING.to_owned())),
        ("Hand-overs", handovers.unwrap_or_else(|| MISSING.to_owned())),
        (
            "Changed before the take-off",
            summary.settings.changed().unwrap_or_else(|| MISSING.to_owned()),
        ),
        ("Configuration hash", summary.settings.config_hash.clone()),
        ("Trajectory hash", summary.trajectory_hash.clone().unwrap_or_else(|| MISSING.to_owned())),
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
