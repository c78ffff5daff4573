//! Sent commands: those in effect, those in transit, and those that were lost.
//!
//! Commands use one connection and keep their order, and a vehicle that has reported a command does not apply an older one: an
//! older command without a report was lost. So was a command whose report is overdue, as long as reports arrive at all. A command
//! whose report is not yet due counts as lost with the recently measured probability of a loss after a lost command, or after a
//! received one (Gilbert, *Capacity of a burst-noise channel*, Bell System Technical Journal 39, 1960). The model applies the
//! expected input, which gives the expected motion of a linear vehicle.

use nalgebra::Vector3;

use super::model::{Bias, ModelInput, Motion, VehicleModel};
use super::ring::Ring;

/// Weight of a new measurement in the low-pass on the delay \[-\]: at 60 Hz a time constant of 0.16 s.
const DELAY_WEIGHT: f64 = 0.1;

/// Greatest plausible delay \[s\]; a longer one is attributed to a wrong stamp and ignored.
const LONGEST_DELAY_S: f64 = 0.25;

/// Weight of a command in the low-pass on the losses \[-\]: a memory of some hundred commands.
const LOSS_WEIGHT: f64 = 0.01;

/// Initial probability of a further loss after the first one \[-\].
const INITIAL_LOSS: f64 = 0.5;

/// Reduction, with each report, of the number of commands after which a report counts as overdue \[-\].
const TIMEOUT_DECAY: f64 = 0.02;

/// A command that was sent.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sent {
    sequence: u64,
    sent_s: f64,
    acts_s: f64,
    input: ModelInput,
    /// Whether the command is known to be applied or lost.
    settled: bool,
    /// Probability that the command was lost \[-\].
    loss: f64,
}

/// A vehicle's report that it applied a command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandReport {
    /// Sequence of the command.
    pub sequence: u64,
    /// Instant of its effect \[s\].
    pub acts_s: f64,
    /// Whether no report between the previous one and this one was missed: commands in between were then lost.
    pub follows: bool,
}

/// Correction of the reported effect of commands on the rotation. The thrust is not corrected: a rate loop around slow rotors has
/// a second lag, which the estimator identifies as a delay and which the thrust does not have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandEffect {
    /// Delay from the reported to the real effect of the demand and the attitude \[s\].
    pub delay_s: f64,
    /// Factor of the demand about each axis \[-, body axes\].
    pub gain: Vector3<f64>,
}

impl Default for CommandEffect {
    fn default() -> Self {
        Self { delay_s: 0.0, gain: Vector3::repeat(1.0) }
    }
}

/// The newest commands with the times at which they take effect, and the measured delay from sending to effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandHistory {
    sent: Ring<Sent>,
    delay_s: f64,
    effect: CommandEffect,
    /// Probability of a loss after a received command, and after a lost one \[-\].
    losses: [f64; 2],
    /// Whether the newest settled command was lost.
    last_was_lost: bool,
    /// Maximum number of commands sent after a command before its report arrives \[-\]; `None` before the first report.
    report_timeout: Option<f64>,
}

impl CommandHistory {
    /// Empty history. `delay_s` is the initial delay from sending to effect \[s\].
    pub fn new(delay_s: f64) -> Self {
        Self {
            sent: Ring::new(),
            delay_s,
            effect: CommandEffect::default(),
            losses: [0.0, INITIAL_LOSS],
            last_was_lost: false,
            report_timeout: None,
        }
    }

    /// Measured delay from sending a command to its effect, by the reports \[s\].
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Delay from sending a command to its effect on the rotation, including the part hidden from reports \[s\].
    pub fn effect_delay_s(&self) -> f64 {
        self.delay_s + self.effect.delay_s
    }

    /// Recently measured probability that a command is lost after a received one, and after a lost one \[-\].
    pub fn loss_probabilities(&self) -> [f64; 2] {
        self.losses
    }

    /// The correction of the reported effect of commands.
    pub fn effect(&self) -> &CommandEffect {
        &self.effect
    }

    /// Sets the correction of the reported effect of commands.
    pub fn set_effect(&mut self, effect: CommandEffect) {
        self.effect = effect;
    }

    /// Records a command sent at `sent_s` \[s\]. A command out of order is ignored.
    pub fn push(&mut self, sequence: u64, sent_s: f64, input: ModelInput) {
        let newest = self.sent.newest_first().next();
        let follows = newest.is_none_or(|last| last.sent_s <= sent_s);
        if follows && sent_s.is_finite() {
            // Commands use one connection, so their order is kept.
            let acts_s = (sent_s + self.delay_s).max(newest.map_or(sent_s, |last| last.acts_s));
            self.sent.push(Sent { sequence, sent_s, acts_s, input, settled: false, loss: 0.0 });
            self.update_losses(1);
        }
    }

    /// Records that a command took effect.
    pub fn applied(&mut self, report: CommandReport) {
        let CommandReport { sequence, acts_s, follows } = report;
        let Some(newer) = self.sent.newest_first().position(|sent| sent.sequence == sequence)
        else {
            return;
        };
        let Some(sent) = self.sent.back_mut(newer + 1) else { return };
        let measured_s = acts_s - sent.sent_s;
        if !(0.0..=LONGEST_DELAY_S).contains(&measured_s) {
            return;
        }
        sent.acts_s = acts_s;
        self.delay_s += DELAY_WEIGHT * (measured_s - self.delay_s);
        let open = self.open_until();
        if newer < open {
            // If reports are missed, they arrive after more commands.
            let waited = if follows { newer } else { open };
            let timeout = self.report_timeout.map_or(0.0, |timeout| timeout - TIMEOUT_DECAY);
            self.report_timeout = Some(timeout.max(waited as f64));
            self.settle(newer + 1, follows);
            self.update_losses(0);
        }
    }

    /// Marks commands with overdue reports as lost; to be called when the next command is to be sent.
    pub fn expect_reports(&mut self) {
        self.update_losses(0);
    }

    /// Settles the command sent `back` commands ago as applied, and earlier ones as lost unless the vehicle may have reported
    /// them.
    fn settle(&mut self, back: usize, follows: bool) {
        for older in (back..=self.open_until()).rev() {
            let is_lost = follows && older > back;
            let Some(sent) = self.sent.back_mut(older) else { continue };
            (sent.settled, sent.loss) = (true, f64::from(u8::from(is_lost)));
            let after = &mut self.losses[usize::from(self.last_was_lost)];
            *after += LOSS_WEIGHT * (f64::from(u8::from(is_lost)) - *after);
            self.last_was_lost = is_lost;
        }
    }

    /// Number of the newest commands that are not yet settled \[-\].
    fn open_until(&self) -> usize {
        self.sent.newest_first().take_while(|sent| !sent.settled).count()
    }

    /// Sets the loss probabilities of the unsettled commands, oldest first. `sent` is the number of commands sent since the last
    /// report was due \[-\].
    fn update_losses(&mut self, sent: usize) {
        let Some(timeout) = self.report_timeout else { return };
        let overdue = timeout.ceil() as usize + 1 + sent;
        let [after_arrival, after_loss] = self.losses;
        let mut loss = 0.0;
        for back in (1..=self.open_until()).rev() {
            loss = loss * after_loss + (1.0 - loss) * after_arrival;
            if back >= overdue {
                loss = 1.0;
            }
            if let Some(open) = self.sent.back_mut(back) {
                open.loss = loss;
            }
        }
    }

    /// Propagates `motion` from `from_s` \[s\] to `to_s` \[s\] under the commands in effect.
    pub fn propagate(
        &self,
        model: &VehicleModel,
        (motion, bias): (&Motion, &Bias),
        (from_s, to_s): (f64, f64),
    ) -> Motion {
        let (mut motion, mut t_s) = (*motion, from_s);
        while t_s < to_s {
            let (input, until_s) = self.acting(t_s);
            let end_s = until_s.min(to_s);
            motion = model.advance(&motion, &input, bias, end_s - t_s);
            t_s = end_s;
        }
        motion
    }

    /// Expected input in effect at `t_s` \[s\] and the end of its effect \[s\]; demand and attitude are corrected by
    /// [`Self::effect`], thrust is as reported; zero before the first command, and the oldest of those kept where older
    /// ones were dropped.
    pub(super) fn acting(&self, t_s: f64) -> (ModelInput, f64) {
        let CommandEffect { delay_s, gain } = self.effect;
        let (turning, turning_until_s) = self.reported(t_s, delay_s);
        let (lifting, lifting_until_s) = self.reported(t_s, 0.0);
        let demand = turning.demand.component_mul(&gain);
        let input = ModelInput { demand, attitude: turning.attitude, thrust_n: lifting.thrust_n };
        (input, turning_until_s.min(lifting_until_s))
    }

    /// Expected input in effect at `t_s` \[s\] and the end of its effect \[s\], if commands take effect `delay_s` \[s\] after the
    /// reported instant; zero before the first command.
    pub fn reported(&self, t_s: f64, delay_s: f64) -> (ModelInput, f64) {
        let mut until_s = f64::INFINITY;
        let mut commands = self.sent.newest_first();
        let acting = commands.find(|sent| {
            let acts = sent.acts_s + delay_s <= t_s;
            if !acts {
                until_s = until_s.min(sent.acts_s + delay_s);
            }
            acts
        });
        let Some(acting) = acting.or_else(|| self.sent.oldest_if_full()) else {
            return (ModelInput::default(), until_s);
        };
        let (mut input, mut loss) = (acting.input, acting.loss);
        for older in commands {
            if loss <= 0.0 {
                break;
            }
            // The older command is in effect if all newer ones were lost.
            let share = loss * (1.0 - older.loss);
            input = input.towards(&older.input, share / (1.0 - loss + share).max(f64::EPSILON));
            loss *= older.loss;
        }
        (input, until_s)
    }
}
