//! What is tuned, as data: a further law is a further entry.

/// A gain, by its key in the configuration, and where it is searched: evenly in its logarithm.
#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    /// The key, dotted.
    pub key: &'static str,
    /// The least value.
    pub low: f64,
    /// The greatest value.
    pub high: f64,
}

/// An attitude law and its own gains. The gains of what surrounds it, [`SURROUNDINGS`], are tuned with them.
#[derive(Clone, Copy, Debug)]
pub struct LawSpace {
    /// Its name in the configuration.
    pub controller: &'static str,
    /// Its gains; the first is the one that `max_q` raises.
    pub gains: &'static [Parameter],
    /// Whether the estimator and the position loops of the paper surround it, or it has its own.
    pub surrounded: bool,
}

const fn parameter(key: &'static str, low: f64, high: f64) -> Parameter {
    Parameter { key, low, high }
}

/// The laws that are tuned and compared.
pub const LAWS: [LawSpace; 5] = [
    LawSpace {
        controller: "pid",
        gains: &[
            parameter("control.pid.gain", 1.0, 40.0),
            parameter("control.pid.integral-time-s", 0.2, 50.0),
        ],
        surrounded: true,
    },
    LawSpace {
        controller: "lqr",
        gains: &[
            parameter("control.lqr.attitude-weight", 1.0, 400.0),
            parameter("control.lqr.integral-weight", 1e-4, 1.0),
        ],
        surrounded: true,
    },
    LawSpace {
        controller: "oqtal",
        gains: &[
            parameter("control.oqtal.attitude-weight", 4.0, 1600.0),
            parameter("control.oqtal.integral-weight", 1e-4, 1.0),
        ],
        surrounded: true,
    },
    LawSpace {
        controller: "geometric",
        gains: &[
            parameter("control.geometric.attitude-gain", 1.0, 40.0),
            parameter("control.geometric.integral-gain-per-s", 0.01, 5.0),
        ],
        surrounded: true,
    },
    LawSpace {
        controller: "oqtal-dt",
        gains: &[
            parameter("control.oqtal-dt.attitude-weight", 100.0, 1e5),
            parameter("control.oqtal-dt.rate-weight", 1e-3, 10.0),
            parameter("control.predictive.position-gain-per-s", 0.3, 4.0),
            parameter("control.predictive.vertical-position-gain-per-s", 0.3, 6.0),
            parameter("control.predictive.velocity-gain-per-s", 2.0, 20.0),
            parameter("control.predictive.command-bandwidth-rad-s", 4.0, 40.0),
            parameter("control.predictive.filter.rate-walk-rad-s", 0.05, 5.0),
            parameter("control.predictive.filter.demand-bias-walk", 1e-3, 0.1),
            parameter("control.predictive.filter.velocity-walk-m-s", 1e-3, 0.1),
            parameter("control.predictive.filter.acceleration-walk-m-s2", 0.01, 1.0),
        ],
        surrounded: false,
    },
];

/// The names of the laws.
pub const LAW_NAMES: [&str; LAWS.len()] = {
    let mut names = [""; LAWS.len()];
    let mut index = 0;
    while index < LAWS.len() {
        names[index] = LAWS[index].controller;
        index += 1;
    }
    names
};

/// What can be asked for: a law, or the position loops.
pub const NAMES: [&str; LAWS.len() + 1] = {
    let mut names = ["outer"; LAWS.len() + 1];
    let mut index = 0;
    while index < LAWS.len() {
        names[index] = LAWS[index].controller;
        index += 1;
    }
    names
};

/// The estimator and the position loops, the same for every law of the paper.
pub const SURROUNDINGS: [Parameter; 8] = [
    parameter("control.estimator.velocity-cutoff-hz", 2.0, 20.0),
    parameter("position.horizontal-position.kp", 0.5, 4.0),
    parameter("position.horizontal-position.ki", 1e-3, 0.3),
    parameter("position.horizontal-velocity.kp", 1.0, 10.0),
    parameter("position.horizontal-velocity.ki", 0.05, 5.0),
    parameter("position.vertical-position.kp", 0.5, 6.0),
    parameter("position.vertical-velocity.kp", 1.0, 15.0),
    parameter("position.vertical-velocity.ki", 0.05, 10.0),
];

impl LawSpace {
    /// All parameters that are tuned with this law.
    #[must_use]
    pub fn parameters(&self) -> Vec<Parameter> {
        let around: &[Parameter] = if self.surrounded { &SURROUNDINGS } else { &[] };
        self.gains.iter().chain(around).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tune::search::shipped;

    #[test]
    fn every_parameter_is_a_key_whose_shipped_value_is_within_its_bounds() {
        for law in LAWS {
            for parameter in law.parameters() {
                let value = shipped(parameter.key);
                let Parameter { key, low, high } = parameter;
                assert!((low..=high).contains(&value), "{key} = {value}");
            }
        }
    }
}
