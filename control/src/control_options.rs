//! The section `[control]` of a configuration: the loop, its law, and what estimates the motion.

use serde::{Deserialize, Serialize};

use crate::controller::{
    self, ControllerName, ControllerOptions, for_each_law, with_optional_laws,
};
use crate::estimator::EstimatorOptions;
use crate::options::{OptionError, Rule, check_options};
use crate::predictive::PredictiveOptions;

/// What estimates the motion and controls the position around an attitude law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LawSurroundings {
    /// The autopilot of [`crate::predictive`] around `oqtal-dt` and `mpc`, estimator and position loops around every other law.
    #[default]
    Own,
    /// The autopilot of [`crate::predictive`] around every law.
    Predictive,
}

macro_rules! define_section {
    ($($(#[$doc:meta])* $Variant:ident = $name:literal, $field:ident: $Options:ident => $Law:ident;)*) => {
        /// The section `[control]`. The default is for the Hummingbird in rate form.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
        pub struct ControlOptions {
            /// Rate of the loop \[Hz\].
            pub rate_hz: f64,
            /// The law that flies.
            pub controller: ControllerName,
            $($(#[$doc])* #[serde(rename = $name)] pub $field: controller::$Options,)*
            /// What is around the law.
            pub surroundings: LawSurroundings,
            /// Filter, reference model and position law of [`Autopilot`](crate::predictive::Autopilot), with which `oqtal-dt`
            /// flies in place of estimator and position loops, and every law if `surroundings` says so.
            pub predictive: PredictiveOptions,
            /// Estimator of velocity and body rate, for the other laws.
            pub estimator: EstimatorOptions,
        }

        impl Default for ControlOptions {
            fn default() -> Self {
                let ControllerOptions { controller, rate_hz, $($field),* } = Default::default();
                let (surroundings, predictive, estimator) = Default::default();
                Self { rate_hz, controller, $($field,)* surroundings, predictive, estimator }
            }
        }

        impl ControlOptions {
            /// The law that flies, and the options of every law.
            #[must_use]
            pub fn controller_options(&self) -> ControllerOptions {
                let Self { controller, rate_hz, $($field,)* .. } = *self;
                ControllerOptions { controller, rate_hz, $($field),* }
            }
        }
    };
}

for_each_law!(define_section);

impl ControlOptions {
    /// Whether the autopilot of [`crate::predictive`] is around the law that flies.
    #[must_use]
    pub fn is_predictive(&self) -> bool {
        self.controller.is_predictive() || self.surroundings == LawSurroundings::Predictive
    }

    /// Checks every option.
    ///
    /// # Errors
    /// The first option whose value is not allowed.
    pub fn check(&self) -> Result<(), OptionError> {
        check_options([("rate-hz", self.rate_hz, Rule::Between(1.0, 1000.0))])?;
        self.controller_options().check()?;
        self.predictive.check().map_err(|error| error.within("predictive"))?;
        self.estimator.check().map_err(|error| error.within("estimator"))
    }
}
