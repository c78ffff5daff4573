//! Motor switch: holding the yaw stick to one side without thrust starts the motors; repeating it stops them.

use oqtal_bus::time::{Span, Time};

/// State of the motors and of the motor switch.
#[derive(Clone, Copy, Debug)]
pub struct MotorSwitch {
    hold: Span,
    running_since: Option<Time>,
    held: Held,
}

/// State of the yaw stick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Held {
    No,
    Since(Time),
    /// Held after switching; must be released before the next switching.
    Spent,
}

impl MotorSwitch {
    /// Switch of stopped motors, operated by holding the stick for `hold`.
    pub fn new(hold: Span) -> Self {
        Self { hold, running_since: None, held: Held::No }
    }

    /// Whether the motors run.
    pub fn is_running(&self) -> bool {
        self.running_since.is_some()
    }

    /// Time since the motors started; zero if they are stopped.
    pub fn up_time(&self, now: Time) -> Span {
        self.running_since.map_or(Span::ZERO, |since| now.since(since))
    }

    /// Takes a command at `now`; `holds` if it holds the switch.
    pub fn command(&mut self, now: Time, holds: bool) {
        self.held = match (holds, self.held) {
            (false, _) => Held::No,
            (true, Held::No) => Held::Since(now),
            (true, Held::Since(since)) if now.since(since) >= self.hold => {
                self.running_since = if self.is_running() { None } else { Some(now) };
                Held::Spent
            }
            (true, held) => held,
        };
    }

    /// Stops the motors at once; a held stick must be released before it starts them.
    pub fn stop(&mut self) {
        self.running_since = None;
        if self.held != Held::No {
            self.held = Held::Spent;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    /// Sends a command every 10 ms over the range `millis` \[ms\].
    fn commands(motors: &mut MotorSwitch, millis: std::ops::Range<i64>, holds: bool) {
        millis.step_by(10).for_each(|millis| motors.command(at(millis), holds));
    }

    #[test]
    fn the_switch_must_be_held_and_released_before_it_switches_again() {
        let mut motors = MotorSwitch::new(Span::from_millis(400));
        commands(&mut motors, 0..400, true);
        assert!(!motors.is_running());
        commands(&mut motors, 400..2000, true);
        assert!(motors.is_running(), "held for longer, it switches once");
        assert_eq!(motors.up_time(at(500)), Span::from_millis(100));
        commands(&mut motors, 2000..2010, false);
        commands(&mut motors, 2010..2410, true);
        assert!(motors.is_running());
        commands(&mut motors, 2410..2420, true);
        assert!(!motors.is_running());
    }

    #[test]
    fn a_switch_released_too_early_does_nothing() {
        let mut motors = MotorSwitch::new(Span::from_millis(400));
        for begin in (0..5000).step_by(500) {
            commands(&mut motors, begin..begin + 390, true);
            commands(&mut motors, begin + 390..begin + 400, false);
        }
        assert!(!motors.is_running());
    }

    #[test]
    fn an_emergency_stop_overrides_a_switch_that_is_held() {
        let mut motors = MotorSwitch::new(Span::from_millis(400));
        commands(&mut motors, 0..600, true);
        motors.stop();
        commands(&mut motors, 600..3000, true);
        assert!(!motors.is_running());
    }
}
