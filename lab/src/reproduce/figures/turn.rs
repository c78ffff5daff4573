//! Figs. 10 to 14: the gravity turn under the best-tuned laws, beside the ideal.

use maud::{Markup, html};
use oqtal_control::controller::{ControllerOptions, RateFeedback};
use oqtal_control::euler::EulerAngles;
use oqtal_control::options::OptionError;
use oqtal_control::schedule::Cells;

use crate::reproduce::lander::{DURATION_S, Descent, Lander, RATE_HZ, attitude_state};
use crate::reproduce::roster;
use oqtal_observe::report::figure::in_plane;
use oqtal_observe::report::palette::Ink;
use oqtal_observe::report::series::{Point, Trace};

use super::scene::{Point3, Scene, around};
use super::{Figure, over};

/// One tick of a turn: time \[s\], place and velocity with x down range \[m, m/s\], pitch \[deg\].
#[derive(Clone, Copy, Debug)]
struct Tick {
    time_s: f64,
    place: Point3,
    velocity: Point3,
    pitch_deg: f64,
}

struct Path {
    name: &'static str,
    ink: Ink,
    ticks: Vec<Tick>,
}

/// The five figures.
///
/// # Errors
/// An option of a law has no meaning.
pub fn all(lander: &Lander) -> Result<Vec<Figure>, OptionError> {
    let laws: [(&'static str, Ink, ControllerOptions); 3] = [
        ("PID", Ink::Third, roster::pid([50.0, 5.95, 1.15], RateFeedback::Omega)),
        ("classic LQR", Ink::Second, roster::lqr([128.0, 1.0], Cells::Centred)),
        ("OQTAL", Ink::Actual, roster::oqtal([256.0, 1.0], Cells::Centred)),
    ];
    let mut paths = vec![ideal(lander)];
    for (name, ink, options) in laws {
        paths.push(Path { name, ink, ticks: flown(lander, &options)? });
    }
    let over_time = |title: &str, value: fn(&Tick) -> f64| {
        over(title, " s", traces(&paths, |tick| (tick.time_s, value(tick))))
    };
    let seen =
        |title: &str, view: fn(&Tick) -> Point| in_plane(title, traces(&paths, view), Vec::new());
    let pitch = traces(&paths, |tick| (tick.place[2], tick.pitch_deg));
    // From above, the paths differ by far less than they are long.
    let above = traces(&paths, |tick| (tick.place[0], tick.place[1]));
    let position = html! {
        (seen("Fig. 11 B: side view, z over x [m]", |t| (t.place[0], t.place[2])))
        (over("Fig. 11 A: top view, y [m] over x, stretched", " m", above))
        (over_time("Fig. 11 C: x [m]", |t| t.place[0]))
        (over_time("Fig. 11 D: z [m]", |t| t.place[2]))
    };
    // Pairs of one height stand side by side.
    Ok([
        (10, in_space(&paths)),
        (11, position),
        (12, over("Fig. 12: pitch [deg] over altitude", " m", pitch)),
        (13, over_time("Fig. 13: velocity in x [m/s]", |t| t.velocity[0])),
        (14, over_time("Fig. 14: velocity in z [m/s]", |t| t.velocity[2])),
    ]
    .map(|(number, markup)| Figure { number, markup })
    .into())
}

fn ideal(lander: &Lander) -> Path {
    let tick = |index: u32| {
        let time_s = f64::from(index) / RATE_HZ;
        let state = lander.turn().at_time(time_s);
        Tick {
            time_s,
            place: down_range(lander.ideal(time_s).into()),
            velocity: [state.forward_m_s, 0.0, -state.sink_m_s],
            pitch_deg: state.angle_rad.to_degrees(),
        }
    };
    let count = (DURATION_S * RATE_HZ) as u32;
    Path { name: "ideal", ink: Ink::Reference, ticks: (0..count).map(tick).collect() }
}

/// The turn is flown towards -x.
fn down_range([x, y, z]: Point3) -> Point3 {
    [-x, y, z]
}

fn flown(lander: &Lander, options: &ControllerOptions) -> Result<Vec<Tick>, OptionError> {
    let mut ticks = Vec::new();
    lander.fly(options, &Descent::default(), |moment| {
        let attitude = attitude_state(&moment.state).attitude;
        ticks.push(Tick {
            time_s: moment.time_s,
            place: down_range(moment.state.position.into()),
            velocity: down_range(moment.state.velocity.into()),
            pitch_deg: EulerAngles::from_attitude(&attitude).pitch.to_degrees(),
        });
    })?;
    Ok(ticks)
}

fn traces(paths: &[Path], point: impl Fn(&Tick) -> Point) -> Vec<Trace> {
    let trace = |path: &Path| Trace {
        name: path.name,
        ink: path.ink,
        points: path.ticks.iter().map(&point).collect(),
    };
    paths.iter().map(trace).collect()
}

fn in_space(paths: &[Path]) -> Markup {
    let places = paths.iter().flat_map(|path| &path.ticks).map(|tick| &tick.place);
    let mut scene = Scene::new(around(["x [m]", "y [m]", "z [m]"], places));
    for path in paths {
        let points: Vec<Point3> = path.ticks.iter().step_by(6).map(|tick| tick.place).collect();
        scene.line(path.name, path.ink, &points);
    }
    scene.figure("Fig. 10: gravity turn")
}
