//! Holds of a flight by the fence.

use serde::Serialize;

use crate::flight::{Flight, HELD};
use crate::flight_sample::FlightSample;

/// Rate of descent above which a vehicle that is held falls \[m/s\]; faster than any planned descent to the lower border.
const FALL_M_S: f64 = 1.5;

/// Holds of a flight by the fence.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FenceHold {
    /// Time for which the fence held the vehicle, which is not scored \[s\].
    pub held_s: f64,
    /// Whether a tick after the first hold is scored: the errors contain the return to the reference.
    #[serde(skip)]
    pub is_return_scored: bool,
    /// Whether the vehicle was falling when the first hold began.
    #[serde(skip)]
    pub is_fall: bool,
}

impl FenceHold {
    /// The holds of `flight`.
    pub(crate) fn of(flight: &Flight) -> Self {
        let mut from_hold = flight.samples.iter().skip_while(|sample| !sample.is_held());
        let is_fall = from_hold.next().is_some_and(|first| {
            let velocity = first.velocity();
            -velocity.z > FALL_M_S.max(velocity.xy().norm())
        });
        // The first tick of a landing by the daemon is scored.
        let returns = |sample: &FlightSample| sample.is_scored() && !sample.is_ended_by_daemon();
        let is_return_scored = from_hold.any(returns);
        Self { held_s: flight.held_s(), is_return_scored, is_fall }
    }

    /// The holds as text, for a flight of which a part is scored or not; `None` without a hold.
    pub fn text(&self, is_scored: bool) -> Option<String> {
        let cause =
            if self.is_fall { ", after a fall towards its lower border (fence.z-m)" } else { "" };
        let scored = match (is_scored, self.is_return_scored) {
            (false, _) => "",
            (true, false) => ", which is not scored",
            (true, true) => {
                ", which is not scored; the return from it is: do not compare with other flights"
            }
        };
        (self.held_s > 0.0).then(|| format!("{HELD} for {:.2} s{cause}{scored}", self.held_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::tests::fixture;
    use oqtal_bus::code::{Mode, SafetyState};

    #[test]
    fn a_return_is_scored_only_after_a_hold_and_a_fall_is_named() {
        let mut flight = fixture::square();
        flight.samples.iter_mut().for_each(|sample| sample.telemetry.scored = 1);
        let told = |flight: &Flight| FenceHold::of(flight).text(true);
        assert_eq!(told(&flight), None);
        let begin = flight.samples.len() / 2;
        for sample in &mut flight.samples[begin..begin + 12] {
            let tick = &mut sample.telemetry;
            (tick.mode, tick.state) = (Mode::Flying.code(), SafetyState::Hold.code());
            tick.scored = 0;
        }
        let with_return = told(&flight).unwrap();
        assert!(with_return.ends_with("do not compare with other flights"), "{with_return}");
        flight.samples.truncate(begin + 13);
        flight.samples[begin + 12].telemetry.state = SafetyState::Land.code();
        let first = &mut flight.samples[begin];
        first.telemetry.velocity = [0.0, 0.0, -3.0];
        first.truth = None;
        let crashed = told(&flight).unwrap();
        assert!(crashed.contains(" s, after a fall towards its lower border (fence.z-m)"));
        assert!(crashed.ends_with("(fence.z-m), which is not scored"), "{crashed}");
        assert_eq!(FenceHold::of(&flight).text(false).unwrap() + ", which is not scored", crashed);
    }
}
