//! `[control]`: the loop, its attitude law and its estimator.

use oqtal_control::controller::{
    ControllerName, ControllerOptions, GeometricOptions, LqrOptions, OqtalDtOptions, OqtalOptions,
    PidOptions,
};
use oqtal_control::estimator::EstimatorOptions;
use oqtal_control::options::{OptionError, Rule, check_options};
use oqtal_control::predictive::PredictiveOptions;
use serde::{Deserialize, Serialize};

/// `[control]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Control {
    /// Rate of the loop \[Hz\].
    pub rate_hz: f64,
    /// The attitude law in use.
    pub controller: ControllerName,
    /// `[control.pid]`.
    pub pid: PidOptions,
    /// `[control.lqr]`.
    pub lqr: LqrOptions,
    /// `[control.oqtal]`.
    pub oqtal: OqtalOptions,
    /// `[control.oqtal-dt]`.
    pub oqtal_dt: OqtalDtOptions,
    /// `[control.geometric]`.
    pub geometric: GeometricOptions,
    /// `[control.predictive]`: estimation, prediction and position law around `oqtal-dt`.
    pub predictive: PredictiveOptions,
    /// `[control.estimator]`.
    pub estimator: EstimatorOptions,
}

impl Control {
    pub(crate) fn check(&self) -> Result<(), OptionError> {
        check_options([("rate-hz", self.rate_hz, Rule::Between(1.0, 1000.0))])
            .and_then(|()| self.pid.check().map_err(|error| error.within("pid")))
            .and_then(|()| self.lqr.check().map_err(|error| error.within("lqr")))
            .and_then(|()| self.oqtal.check().map_err(|error| error.within("oqtal")))
            .and_then(|()| self.oqtal_dt.check().map_err(|error| error.within("oqtal-dt")))
            .and_then(|()| self.geometric.check().map_err(|error| error.within("geometric")))
            .and_then(|()| self.predictive.check().map_err(|error| error.within("predictive")))
            .and_then(|()| self.estimator.check().map_err(|error| error.within("estimator")))
            .map_err(|error| error.within("control"))
    }

    /// The attitude law in use, and the options of all laws.
    #[must_use]
    pub fn controller_options(&self) -> ControllerOptions {
        let Self { controller, rate_hz, pid, lqr, oqtal, oqtal_dt, geometric, .. } = *self;
        ControllerOptions { controller, rate_hz, pid, lqr, oqtal, oqtal_dt, geometric }
    }
}
