//! Flight marker of a daemon's run: set while the daemon may take off automatically, and left set by an end without good order.

use oqtal_bus::paths::InstancePaths;
use oqtal_config::SafetyOptions;
use oqtal_runtime::flight_marker::FlightMarker;

use crate::cycle::Cycle;

/// The marker during a run. An observer flies nothing, and changes nothing.
#[derive(Debug)]
pub(crate) struct RunMarker {
    marker: FlightMarker,
    is_observer: bool,
    /// Whether the marker cancels an automatic flight.
    pub(crate) stays: bool,
}

impl RunMarker {
    /// Claims the marker of the instance at `paths` if a flight at start-up is configured, and cancels that flight of `cycle` if the marker
    /// was set.
    pub(crate) fn begin(paths: &InstancePaths, safety: &SafetyOptions, cycle: &mut Cycle) -> Self {
        let (marker, is_observer) = (FlightMarker::of(paths), safety.observe_only);
        let was_set = marker.is_set();
        let stays = safety.arm_at_start && !is_observer && !marker.claim();
        if was_set || stays {
            cycle.cancel_automatic();
        }
        Self { marker, is_observer, stays }
    }

    /// Removes the marker at an end `in_order`, unless the daemon `awaits_arm`, and sets it otherwise; also for a stop that was raised while
    /// the marker was removed.
    pub(crate) fn end(&self, in_order: bool, mut awaits_arm: impl FnMut() -> bool) {
        if self.is_observer {
            return;
        }
        if in_order && !awaits_arm() {
            self.marker.remove();
            if !awaits_arm() {
                return;
            }
        }
        if let Err(error) = self.marker.ensure_set() {
            tracing::error!(
                "the next daemon may take off automatically: the flight marker cannot be written: {error}"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use oqtal_bus::time::Time;
    use oqtal_config::{Config, Setting};

    use super::*;
    use crate::trajectory;

    #[test]
    fn a_stop_raised_between_the_removal_of_the_marker_and_the_end_holds_back_the_next_take_off() {
        let directory = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("raised", Some(directory.path())).unwrap();
        let settings = [Setting::flag("test", "safety.arm-at-start", true)];
        let config = Config::from_settings(&settings).unwrap();
        let begin = || {
            let path = trajectory(&config).unwrap();
            let mut cycle = Cycle::new(&config, path, Time::VIRTUAL_START).unwrap();
            RunMarker::begin(&paths, &config.safety, &mut cycle)
        };
        let is_set = || FlightMarker::of(&paths).is_set();
        let run = begin();
        assert!(is_set() && !run.stays);
        run.end(true, || false);
        assert!(!is_set(), "an end in good order");
        let run = begin();
        // Raised once the marker is removed.
        run.end(true, || !is_set());
        assert!(is_set() && begin().stays);
    }
}
