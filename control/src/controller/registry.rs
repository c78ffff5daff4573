//! What follows from the table of the laws in `controller/mod.rs`: their names, the options of all of them, and the law that a
//! configuration names.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::input::InputForm;
use super::law::{AttitudeLaw, LawOptions, SearchRange};
use crate::options::OptionError;
use crate::tracking_error::{AttitudeReference, AttitudeState};

macro_rules! define_registry {
    ($($(#[$doc:meta])* $Variant:ident = $name:literal, $field:ident: $Options:ident => $Law:ident;)*) => {
        /// Name of an attitude law.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
        pub enum ControllerName {
            $($(#[$doc])* #[serde(rename = $name)] $Variant,)*
        }

        impl ControllerName {
            /// Every law, in the order of the table.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$Variant),*];

            /// The names of [`ALL`](Self::ALL) in a configuration.
            pub const NAMES: [&str; Self::ALL.len()] = [$($name),*];

            /// The name in a configuration.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$Variant => $name,)*
                }
            }

            /// Whether the law flies within the prediction by itself: [`LawOptions::IS_PREDICTIVE`].
            #[must_use]
            pub const fn is_predictive(self) -> bool {
                match self {
                    $(Self::$Variant => <super::$Options as LawOptions>::IS_PREDICTIVE,)*
                }
            }

            /// The gains that are tuned: [`LawOptions::TUNED`].
            #[must_use]
            pub const fn tuned_gains(self) -> &'static [SearchRange] {
                match self {
                    $(Self::$Variant => <super::$Options as LawOptions>::TUNED,)*
                }
            }
        }

        /// The law that flies, and the options of every law. The default is for the Hummingbird in rate form.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
        pub struct ControllerOptions {
            /// The law that flies.
            pub controller: ControllerName,
            /// Rate of the loop, for laws in discrete time \[Hz\].
            pub rate_hz: f64,
            $($(#[$doc])* #[serde(rename = $name)] pub $field: super::$Options,)*
        }

        impl Default for ControllerOptions {
            fn default() -> Self {
                let controller = ControllerName::default();
                Self { controller, rate_hz: 60.0, $($field: super::$Options::default(),)* }
            }
        }

        impl ControllerOptions {
            /// The gains of the paper's gravity turn, Table IV: for the spacecraft in torque form.
            #[must_use]
            pub fn spacecraft() -> Self {
                Self { $($field: super::$Options::spacecraft(),)* ..Self::default() }
            }

            /// Checks the options of every law.
            ///
            /// # Errors
            /// The first option whose value is not allowed.
            pub fn check(&self) -> Result<(), OptionError> {
                $(self.$field.check().map_err(|error| error.within($name))?;)*
                Ok(())
            }
        }

        /// The law that a configuration names.
        // Not boxed: the cache warm-up copies the law, and a copy must not allocate.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[allow(clippy::large_enum_variant)]
        pub enum Controller<I> {
            $($(#[$doc])* $Variant(super::$Law<I>),)*
        }

        impl<I: InputForm> Controller<I> {
            /// The law that `options` names, for a vehicle commanded through `input`.
            ///
            /// # Errors
            /// An option of that law whose value is not allowed, under its key in the section of all laws: `pid.gain`.
            pub fn new(options: &ControllerOptions, input: I) -> Result<Self, OptionError> {
                let name = options.controller;
                let period_s = 1.0 / options.rate_hz;
                let law = match name {
                    $(ControllerName::$Variant => options.$field.build(input, period_s).map(Self::$Variant),)*
                };
                law.map_err(|error| error.within(name.name()))
            }

            fn law(&self) -> &dyn AttitudeLaw<Command = I::Command> {
                match self {
                    $(Self::$Variant(law) => law,)*
                }
            }

            fn law_mut(&mut self) -> &mut dyn AttitudeLaw<Command = I::Command> {
                match self {
                    $(Self::$Variant(law) => law,)*
                }
            }
        }
    };
}

for_each_law!(define_registry);

impl Default for ControllerName {
    fn default() -> Self {
        Self::Oqtal
    }
}

impl fmt::Display for ControllerName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl<I: InputForm> AttitudeLaw for Controller<I> {
    type Command = I::Command;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> I::Command {
        self.law_mut().command(state, reference, dt_s)
    }

    fn reset(&mut self) {
        self.law_mut().reset();
    }

    fn set_rate_lag(&mut self, lag_s: f64, period_s: f64) {
        self.law_mut().set_rate_lag(lag_s, period_s);
    }

    fn riccati_solves(&self) -> u32 {
        self.law().riccati_solves()
    }

    fn failed_solves(&self) -> u32 {
        self.law().failed_solves()
    }
}
