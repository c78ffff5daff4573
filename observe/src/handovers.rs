//! Hand-overs from a law to its fallback.

use std::collections::BTreeMap;
use std::fmt;

use oqtal_bus::code::{HandoverCause, Mode};
use oqtal_control::trajectory::Phase;
use serde::Serialize;

use crate::flight::Flight;
use crate::flight_sample::FlightSample;

/// Least share of the trajectory under the fallback of which a note is made \[-\].
const LEAST_SHARE: f64 = 0.01;

/// Hand-overs from a law to its fallback.
#[derive(Clone, Debug, Default, Serialize)]
pub struct HandoverFigures {
    /// Number \[-\].
    pub count: u64,
    /// Number by reason \[-\].
    pub causes: BTreeMap<String, u64>,
    /// Ticks of the trajectory, up to the landing \[-\].
    pub trajectory_ticks: usize,
    /// Ticks of these that the fallback flew \[-\].
    pub fallback_ticks: usize,
    /// Reason why the fallback flew them from the beginning: no command of the law had been good until then; `None` after a hand-over.
    pub refused: Option<String>,
}

impl HandoverFigures {
    /// The hand-overs of `flight`; `None` if its law has no fallback.
    pub(crate) fn of(flight: &Flight) -> Option<Self> {
        let control = &flight.config.control;
        if !control.is_external() && control.fallback.is_none() {
            return None;
        }
        let (mut figures, mut last) = (Self::default(), 0);
        for FlightSample { telemetry, .. } in flight.armed() {
            let cause = HandoverCause::from_code(telemetry.handover_cause).unwrap_or_default();
            if telemetry.handovers > last {
                *figures.causes.entry(cause.to_string()).or_default() += 1;
                figures.count += 1;
            }
            last = telemetry.handovers;
            // In the first tick of a landing the phase is still that of the trajectory.
            let is_on_trajectory =
                [telemetry.mode, telemetry.phase] == [Mode::Flying.code(), Phase::Trajectory as u8];
            figures.trajectory_ticks += usize::from(is_on_trajectory);
            if is_on_trajectory && telemetry.fallback == 1 {
                figures.fallback_ticks += 1;
                if telemetry.handovers == 0 && cause != HandoverCause::None {
                    figures.refused.get_or_insert_with(|| cause.to_string());
                }
            }
        }
        Some(figures)
    }

    /// Note on a flight of whose trajectory the fallback flew a part, with the remedy for late answers if that is most of it; `None` for
    /// another one.
    pub fn note(&self) -> Option<&'static str> {
        let share = self.fallback_ticks as f64 / self.trajectory_ticks.max(1) as f64;
        (share >= LEAST_SHARE).then_some(match (share > 0.5, self.is_late()) {
            (true, true) => {
                "the fallback law flew most of the trajectory: the figures are not those of the configured law, whose answers were late: raise external.budget-us to give it more time, or lower external.return-answers to give it control back sooner"
            }
            (true, false) => {
                "the fallback law flew most of the trajectory: the figures are not those of the configured law"
            }
            (false, _) => {
                "the fallback law flew a part of the trajectory: the figures are those of both laws"
            }
        })
    }

    /// Whether most of the hand-overs were for answers that did not come in time.
    fn is_late(&self) -> bool {
        let late = HandoverCause::Missing.to_string();
        let count = self.causes.get(&late).copied().unwrap_or(0);
        2 * count > self.count || self.refused.as_ref() == Some(&late)
    }

    /// Share of the trajectory that the fallback flew, as text.
    pub(crate) fn share(&self) -> String {
        format!("{} of {} ticks", self.fallback_ticks, self.trajectory_ticks)
    }

    /// Number of hand-overs, and of each reason, as text.
    pub(crate) fn counts(&self) -> String {
        let causes = self.causes.iter().map(|(cause, count)| format!("{cause} {count}"));
        let causes = causes.collect::<Vec<_>>().join(", ");
        let separator = if causes.is_empty() { "" } else { ": " };
        format!("{}{separator}{causes}", self.count)
    }
}

impl fmt::Display for HandoverFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {} of the trajectory by the fallback law", self.counts(), self.share())?;
        let refused = self.refused.as_ref();
        refused.map_or(Ok(()), |cause| write!(f, ", from the beginning on: {cause}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;
    use oqtal_config::{Config, Setting};

    #[test]
    fn a_law_that_was_refused_before_the_trajectory_has_its_cause_told() {
        let external = Setting::parse("test", "control.controller=external").unwrap();
        let mut flight = fixture::square();
        flight.config = Config::from_settings(&[external]).unwrap();
        flight.samples.iter_mut().for_each(|sample| {
            sample.telemetry.fallback = 1;
            sample.telemetry.handover_cause = HandoverCause::NotFinite.code();
        });
        let told = HandoverFigures::of(&flight).unwrap().to_string();
        assert!(told.starts_with("0; ") && told.ends_with("from the beginning on: not finite"));
        assert!(!HandoverFigures::of(&flight).unwrap().note().unwrap().contains("external."));
        let late = HandoverCause::Missing.code();
        flight.samples.iter_mut().for_each(|sample| sample.telemetry.handover_cause = late);
        let note = HandoverFigures::of(&flight).unwrap().note().unwrap();
        assert!(note.contains("external.budget-us") && note.contains("external.return-answers"));
    }
}
