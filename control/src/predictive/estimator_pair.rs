//! Choice between an adapted model and a fixed one by the innovations of two estimators.
//!
//! Both predict the same poses. Half the difference of the squares of their normalised innovations, summed over some seconds, approximates
//! the logarithm of the likelihood ratio of the two models: if the fixed model is more likely, it is used and the adaptation restarts; the
//! adapted model is used again once it has been equally good for some time. The fixed model does not replace the adapted one while its own
//! innovations are larger than those of a correct model: a comparison of two wrong models is not conclusive.

/// Time constant with which evidence for one of the models decays \[s\].
const EVIDENCE_S: f64 = 3.0;

/// Logarithm of the likelihood ratio, fixed to adapted model \[-\], above which the fixed model is used, and below which the
/// adapted model may be used again.
const WORSE: f64 = 10.0;
const AS_GOOD: f64 = 4.0;

/// Mean normalised square of the innovations above which the fixed model does not describe the vehicle \[-\], and the time constant
/// of that mean \[s\].
const GOOD_FIT: f64 = 1.5;
const FIT_S: f64 = 1.0;

/// Time for which the adapted model must be equally good before it is used again \[s\].
const PROBATION_S: f64 = 2.0;

/// Square of an innovation over its variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalisedSquare {
    /// Sum over the components \[-\].
    pub sum: f64,
    /// Number of components \[-\].
    pub freedom: f64,
}

/// An estimator of a state with the parameters of its model.
pub trait AdaptiveEstimator: Copy {
    /// Interval that ends with a pose.
    type Interval<'a>;

    /// The estimator with its initial parameters, in the state of `other`.
    fn restarted(&self, other: &Self) -> Self;

    /// Takes the pose at the end of an interval; its innovation corrects the parameters like one of `scale` times the variance.
    fn take(&mut self, interval: &Self::Interval<'_>, scale: f64) -> NormalisedSquare;
}

/// Two estimators with the evidence for each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EstimatorPair<E> {
    adapted: E,
    fixed: E,
    /// Logarithm of the likelihood ratio of the last seconds, fixed to adapted model \[-\].
    evidence: f64,
    /// Mean normalised square of the innovations of the adapted and of the fixed model \[-\].
    fits: [f64; 2],
    /// Time for which the adapted model has been equally good while the fixed one is used \[s\]; `None` while the adapted one is
    /// used.
    probation_s: Option<f64>,
}

impl<E: AdaptiveEstimator> EstimatorPair<E> {
    /// A pair before its first pose, with the mean squares of its predecessor `before`, if any, since the noise of the poses has not
    /// changed.
    pub fn new([adapted, fixed]: [E; 2], before: Option<&Self>) -> Self {
        let fits = before.map_or([1.0; 2], |before| before.fits);
        Self { adapted, fixed, evidence: 0.0, fits, probation_s: None }
    }

    /// Both estimators.
    pub fn each(&mut self) -> [&mut E; 2] {
        [&mut self.adapted, &mut self.fixed]
    }

    /// The adapted estimator, unless the fixed model is used.
    pub fn used(&self) -> Option<&E> {
        self.probation_s.is_none().then_some(&self.adapted)
    }

    /// Takes the pose at the end of an interval of `dt_s` \[s\]; corrects the parameters only if `learns`.
    pub fn take(&mut self, interval: &E::Interval<'_>, dt_s: f64, learns: bool) {
        // If the innovations are too large for both models, the noise is greater than assumed.
        let scale = if learns { self.fits[0].min(self.fits[1]).max(1.0) } else { f64::INFINITY };
        let squares = [self.adapted.take(interval, scale), self.fixed.take(interval, scale)];
        let kept = (1.0 - dt_s / EVIDENCE_S).clamp(0.0, 1.0);
        // A sum that does not fall below zero detects a change early (Page, Biometrika 41, 1954).
        self.evidence =
            (self.evidence * kept + (squares[0].sum - squares[1].sum) / (2.0 * scale)).max(0.0);
        for (fit, NormalisedSquare { sum, freedom }) in self.fits.iter_mut().zip(squares) {
            *fit += (dt_s / FIT_S).min(1.0) * (sum / freedom - *fit);
        }
        self.select_model(dt_s);
    }

    fn select_model(&mut self, dt_s: f64) {
        self.probation_s = match self.probation_s {
            _ if self.evidence > WORSE && self.fits[1] < GOOD_FIT => {
                self.adapted = self.adapted.restarted(&self.fixed);
                self.evidence = 0.0;
                Some(0.0)
            }
            None => None,
            Some(_) if self.evidence > AS_GOOD => Some(0.0),
            Some(since_s) => Some(since_s + dt_s).filter(|since_s| *since_s < PROBATION_S),
        };
    }
}
