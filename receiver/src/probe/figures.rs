//! Figures of a probe, and their text.

use std::fmt;

use oqtal_config::CameraRateAdvice;
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
    /// Mean rate of the frames \[Hz\]; `None` if there are not two.
    pub rate_hz: Option<f64>,
    /// Rate of the cameras: that of the median interval between arrivals, which lost frames do not lower \[Hz\]; `None` if there are not two
    /// frames.
    pub camera_rate_hz: Option<f64>,
    /// Share of the cameras' frames that did not arrive: by the server's numbers, without numbers by the intervals \[0..1\]; `None` without a
    /// frame.
    pub loss: Option<f64>,
    /// Share of lost frames above which the daemon warns, `safety.pose-loss-warning` \[0..1\].
    #[serde(skip)]
    pub loss_warning: f64,
    /// Age of the last pose at which the daemon stops the motors, `safety.coast-ms` \[ms\].
    #[serde(skip)]
    pub coast_ms: f64,
    /// Whether poses are dated by their arrival: the server's clock is then not used.
    #[serde(skip)]
    pub dates_by_arrival: bool,
    /// Whether the link can also receive over TCP.
    #[serde(skip)]
    pub has_tcp: bool,
    /// Rate of the loop that is to fly with them, as configured \[Hz\]; the advised one if there is advice on it.
    pub loop_hz: f64,
    /// Advice on the rates of cameras and loop; `None` if they are as configured.
    #[serde(skip)]
    pub rate_advice: Option<CameraRateAdvice>,
    /// Intervals between arrivals; `None` without any.
    pub interval: Option<IntervalFigures>,
    /// Intervals longer than 50 ms \[-\]; `None` without a frame.
    pub gaps: Option<usize>,
    /// Frames that never came, by the server's numbers \[-\]; `None` without a frame, and if frames have no numbers.
    pub lost: Option<u64>,
    /// The server's clock; `None` without a frame.
    pub clock: Option<ClockFigures>,
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
    /// Whether the server's clock is known.
    pub known: bool,
    /// Our clock minus the server's, the least delay included \[ns\].
    pub offset_ns: i64,
    /// Rate of our clock against the server's \[ppm\].
    pub drift_ppm: f64,
    /// Delay beyond the least one that 99 frames of 100 do not exceed \[ns\].
    pub residual_p99_ns: i64,
    /// Error of an instant of capture that 99 of 100 do not exceed, the least delay excluded \[ns\].
    pub uncertainty_ns: i64,
    /// Number of times that the clock was set during the probe \[-\].
    pub relearned: u64,
}

/// Standard deviations of a body at rest in a window of a second; of a probe, their median over all windows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct NoiseFigures {
    /// Standard deviation of the position \[mm, axes of the room\].
    pub position_mm: [f64; 3],
    /// Standard deviation of the attitude \[deg, axes of the body\].
    pub attitude_deg: [f64; 3],
}

/// A body.
#[derive(Clone, Debug, Default, Serialize)]
pub struct BodyFigures {
    /// Name.
    pub name: String,
    /// Number in the camera system, from 1; 0 if no frame had it \[-\].
    pub id: i64,
    /// Share of its frames in which the cameras saw it \[0..1\]; `None` if no frame had it.
    pub tracked: Option<f64>,
    /// Whether the camera system has no body of this name.
    #[serde(skip)]
    pub is_unknown: bool,
}

impl ProbeFigures {
    /// Writes the figures of the frames, which are known.
    fn write_frames(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |nanos: i64| nanos as f64 * 1e-6;
        if let (Some(rate_hz), Some(camera_hz), Some(gaps)) =
            (self.rate_hz, self.camera_rate_hz, self.gaps)
        {
            let lost = match self.lost {
                Some(lost) => format!("{lost} lost"),
                None => format!("about {:.1} % lost", self.loss.unwrap_or(0.0) * 100.0),
            };
            writeln!(
                f,
                "rate       {rate_hz:.2} Hz, of cameras at {camera_hz:.1} Hz, {lost}, {gaps} gaps over 50 ms"
            )?;
        }
        if let Some(IntervalFigures { min_ns, p50_ns, p99_ns, max_ns }) = self.interval {
            let [min, median, p99, max] = [min_ns, p50_ns, p99_ns, max_ns].map(ms);
            writeln!(
                f,
                "interval   min {min:.2}, median {median:.2}, p99 {p99:.2}, max {max:.2} ms"
            )?;
        }
        self.write_clock(f)?;
        match &self.noise {
            Some(NoiseFigures { position_mm: [x, y, z], attitude_deg: [a, b, c] }) => writeln!(
                f,
                "noise      x {x:.3}, y {y:.3}, z {z:.3} mm; about x {a:.3}, y {b:.3}, z {c:.3} deg"
            ),
            None if self
                .bodies
                .iter()
                .all(|body| body.tracked.is_none_or(|share| share == 0.0)) =>
            {
                writeln!(f, "noise      no body was seen")
            }
            None => writeln!(f, "noise      no body rests"),
        }
    }

    /// Writes the figures of the server's clock.
    fn write_clock(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.clock {
            Some(_) if self.dates_by_arrival => {
                writeln!(f, "clock      not used, since receiver.stamps is \"arrival\"")
            }
            Some(clock) => writeln!(f, "{clock}"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for ProbeFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}, observed for {:.0} s", self.server, self.seconds)?;
        match self.counts.arrived {
            0 => writeln!(f, "frames     none came")?,
            _ => self.write_frames(f)?,
        }
        self.bodies.iter().try_for_each(|body| writeln!(f, "{body}"))?;
        self.findings.iter().try_for_each(|finding| writeln!(f, "{finding}"))?;
        let Self { verdict, loop_hz, .. } = self;
        let is_advised = self.rate_advice.as_ref().is_some_and(|it| it.loop_hz == *loop_hz);
        let advised = if is_advised { ", set as advised" } else { "" };
        write!(f, "verdict    {verdict} for a loop of {loop_hz} Hz{advised}")
    }
}

impl fmt::Display for BodyFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, id, tracked, is_unknown } = self;
        write!(f, "body       {name}, ")?;
        match tracked {
            _ if *is_unknown => write!(f, "unknown to the camera system"),
            None => write!(f, "in no frame"),
            Some(share) => write!(f, "number {id}, tracked {:.1} % of the time", share * 100.0),
        }
    }
}

impl fmt::Display for ClockFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { known, offset_ns, drift_ppm, residual_p99_ns, uncertainty_ns, .. } = *self;
        if !known {
            return write!(f, "clock      unknown");
        }
        write!(
            f,
            "clock      offset {:.3} s (any value is fine), drift {drift_ppm:.1} ppm, delays p99 {:.3} ms, known to {:.3} ms",
            offset_ns as f64 * 1e-9,
            residual_p99_ns as f64 * 1e-6,
            uncertainty_ns as f64 * 1e-6
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_frames_there_are_no_figures() {
        let bodies = vec![BodyFigures { name: "a".to_owned(), ..BodyFigures::default() }];
        let text = ProbeFigures { bodies: bodies.clone(), ..ProbeFigures::default() }.to_string();
        assert!(text.contains("\nframes     none came\nbody       a, in no frame\n"), "{text}");
        for word in ["rate", "interval", "clock", "noise", "0.0"] {
            assert!(!text.contains(word), "{text}");
        }
        let json =
            serde_json::to_value(ProbeFigures { bodies, ..ProbeFigures::default() }).unwrap();
        for key in ["/rate_hz", "/interval", "/gaps", "/lost", "/clock", "/bodies/0/tracked"] {
            assert_eq!(json.pointer(key), Some(&serde_json::Value::Null), "{key}: {json}");
        }
    }

    #[test]
    fn a_clock_that_is_not_used_has_no_figures() {
        let counts = FrameCounts { arrived: 9, ..FrameCounts::default() };
        let clock = Some(ClockFigures { known: true, ..ClockFigures::default() });
        let text = |dates_by_arrival| {
            ProbeFigures { counts, clock, dates_by_arrival, ..ProbeFigures::default() }.to_string()
        };
        assert!(text(true).contains("\nclock      not used, since"), "{}", text(true));
        assert!(text(false).contains("known to 0.000 ms"), "{}", text(false));
    }

    #[test]
    fn an_unknown_body_is_not_said_to_move() {
        let counts = FrameCounts { arrived: 9, ..FrameCounts::default() };
        let seen = |tracked, is_unknown| {
            let body = BodyFigures { name: "a".to_owned(), id: 1, tracked, is_unknown };
            ProbeFigures { counts, bodies: vec![body], ..ProbeFigures::default() }.to_string()
        };
        let text = seen(None, true);
        assert!(text.contains("body       a, unknown to the camera system\n"), "{text}");
        assert!(text.contains("no body was seen") && !text.contains("rests"), "{text}");
        assert!(seen(Some(1.0), false).contains("noise      no body rests\n"));
    }
}
