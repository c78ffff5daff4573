//! Instants at which frames are sent: a set-point with each command, or by the bridge's own clock without one; periodic frames
//! where the line has room.
//!
//! On a half-duplex radio, the vehicle's answers use time that set-points could use. A periodic frame is therefore sent directly
//! after a set-point, and only if it ends before the next set-point is due. Requests are spaced so that the whole exchange, with
//! every set-point and every answer, fits on the line. An answer that is longer than the rest of its period may delay the next
//! set-point by less than a frame, and does not delay the one after it.

use oqtal_bus::time::{Span, Time};

/// Time without a command after which a set-point is sent by the bridge's own clock \[control periods\].
const OWN_CLOCK_PERIODS: f64 = 1.5;
/// Widest spacing of periodic frames \[control periods\]: the state of a vehicle that is polled less often is not supervised.
const WIDEST_SPACING: u32 = 12;
/// Number of set-points by the bridge's own clock after which no command is expected \[-\]. Below this number a late command may still
/// arrive, so no periodic frame is sent that would delay it.
const ALONE_AFTER: u32 = 3;
/// Time that a radio and the vehicle's own loop need to turn a request into an answer.
const TURNAROUND: Span = Span::from_millis(2);

/// Schedule of frames.
#[derive(Clone, Debug)]
pub struct Schedule {
    period: Span,
    /// Shortest time between two periodic frames.
    spacing: Span,
    last_setpoint: Time,
    /// Set-points sent by the bridge's own clock since the last one with a command.
    own_setpoints: u32,
    last_periodic: Time,
    /// Set-point after which the last periodic frame was sent.
    periodic_slot: Time,
}

impl Schedule {
    /// Schedule with a set-point at least every `period`, and periodic frames `spacing` apart, as [`spacing`] computes it.
    pub fn new(period: Span, spacing: Span) -> Self {
        Self {
            period,
            // A set-point may be half a period early.
            spacing: spacing - period.scaled(0.5),
            last_setpoint: Time::UNSET,
            own_setpoints: 0,
            last_periodic: Time::UNSET,
            periodic_slot: Time::UNSET,
        }
    }

    /// Makes a set-point due at once: a port was opened.
    pub fn restart(&mut self) {
        (self.last_setpoint, self.last_periodic, self.own_setpoints) =
            (Time::UNSET, Time::UNSET, 0);
        self.periodic_slot = Time::UNSET;
    }

    /// Instant of the next set-point if no command arrives.
    pub fn next_setpoint(&self) -> Time {
        let periods = if self.own_setpoints == 0 { OWN_CLOCK_PERIODS } else { 1.0 };
        self.last_setpoint + self.period.scaled(periods)
    }

    /// Records a set-point that begins at `now`, with a new command or without.
    pub fn add_setpoint(&mut self, now: Time, with_command: bool) {
        // The own clock keeps its grid, however late it is served, unless it is late by a whole period.
        let due = self.next_setpoint();
        let on_grid = !with_command && now.since(due) < self.period;
        self.last_setpoint = if on_grid { due } else { now };
        self.own_setpoints = if with_command { 0 } else { self.own_setpoints.saturating_add(1) };
    }

    /// Whether a periodic frame fits behind the set-point sent at `now`: the last periodic frame is not too recent, and it ends
    /// before the next set-point, after `ahead` for the occupied line and `sending` for itself.
    pub fn has_room(&self, now: Time, ahead: Span, sending: Span) -> bool {
        // The next command follows one period after this set-point, also if the own clock would wait longer.
        let room = (self.last_setpoint + self.period).since(now);
        let command_is_late = (1..ALONE_AFTER).contains(&self.own_setpoints);
        let is_spaced = now >= self.last_periodic + self.spacing
            || self.periodic_slot.is_set() && self.periodic_slot == self.last_setpoint;
        is_spaced && !command_is_late && ahead + sending + TURNAROUND <= room
    }

    /// Records a periodic frame that begins at `now`.
    pub fn add_periodic(&mut self, now: Time) {
        (self.last_periodic, self.periodic_slot) = (now, self.last_setpoint);
    }
}

/// Spacing of periodic frames, if a set-point and its acknowledgement take `setpoint` of every `period`, and a request and its
/// answer take `exchange`; `None` if there is no room for any.
pub fn spacing(period: Span, setpoint: Span, exchange: Span) -> Option<Span> {
    let has_room = |periods: &u32| {
        let periods = f64::from(*periods);
        setpoint.scaled(periods) + exchange + TURNAROUND <= period.scaled(periods)
    };
    (1..=WIDEST_SPACING).find(has_room).map(|periods| period.scaled(f64::from(periods)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Span = Span::from_nanos(16_666_667);
    const SENDING: Span = Span::from_millis(1);

    fn schedule() -> Schedule {
        Schedule::new(PERIOD, PERIOD)
    }

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    /// Sends a periodic frame if there is room.
    fn word(schedule: &mut Schedule, now: Time, ahead: Span) -> bool {
        let goes = schedule.has_room(now, ahead, SENDING);
        if goes {
            schedule.add_periodic(now);
        }
        goes
    }

    #[test]
    fn own_setpoints_keep_sixty_hertz_however_late_they_are_served() {
        let mut schedule = schedule();
        schedule.add_setpoint(at(0), true);
        let mut frames = 0;
        while schedule.next_setpoint() <= at(10_000) {
            let late = Span::from_nanos((frames % 7) * 300_000);
            schedule.add_setpoint(schedule.next_setpoint() + late, false);
            frames += 1;
        }
        assert!((599..=600).contains(&frames), "{frames}");
    }

    #[test]
    fn after_a_long_suspension_no_setpoint_is_made_up_for() {
        let mut schedule = schedule();
        schedule.add_setpoint(at(0), true);
        schedule.add_setpoint(at(5000), false);
        assert_eq!(schedule.next_setpoint(), at(5000) + PERIOD);
    }

    #[test]
    fn a_regular_command_is_waited_for() {
        let mut schedule = schedule();
        schedule.add_setpoint(at(0), true);
        assert_eq!(schedule.next_setpoint(), at(0) + PERIOD.scaled(1.5));
    }

    #[test]
    fn no_word_delays_a_command_that_is_late() {
        let mut schedule = schedule();
        schedule.add_setpoint(at(0), true);
        let words = [25, 42, 58, 75].map(|millis| {
            schedule.add_setpoint(at(millis), false);
            word(&mut schedule, at(millis), Span::from_millis(3))
        });
        assert_eq!(words, [false, false, true, true]);
    }

    #[test]
    fn words_are_drawn_only_where_there_is_room() {
        let mut schedule = schedule();
        let ahead = Span::from_millis(3);
        schedule.add_setpoint(at(0), true);
        assert!(word(&mut schedule, at(0), ahead));
        schedule.add_setpoint(at(8), true);
        assert!(!word(&mut schedule, at(8), ahead), "too soon after the last");
        schedule.add_setpoint(at(17), true);
        assert!(word(&mut schedule, at(17), ahead));
        schedule.add_setpoint(at(200), true);
        assert!(!word(&mut schedule, at(211), ahead), "would delay the next set-point");
        assert!(!word(&mut schedule, at(200), Span::from_millis(14)), "busy line");
        assert!(word(&mut schedule, at(201), ahead));
    }

    #[test]
    fn periodic_frames_leave_time_for_every_exchange() {
        let period = Span::from_millis(16);
        let (setpoint, exchange) = (Span::from_millis(10), Span::from_millis(14));
        assert_eq!(spacing(period, Span::from_millis(4), Span::from_millis(8)), Some(period));
        assert_eq!(spacing(period, setpoint, exchange), Some(period.scaled(3.0)));
        assert_eq!(spacing(period, period, exchange), None);
        let mut schedule = Schedule::new(period, period.scaled(3.0));
        let words = (0..30).filter(|frame| {
            let now = at(16 * frame);
            schedule.add_setpoint(now, true);
            word(&mut schedule, now, Span::ZERO)
        });
        assert_eq!(words.count(), 10);
    }
}
