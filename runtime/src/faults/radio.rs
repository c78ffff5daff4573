//! Faults of the simulated radio, between the receipt of a command and its effect.

use oqtal_bus::error::BusError;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::transport::Transport;
use oqtal_config::{Config, Fault, FaultKind, FaultTarget};

use super::clock::{ArmingWatch, interval, is_within};

/// Disturbance of the radio at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RadioDisturbance {
    /// Additional latency.
    pub delay: Span,
    /// Probability that a command or a frame is lost, in addition to the radio's own losses \[0..1\].
    pub loss_probability: f64,
}

/// The faults of the radio in one flight.
#[derive(Debug)]
pub struct RadioFaults<T: Transport> {
    arming: ArmingWatch<T>,
    faults: Vec<Fault>,
}

impl<T: Transport> RadioFaults<T> {
    /// Faults of `config` with the target `radio`.
    ///
    /// # Errors
    /// The transport failed.
    pub fn open(bus: &T, config: &Config) -> Result<Self, BusError> {
        let all = config.fault.inject.iter();
        let faults: Vec<Fault> =
            all.filter(|fault| fault.target == FaultTarget::Radio).cloned().collect();
        Ok(Self { arming: ArmingWatch::open(bus, !faults.is_empty())?, faults })
    }

    /// The disturbance at `now`.
    ///
    /// # Errors
    /// The transport failed.
    pub fn at(&mut self, now: Time) -> Result<RadioDisturbance, BusError> {
        let mut disturbance = RadioDisturbance::default();
        let Some(armed_at) = self.arming.armed_at()? else { return Ok(disturbance) };
        let acts =
            |fault: &&Fault| is_within(interval(fault.at_s, fault.duration_s, armed_at), now);
        for fault in self.faults.iter().filter(acts) {
            let RadioDisturbance { delay, loss_probability } = &mut disturbance;
            match fault.kind {
                FaultKind::Delayed => *delay = *delay + Span::from_seconds(fault.value() * 1e-3),
                FaultKind::Off => *loss_probability = 1.0,
                FaultKind::Intermittent => {
                    *loss_probability = loss_probability.max(fault.value() / 100.0);
                }
                _ => {}
            }
        }
        Ok(disturbance)
    }
}
