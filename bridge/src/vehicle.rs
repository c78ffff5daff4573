//! What is known of the vehicle from what it says: that it is there, its battery, and how much of what it is asked it answers.

use oqtal_bus::time::{Span, Time};

use crate::protocol::VehicleReply;

/// Requests and answers are counted over the last second, in so many parts of it.
const PARTS: usize = 10;
const PART: Span = Span::from_millis(100);

/// What is known of the vehicle.
#[derive(Clone, Debug)]
pub struct VehicleMonitor {
    silence: Span,
    heard_at: Time,
    battery_v: f64,
    parts: [(u32, u32); PARTS],
    part: usize,
    part_began: Time,
}

impl VehicleMonitor {
    /// A vehicle that was never reply; it is silent once nothing valid came for `silence`.
    #[must_use]
    pub fn new(silence: Span) -> Self {
        Self {
            silence,
            heard_at: Time::UNSET,
            battery_v: f64::NAN,
            parts: [(0, 0); PARTS],
            part: 0,
            part_began: Time::UNSET,
        }
    }

    /// A port was opened: who is at its other end is not known yet.
    pub fn forget(&mut self) {
        *self = Self::new(self.silence);
    }

    /// Something was said to it that it should answer.
    pub fn asked(&mut self, now: Time) {
        self.count(now).0 += 1;
    }

    /// It said something valid.
    pub fn hear(&mut self, now: Time, reply: VehicleReply) {
        self.heard_at = now;
        match reply {
            VehicleReply::Acknowledged => self.count(now).1 += 1,
            VehicleReply::Status { battery_v, .. } => {
                self.battery_v = battery_v;
                self.count(now).1 += 1;
            }
            VehicleReply::Other => {}
        }
    }

    /// Whether it was reply lately.
    #[must_use]
    pub fn answers(&self, now: Time) -> bool {
        self.heard_at.is_set() && now.since(self.heard_at) <= self.silence
    }

    /// Battery voltage as last reply \[V\]; NaN before.
    #[must_use]
    pub fn battery_v(&self) -> f64 {
        self.battery_v
    }

    /// The share of what it was asked in the last second that it answered; NaN if nothing was.
    pub fn quality(&mut self, now: Time) -> f64 {
        self.pass(now);
        let (asked, answered) =
            self.parts.iter().fold((0, 0), |sum, part| (sum.0 + part.0, sum.1 + part.1));
        // An answer may come in a later part than its request.
        if asked == 0 { f64::NAN } else { (f64::from(answered) / f64::from(asked)).min(1.0) }
    }

    fn count(&mut self, now: Time) -> &mut (u32, u32) {
        self.pass(now);
        &mut self.parts[self.part]
    }

    /// Goes on to the part of the second that `now` is in.
    fn pass(&mut self, now: Time) {
        if now.since(self.part_began) >= PART.scaled(PARTS as f64) {
            self.parts = [(0, 0); PARTS];
            self.part_began = now;
        }
        while now.since(self.part_began) >= PART {
            self.part = (self.part + 1) % PARTS;
            self.parts[self.part] = (0, 0);
            self.part_began = self.part_began + PART;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATUS: VehicleReply = VehicleReply::Status { battery_v: 11.1, motors_run: false };

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn a_vehicle_is_silent_until_heard_and_after_a_while() {
        let mut vehicle = VehicleMonitor::new(Span::from_millis(1000));
        assert!(!vehicle.answers(at(0)) && vehicle.battery_v().is_nan());
        vehicle.hear(at(0), STATUS);
        assert!(vehicle.answers(at(1000)) && !vehicle.answers(at(1001)));
        assert_eq!(vehicle.battery_v(), 11.1);
        vehicle.forget();
        assert!(!vehicle.answers(at(1)));
    }

    #[test]
    fn quality_is_that_of_the_last_second() {
        let mut vehicle = VehicleMonitor::new(Span::from_millis(1000));
        assert!(vehicle.quality(at(0)).is_nan());
        for tick in 0..100 {
            vehicle.asked(at(20 * tick));
            // The second half of the time it answers nothing but every fifth.
            if tick < 50 || tick % 5 == 0 {
                vehicle.hear(at(20 * tick + 5), VehicleReply::Acknowledged);
            }
        }
        assert!((vehicle.quality(at(1999)) - 0.2).abs() < 0.05, "{}", vehicle.quality(at(1999)));
        assert!(vehicle.quality(at(5000)).is_nan());
    }
}
