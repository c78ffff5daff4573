//! Figs. 17 to 22: squares flown by the laws, tuned alike.

use maud::{Markup, html};
use oqtal_runtime::process::Failure;
use rayon::prelude::*;

use crate::sheet::Variant;
use crate::study::EVALUATION_SEEDS;
use crate::study::flights;
use crate::study::law::StudyLaw;
use crate::study::metric::of_path;
use oqtal_observe::flight::{Flight, FlightSample};
use oqtal_observe::plot::figure::in_plane;
use oqtal_observe::plot::palette::Ink;
use oqtal_observe::plot::trace::{Point, Trace, thin_path};

use super::over;
use super::scene::{Point3, Scene, around};

/// Number of runs shown in one figure.
const REPEATED: usize = 5;
/// Number of runs flown; the runs with the smallest position error are shown.
const RUNS: u64 = 25;
const INKS: [Ink; REPEATED] = [Ink::Actual, Ink::Second, Ink::Third, Ink::Fourth, Ink::Fifth];
const RUN_NAMES: [&str; REPEATED] = ["best", "second", "third", "fourth", "fifth"];

/// The best runs of one of the paper's laws.
struct LawRuns {
    controller: &'static str,
    figure: u8,
    flights: Vec<Flight>,
}

/// The six figures.
///
/// # Errors
/// A setting is invalid.
pub fn all(among: &[StudyLaw]) -> Result<Vec<Markup>, Failure> {
    let laws: Result<Vec<LawRuns>, Failure> = [("pid", 20), ("lqr", 21), ("oqtal", 22)]
        .into_iter()
        .map(|(name, figure)| best_runs(among, name, figure))
        .collect();
    let laws = laws?;
    let of_all = [in_space(&laws), position(&laws), attitude(&laws)];
    Ok(of_all.into_iter().chain(laws.iter().map(five_runs)).collect())
}

fn best_runs(laws: &[StudyLaw], controller: &'static str, figure: u8) -> Result<LawRuns, Failure> {
    let law = laws
        .iter()
        .find(|law| law.variant == Variant::Ours && law.controller == controller)
        .expect("the paper's laws are among those tuned");
    let seeds = EVALUATION_SEEDS.start..EVALUATION_SEEDS.start + RUNS;
    let flown: Result<Vec<_>, Failure> =
        seeds.into_par_iter().map(|seed| flights::path(law, seed)).collect();
    let mut flights: Vec<(f64, Flight)> =
        flown?.into_iter().flatten().map(|flight| (of_path(&flight)[0], flight)).collect();
    flights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let flights = flights.into_iter().take(REPEATED).map(|(_, flight)| flight).collect();
    Ok(LawRuns { controller, figure, flights })
}

/// The best run of each law as a trace, the reference first.
fn samples(
    laws: &[LawRuns],
    with_reference: bool,
    point: impl Fn(&FlightSample, bool) -> Point,
) -> Vec<Trace> {
    let trace = |name, ink, flight: &Flight, reference| Trace {
        name,
        ink,
        points: flight.scored().map(|sample| point(sample, reference)).collect(),
    };
    let first = laws.iter().flat_map(|law| law.flights.first()).next();
    let reference = first
        .filter(|_| with_reference)
        .map(|flight| trace("reference", Ink::Reference, flight, true));
    let best = laws
        .iter()
        .zip([Ink::Third, Ink::Second, Ink::Actual])
        .filter_map(|(law, ink)| Some(trace(law.controller, ink, law.flights.first()?, false)));
    reference.into_iter().chain(best).collect()
}

fn place(sample: &FlightSample, reference: bool) -> Point3 {
    if reference { sample.telemetry.reference_position } else { sample.position().into() }
}

fn time(sample: &FlightSample) -> f64 {
    sample.telemetry.mission_s
}

fn in_space(laws: &[LawRuns]) -> Markup {
    let path = |flight: &Flight| -> Vec<Point3> {
        flight.armed().step_by(4).map(|sample| sample.position().into()).collect()
    };
    let shown = laws.iter().filter(|law| law.controller != "lqr");
    let paths: Vec<(&'static str, Vec<Point3>)> =
        shown.filter_map(|law| Some((law.controller, path(law.flights.first()?)))).collect();
    let points = paths.iter().flat_map(|(_, path)| path);
    let mut scene = Scene::new(around(["x [m]", "y [m]", "z [m]"], points));
    for ((name, path), ink) in paths.iter().zip([Ink::Third, Ink::Actual]) {
        scene.line(name, ink, path);
    }
    scene.figure("Fig. 17: sample square, PID and OQTAL, from take-off to landing")
}

fn position(laws: &[LawRuns]) -> Markup {
    let view = |title: &str, project: fn(Point3) -> Point| {
        let traces = samples(laws, true, |sample, reference| project(place(sample, reference)));
        let thinned =
            traces.into_iter().map(|trace| Trace { points: thin_path(trace.points), ..trace });
        in_plane(title, thinned.collect(), Vec::new())
    };
    let over_time = |title: &str, axis: usize| {
        let traces =
            samples(laws, true, |sample, reference| (time(sample), place(sample, reference)[axis]));
        over(title, " s", traces)
    };
    html! {
        (view("Fig. 18 A: top view, y over x [m]", |[x, y, _]| (x, y)))
        (view("Fig. 18 B: side view, z over x [m]", |[x, _, z]| (x, z)))
        (over_time("Fig. 18 C: x [m]", 0))
        (over_time("Fig. 18 D: y [m]", 1))
    }
}

fn attitude(laws: &[LawRuns]) -> Markup {
    let angle = |title: &str, axis: usize| {
        let traces = samples(laws, false, |sample, _| (time(sample), euler_deg(sample)[axis]));
        over(title, " s", traces)
    };
    let stick = |title: &str, axis: usize| {
        let traces =
            samples(laws, false, |sample, _| (time(sample), sample.telemetry.sticks[axis]));
        over(title, " s", traces)
    };
    html! {
        (angle("Fig. 19 A: roll [deg]", 0))
        (stick("Fig. 19 B: control, roll [-1..1]", 0))
        (angle("Fig. 19 C: pitch [deg]", 1))
        (stick("Fig. 19 D: control, pitch [-1..1]", 1))
    }
}

/// Roll, pitch, yaw \[deg\].
fn euler_deg(sample: &FlightSample) -> [f64; 3] {
    let (roll, pitch, yaw) = sample.attitude().unit_quaternion().euler_angles();
    [roll, pitch, yaw].map(f64::to_degrees)
}

fn five_runs(law: &LawRuns) -> Markup {
    let LawRuns { controller, figure, flights } = law;
    let view = |title: String, project: fn(Point3) -> Point| {
        let traces =
            flights.iter().zip(INKS.into_iter().zip(RUN_NAMES)).map(|(flight, (ink, name))| {
                let points = flight.scored().map(|sample| project(place(sample, false))).collect();
                Trace { name, ink, points: thin_path(points) }
            });
        in_plane(&title, traces.collect(), Vec::new())
    };
    html! {
        (view(format!("Fig. {figure} A: {controller}, five runs, y over x [m]"), |[x, y, _]| (x, y)))
        (view(format!("Fig. {figure} B: {controller}, five runs, z over x [m]"), |[x, _, z]| (x, z)))
    }
}
