//! Compares the rotation seen by the cameras with that of one source: the vehicle's gyroscope, or the commands sent.
//!
//! A rotation that the source does not cover is left out of both, so that a gap in the reports costs only the evidence of its time.

use nalgebra::Vector3;

use super::drift::{DriftLimit, DriftTest};
use super::response::{ResponseLimit, ResponseTest};
use super::rotation_pair::RotationPair;
use super::washout::WashOut;
use crate::delayed_mean::DelayedMean;

/// Least deviation of rotations that agree \[rad\]: gyroscope and model are not exact.
pub(super) const LEAST_DEVIATION_RAD: f64 = 0.002;
/// Evidence, as a share of its limit, above which the noise is not updated \[-\].
pub(super) const QUIET: f64 = 0.5;
/// Least deviation of agreeing rotations over the measured noise \[-\].
const NOISE_SHARE: f64 = 1.2;
/// Time constant of the deviation between rotations that agree \[s\].
const DEVIATION_S: f64 = 2.0;
/// Time in the air after which rotations by commands are compared, and the deviation from those of a gyroscope is known \[s\].
const SETTLED_S: f64 = 2.5;

/// Source of the rotation with which that of the poses is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// The rates that the vehicle's gyroscope reports.
    Gyroscope,
    /// The commands sent.
    Commands,
}

/// Rotation of the vehicle between two poses, by a source.
#[derive(Clone, Copy, Debug)]
pub(super) struct DrivenRotation {
    pub(super) source: Source,
    /// \[rad, body axes\].
    pub(super) turn: Vector3<f64>,
}

/// Accuracy of a source.
#[derive(Clone, Copy, Debug)]
pub(super) struct Accuracy {
    drift: DriftLimit,
    response: ResponseLimit,
    /// Factor of the limit of the response \[-\], and before [`SETTLED_S`]; `None` if rotations are not compared then.
    factor: f64,
    early_factor: Option<f64>,
}

impl Accuracy {
    /// Accuracy of the gyroscope. Early, the noise of the poses is not measured yet, and may exceed the configured one.
    pub(super) const GYROSCOPE: Self = Self {
        drift: DriftLimit::GYROSCOPE,
        response: ResponseLimit::GYROSCOPE,
        factor: 1.0,
        early_factor: Some(2.0),
    };
    /// Accuracy of the commands. The bias of the rate that they counteract is washed out first.
    pub(super) const COMMANDS: Self = Self {
        drift: DriftLimit::COMMANDS,
        response: ResponseLimit::COMMANDS,
        factor: 2.5,
        early_factor: None,
    };
}

/// The test against one source.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotationTest {
    accuracy: Accuracy,
    limit: f64,
    /// Time of the rotations in the air \[s\].
    airborne_s: f64,
    seen: WashOut,
    driven: WashOut,
    /// Mean square of the difference of both \[rad^2\].
    deviation: DelayedMean,
    response: ResponseTest,
    drift: DriftTest,
    /// Evidence of the response over its limit \[-\].
    pub(super) response_evidence: f64,
    /// Evidence of a drift over its limit \[-\].
    pub(super) drift_evidence: f64,
}

impl RotationTest {
    /// A test with the deviation `deviation_rad` between rotations that agree \[rad\] until it is measured.
    pub(super) fn new(accuracy: Accuracy, limit: f64, deviation_rad: f64) -> Self {
        Self {
            accuracy,
            limit,
            airborne_s: 0.0,
            seen: WashOut::default(),
            driven: WashOut::default(),
            deviation: DelayedMean::new(deviation_rad * deviation_rad, DEVIATION_S),
            response: ResponseTest::default(),
            drift: DriftTest::default(),
            response_evidence: 0.0,
            drift_evidence: 0.0,
        }
    }

    /// Takes the rotations of an interval; `noise_rad` is the noise of the attitude \[rad\]. Returns them washed out; `None` if they are
    /// not compared yet.
    pub(super) fn take(
        &mut self,
        pair: &RotationPair,
        noise_rad: f64,
        is_airborne: bool,
    ) -> Option<RotationPair> {
        let RotationPair { seen, driven, t_s, dt_s } = *pair;
        self.airborne_s += dt_s;
        let drift = self.drift.take(pair, &self.accuracy.drift, noise_rad);
        let (seen, driven) = (self.seen.take(&seen, dt_s), self.driven.take(&driven, dt_s));
        let washed_out = RotationPair { seen, driven, ..*pair };
        self.deviation.take(t_s, (seen - driven).norm_squared() / 3.0);
        let is_settled = self.airborne_s >= SETTLED_S;
        let factor =
            if is_settled { Some(self.accuracy.factor) } else { self.accuracy.early_factor };
        let Some(factor) = factor.filter(|_| is_airborne) else {
            self.drift.restart();
            return None;
        };
        self.drift_evidence = drift;
        let least = LEAST_DEVIATION_RAD.max(NOISE_SHARE * noise_rad);
        let variance = self.deviation.mean().max(least * least);
        let sum = self.response.take(&washed_out, &self.accuracy.response, variance);
        self.response_evidence = sum / (factor * self.limit);
        if self.response_evidence > QUIET {
            self.deviation.discard();
        }
        Some(washed_out)
    }

    /// Time since the poses were last found to follow the vehicle \[s\].
    pub(super) fn unconfirmed_s(&self) -> f64 {
        self.response.unconfirmed_s()
    }

    /// Discards the latest deviations: they are those of a fault.
    pub(super) fn discard_deviations(&mut self) {
        self.deviation.discard();
    }

    /// Discards the evidence that the rotation seen is not that of the vehicle.
    pub(super) fn discard_evidence(&mut self) {
        (self.response, self.response_evidence) = (ResponseTest::default(), 0.0);
    }

    /// Discards all evidence: the vehicle is on the ground.
    pub(super) fn clear(&mut self) {
        self.discard_evidence();
        self.drift.restart();
        self.drift_evidence = 0.0;
        self.airborne_s = 0.0;
        self.deviation.discard();
    }

    /// Discards the rotations: the poses have a gap, or the vehicle cannot follow its commands.
    pub(super) fn begin_again(&mut self) {
        self.airborne_s = 0.0;
        (self.seen, self.driven) = (WashOut::default(), WashOut::default());
        self.drift = DriftTest::default();
    }
}
