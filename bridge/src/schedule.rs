//! When frames go: with each command, by the bridge's own clock without one, and polls where the wire has room for them.
//!
//! The wire is half duplex where a radio is in between: while the vehicle answers, nobody else should speak. So a poll goes
//! right behind a command, and only if it and its answer are over before the next command is due.

use oqtal_bus::time::{Span, Time};

/// Without a command for so many periods a frame goes by the bridge's own clock.
const OWN_CLOCK_PERIODS: f64 = 1.5;
/// After so many frames of its own the bridge reckons with no command: before, one is late, and would come upon a poll.
const ALONE_AFTER: u32 = 3;
/// What a radio, and the vehicle's own loop, may need to turn a poll into an answer.
const TURNAROUND: Span = Span::from_millis(2);

/// When frames go.
#[derive(Clone, Debug)]
pub struct Schedule {
    period: Span,
    status_period: Span,
    last_frame: Time,
    /// Frames by the own clock since the last that went with a command.
    own_frames: u32,
    last_poll: Time,
}

impl Schedule {
    /// Frames every `period` at least, and a status every `status_period`.
    #[must_use]
    pub fn new(period: Span, status_period: Span) -> Self {
        Self {
            period,
            status_period,
            last_frame: Time::UNSET,
            own_frames: 0,
            last_poll: Time::UNSET,
        }
    }

    /// A port was opened: a frame goes at once.
    pub fn restart(&mut self) {
        (self.last_frame, self.last_poll, self.own_frames) = (Time::UNSET, Time::UNSET, 0);
    }

    /// When a frame goes if no command comes.
    #[must_use]
    pub fn next_frame(&self) -> Time {
        let periods = if self.own_frames == 0 { OWN_CLOCK_PERIODS } else { 1.0 };
        self.last_frame + self.period.scaled(periods)
    }

    /// A frame goes `now`, with a new command or without.
    pub fn frame(&mut self, now: Time, with_command: bool) {
        // The own clock keeps its grid, however late it was served, unless it fell behind by a whole frame.
        let due = self.next_frame();
        let on_grid = !with_command && now.since(due) < self.period;
        self.last_frame = if on_grid { due } else { now };
        self.own_frames = if with_command { 0 } else { self.own_frames.saturating_add(1) };
    }

    /// Whether a poll goes right behind the frame that went `now`: one is due (at once if `urgent`), and `exchange`, from the
    /// end of what is `ahead` on the wire to the end of the answer, is over before the next frame.
    pub fn poll(&mut self, now: Time, ahead: Span, exchange: Span, urgent: bool) -> bool {
        let due = urgent || now >= self.last_poll + self.status_period;
        // The next command comes a period after this frame, also where the own clock would wait longer.
        let room = (self.last_frame + self.period).since(now);
        let expected = (1..ALONE_AFTER).contains(&self.own_frames);
        let goes = due && !expected && fits(room, ahead + exchange);
        if goes {
            self.last_poll = now;
        }
        goes
    }
}

/// Whether what takes `needed` is over within `room`.
#[must_use]
pub fn fits(room: Span, needed: Span) -> bool {
    needed + TURNAROUND <= room
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Span = Span::from_nanos(16_666_667);
    const EXCHANGE: Span = Span::from_millis(7);

    fn schedule() -> Schedule {
        Schedule::new(PERIOD, Span::from_millis(125))
    }

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn own_frames_keep_sixty_hertz_however_late_they_are_served() {
        let mut schedule = schedule();
        schedule.frame(at(0), true);
        let mut frames = 0;
        while schedule.next_frame() <= at(10_000) {
            let late = Span::from_nanos((frames % 7) * 300_000);
            schedule.frame(schedule.next_frame() + late, false);
            frames += 1;
        }
        assert!((599..=600).contains(&frames), "{frames}");
    }

    #[test]
    fn after_a_long_sleep_nothing_is_caught_up() {
        let mut schedule = schedule();
        schedule.frame(at(0), true);
        schedule.frame(at(5000), false);
        assert_eq!(schedule.next_frame(), at(5000) + PERIOD);
    }

    #[test]
    fn a_regular_command_is_waited_for() {
        let mut schedule = schedule();
        schedule.frame(at(0), true);
        assert_eq!(schedule.next_frame(), at(0) + PERIOD.scaled(1.5));
    }

    #[test]
    fn no_poll_stands_in_the_way_of_a_command_that_is_late() {
        let mut schedule = schedule();
        schedule.frame(at(0), true);
        let polls = [25, 42, 58, 75].map(|millis| {
            schedule.frame(at(millis), false);
            schedule.poll(at(millis), Span::from_millis(3), EXCHANGE, true)
        });
        assert_eq!(polls, [false, false, true, true]);
    }

    #[test]
    fn polls_keep_their_rate_and_go_only_where_there_is_room() {
        let mut schedule = schedule();
        let ahead = Span::from_millis(3);
        schedule.frame(at(0), true);
        assert!(schedule.poll(at(0), ahead, EXCHANGE, false));
        schedule.frame(at(17), true);
        assert!(!schedule.poll(at(17), ahead, EXCHANGE, false), "not due");
        assert!(schedule.poll(at(17), ahead, EXCHANGE, true), "urgent");
        schedule.frame(at(200), true);
        assert!(!schedule.poll(at(206), ahead, EXCHANGE, false), "would be answered too late");
        assert!(!schedule.poll(at(200), Span::from_millis(9), EXCHANGE, false), "busy wire");
        assert!(schedule.poll(at(201), ahead, EXCHANGE, false));
    }
}
