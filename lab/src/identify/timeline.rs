//! Commands over time: a time span divided at the instants at which commands take effect.

use super::data::CommandRecord;

/// Longest interval \[s\].
const LONGEST_S: f64 = 6e-3;

/// Commands of a flight with a delay, read in order of time.
#[derive(Clone, Debug)]
pub struct CommandTimeline<'a> {
    commands: &'a [CommandRecord],
    delay_s: f64,
    /// Number of commands that have taken effect \[-\].
    acted: usize,
}

impl<'a> CommandTimeline<'a> {
    /// Commands that take effect `delay_s` \[s\] after they were sent.
    pub fn new(commands: &'a [CommandRecord], delay_s: f64) -> Self {
        Self { commands, delay_s, acted: 0 }
    }

    /// Passes every interval of the span from `from_s` to `to_s` \[s\] to `piece`, with its length \[s\] and the command in
    /// effect. Successive spans must be contiguous.
    pub fn pieces(
        &mut self,
        (from_s, to_s): (f64, f64),
        mut piece: impl FnMut(f64, Option<&CommandRecord>),
    ) {
        let mut t_s = from_s;
        while t_s < to_s {
            while self.next_s().is_some_and(|next_s| next_s <= t_s) {
                self.acted += 1;
            }
            let until_s = self.next_s().unwrap_or(to_s).min(to_s);
            let count = ((until_s - t_s) / LONGEST_S).ceil().clamp(1.0, 1e4);
            let acting = self.acted.checked_sub(1).map(|index| &self.commands[index]);
            for _ in 0..count as u32 {
                piece((until_s - t_s) / count, acting);
            }
            t_s = until_s;
        }
    }

    /// Instant at which the next command takes effect \[s\].
    fn next_s(&self) -> Option<f64> {
        self.commands.get(self.acted).map(|command| command.sent_s + self.delay_s)
    }
}
