//! Radio between the bus and the simulated vehicle: delay, jitter, burst losses, and injected faults.
//!
//! Losses follow the channel of Gilbert (*Capacity of a burst-noise channel*, Bell System Technical Journal 39, 1960): in its bad
//! state every command is lost, in its good state none is lost.

use std::collections::VecDeque;

use oqtal_bus::message::{CommandV1, Header};
use oqtal_bus::time::{Span, Time};
use oqtal_config::PlantOptions;
use oqtal_runtime::faults::RadioDisturbance;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;

/// Command in transit on the radio.
#[derive(Clone, Copy, Debug)]
pub struct OnAir {
    /// Instant at which it takes effect.
    pub acts_at: Time,
    /// Header of the command.
    pub header: Header,
    /// The command.
    pub command: CommandV1,
}

/// Burst losses of commands.
#[derive(Clone, Debug)]
pub struct CommandLoss {
    generator: Generator,
    /// Probability that a burst begins with a command \[-\].
    begins: f64,
    /// Probability that a burst continues with the next command \[-\].
    continues: f64,
    is_bad: bool,
}

impl CommandLoss {
    /// Losses of `plant` under `seed`.
    pub fn new(plant: &PlantOptions, seed: u64) -> Self {
        let PlantOptions { command_loss_probability: share, command_loss_burst: burst, .. } = plant;
        Self {
            generator: stream(seed, RandomSource::CommandLoss),
            // In the long run the channel is in its bad state for `share` of the commands.
            begins: share / ((1.0 - share) * burst),
            continues: 1.0 - burst.recip(),
            is_bad: false,
        }
    }

    /// Whether the next command is lost.
    pub fn next_is_lost(&mut self) -> bool {
        if self.begins > 0.0 {
            let probability = if self.is_bad { self.continues } else { self.begins };
            self.is_bad = self.generator.random::<f64>() < probability;
        }
        self.is_bad
    }
}

/// The commands on their way to the vehicle.
#[derive(Clone, Debug)]
pub struct CommandRadio {
    on_air: VecDeque<OnAir>,
    delay: Span,
    /// Delay from the reported effect of a command to the real one.
    hidden_delay: Span,
    /// Greatest additional delay, and the generator that draws it.
    jitter: (Span, Generator),
    loss: CommandLoss,
    lost: u64,
    /// Faults of the radio, and the generator that they use.
    disturbed: (RadioDisturbance, Generator),
}

impl CommandRadio {
    /// The radio of `plant` under `seed`.
    pub fn new(plant: &PlantOptions, seed: u64) -> Self {
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        Self {
            // Few: a ring uses all of its memory in turn, and the lanes of an environment share a cache.
            on_air: VecDeque::with_capacity(4),
            delay: millis(plant.command_delay_ms),
            hidden_delay: millis(plant.hidden_delay_ms),
            jitter: (millis(plant.command_jitter_ms), stream(seed, RandomSource::CommandJitter)),
            loss: CommandLoss::new(plant, seed),
            lost: 0,
            disturbed: (RadioDisturbance::default(), stream(seed, RandomSource::RadioFault)),
        }
    }

    /// Disturbs the radio from now on.
    pub fn disturb(&mut self, disturbance: RadioDisturbance) {
        self.disturbed.0 = disturbance;
    }

    /// Instant at which the next command takes effect; `None` without a command in transit.
    pub fn next_effect(&self) -> Option<Time> {
        self.on_air.front().map(|on_air| on_air.acts_at)
    }

    /// Replaces every command on its way by one that disarms.
    pub fn disarm(&mut self) {
        self.on_air.iter_mut().for_each(|on_air| on_air.command = CommandV1::default());
    }

    /// Number of commands lost so far \[-\].
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Sends a command at `now`, unless it is lost.
    pub fn send(&mut self, now: Time, header: Header, command: CommandV1) {
        let is_lost = self.loss.next_is_lost();
        let (disturbance, generator) = &mut self.disturbed;
        let is_disturbed = disturbance.loss_probability > 0.0
            && generator.random::<f64>() < disturbance.loss_probability;
        let (jitter, generator) = &mut self.jitter;
        let jitter = match *jitter > Span::ZERO {
            true => jitter.scaled(generator.random::<f64>()),
            false => Span::ZERO,
        };
        if is_lost || is_disturbed {
            self.lost += 1;
            return;
        }
        // Commands keep their order, also behind a delayed one.
        let arrival = now + self.delay + self.hidden_delay + disturbance.delay + jitter;
        let acts_at = self.on_air.back().map_or(arrival, |last| arrival.max(last.acts_at));
        self.on_air.push_back(OnAir { acts_at, header, command });
    }

    /// The next command that takes effect by `now`, and the instant that the vehicle reports as its effect.
    pub fn receive(&mut self, now: Time) -> Option<(OnAir, Time)> {
        // Most calls find nothing due: only then is the command copied.
        self.next_effect().filter(|acts_at| *acts_at <= now)?;
        let next = self.on_air.pop_front()?;
        Some((next, next.acts_at - self.hidden_delay))
    }
}
