//! The six PIDs of Fig. 16 tuned in flight, one at a time: single input, single output, by an artificial bee colony whose bees are
//! gains that are flown in turn, as the paper's reference \[27\] does.
//!
//! All bees are evaluated in one flight. In every *window* the vehicle moves away along all axes and back. The tuned loop has the
//! gains of a bee, the other loops the best gains so far. The objective is computed from the daemon's measurements, not from the
//! truth. If the vehicle strays, the bee is aborted and the best gains so far bring the vehicle back.

use std::fmt::Write;

use nalgebra::Vector3;
use oqtal_config::{Config, Setting};
use oqtal_control::position::{OuterLoop, PositionOptions};
use oqtal_control::scalar_pid::PidGains;
use oqtal_control::trajectory::{TrajectoryKind, Waypoints};
use oqtal_observe::flight::{FlightSample, Outcome};
use oqtal_runtime::process::{Exit, Failure};

use super::bee_colony::BeeColony;
use crate::mission::Mission;
use crate::progress::Progress;
use crate::simulation::online::OnlineFlight;

/// Duration of a window \[s\], a multiple of [`POLL_PERIOD`](crate::simulation::POLL_PERIOD).
const WINDOW_S: f64 = 4.0;
/// Displacement of a window \[m, world\].
const AWAY_M: [f64; 3] = [0.3, 0.3, 0.2];
/// Duration of the displacement, and of the return \[s\].
const WAY_S: f64 = 1.0;
/// Height of the flight \[m\].
const HEIGHT_M: f64 = 1.0;
/// Distance from the reference beyond which a bee is aborted \[m\].
const STRAY_M: f64 = 0.5;
/// Colony of a loop: at most 27 windows, so that all loops are tuned on one battery.
const COLONY: BeeColony = BeeColony { sources: 5, cycles: 2, limit: 8, pull: 1.5, seed: 1 };
/// Number of windows with the gains before the first bee, and with the gains found, for the comparison of the two.
const COMPARED: usize = 6;
/// Factor by which a gain may be raised or lowered in the search \[-\].
const RANGE: f64 = 3.0;
/// Weight of the command jitter relative to the error \[-\].
const JITTER_WEIGHT: f64 = 0.5;

/// Loop with its name.
pub type NamedLoop = (OuterLoop, &'static str);

/// Loops in the order of tuning, inner loops first.
pub const LOOPS: [NamedLoop; 6] = [
    (OuterLoop::VelocityZ, "V_Z"),
    (OuterLoop::VelocityX, "V_X"),
    (OuterLoop::VelocityY, "V_Y"),
    (OuterLoop::Z, "Z"),
    (OuterLoop::X, "X"),
    (OuterLoop::Y, "Y"),
];

/// One loop, tuned in flight.
#[derive(Clone, Copy, Debug)]
pub struct TunedLoop {
    /// Name of the controlled variable.
    pub name: &'static str,
    /// Gains before and after \[output / error, and per s\].
    pub gains: [PidGains; 2],
    /// Mean error of the loop with the initial gains, and with the final gains of all loops \[m or m/s\].
    pub error: [f64; 2],
    /// Number of bees flown \[-\].
    pub bees: usize,
    /// Number of bees aborted \[-\].
    pub strayed: usize,
}

/// All loops, tuned in one flight.
#[derive(Clone, Debug)]
pub struct TunedInFlight {
    /// Loops in the order of tuning.
    pub loops: Vec<TunedLoop>,
    /// Command jitter before and after: RMS of its change from tick to tick \[rad/s\].
    pub jitter: [f64; 2],
    /// Duration of the flight \[s\].
    pub flown_s: f64,
    /// Greatest distance from the reference in the whole flight \[m\].
    pub furthest_m: f64,
    /// Outcome of the flight.
    pub outcome: Outcome,
}

/// Figures of a window: mean error along each axis of position \[m\] and velocity \[m/s\], and the jitter \[rad/s\].
#[derive(Clone, Copy, Debug, Default)]
struct WindowFigures {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    jitter: f64,
}

/// Tunes `named` of [`LOOPS`] around the law of the configuration with `settings`.
///
/// # Errors
/// A setting is invalid, or the flight ended before the last bee (exit code 1).
pub fn tune(
    settings: &[Setting],
    named: &[NamedLoop],
    progress: &Progress,
) -> Result<TunedInFlight, Failure> {
    let mission = mission(settings, named.len())?;
    let mut search = OnlineSearch::begin(&mission, progress)?;
    let bar = progress.start("tuning in flight", named.len() + 2);
    let before = search.compare()?;
    bar.inc();
    let mut loops = Vec::new();
    for (which, name) in named.iter().copied() {
        let start = configured(&mission.config.position, which);
        let (found, bees, strayed) = search.tune(which, start, &before)?;
        loops.push(TunedLoop { name, gains: [start, found], error: [0.0; 2], bees, strayed });
        bar.inc();
    }
    let after = search.compare()?;
    bar.inc();
    for (tuned, (which, _)) in loops.iter_mut().zip(named) {
        tuned.error = [before, after].map(|figures| figures.error(*which));
    }
    let rate_hz = mission.config.loop_rate_hz();
    let flight = search.flight.finish()?;
    let away = flight.armed().map(strayed);
    Ok(TunedInFlight {
        loops,
        jitter: [before.jitter, after.jitter],
        flown_s: flight.armed().count() as f64 / rate_hz,
        furthest_m: away.fold(0.0, f64::max),
        outcome: flight.outcome,
    })
}

/// Flight in which `loops` loops are tuned: take-off, consecutive windows, landing.
fn mission(settings: &[Setting], loops: usize) -> Result<Mission, Failure> {
    let height = Setting::flag("tune", "trajectory.height-m", HEIGHT_M);
    let mut config = Config::from_settings(&[settings, &[height]].concat())?;
    config.trajectory.kind = TrajectoryKind::Waypoints;
    let windows = 2 * COMPARED + loops * COLONY.most_evaluations() + 1;
    let waypoints = Waypoints::parse(&table(windows))
        .map_err(|error| Failure::new(Exit::Internal, error.problem.to_string()))?;
    let trajectory = config.trajectory.trajectory(Some(waypoints));
    let trajectory = trajectory
        .ok_or_else(|| Failure::new(Exit::Internal, "the windows do not form a trajectory"))?;
    Ok(Mission { config, trajectory, recording: None })
}

/// The waypoints of `windows` windows.
fn table(windows: usize) -> String {
    let mut text = "t,x,y,z\n".to_owned();
    for window in 0..windows {
        let from_s = window as f64 * WINDOW_S;
        // Alternating sides, so that the vehicle stays in place on average.
        let side = if window.is_multiple_of(2) { 1.0 } else { -1.0 };
        let [x, y, z] = AWAY_M.map(|away| away * side);
        for (t_s, share) in
            [(0.0, 0.0), (WAY_S, 1.0), (WINDOW_S / 2.0, 1.0), (WINDOW_S / 2.0 + WAY_S, 0.0)]
        {
            let (t_s, z) = (from_s + t_s, HEIGHT_M + z * share);
            let _ = writeln!(text, "{t_s},{},{},{z}", x * share, y * share);
        }
    }
    let _ = writeln!(text, "{},0,0,{HEIGHT_M}", windows as f64 * WINDOW_S);
    text
}

/// The configured gains of a loop.
fn configured(options: &PositionOptions, which: OuterLoop) -> PidGains {
    match which {
        OuterLoop::X | OuterLoop::Y => options.horizontal_position,
        OuterLoop::Z => options.vertical_position,
        OuterLoop::VelocityX | OuterLoop::VelocityY => options.horizontal_velocity,
        OuterLoop::VelocityZ => options.vertical_velocity,
    }
}

/// Measured distance from the reference \[m\].
fn strayed(sample: &FlightSample) -> f64 {
    let telemetry = &sample.telemetry;
    (Vector3::from(telemetry.position) - Vector3::from(telemetry.reference_position)).norm()
}

impl WindowFigures {
    /// Figures of the ticks of a window; `authority` is the rate at full stick \[rad/s, body\].
    fn of(samples: &[FlightSample], authority: &Vector3<f64>) -> Self {
        let count = samples.len().max(1) as f64;
        let mut figures = Self::default();
        for FlightSample { telemetry, .. } in samples {
            let [at, reference] =
                [telemetry.position, telemetry.reference_position].map(Vector3::from);
            let [velocity, set_point] =
                [telemetry.velocity, telemetry.velocity_command].map(Vector3::from);
            figures.position += (at - reference).abs() / count;
            figures.velocity += (velocity - set_point).abs() / count;
        }
        let sticks = |sample: &FlightSample| Vector3::from(sample.telemetry.sticks);
        let change = |pair: &[FlightSample]| {
            (sticks(&pair[1]) - sticks(&pair[0])).component_mul(authority).norm_squared()
        };
        figures.jitter = (samples.windows(2).map(change).sum::<f64>() / count).sqrt();
        figures
    }

    /// Mean error of the variable controlled by a loop \[m or m/s\].
    fn error(&self, which: OuterLoop) -> f64 {
        match which {
            OuterLoop::X => self.position.x,
            OuterLoop::Y => self.position.y,
            OuterLoop::Z => self.position.z,
            OuterLoop::VelocityX => self.velocity.x,
            OuterLoop::VelocityY => self.velocity.y,
            OuterLoop::VelocityZ => self.velocity.z,
        }
    }
}

/// Search in flight.
struct OnlineSearch<'a> {
    flight: OnlineFlight<'a>,
    progress: &'a Progress,
    authority: Vector3<f64>,
    /// Number of ticks of finished windows \[-\].
    seen: usize,
    /// End of the last window \[s since the start of the flight\].
    until_s: f64,
}

impl<'a> OnlineSearch<'a> {
    /// Takes off, and flies to the first window.
    fn begin(mission: &'a Mission, progress: &'a Progress) -> Result<Self, Failure> {
        let authority = Vector3::from(mission.config.vehicle.rate_authority_rad_s);
        let flight = OnlineFlight::begin(mission)?;
        let mut search = Self { flight, progress, authority, seen: 0, until_s: 0.0 };
        while search.flight.samples().last().is_none_or(|last| last.telemetry.scored == 0) {
            search.advance()?;
        }
        search.seen =
            search.flight.samples().iter().position(|s| s.telemetry.scored != 0).unwrap_or(0);
        search.until_s = search.at_s(search.seen);
        Ok(search)
    }

    fn at_s(&self, index: usize) -> f64 {
        self.flight.samples().get(index).map_or(0.0, |s| s.telemetry.time.nanos() as f64 * 1e-9)
    }

    fn advance(&mut self) -> Result<(), Failure> {
        self.progress.check()?;
        match self.flight.advance()? {
            true => Ok(()),
            false => {
                Err(Failure::new(Exit::Flight, "the flight ended before its loops were tuned"))
            }
        }
    }

    /// Flies a window; `None` if the vehicle strayed, after which its loop has the gains of `fallback`.
    fn window(
        &mut self,
        fallback: Option<(OuterLoop, PidGains)>,
    ) -> Result<Option<WindowFigures>, Failure> {
        self.until_s += WINDOW_S;
        let mut has_strayed = false;
        while self.at_s(self.flight.samples().len() - 1) < self.until_s {
            self.advance()?;
            let fresh = &self.flight.samples()[self.seen..];
            if !has_strayed && fresh.iter().any(|sample| strayed(sample) > STRAY_M) {
                has_strayed = true;
                if let Some((which, gains)) = fallback {
                    self.flight.set_loop(which, gains)?;
                }
            }
        }
        let fresh = &self.flight.samples()[self.seen..];
        let figures = WindowFigures::of(fresh, &self.authority);
        self.seen += fresh.len();
        Ok((!has_strayed).then_some(figures))
    }

    /// Mean figures of [`COMPARED`] windows with the present gains.
    fn compare(&mut self) -> Result<WindowFigures, Failure> {
        let mut mean = WindowFigures::default();
        for _ in 0..COMPARED {
            let strayed =
                || Failure::new(Exit::Flight, "the vehicle strays with the configured gains");
            let figures = self.window(None)?.ok_or_else(strayed)?;
            let share = 1.0 / COMPARED as f64;
            mean.position += figures.position * share;
            mean.velocity += figures.velocity * share;
            mean.jitter += figures.jitter * share;
        }
        Ok(mean)
    }

    /// Tunes one loop from its gains `start`, relative to the figures `before`. Returns the gains found, and the numbers of bees
    /// flown and aborted.
    fn tune(
        &mut self,
        which: OuterLoop,
        start: PidGains,
        before: &WindowFigures,
    ) -> Result<(PidGains, usize, usize), Failure> {
        let centre = [start.kp.ln(), start.ki.ln()];
        let bounds = centre.map(|log| log - RANGE.ln()..=log + RANGE.ln());
        let of = |point: &[f64]| PidGains { kp: point[0].exp(), ki: point[1].exp(), ..start };
        let (mut best, mut strayed, mut failed) = ((f64::INFINITY, start), 0, None);
        let mut evaluate = |point: &Vec<f64>| {
            let flown = self.bee(which, (of(point), best.1), before);
            let value = flown.unwrap_or_else(|failure| {
                failed.get_or_insert(failure);
                None
            });
            strayed += usize::from(value.is_none());
            let value = value.unwrap_or(f64::INFINITY);
            if value < best.0 {
                best = (value, of(point));
            }
            value
        };
        let starts = [centre.to_vec()];
        let found =
            COLONY.minimise(&bounds, &starts, |points| points.iter().map(&mut evaluate).collect());
        if let Some(failure) = failed {
            return Err(failure);
        }
        self.flight.set_loop(which, best.1)?;
        Ok((best.1, found.evaluations, strayed))
    }

    /// Objective of a bee with these gains, relative to the figures `before`; `None` if the vehicle strayed.
    fn bee(
        &mut self,
        which: OuterLoop,
        (gains, best): (PidGains, PidGains),
        before: &WindowFigures,
    ) -> Result<Option<f64>, Failure> {
        self.flight.set_loop(which, gains)?;
        let figures = self.window(Some((which, best)))?;
        Ok(figures.map(|figures| {
            let error = figures.error(which) / before.error(which);
            (error + JITTER_WEIGHT * figures.jitter / before.jitter) / (1.0 + JITTER_WEIGHT)
        }))
    }
}
