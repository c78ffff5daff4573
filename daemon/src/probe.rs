//! Heading probe: a small turn by which poses show that they follow the vehicle, where nothing else turns it.
//!
//! In a quiet hover nothing distinguishes poses that stay the same from those of a vehicle that does. A vehicle that reports the
//! rates of its gyroscope is compared with them; another one turns its heading a little and back, which moves it nowhere.

use oqtal_bus::time::{Span, Time};

/// Time without conclusive evidence after which the probe begins.
const INCONCLUSIVE: Span = Span::from_millis(2000);
/// Duration of the turn and back \[s\].
const DURATION_S: f64 = 1.0;

/// The probe of a flight.
#[derive(Clone, Debug)]
pub struct HeadingProbe {
    /// Greatest turn \[rad\]; 0 for no probe.
    amplitude_rad: f64,
    conclusive_at: Option<Time>,
    began: Option<Time>,
}

impl HeadingProbe {
    /// A probe of this amplitude \[rad\].
    pub fn new(amplitude_rad: f64) -> Self {
        Self { amplitude_rad, conclusive_at: None, began: None }
    }

    /// Turn of the heading at `now` \[rad\]; `conclusive` if the poses of the last seconds have shown whether they follow the vehicle.
    pub fn turn_rad(&mut self, now: Time, conclusive: bool) -> f64 {
        if let Some(began) = self.began {
            let elapsed = now.since(began).seconds() / DURATION_S;
            if elapsed < 1.0 {
                return self.amplitude_rad * 0.5 * (1.0 - (std::f64::consts::TAU * elapsed).cos());
            }
            (self.began, self.conclusive_at) = (None, Some(now));
        }
        let since = *self.conclusive_at.get_or_insert(now);
        if conclusive {
            self.conclusive_at = Some(now);
        } else if now.since(since) >= INCONCLUSIVE && self.amplitude_rad > 0.0 {
            self.began = Some(now);
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn f58_the_heading_turns_and_returns_after_two_seconds_without_evidence() {
        let mut probe = HeadingProbe::new(0.03);
        let mut turns = |from_ms: i64, to_ms: i64, conclusive: bool| {
            let instants = (from_ms..to_ms).step_by(10).map(Span::from_millis);
            let turns = instants.map(|at| probe.turn_rad(Time::VIRTUAL_START + at, conclusive));
            turns.fold(0.0, f64::max)
        };
        assert_eq!(turns(0, 5000, true), 0.0);
        assert_eq!(turns(5000, 6990, false), 0.0);
        assert!((turns(6990, 8000, false) - 0.03).abs() < 1e-6);
        assert_eq!(turns(8000, 9900, false), 0.0, "once in a while");
    }
}
