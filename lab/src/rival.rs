//! A law of `oqtal-rivals` as the external law of a flight in one process.

use nalgebra::Vector3;
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_bus::time::Span;
use oqtal_config::Config;
use oqtal_control::predictive::{Bias, ModelInput};
use oqtal_daemon::{ExternalLaw, QuestionView};
use oqtal_rivals::dfbc::{Dfbc, DfbcOptions};
use oqtal_rivals::l1::{L1Geometric, L1Options};
use oqtal_rivals::law::{RateVehicle, Rival, RivalTick};
use oqtal_rivals::nmpc::{Nmpc, NmpcOptions};

/// Knowledge of a law of the motion that it commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Knowledge {
    /// The motion estimated for now, as in the sources.
    Now,
    /// The motion predicted for the effect of the command.
    Effect,
    /// The same, with the disturbances that the prediction estimates.
    Disturbances,
}

impl Knowledge {
    /// All of them, least first.
    pub const ALL: [Self; 3] = [Self::Now, Self::Effect, Self::Disturbances];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Now => "as published",
            Self::Effect => "prediction",
            Self::Disturbances => "prediction and disturbances",
        }
    }
}

/// A law of the literature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RivalName {
    /// [`Nmpc`].
    Nmpc,
    /// [`Dfbc`].
    Dfbc,
    /// [`L1Geometric`].
    L1Geometric,
}

impl RivalName {
    /// All laws.
    pub const ALL: [Self; 3] = [Self::Nmpc, Self::Dfbc, Self::L1Geometric];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nmpc => "nmpc",
            Self::Dfbc => "dfbc-indi",
            Self::L1Geometric => "l1-geometric",
        }
    }

    /// Ranges of the gains in a search \[units of the options\].
    pub fn ranges(self) -> &'static [[f64; 2]] {
        match self {
            Self::Nmpc => &NmpcOptions::RANGES,
            Self::Dfbc => &DfbcOptions::RANGES,
            Self::L1Geometric => &L1Options::RANGES,
        }
    }

    /// Gains found by the search of docs/rivals.md, for a law with this knowledge \[units of the options\].
    pub fn gains(self, knowledge: Knowledge) -> &'static [f64] {
        match self {
            Self::Nmpc => &NMPC[knowledge as usize],
            Self::Dfbc => &DFBC[knowledge as usize],
            Self::L1Geometric => &L1[knowledge as usize],
        }
    }

    /// The law with these gains, as many as it has ranges \[units of the options\].
    pub fn with_gains(self, gains: &[f64]) -> Box<dyn Rival> {
        match self {
            Self::Nmpc => Box::new(Nmpc::new(NmpcOptions::of(&array(gains)))),
            Self::Dfbc => Box::new(Dfbc::new(DfbcOptions::of(&array(gains)))),
            Self::L1Geometric => Box::new(L1Geometric::new(L1Options::of(&array(gains)))),
        }
    }
}

/// The first `N` gains.
fn array<const N: usize>(gains: &[f64]) -> [f64; N] {
    std::array::from_fn(|index| gains[index])
}

/// Gains of [`NmpcOptions::of`], by knowledge.
const NMPC: [[f64; 8]; 3] = [
    [267.005, 22.973, 1.825, 189.148, 0.832, 2.602, 37.79, 8.91],
    [262.905, 2.44, 2.936, 126.918, 0.547, 1.271, 26.101, 8.656],
    [58.467, 1.895, 3.976, 233.737, 0.192, 0.1, 95.432, 0.688],
];
/// Gains of [`DfbcOptions::of`], by knowledge.
const DFBC: [[f64; 9]; 3] = [
    [12.834, 27.759, 3.585, 4.899, 470.244, 23.378, 33.325, 23.63, 4.371],
    [15.573, 24.992, 5.651, 8.671, 475.122, 9.328, 45.414, 10.832, 6.783],
    [17.842, 13.034, 19.579, 9.496, 600.0, 42.556, 52.003, 34.37, 2.897],
];
/// Gains of [`L1Options::of`], by knowledge.
const L1: [[f64; 8]; 3] = [
    [3.286, 12.693, 6.086, 5.48, 5.993, 1.467, 18.504, 19.134],
    [14.286, 5.062, 3.925, 7.378, 9.054, 1.789, 3.466, 6.683],
    [60.0, 24.229, 4.471, 11.498, 40.0, 5.175, 3.145, 0.349],
];

/// A law in a flight.
pub struct RivalLaw {
    law: Box<dyn Rival>,
    knowledge: Knowledge,
    greatest_rate: Vector3<f64>,
    greatest_thrust_n: f64,
    period_s: f64,
    /// The command of this tick; `None` for a vehicle that is not commanded by rates.
    command: Option<ModelInput>,
}

impl RivalLaw {
    /// `law` with this knowledge in a flight of `config`.
    pub fn new(law: Box<dyn Rival>, knowledge: Knowledge, config: &Config) -> Self {
        Self {
            law,
            knowledge,
            greatest_rate: config.vehicle.rate_authority_rad_s.into(),
            greatest_thrust_n: config.vehicle.max_thrust_n,
            period_s: 1.0 / config.control.rate_hz,
            command: None,
        }
    }

    fn commanded(&mut self, view: &QuestionView) -> Option<ModelInput> {
        let QuestionView { now, ahead, tracker, .. } = *view;
        let now_s = now.seconds();
        // Adapted gains turn a command into the rate that the model follows.
        let gain = tracker.effect().gain;
        let greatest_rate = self.greatest_rate.component_mul(&gain);
        let vehicle = RateVehicle::new(tracker.model(), greatest_rate, self.greatest_thrust_n)?;
        let measured = tracker.motion_at(now_s)?;
        let (motion, delay_s) = match self.knowledge {
            Knowledge::Now => (&measured, 0.0),
            Knowledge::Effect | Knowledge::Disturbances => (ahead, tracker.effect_delay_s()),
        };
        let bias = match self.knowledge {
            Knowledge::Disturbances => tracker.bias(),
            Knowledge::Now | Knowledge::Effect => Bias::default(),
        };
        let reference = |ahead_s: f64| {
            let at = now + Span::from_seconds(delay_s + ahead_s);
            (view.course)(at).unwrap_or(*view.reference)
        };
        let command = self.law.command(&RivalTick {
            vehicle: &vehicle,
            motion,
            bias,
            measured: &measured,
            acting: tracker.acting(now_s).0,
            dt_s: self.period_s,
            reference: &reference,
        });
        let demand = command.demand.component_div(&gain);
        Some(ModelInput { demand, ..command })
    }
}

impl ExternalLaw for RivalLaw {
    fn reset(&mut self) {
        self.law.reset();
    }

    fn look(&mut self, view: &QuestionView) {
        self.command = self.commanded(view);
    }

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let command = self.command?;
        Some(ExternalV1 {
            sequence: state.sequence,
            rate: command.demand.into(),
            thrust: command.thrust_n,
            ..ExternalV1::default()
        })
    }
}
