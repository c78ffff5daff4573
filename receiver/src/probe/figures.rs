//! Figures of a probe, and their text.

use std::fmt;

use serde::Serialize;

use super::finding::{FitnessVerdict, ProbeFinding};
use crate::gate::FrameCounts;

/// Figures of a probe, the document of `--json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ProbeFigures {
    /// The server in its own words.
    pub server: String,
    /// Duration \[s\].
    pub seconds: f64,
    /// Instant after which no frame came \[s from the begin\]; `None` if frames came to the end.
    pub silent_from_s: Option<f64>,
    /// Mean rate of the frames \[Hz\].
    pub rate_hz: f64,
    /// Rate of the loop that is to fly with them \[Hz\].
    pub loop_hz: f64,
    /// Number of poses per tick of the loop at the rate that the configuration expects \[-\].
    #[serde(skip)]
    pub poses_per_tick: f64,
    /// Intervals between arrivals.
    pub interval: IntervalFigures,
    /// Intervals longer than 50 ms \[-\].
    pub gaps: usize,
    /// Frames that never came, by the server's numbers \[-\].
    pub lost: u64,
    /// The server's clock.
    pub clock: ClockFigures,
    /// Noise of the bodies that rest; `None` if none does.
    pub noise: Option<NoiseFigures>,
    /// The bodies.
    pub bodies: Vec<BodyFigures>,
    /// Whether the camera system is fit to fly with.
    pub verdict: FitnessVerdict,
    /// Findings against it.
    pub findings: Vec<ProbeFinding>,
    /// All frames by outcome.
    #[serde(skip)]
    pub counts: FrameCounts,
    /// Messages that could not be read \[-\].
    #[serde(skip)]
    pub damaged: u64,
}

/// Intervals between arrivals.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct IntervalFigures {
    /// Shortest \[ns\].
    pub min_ns: i64,
    /// Median \[ns\].
    pub p50_ns: i64,
    /// 99th percentile \[ns\].
    pub p99_ns: i64,
    /// Longest \[ns\].
    pub max_ns: i64,
}

/// The server's clock as seen from here.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct ClockFigures {
    /// Whether it is known.
    pub known: bool,
    /// Our clock minus the server's, the least delay included \[ns\].
    pub offset_ns: i64,
    /// Rate of our clock against the server's \[ppm\].
    pub drift_ppm: f64,
    /// Delay beyond the least one that 99 frames of 100 do not exceed \[ns\].
    pub residual_p99_ns: i64,
    /// Error of an instant of capture that 99 of 100 do not exceed, the least delay excluded \[ns\].
    pub uncertainty_ns: i64,
    /// How often the clock was set meanwhile \[-\].
    pub relearned: u64,
}

/// Standard deviations of a body at rest, the median over windows of a second.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct NoiseFigures {
    /// Of the position \[mm, axes of the room\].
    pub position_mm: [f64; 3],
    /// Of the attitude \[deg, axes of the body\].
    pub attitude_deg: [f64; 3],
}

/// A body.
#[derive(Clone, Debug, Default, Serialize)]
pub struct BodyFigures {
    /// Name.
    pub name: String,
    /// Number in the camera system, from 1; 0 if no frame had it \[-\].
    pub id: i64,
    /// Share of its frames in which the cameras saw it \[0..1\].
    pub tracked: f64,
}

impl fmt::Display for ProbeFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |nanos: i64| nanos as f64 * 1e-6;
        let IntervalFigures { min_ns, p50_ns, p99_ns, max_ns } = self.interval;
        writeln!(f, "{}, observed for {:.0} s", self.server, self.seconds)?;
        writeln!(
            f,
            "rate       {:.2} Hz, {} lost, {} gaps over 50 ms",
            self.rate_hz, self.lost, self.gaps
        )?;
        writeln!(
            f,
            "interval   min {:.2}, median {:.2}, p99 {:.2}, max {:.2} ms",
            ms(min_ns),
            ms(p50_ns),
            ms(p99_ns),
            ms(max_ns)
        )?;
        writeln!(f, "{}", self.clock)?;
        match &self.noise {
            Some(NoiseFigures { position_mm: [x, y, z], attitude_deg: [a, b, c] }) => writeln!(
                f,
                "noise      x {x:.3}, y {y:.3}, z {z:.3} mm; about x {a:.3}, y {b:.3}, z {c:.3} deg"
            )?,
            None => writeln!(f, "noise      no body rests")?,
        }
        for BodyFigures { name, id, tracked } in &self.bodies {
            writeln!(
                f,
                "body       {name}, number {id}, tracked {:.1} % of the time",
                tracked * 100.0
            )?;
        }
        for finding in &self.findings {
            writeln!(f, "{finding}")?;
        }
        let Self { verdict, loop_hz, .. } = self;
        write!(f, "verdict    {verdict} for a loop of {loop_hz} Hz")
    }
}

impl fmt::Display for ClockFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { offset_ns, drift_ppm, residual_p99_ns, uncertainty_ns, .. } = *self;
        write!(
            f,
            "clock      offset {:.3} s, drift {drift_ppm:.1} ppm, delays p99 {:.3} ms, known to {:.3} ms",
            offset_ns as f64 * 1e-9,
            residual_p99_ns as f64 * 1e-6,
            uncertainty_ns as f64 * 1e-6
        )
    }
}
