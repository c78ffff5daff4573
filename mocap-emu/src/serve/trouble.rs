//! Emulated network faults: lost, repeated and reordered frames.

use oqtal_config::ServeOptions;
use oqtal_runtime::random::{Generator, RandomSource, stream};
use rand::RngExt;

use super::feed::ServedFrame;

/// Network faults; they affect all clients alike.
#[derive(Debug)]
pub struct NetworkTrouble {
    loss_probability: f64,
    repeat_probability: f64,
    swap_probability: f64,
    generator: Generator,
    /// Frame that is held back until the next one is sent.
    held: Option<ServedFrame>,
}

impl NetworkTrouble {
    /// Network faults of a configuration.
    pub fn new(options: &ServeOptions, seed: u64) -> Self {
        Self {
            loss_probability: options.loss_probability,
            repeat_probability: options.repeat_probability,
            swap_probability: options.swap_probability,
            generator: stream(seed, RandomSource::Network),
            held: None,
        }
    }

    /// Forwards `frame`: once, twice, after the next one, or never.
    pub fn forward(&mut self, frame: ServedFrame, send: &mut dyn FnMut(&ServedFrame)) {
        let [loss, repeat, swap] = [(); 3].map(|()| self.generator.random::<f64>());
        if loss < self.loss_probability {
            return;
        }
        if swap < self.swap_probability && self.held.is_none() {
            self.held = Some(frame);
            return;
        }
        send(&frame);
        if repeat < self.repeat_probability {
            send(&frame);
        }
        if let Some(overtaken) = self.held.take() {
            send(&overtaken);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::time::Time;
    use oqtal_config::Config;

    /// Numbers of the forwarded frames of 10 000.
    fn sent(probabilities: [f64; 3]) -> Vec<u64> {
        let mut options = Config::default().mocap.serve;
        [options.loss_probability, options.repeat_probability, options.swap_probability] =
            probabilities;
        let (mut trouble, mut sent) = (NetworkTrouble::new(&options, 1), Vec::new());
        for number in 1..=10_000 {
            let frame = ServedFrame::new(number, Time::VIRTUAL_START);
            trouble.forward(frame, &mut |frame| sent.push(frame.number));
        }
        sent
    }

    #[test]
    fn frames_are_lost_repeated_and_swapped_as_configured_only() {
        assert_eq!(sent([0.0; 3]), (1..=10_000).collect::<Vec<_>>());
        let lost = 10_000 - sent([0.01, 0.0, 0.0]).len();
        let repeated = sent([0.0, 0.01, 0.0]).len() - 10_000;
        let swapped = sent([0.0, 0.0, 0.01]);
        let overtaken = swapped.windows(2).filter(|pair| pair[1] < pair[0]).count();
        // Three standard deviations of a binomial distribution: 30.
        for count in [lost, repeated, overtaken] {
            assert!((70..=130).contains(&count), "{lost} {repeated} {overtaken}");
        }
        assert!(swapped.len() >= 9999);
    }
}
