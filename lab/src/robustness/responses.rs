//! Responses in time to a step of the attitude, a sudden force and a gust, without noise.

use maud::Markup;
use oqtal_config::Setting;
use oqtal_control::euler::EulerAngles;
use oqtal_observe::flight::{Flight, FlightSample};
use oqtal_observe::plot::palette::Ink;
use oqtal_observe::plot::trace::Point;
use oqtal_runtime::process::Failure;

use super::probed;
use crate::mission::Mission;
use crate::progress::Progress;
use crate::reproduce::chapter::Chapter;
use crate::reproduce::figures::lines_over;
use crate::sheet::Sheet;
use crate::simulation;
use crate::study::law::StudyLaw;
use crate::study::table::column;

/// Size of the attitude step \[deg\].
const STEP_DEG: f64 = 10.0;
/// Time for which the attitude step is held \[s\].
const HELD_S: f64 = 2.0;
/// Fraction of the step within which it counts as settled \[-\].
const BAND: f64 = 0.05;
/// Instant of a disturbance after arming, in the middle of a hover \[s\].
const DISTURBED_S: f64 = 12.0;
/// Time shown and evaluated after a disturbance \[s\].
const SHOWN_S: f64 = 6.0;
/// Duration of the hover after the take-off \[s\].
const HOVER_S: f64 = 30.0;
/// Distance from the reference within which a disturbance counts as rejected \[mm\].
const REJECTED_MM: f64 = 5.0;

/// Excitation of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ResponseEvent {
    AttitudeStep,
    Force,
    Gust,
}

const EVENTS: [ResponseEvent; 3] =
    [ResponseEvent::AttitudeStep, ResponseEvent::Force, ResponseEvent::Gust];

impl ResponseEvent {
    fn title(self) -> &'static str {
        match self {
            Self::AttitudeStep => "step of the roll angle by 10° [°]",
            Self::Force => {
                "force of 0.2 N from one moment to the next: distance from the reference [mm]"
            }
            Self::Gust => "gust, 1.5 m/s at its height, 1 s: distance from the reference [mm]",
        }
    }

    fn settings(self) -> Vec<Setting> {
        let set = |key: &str, value: toml::Value| Setting::flag("response", key, value);
        let disturbed = |disturbance: &str| {
            let list = toml::Value::Array(vec![disturbance.into()]);
            vec![
                set("trajectory.kind", "hover".into()),
                set("trajectory.duration-s", HOVER_S.into()),
                set("plant.disturb", list),
            ]
        };
        match self {
            Self::AttitudeStep => vec![
                set("trajectory.kind", "step".into()),
                set("trajectory.step.axis", "roll".into()),
                set("trajectory.step.angle-deg", STEP_DEG.into()),
                set("trajectory.step.hold-s", HELD_S.into()),
                set("trajectory.duration-s", (HELD_S + 6.0).into()),
                // The position is not controlled: the vehicle drifts by some metres.
                set("safety.tracking-limit-m", 50.0.into()),
                set("fence.x-m", vec![-40.0, 40.0].into()),
                set("fence.y-m", vec![-40.0, 40.0].into()),
                set("fence.polygon-m", toml::Value::Array(Vec::new())),
            ],
            Self::Force => disturbed(&format!("force@{DISTURBED_S}=0.2,0,0N")),
            Self::Gust => disturbed(&format!("gust@{DISTURBED_S}+1=1.5,0,0m/s")),
        }
    }

    /// Response over the time since the event \[s\]: roll \[deg\], or distance from the reference \[mm\].
    fn curve(self, flight: &Flight) -> Vec<Point> {
        let start = match self {
            Self::AttitudeStep => flight.scored().next(),
            Self::Force | Self::Gust => flight.armed().next(),
        };
        let Some(start) = start.map(|sample| sample.telemetry.time) else { return Vec::new() };
        let begin_s = if self == Self::AttitudeStep { 0.0 } else { DISTURBED_S };
        let end_s = if self == Self::AttitudeStep { HELD_S } else { SHOWN_S };
        let point = |sample: &FlightSample| {
            let time_s = sample.telemetry.time.since(start).seconds() - begin_s;
            (time_s, self.value(sample))
        };
        let shown = |point: &Point| (-0.2..end_s).contains(&point.0);
        flight.armed().map(point).filter(shown).collect()
    }

    fn value(self, sample: &FlightSample) -> f64 {
        match self {
            Self::AttitudeStep => EulerAngles::from_attitude(&sample.attitude()).roll.to_degrees(),
            Self::Force | Self::Gust => 1e3 * sample.position_error().norm(),
        }
    }
}

/// The responses of a law.
#[derive(Clone, Debug)]
pub struct LawResponses {
    law: StudyLaw,
    /// One curve for each of [`EVENTS`]; `None` if the flight did not land as planned.
    curves: [Option<Vec<Point>>; EVENTS.len()],
}

/// Flies every event with every law.
///
/// # Errors
/// A setting is invalid.
pub fn all(laws: &[StudyLaw], progress: &Progress) -> Result<Vec<LawResponses>, Failure> {
    let respond = |law: &StudyLaw| {
        let calm = probed::calm(&law.config()?);
        let fly = |event: ResponseEvent| -> Result<Option<Vec<Point>>, Failure> {
            let config = law.with(&calm).with(&event.settings()).config()?;
            let flight = simulation::fly(&Mission::new(config)?)?;
            Ok(flight.cause().is_none().then(|| event.curve(&flight)))
        };
        let [step, force, gust] = EVENTS;
        let curves = [fly(step)?, fly(force)?, fly(gust)?];
        Ok(LawResponses { law: law.clone(), curves })
    };
    progress.each("responses", laws, respond)
}

/// The chapter of the page.
pub fn chapter(responses: &[LawResponses]) -> Chapter {
    Chapter {
        title: "Responses",
        intro: vec![INTRO.to_owned()],
        sheets: vec![table(responses)],
        figures: EVENTS.iter().enumerate().flat_map(|event| drawn(event, responses)).collect(),
    }
}

const INTRO: &str = "The nominal vehicle without noise, drift and gusts; the filters still assume the noise of the cameras. The \
     attitude step is prescribed, with the position loop open; its times count from the tick in which it is commanded, so that the \
     delay of the loop is in them. Force and gust meet a hover. A dash marks a response that did not settle within the shown \
     time; a row of dashes, a flight that did not land as planned.";

fn table(responses: &[LawResponses]) -> Sheet {
    let step = |figure: usize| move |law: &LawResponses| step_figures(law.curve(0))[figure];
    let most = |event: usize| move |law: &LawResponses| most(law.curve(event));
    let over = |event: usize| move |law: &LawResponses| rejected(law.curve(event));
    let columns = [
        column("rise_s", "step: 10 to 90 % [s]", step(0)),
        column("overshoot_percent", "step: overshoot [%]", step(1)),
        column("settled_s", "step: within 5 % [s]", step(2)),
        column("force_most_mm", "force: farthest [mm]", most(1)),
        column("force_over_s", "force: within 5 mm [s]", over(1)),
        column("gust_most_mm", "gust: farthest [mm]", most(2)),
        column("gust_over_s", "gust: within 5 mm [s]", over(2)),
    ];
    let names =
        |row: &LawResponses| (row.law.name.clone(), row.law.variant, row.law.remark.clone());
    let title = "Responses to a step, a force and a gust";
    Sheet::tabulate(("responses", title), &columns, responses, names)
}

impl LawResponses {
    /// The response to an event; empty if the flight did not land.
    fn curve(&self, event: usize) -> &[Point] {
        self.curves[event].as_deref().unwrap_or_default()
    }
}

/// Rise time \[s\], overshoot \[%\] and settling time \[s\] of the attitude step.
fn step_figures(curve: &[Point]) -> [Option<f64>; 3] {
    let reached = |share: f64| {
        curve.iter().find(|(time, roll)| *time >= 0.0 && *roll >= share * STEP_DEG).map(|p| p.0)
    };
    let rise = reached(0.9).zip(reached(0.1)).map(|(late, early)| late - early);
    let most = curve.iter().map(|point| point.1).reduce(f64::max);
    let overshoot = most.map(|most| 1e2 * (most / STEP_DEG - 1.0).max(0.0));
    let outside = |roll: f64| (roll - STEP_DEG).abs() > BAND * STEP_DEG;
    [rise, overshoot, last_outside(curve, outside)]
}

/// Greatest distance from the reference \[mm\].
fn most(curve: &[Point]) -> Option<f64> {
    curve.iter().filter(|point| point.0 >= 0.0).map(|point| point.1).reduce(f64::max)
}

/// Time until the distance from the reference stays small \[s\].
fn rejected(curve: &[Point]) -> Option<f64> {
    last_outside(curve, |distance| distance > REJECTED_MM)
}

/// Time of the last point that is outside \[s\]; `None` if it is the last of the curve, or there is no curve.
fn last_outside(curve: &[Point], outside: impl Fn(f64) -> bool) -> Option<f64> {
    let after = || curve.iter().filter(|point| point.0 >= 0.0);
    let last = after().filter(|point| outside(point.1)).last();
    let end = curve.last()?;
    match last {
        None => Some(0.0),
        Some(last) if last == end => None,
        Some(last) => Some(last.0),
    }
}

const INKS: [Ink; 6] = [Ink::Actual, Ink::Second, Ink::Third, Ink::Fourth, Ink::Fifth, Ink::Sixth];

/// Curves of an event, in figures with one law per colour.
fn drawn((index, event): (usize, &ResponseEvent), responses: &[LawResponses]) -> Vec<Markup> {
    let with_curve: Vec<(&str, &Vec<Point>)> = responses
        .iter()
        .filter_map(|law| Some((law.law.name.as_str(), law.curves[index].as_ref()?)))
        .collect();
    let title = format!("Response: {}", event.title());
    let plot = |laws: &[(&str, &Vec<Point>)]| {
        let lines = laws.iter().zip(INKS);
        let lines = lines.map(|((name, curve), ink)| (*name, ink, (*curve).clone()));
        lines_over(&title, " s", lines.collect())
    };
    with_curve.chunks(INKS.len()).map(plot).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First-order lag of 0.1 s after a delay of 0.05 s, with a temporary overshoot of a fifth.
    fn curve() -> Vec<Point> {
        let roll = |time: f64| match time {
            t if t < 0.05 => 0.0,
            t if (0.5..0.7).contains(&t) => 12.0,
            t => 10.0 * (1.0 - (-(t - 0.05) / 0.1).exp()),
        };
        (-20..200).map(|tick| 0.01 * f64::from(tick)).map(|time| (time, roll(time))).collect()
    }

    #[test]
    fn a_known_step_has_its_known_figures() {
        let [rise, overshoot, settled] = step_figures(&curve()).map(|figure| figure.unwrap());
        assert!((rise - 0.1 * 9.0_f64.ln()).abs() < 0.011, "{rise}");
        assert!((overshoot - 20.0).abs() < 1e-9);
        assert!((settled - 0.69).abs() < 0.011, "{settled}");
    }

    #[test]
    fn a_curve_that_never_settles_has_no_settling_time() {
        assert_eq!(last_outside(&curve(), |roll| roll < 100.0), None);
        assert_eq!(last_outside(&curve(), |roll| roll > 100.0), Some(0.0));
        assert_eq!(last_outside(&[], |_| true), None);
    }
}
