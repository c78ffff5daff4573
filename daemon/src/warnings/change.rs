//! Warnings of a change of settings in flight.

use super::{oscillates, quick_warnings, without_effect};
use crate::waypoint_file::ReadSettings;

/// The warnings of the settings `next` that `present` does not have.
pub(crate) fn added_warnings(present: &ReadSettings, next: &ReadSettings) -> Vec<String> {
    let of = |settings: &ReadSettings| {
        let trajectory = settings.trajectory();
        trajectory.map_or_else(|_| Vec::new(), |path| quick_warnings(&settings.config, &path))
    };
    let before = of(present);
    let oscillation = oscillates(&next.config)
        .filter(|_| oscillates(&present.config).is_none())
        .map(|warning| format!("{warning}, or take changed settings back by `undo`"));
    let new = of(next).into_iter().filter(|told| !before.contains(told));
    new.chain(without_effect(&present.config, &next.config)).chain(oscillation).collect()
}
