//! Marker files from a daemon to the next one. One exists while the daemon may take off automatically, and remains if it does not end in
//! order; one exists during each flight, and remains if the daemon ends in flight.

use oqtal_bus::code::Cause;
use oqtal_bus::paths::InstancePaths;
use oqtal_config::SafetyOptions;
use oqtal_runtime::flight_marker::FlightMarker;

use crate::cycle::Cycle;

/// The marker against automatic flights. A daemon that only observes does not fly, and leaves the marker unchanged.
#[derive(Debug)]
pub(crate) struct TakeOffMarker {
    marker: FlightMarker,
    is_observer: bool,
    /// Whether an automatic flight is cancelled.
    pub(crate) stays: bool,
    /// Cause of the Stop in which the daemon begins.
    pub(crate) cause: Cause,
}

impl TakeOffMarker {
    /// Claims the marker of the instance at `paths` if a flight at start-up is configured, and cancels that flight of `cycle` if the marker
    /// was set, or if the daemon before ended in flight: then this one begins in Stop. The command that starts a child reports that end.
    pub(crate) fn begin(
        paths: &InstancePaths,
        safety: &SafetyOptions,
        cycle: &mut Cycle,
        is_child: bool,
    ) -> Self {
        let (marker, is_observer) = (FlightMarker::of(paths), safety.observe_only);
        let was_set = marker.is_set();
        let has_fallen = !is_child && !is_observer && FlightMarker::in_flight(paths).is_set();
        let stays = (safety.arm_at_start && !is_observer && !marker.claim()) || has_fallen;
        if was_set || stays {
            cycle.cancel_automatic(has_fallen);
        }
        let cause = if has_fallen { Cause::EndedInFlight } else { Cause::None };
        Self { marker, is_observer, stays, cause }
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

/// The marker of flights, for the background thread.
#[derive(Debug)]
pub(crate) struct InFlightMarker {
    /// Marker of flights; `None` for a daemon that only observes.
    marker: Option<FlightMarker>,
    /// Whether the command that started the daemon reports its end: then only marks of earlier flights are removed.
    is_child: bool,
    has_flown: bool,
    has_warned: bool,
}

impl InFlightMarker {
    /// The marker of the instance at `paths`, for the daemon of a command if `is_child`.
    pub(crate) fn of(paths: &InstancePaths, safety: &SafetyOptions, is_child: bool) -> Self {
        let marker = (!safety.observe_only).then(|| FlightMarker::in_flight(paths));
        Self { marker, is_child, has_flown: false, has_warned: false }
    }

    /// Sets the marker during a flight, and removes it after one. After a loss of files it is not set: the root may belong to another run.
    pub(crate) fn note(&mut self, is_flying: bool, is_lost: bool) {
        let Some(marker) = &self.marker else { return };
        self.has_flown |= is_flying;
        let marks = is_flying && !self.is_child;
        match marker.is_set() {
            false if marks && !is_lost => {
                if let Err(error) = marker.ensure_set()
                    && !std::mem::replace(&mut self.has_warned, true)
                {
                    tracing::warn!(
                        "if this daemon ends in flight, the next one does not know of it: the marker cannot be written: {error}"
                    );
                }
            }
            true if self.has_flown && !marks => marker.remove(),
            _ => {}
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
            let run = TakeOffMarker::begin(&paths, &config.safety, &mut cycle, false);
            (run, cycle)
        };
        let is_set = || FlightMarker::of(&paths).is_set();
        let (run, _) = begin();
        assert!(is_set() && !run.stays);
        run.end(true, || false);
        assert!(!is_set(), "an end in good order");
        let (run, _) = begin();
        // Raised once the marker is removed.
        run.end(true, || !is_set());
        assert!(is_set() && begin().0.stays);
    }

    #[test]
    fn a_flight_is_marked_while_it_lasts_and_that_of_a_command_removes_an_older_mark() {
        let directory = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("flight", Some(directory.path())).unwrap();
        let marker = || FlightMarker::in_flight(&paths);
        let of = |is_child| InFlightMarker::of(&paths, &Config::default().safety, is_child);
        let mut service = of(false);
        service.note(true, false);
        assert!(marker().is_set());
        of(false).note(false, false);
        assert!(marker().is_set(), "a daemon that has not flown knows nothing of that flight");
        marker().remove();
        service.note(true, true);
        assert!(!marker().is_set(), "files are lost");
        service.note(true, false);
        assert!(marker().is_set(), "written again");
        service.note(false, true);
        assert!(!marker().is_set());
        marker().ensure_set().unwrap();
        of(true).note(true, false);
        assert!(!marker().is_set());
    }

    #[test]
    fn after_a_daemon_that_ended_in_flight_the_next_one_begins_in_stop() {
        let directory = tempfile::tempdir().unwrap();
        let paths = InstancePaths::new("fallen", Some(directory.path())).unwrap();
        FlightMarker::in_flight(&paths).ensure_set().unwrap();
        let config = Config::default();
        let cycle = || {
            let path = trajectory(&config).unwrap();
            Cycle::new(&config, path, Time::VIRTUAL_START).unwrap()
        };
        for (is_child, cause) in [(false, Cause::EndedInFlight), (true, Cause::None)] {
            let mut cycle = cycle();
            let run = TakeOffMarker::begin(&paths, &config.safety, &mut cycle, is_child);
            assert_eq!((run.cause, run.stays), (cause, !is_child));
            assert_eq!(cycle.awaits_arm(), !is_child);
        }
    }
}
