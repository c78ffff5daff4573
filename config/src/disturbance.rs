//! Disturbances in time: forces, torques, gusts and payloads that act on the simulated vehicle, in the grammar of
//! `oqtal fly --disturb`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::period::Period;

/// Load on the simulated vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DisturbanceKind {
    /// A constant force \[N, world\].
    Force([f64; 3]),
    /// A constant torque \[N m, body\].
    Torque([f64; 3]),
    /// A wind that rises and falls as 1 - cos over the duration: its greatest velocity \[m/s, world\]. It acts through the drag of the
    /// vehicle.
    Gust([f64; 3]),
    /// Mass of a payload at the centre of mass, which leaves the inertia unchanged; negative for a payload that is dropped \[kg\].
    Mass(f64),
}

/// A kind in the grammar: name, unit, example, greatest magnitude \[unit\].
type Form = (&'static str, &'static str, &'static str, f64);

const FORMS: [Form; 4] = [
    ("force", "N", "force@5+1=0.3,0,0N", 1000.0),
    ("torque", "Nm", "torque@5+0.1=0.002,0,0Nm", 100.0),
    ("gust", "m/s", "gust@5+2=1.5,0,0m/s", 100.0),
    ("mass", "kg", "mass@5=0.05kg", 1000.0),
];

/// A disturbance and the time for which it acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct TimedDisturbance {
    /// Kind and magnitude.
    pub kind: DisturbanceKind,
    /// Beginning, from the first command that arms \[s\].
    pub at_s: f64,
    /// Duration; `None` for the rest of the flight \[s\].
    pub duration_s: Option<f64>,
}

impl TimedDisturbance {
    /// Time at which the disturbance ends, from the first command that arms; infinite if it lasts to the end of the flight \[s\].
    pub fn end_s(&self) -> f64 {
        self.duration_s.map_or(f64::INFINITY, |duration| self.at_s + duration)
    }

    /// Forms of a disturbance, for messages.
    pub fn grammar() -> String {
        let mut text =
            "expected KIND@TIME[+DURATION]=VALUE; times in seconds, TIME from arming,\n  \
             without DURATION, which a gust needs, until the end of the flight:"
                .to_owned();
        let about = [
            "constant; x,y,z of the world",
            "constant; x,y,z of the body",
            "peak of a wind that swells and dies; world",
            "payload; negative to take mass away",
        ];
        for ((_, unit, example, most), about) in FORMS.iter().zip(about) {
            text += &format!("\n  {example:<26} {about}; up to {most} {unit}");
        }
        text
    }

    fn parse(text: &str) -> Option<Self> {
        let (name, rest) = text.split_once('@')?;
        let (when, value) = rest.split_once('=')?;
        let &(name, unit, _, most) = FORMS.iter().find(|(known, ..)| *known == name)?;
        // The unit is determined by the kind and may be omitted.
        let value = value.strip_suffix(unit).unwrap_or(value).trim_end();
        let numbers: Option<Vec<f64>> =
            value.split(',').map(|number| number.trim().parse().ok()).collect();
        let numbers = numbers?;
        let Period { at_s, duration_s } = Period::parse(when)?;
        // A comparison with NaN is false.
        if !numbers.iter().all(|number| number.abs() <= most) {
            return None;
        }
        let kind = match (name, numbers.as_slice(), duration_s) {
            ("force", &[x, y, z], _) => DisturbanceKind::Force([x, y, z]),
            ("torque", &[x, y, z], _) => DisturbanceKind::Torque([x, y, z]),
            ("gust", &[x, y, z], Some(_)) => DisturbanceKind::Gust([x, y, z]),
            ("mass", &[mass_kg], _) => DisturbanceKind::Mass(mass_kg),
            _ => return None,
        };
        Some(Self { kind, at_s, duration_s })
    }
}

impl FromStr for TimedDisturbance {
    type Err = String;

    /// Parses `KIND@TIME[+DURATION]=VALUE`; the error lists the grammar.
    fn from_str(text: &str) -> Result<Self, String> {
        Self::parse(text)
            .ok_or_else(|| format!("`{text}` is not a disturbance: {}", Self::grammar()))
    }
}

impl TryFrom<String> for TimedDisturbance {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<TimedDisturbance> for String {
    fn from(disturbance: TimedDisturbance) -> Self {
        disturbance.to_string()
    }
}

impl fmt::Display for TimedDisturbance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { at_s, duration_s, .. } = *self;
        let when = Period { at_s, duration_s };
        match self.kind {
            DisturbanceKind::Force([x, y, z]) => write!(f, "force@{when}={x},{y},{z}N"),
            DisturbanceKind::Torque([x, y, z]) => write!(f, "torque@{when}={x},{y},{z}Nm"),
            DisturbanceKind::Gust([x, y, z]) => write!(f, "gust@{when}={x},{y},{z}m/s"),
            DisturbanceKind::Mass(mass_kg) => write!(f, "mass@{when}={mass_kg}kg"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disturbance_is_read_and_written_back() {
        for (.., example, _) in FORMS {
            let read: TimedDisturbance = example.parse().unwrap();
            assert_eq!(read.to_string(), example);
        }
        let bare: TimedDisturbance = "force@1e1=0, -0.5 ,2".parse().unwrap();
        assert_eq!(bare.to_string(), "force@10=0,-0.5,2N");
        let with_units: TimedDisturbance = "mass@5s+0.5s=0.05kg".parse().unwrap();
        assert_eq!(with_units.to_string(), "mass@5+0.5=0.05kg");
        assert_eq!((bare.at_s, bare.end_s()), (10.0, f64::INFINITY));
    }

    #[test]
    fn any_other_text_is_refused_with_the_grammar() {
        for wrong in [
            "",
            "force",
            "force@5",
            "force@5=1",
            "force@5=1,2",
            "force@5=1,2,3,4",
            "force@5=1,2,3kg",
            "force@-1=1,2,3",
            "force@5+0=1,2,3",
            "force=1,2,3@5",
            "force@5=nan,0,0",
            "force@5=1e9,0,0",
            "gust@5=1,0,0",
            "mass@5=1,2,3",
            "wind@5=1,2,3",
        ] {
            let message = wrong.parse::<TimedDisturbance>().unwrap_err();
            for (.., example, _) in FORMS {
                assert!(message.contains(example), "{wrong}: {message}");
            }
            assert!(message.contains("; up to 1000 N\n"), "{wrong}: {message}");
        }
    }
}
