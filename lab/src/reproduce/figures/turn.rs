//! Figs. 10 to 14: the gravity turn under the best-tuned laws, compared with the ideal turn.

use maud::{Markup, html};
use oqtal_control::controller::{ControlOptions, RateFeedback};
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::schedule::Cells;

use crate::reproduce::lander::{DURATION_S, Descent, Lander, RATE_HZ, attitude_state};
use crate::reproduce::roster;
use oqtal_observe::plot::figure::in_plane;
use oqtal_observe::plot::palette::Ink;
use oqtal_observe::plot::trace::{Point, Trace};

use super::over;
use super::scene::{Point3, Scene, around};

/// One tick of a turn: time \[s\], position \[m\] and velocity \[m/s\] with x down range, pitch \[deg\].
#[derive(Clone, Copy, Debug)]
struct TurnTick {
    time_s: f64,
    place: Point3,
    velocity: Point3,
    pitch_deg: f64,
}

struct TurnPath {
    name: &'static str,
    ink: Ink,
    ticks: Vec<TurnTick>,
}

/// The five figures.
///
/// # Errors
/// An option of a law is invalid.
pub fn all(lander: &Lander) -> Result<Vec<Markup>, OptionError> {
    let laws: [(&'static str, Ink, ControlOptions); 3] = [
        ("PID", Ink::Third, roster::pid([50.0, 5.95, 1.15], RateFeedback::Omega)),
        ("classic LQR", Ink::Second, roster::lqr([128.0, 1.0], Cells::Centred)),
        ("OQTAL", Ink::Actual, roster::oqtal_as_printed([256.0, 1.0], Cells::Centred)),
    ];
    let mut paths = vec![ideal(lander)];
    for (name, ink, options) in laws {
        paths.push(TurnPath { name, ink, ticks: flown(lander, &options)? });
    }
    let over_time = |title: &str, value: fn(&TurnTick) -> f64| {
        over(title, " s", traces(&paths, |tick| (tick.time_s, value(tick))))
    };
    let seen = |title: &str, view: fn(&TurnTick) -> Point| {
        in_plane(title, traces(&paths, view), Vec::new())
    };
    let pitch = traces(&paths, |tick| (tick.place[2], tick.pitch_deg));
    // Viewed from above, the lateral differences are far smaller than the length of the paths.
    let above = traces(&paths, |tick| (tick.place[0], tick.place[1]));
    let position = html! {
        (seen("Fig. 11 B: side view, z over x [m]", |t| (t.place[0], t.place[2])))
        (over("Fig. 11 A: top view, y [m] over x, stretched", " m", above))
        (over_time("Fig. 11 C: x [m]", |t| t.place[0]))
        (over_time("Fig. 11 D: z [m]", |t| t.place[2]))
    };
    // Figures with the same height are placed side by side.
    Ok([
        in_space(&paths),
        position,
        over("Fig. 12: pitch [deg] over altitude", " m", pitch),
        over_time("Fig. 13: velocity in x [m/s]", |t| t.velocity[0]),
        over_time("Fig. 14: velocity in z [m/s]", |t| t.velocity[2]),
    ]
    .into())
}

fn ideal(lander: &Lander) -> TurnPath {
    let tick = |index: u32| {
        let time_s = f64::from(index) / RATE_HZ;
        let state = lander.turn().at_time(time_s);
        TurnTick {
            time_s,
            place: down_range(lander.ideal(time_s).into()),
            velocity: [state.forward_m_s, 0.0, -state.sink_m_s],
            pitch_deg: state.angle_rad.to_degrees(),
        }
    };
    let count = (DURATION_S * RATE_HZ) as u32;
    TurnPath { name: "ideal", ink: Ink::Reference, ticks: (0..count).map(tick).collect() }
}

/// The turn is flown towards -x.
fn down_range([x, y, z]: Point3) -> Point3 {
    [-x, y, z]
}

fn flown(lander: &Lander, options: &ControlOptions) -> Result<Vec<TurnTick>, OptionError> {
    let mut ticks = Vec::new();
    lander.fly(options, &Descent::default(), |moment| {
        let attitude = attitude_state(&moment.state).attitude;
        ticks.push(TurnTick {
            time_s: moment.time_s,
            place: down_range(moment.state.position.into()),
            velocity: down_range(moment.state.velocity.into()),
            pitch_deg: EulerAngles::from_attitude(&attitude).pitch.to_degrees(),
        });
    })?;
    Ok(ticks)
}

fn traces(paths: &[TurnPath], point: impl Fn(&TurnTick) -> Point) -> Vec<Trace> {
    let trace = |path: &TurnPath| Trace {
        name: path.name,
        ink: path.ink,
        points: path.ticks.iter().map(&point).collect(),
    };
    paths.iter().map(trace).collect()
}

fn in_space(paths: &[TurnPath]) -> Markup {
    let places = paths.iter().flat_map(|path| &path.ticks).map(|tick| &tick.place);
    let mut scene = Scene::new(around(["x [m]", "y [m]", "z [m]"], places));
    for path in paths {
        let points: Vec<Point3> = path.ticks.iter().step_by(6).map(|tick| tick.place).collect();
        scene.line(path.name, path.ink, &points);
    }
    scene.figure("Fig. 10: gravity turn")
}
