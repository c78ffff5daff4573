//! The commands already sent: those that act on the vehicle now and those still on the way.

use super::model::{Bias, ModelInput, Motion, VehicleModel};
use super::ring::Ring;

/// Weight of a new measurement in the low-pass on the delay \[-\]: at 60 Hz a time constant of 0.16 s.
const DELAY_WEIGHT: f64 = 0.1;

/// Greatest plausible delay \[s\]; a longer one is taken for a wrong stamp and ignored.
const LONGEST_DELAY_S: f64 = 0.25;

/// A command that was sent.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sent {
    sequence: u64,
    sent_s: f64,
    acts_s: f64,
    input: ModelInput,
}

/// The newest commands with the times at which they take effect, and the measured delay from sending to effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandHistory {
    sent: Ring<Sent>,
    delay_s: f64,
}

impl CommandHistory {
    /// An empty history. `delay_s` is the delay from sending to effect until one is measured \[s\].
    #[must_use]
    pub fn new(delay_s: f64) -> Self {
        Self { sent: Ring::new(), delay_s }
    }

    /// Measured delay from sending a command to its effect \[s\].
    #[must_use]
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Records a command sent at `sent_s` \[s\]. A command that does not follow the last one is ignored.
    pub fn push(&mut self, sequence: u64, sent_s: f64, input: ModelInput) {
        let newest = self.sent.newest_first().next();
        let follows = newest.is_none_or(|last| last.sent_s <= sent_s);
        if follows && sent_s.is_finite() {
            // Commands use one connection, so their order is kept.
            let acts_s = (sent_s + self.delay_s).max(newest.map_or(sent_s, |last| last.acts_s));
            self.sent.push(Sent { sequence, sent_s, acts_s, input });
        }
    }

    /// Records that a command took effect at `acts_s` \[s\].
    pub fn applied(&mut self, sequence: u64, acts_s: f64) {
        let Some(sent) = self.sent.newest_mut(|sent| sent.sequence == sequence) else {
            return;
        };
        let measured_s = acts_s - sent.sent_s;
        if (0.0..=LONGEST_DELAY_S).contains(&measured_s) {
            sent.acts_s = acts_s;
            self.delay_s += DELAY_WEIGHT * (measured_s - self.delay_s);
        }
    }

    /// Propagates `motion` from `from_s` \[s\] to `to_s` \[s\] under the commands that act in between.
    #[must_use]
    pub fn propagate(
        &self,
        model: &VehicleModel,
        (motion, bias): (&Motion, &Bias),
        (from_s, to_s): (f64, f64),
    ) -> Motion {
        let (mut motion, mut t_s) = (*motion, from_s);
        while t_s < to_s {
            let (input, until_s) = self.at(t_s);
            let end_s = until_s.min(to_s);
            motion = model.advance(&motion, &input, bias, end_s - t_s);
            t_s = end_s;
        }
        motion
    }

    /// The input that acts at `t_s` \[s\] and the time until which it acts \[s\]; zero before the first command.
    fn at(&self, t_s: f64) -> (ModelInput, f64) {
        let mut until_s = f64::INFINITY;
        for sent in self.sent.newest_first() {
            if sent.acts_s <= t_s {
                return (sent.input, until_s);
            }
            until_s = until_s.min(sent.acts_s);
        }
        (ModelInput::default(), until_s)
    }
}
