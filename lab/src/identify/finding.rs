//! Findings: a parameter with its confidence interval, and the rule that accepts or rejects its value.

use serde::Serialize;

/// Half the width of a 95 % interval over its standard deviation \[-\].
pub const INTERVAL: f64 = 1.96;

/// Estimate of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterFinding {
    /// Name of the parameter.
    pub name: &'static str,
    /// Key of the configuration for its value, if there is one.
    pub key: Option<&'static str>,
    /// Unit of the numbers.
    pub unit: &'static str,
    /// The value \[unit of the finding\].
    pub value: f64,
    /// Half the width of its 95 % interval \[unit of the finding\]; 0 for a given value.
    pub half_width: f64,
    /// The value in the configuration \[unit of the finding\]; `None` if it has none.
    pub before: Option<f64>,
    /// Manoeuvre that the flights lack, if they do not determine the value.
    pub missing: Option<&'static str>,
    /// Assumption of the model that may not hold, if the flights do not determine the value although they have the manoeuvre.
    pub unfit: Option<&'static str>,
}

/// Rule for a parameter: the interval width below which its value is accepted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FindingRule {
    /// Name of the parameter.
    pub name: &'static str,
    /// The key of the configuration.
    pub key: Option<&'static str>,
    /// Unit of the numbers.
    pub unit: &'static str,
    /// Greatest half width of the interval over the value \[-\].
    pub widest_ratio: f64,
    /// Greatest half width of the interval for a small value \[unit of the finding\].
    pub widest: f64,
    /// Manoeuvre that determines the value.
    pub motion: &'static str,
}

impl FindingRule {
    /// The finding of `value` with the standard deviation `sd`, `before` in the configuration.
    pub fn found(&self, value: f64, sd: f64, before: Option<f64>) -> ParameterFinding {
        let Self { name, key, unit, widest_ratio, widest, motion } = *self;
        let half_width = INTERVAL * sd;
        let is_shown = half_width <= widest.max(widest_ratio * value.abs());
        let missing = (!is_shown).then_some(motion);
        ParameterFinding { name, key, unit, value, half_width, before, missing, unfit: None }
    }

    /// Finding for a given `value`.
    pub fn given(&self, value: f64, before: Option<f64>) -> ParameterFinding {
        self.found(value, 0.0, before)
    }
}

impl ParameterFinding {
    /// Whether the flights determine the value.
    pub fn is_shown(&self) -> bool {
        self.missing.is_none() && self.unfit.is_none()
    }

    /// The finding, with the `assumption` in place of the missing manoeuvre, if there is one.
    pub fn with_assumption(mut self, assumption: Option<&'static str>) -> Self {
        if self.missing.is_some() && assumption.is_some() {
            (self.missing, self.unfit) = (None, assumption);
        }
        self
    }

    /// The delay of commands and the rate `lag`, undetermined if one of them is, or if the interval of the lag exceeds its value. Delay and
    /// lag can replace each other in a fit: one of them beside the configured value of the other would give a wrong sum.
    pub fn together(mut self, mut lag: Self) -> [Self; 2] {
        if !self.is_shown() || !lag.is_shown() || lag.half_width > lag.value {
            (self.missing, lag.missing) = (Some(rules::DELAY.motion), Some(rules::RATE_LAG.motion));
        }
        [self, lag]
    }

    /// Reason why the value is not determined; `None` if it is.
    pub fn reason(&self) -> Option<String> {
        let lacking = self.missing.map(|motion| format!("missing: {motion}"));
        let unfit = |assumption| {
            format!(
                "the flight has the required motion, but the model may not fit; the model assumes {assumption}"
            )
        };
        lacking.or_else(|| self.unfit.map(unfit))
    }
}

/// `value` and its half width \[any unit\]: the half width with two significant digits, the value with the same number of
/// decimals; a value without an interval, one that is given, with all its digits.
pub fn with_interval(value: f64, half_width: f64) -> (String, String) {
    if half_width == 0.0 {
        return (value.to_string(), "0".to_owned());
    }
    let decimals = if half_width.is_finite() && half_width > 0.0 {
        (1.0 - half_width.log10().floor()).clamp(0.0, 9.0) as usize
    } else {
        4
    };
    (format!("{value:.decimals$}"), format!("{half_width:.decimals$}"))
}

/// The parameters in the order in which they are shown.
pub mod rules {
    use super::FindingRule;

    const FAST: &str = "fast motions about roll and pitch: doublets, or sines up to some Hz";
    const STEPS: &str = "steps of the thrust: climbs and descents of some tenths of a metre";

    /// Quantity without a key, shown with any interval.
    const fn information(name: &'static str, unit: &'static str) -> FindingRule {
        let any = f64::INFINITY;
        FindingRule { name, key: None, unit, widest_ratio: any, widest: any, motion: "" }
    }

    /// Time from the sending of a command to its effect.
    pub const DELAY: FindingRule = FindingRule {
        name: "delay of commands",
        key: Some("vehicle.command-delay-ms"),
        unit: "ms",
        widest_ratio: 0.0,
        widest: 8.0,
        motion: FAST,
    };
    /// Part of the delay that is missing in the stamps of the commands.
    pub const HIDDEN_DELAY: FindingRule = information("of it, not in stamps", "ms");
    /// Time constant of the rate loop.
    pub const RATE_LAG: FindingRule =
        FindingRule { name: "rate lag", key: Some("vehicle.rate-lag-ms"), ..DELAY };
    /// Rate at full stick about roll, pitch and yaw.
    pub const AUTHORITY: [FindingRule; 3] = [
        authority("full stick, roll", "motions about roll"),
        authority("full stick, pitch", "motions about pitch"),
        authority("full stick, yaw", "a swing of the heading"),
    ];
    /// Bias of the rate loop about roll, pitch and yaw.
    pub const RATE_BIAS: [FindingRule; 3] = [
        information("rate bias, roll", "deg/s"),
        information("rate bias, pitch", "deg/s"),
        information("rate bias, yaw", "deg/s"),
    ];
    /// Greatest thrust.
    pub const THRUST: FindingRule = FindingRule {
        name: "greatest thrust",
        key: Some("vehicle.max-thrust-n"),
        unit: "N",
        widest_ratio: 0.1,
        widest: 0.0,
        motion: "time in the air, tilted to all sides",
    };
    /// Mass.
    pub const MASS: FindingRule =
        FindingRule { name: "mass", key: Some("vehicle.mass-kg"), unit: "kg", ..THRUST };
    /// Greatest thrust over the mass.
    pub const THRUST_PER_MASS: FindingRule = information("thrust over mass", "m/s^2");
    /// Time constant of the thrust.
    pub const THRUST_LAG: FindingRule = FindingRule {
        name: "thrust lag",
        key: Some("vehicle.thrust-lag-ms"),
        unit: "ms",
        widest_ratio: 0.0,
        widest: 10.0,
        motion: STEPS,
    };
    /// Curvature of the thrust over its command: 0 for a straight line, 1 for a parabola.
    pub const THRUST_CURVE: FindingRule = information("curvature of the thrust", "-");
    /// Drag.
    pub const DRAG: FindingRule = FindingRule {
        name: "drag",
        key: Some("vehicle.drag-per-s"),
        unit: "1/s",
        widest_ratio: 0.25,
        widest: 0.04,
        motion: "travel to and fro at the greatest speed",
    };
    /// External acceleration along x, y and z.
    pub const PUSH: [FindingRule; 3] = [
        information("push, x", "m/s^2"),
        information("push, y", "m/s^2"),
        information("push, z", "m/s^2"),
    ];
    /// Standard deviation of the gusts.
    pub const GUST: FindingRule = information("gusts, 1 sd", "m/s^2");
    /// Noise of a measured attitude in flight.
    pub const ATTITUDE_NOISE: FindingRule = FindingRule {
        name: "attitude noise",
        key: Some("control.predictive.filter.attitude-noise-deg"),
        unit: "deg",
        widest_ratio: 0.2,
        widest: 0.0,
        motion: "more time in the air",
    };
    /// Noise of a measured position in flight.
    pub const POSITION_NOISE: FindingRule = FindingRule {
        name: "position noise",
        key: Some("control.predictive.filter.position-noise-mm"),
        unit: "mm",
        ..ATTITUDE_NOISE
    };

    const fn authority(name: &'static str, motion: &'static str) -> FindingRule {
        FindingRule {
            name,
            key: Some("vehicle.rate-authority-rad-s"),
            unit: "rad/s",
            // Without such a motion, feedback biases the value by more than its interval: a square's yaw is 5 to 15 % too great.
            widest_ratio: 0.02,
            widest: 0.0,
            motion,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delay_and_rate_lag_are_determined_together_or_not_at_all() {
        let shown = |delay_sd: f64, lag: f64, lag_sd: f64| {
            let lag = rules::RATE_LAG.found(lag, lag_sd / INTERVAL, Some(10.0));
            let delay = rules::DELAY.found(22.0, delay_sd / INTERVAL, Some(12.0));
            delay.together(lag).map(|finding| finding.is_shown())
        };
        assert_eq!(shown(1.0, 40.0, 1.0), [true; 2]);
        assert_eq!(shown(111.0, 40.0, 1.0), [false; 2], "delay too wide");
        assert_eq!(shown(1.0, 40.0, 9.0), [false; 2], "lag too wide");
        assert_eq!(shown(1.0, 1.8, 4.6), [false; 2], "the interval of the lag includes 0");
    }

    #[test]
    fn a_value_has_the_decimals_of_its_interval() {
        let pair = |value, half| with_interval(value, half);
        assert_eq!(pair(54.2163, 0.5742), ("54.22".to_owned(), "0.57".to_owned()));
        assert_eq!(pair(20.5, 12.3), ("20".to_owned(), "12".to_owned()));
        assert_eq!(pair(0.02745, 0.0), ("0.02745".to_owned(), "0".to_owned()));
    }
}
