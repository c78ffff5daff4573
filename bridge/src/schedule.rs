//! When frames go: with each command, by the bridge's own clock without one, and polls where the wire has room for them.
//!
//! Where a radio is in between, the vehicle's answers take the time that commands could take. So a poll goes right behind a
//! command and only if it is out before the next one is due, and polls are so far apart that the whole exchange, every command
//! and every answer, has its time on the line. An answer that is longer than what is left of its period may make the next command
//! wait, for less than a frame, and the one after it does not.

use oqtal_bus::time::{Span, Time};

/// Without a command for so many periods a frame goes by the bridge's own clock.
const OWN_CLOCK_PERIODS: f64 = 1.5;
/// A vehicle that could be asked no more often than once in so many periods is not watched any more.
const SPARSEST_POLLS: u32 = 12;
/// After so many frames of its own the bridge reckons with no command: before, one is late, and would come upon a poll.
const ALONE_AFTER: u32 = 3;
/// What a radio, and the vehicle's own loop, may need to turn a poll into an answer.
const TURNAROUND: Span = Span::from_millis(2);

/// When frames go.
#[derive(Clone, Debug)]
pub struct Schedule {
    period: Span,
    status_period: Span,
    spacing: Span,
    last_frame: Time,
    /// Frames by the own clock since the last that went with a command.
    own_frames: u32,
    last_poll: Time,
}

impl Schedule {
    /// Frames every `period` at least, and a status every `status_period`, or `spacing`, which is no longer, where it is wanted
    /// urgently.
    #[must_use]
    pub fn new(period: Span, status_period: Span, spacing: Span) -> Self {
        Self {
            period,
            status_period,
            // A frame may come a little early.
            spacing: spacing - period.scaled(0.5),
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

    /// Whether a poll goes right behind the frame that went `now`: one is due (sooner if `urgent`), and it is out before the
    /// next frame, behind what is `ahead` of it; itself it takes `asking`.
    pub fn poll(&mut self, now: Time, ahead: Span, asking: Span, urgent: bool) -> bool {
        let apart = if urgent { self.spacing } else { self.status_period };
        // The next command comes a period after this frame, also where the own clock would wait longer.
        let room = (self.last_frame + self.period).since(now);
        let expected = (1..ALONE_AFTER).contains(&self.own_frames);
        let due = now >= self.last_poll + apart;
        let goes = due && !expected && ahead + asking + TURNAROUND <= room;
        if goes {
            self.last_poll = now;
        }
        goes
    }
}

/// How far polls must be apart at least, where a command and its acknowledgement take `setpoint` of every `period`, and a poll and
/// its answer `exchange`; `None` if there is no room for any.
#[must_use]
pub fn spacing(period: Span, setpoint: Span, exchange: Span) -> Option<Span> {
    let has_room = |periods: &u32| {
        let periods = f64::from(*periods);
        setpoint.scaled(periods) + exchange + TURNAROUND <= period.scaled(periods)
    };
    (1..=SPARSEST_POLLS).find(has_room).map(|periods| period.scaled(f64::from(periods)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Span = Span::from_nanos(16_666_667);
    const ASKING: Span = Span::from_millis(1);

    fn schedule() -> Schedule {
        Schedule::new(PERIOD, Span::from_millis(125), PERIOD)
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
            schedule.poll(at(millis), Span::from_millis(3), ASKING, true)
        });
        assert_eq!(polls, [false, false, true, true]);
    }

    #[test]
    fn polls_keep_their_rate_and_go_only_where_there_is_room() {
        let mut schedule = schedule();
        let ahead = Span::from_millis(3);
        schedule.frame(at(0), true);
        assert!(schedule.poll(at(0), ahead, ASKING, false));
        schedule.frame(at(17), true);
        assert!(!schedule.poll(at(17), ahead, ASKING, false), "not due");
        assert!(schedule.poll(at(17), ahead, ASKING, true), "urgent");
        schedule.frame(at(200), true);
        assert!(!schedule.poll(at(211), ahead, ASKING, false), "would be in the way of the next");
        assert!(!schedule.poll(at(200), Span::from_millis(14), ASKING, false), "busy wire");
        assert!(schedule.poll(at(201), ahead, ASKING, false));
    }

    #[test]
    fn polls_are_so_far_apart_that_everything_has_its_time() {
        let period = Span::from_millis(16);
        let (setpoint, exchange) = (Span::from_millis(10), Span::from_millis(14));
        assert_eq!(spacing(period, Span::from_millis(4), Span::from_millis(8)), Some(period));
        assert_eq!(spacing(period, setpoint, exchange), Some(period.scaled(3.0)));
        assert_eq!(spacing(period, period, exchange), None);
        let mut schedule = Schedule::new(period, period.scaled(9.0), period.scaled(3.0));
        let polls = (0..30).filter(|frame| {
            let now = at(16 * frame);
            schedule.frame(now, true);
            schedule.poll(now, Span::ZERO, ASKING, true)
        });
        assert_eq!(polls.count(), 10);
    }
}
