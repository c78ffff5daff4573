//! Frames that a probe receives, one by one.

use oqtal_bus::time::{Span, Time};
use oqtal_config::ReceiverOptions;

use super::figures::{BodyFigures, ClockFigures, IntervalFigures, NoiseFigures, ProbeFigures};
use super::statistics::{NoiseWindow, median, percentile};
use crate::gate::{FrameCounts, FrameGate, FrameRefusal, FrameStamp};
use crate::stream::{FrameSink, MeasuredBody};

/// Length of a window of noise: what moves slowly does not count as noise.
const WINDOW: Span = Span::from_millis(1000);
/// Deviation in a window above which a body does not rest \[mm\].
const MOVES_MM: f64 = 20.0;
/// An interval between two frames above this is a gap \[ns\].
const GAP_NS: i64 = 50_000_000;
/// Delays that are kept \[-\].
const MAX_DELAYS: usize = 1 << 20;

/// Observations of one body.
#[derive(Clone, Debug, Default)]
struct ObservedBody {
    id: u32,
    frames: u64,
    tracked: u64,
    window: NoiseWindow,
    window_began: Time,
    noise: Vec<NoiseFigures>,
}

/// Takes the frames of a probe.
#[derive(Debug)]
pub struct ProbeListener {
    gates: Vec<FrameGate>,
    /// The first gate with a frame: if each body has its own stamps, the intervals of one body are the frame intervals.
    timed: Option<usize>,
    bodies: Vec<ObservedBody>,
    last_arrival: Time,
    arrival: Time,
    intervals: Vec<i64>,
    delays: Vec<i64>,
    damaged: u64,
    /// Whether frames have numbers.
    are_numbered: bool,
    /// Time without a frame after which the server counts as silent.
    silence: Span,
}

impl ProbeListener {
    /// Listener with this number of gates and bodies.
    pub fn new(options: &ReceiverOptions, (gates, bodies): (usize, usize)) -> Self {
        Self {
            gates: vec![FrameGate::new(options); gates.max(1)],
            timed: None,
            bodies: vec![ObservedBody::default(); bodies],
            last_arrival: Time::UNSET,
            arrival: Time::UNSET,
            intervals: Vec::new(),
            delays: Vec::new(),
            damaged: 0,
            are_numbered: false,
            silence: Span::from_seconds(options.silence_ms * 1e-3),
        }
    }

    /// Figures of the frames received in the `duration` that ends at `end`. Of a server that is silent at the end, they are those until
    /// its last frame.
    pub fn figures(mut self, duration: Span, end: Time) -> ProbeFigures {
        let silence = end.since(self.last_arrival);
        let has_begun = self.last_arrival.is_set();
        let is_silent = has_begun && silence > self.silence;
        if has_begun && !is_silent && silence.nanos() > GAP_NS {
            self.intervals.push(silence.nanos());
        }
        let counts = self.gates.iter().map(FrameGate::counts);
        let counts = counts.fold(FrameCounts::default(), FrameCounts::plus);
        let total_s = self.intervals.iter().sum::<i64>() as f64 * 1e-9;
        let median_s = percentile(&self.intervals, 50.0) as f64 * 1e-9;
        // A frame that is overtaken counts as lost first.
        let lost = self.are_numbered.then(|| counts.lost.saturating_sub(counts.out_of_order));
        let count = self.intervals.len() as f64;
        // Of frames that arrive in bursts, the intervals do not show the period.
        let period_s = (median_s * count >= 0.2 * total_s).then_some(median_s).filter(|s| *s > 0.0);
        let unseen = period_s.map_or(0.0, |period_s| (total_s / period_s).round() - count);
        let missing = lost.unwrap_or(unseen.max(0.0) as u64);
        let arrived =
            if self.are_numbered { counts.arrived } else { self.intervals.len() as u64 + 1 };
        ProbeFigures {
            seconds: duration.seconds(),
            silent_from_s: is_silent.then(|| (duration - silence).seconds()),
            rate_hz: (total_s > 0.0).then(|| count / total_s),
            camera_rate_hz: period_s.map(f64::recip),
            loss: has_begun.then(|| missing as f64 / (arrived + missing).max(1) as f64),
            gaps: has_begun
                .then(|| self.intervals.iter().filter(|interval| **interval > GAP_NS).count()),
            interval: interval_figures(&self.intervals),
            lost,
            counts,
            damaged: self.damaged,
            clock: has_begun.then(|| self.clock_figures()),
            noise: noise_figures(&mut self.bodies),
            bodies: self.bodies.iter().map(ObservedBody::figures).collect(),
            ..ProbeFigures::default()
        }
    }

    /// Figures of the clock by which the frames are dated.
    fn clock_figures(&self) -> ClockFigures {
        let clock = self.gates[self.timed.unwrap_or(0)].clock();
        ClockFigures {
            known: clock.is_known,
            offset_ns: clock.offset_ns,
            drift_ppm: clock.drift_ppm,
            residual_p99_ns: percentile(&self.delays, 99.0),
            uncertainty_ns: clock.uncertainty.nanos(),
            relearned: clock.relearned,
        }
    }
}

/// Noise of the bodies that rest; `None` if none does.
fn noise_figures(bodies: &mut [ObservedBody]) -> Option<NoiseFigures> {
    let mut noise = Vec::new();
    for body in bodies {
        body.noise.extend(body.window.finish());
        let rests = |window: &&NoiseFigures| window.position_mm.iter().all(|x| *x < MOVES_MM);
        noise.extend(body.noise.iter().filter(rests));
    }
    let position_mm = median(|window| window.position_mm, &noise)?;
    let attitude_deg = median(|window| window.attitude_deg, &noise)?;
    Some(NoiseFigures { position_mm, attitude_deg })
}

/// Figures of the intervals \[ns\]; `None` without any.
fn interval_figures(intervals: &[i64]) -> Option<IntervalFigures> {
    Some(IntervalFigures {
        min_ns: *intervals.iter().min()?,
        p50_ns: percentile(intervals, 50.0),
        p99_ns: percentile(intervals, 99.0),
        max_ns: *intervals.iter().max()?,
    })
}

impl ObservedBody {
    fn figures(&self) -> BodyFigures {
        let tracked = (self.frames > 0).then(|| self.tracked as f64 / self.frames as f64);
        BodyFigures { id: i64::from(self.id), tracked, ..BodyFigures::default() }
    }
}

impl FrameSink for ProbeListener {
    fn frame(&mut self, gate: usize, stamp: FrameStamp, arrival: Time) {
        let Some(frame_gate) = self.gates.get_mut(gate) else { return };
        self.are_numbered |= stamp.number.is_some();
        let checked = frame_gate.check(stamp, arrival);
        self.arrival = arrival;
        let repeated = matches!(checked, Err(FrameRefusal::Repeated | FrameRefusal::OutOfOrder));
        if *self.timed.get_or_insert(gate) != gate || repeated {
            return;
        }
        if self.last_arrival.is_set() && self.intervals.len() < MAX_DELAYS {
            self.intervals.push(arrival.since(self.last_arrival).nanos());
        }
        self.last_arrival = arrival;
        if let Ok(dated) = checked
            && self.delays.len() < MAX_DELAYS
        {
            self.delays.push(dated.captured.delay.nanos());
        }
    }

    fn body(&mut self, _gate: usize, route: usize, body: MeasuredBody) {
        let Some(body_state) = self.bodies.get_mut(route) else { return };
        body_state.id = body.number;
        body_state.frames += 1;
        let Some(pose) = &body.pose else { return };
        body_state.tracked += 1;
        if !body_state.window_began.is_set()
            || self.arrival.since(body_state.window_began) >= WINDOW
        {
            body_state.noise.extend(body_state.window.finish());
            body_state.window_began = self.arrival;
        }
        body_state.window.add(pose);
    }

    fn damaged(&mut self) {
        self.damaged += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Config;

    /// Figures of numbered frames that arrive at `arrivals` \[ms\], observed until `end` \[ms\].
    fn figures(arrivals: impl Iterator<Item = i64>, end: i64) -> ProbeFigures {
        figures_of((0..).zip(arrivals).map(|(number, millis)| (Some(number), millis)), end)
    }

    /// Figures of frames with these numbers and arrivals \[ms\], observed until `end` \[ms\].
    fn figures_of(frames: impl Iterator<Item = (Option<u32>, i64)>, end: i64) -> ProbeFigures {
        let mut listener = ProbeListener::new(&Config::default().receiver, (1, 0));
        let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
        for (number, millis) in frames {
            let stamp_ns = Some(millis.unsigned_abs() * 1_000_000);
            listener.frame(0, FrameStamp { number, stamp_ns }, at(millis));
        }
        listener.figures(Span::from_millis(end), at(end))
    }

    #[test]
    fn a_server_that_falls_silent_has_the_figures_until_then() {
        let figures = figures((0..=2000).step_by(10), 8000);
        assert_eq!((figures.rate_hz.unwrap().round(), figures.gaps), (100.0, Some(0)));
        assert_eq!(figures.silent_from_s, Some(2.0));
    }

    /// Every tenth frame of cameras at 100 Hz is lost.
    #[test]
    fn losses_lower_the_rate_of_arrivals_and_not_that_of_the_cameras() {
        for is_numbered in [true, false] {
            let arrived = (1..1000_u32).filter(|number| number % 10 != 0);
            let frames =
                arrived.map(|number| (is_numbered.then_some(number), i64::from(number) * 10));
            let figures = figures_of(frames, 10_000);
            assert_eq!(figures.camera_rate_hz.unwrap().round(), 100.0);
            assert_eq!(figures.rate_hz.unwrap().round(), 90.0);
            assert!((figures.loss.unwrap() - 0.1).abs() < 0.005, "{figures:?}");
            assert_eq!(figures.lost, is_numbered.then_some(99));
        }
        assert_eq!(figures_of((0..9).map(|k| (None, k * 10)), 90).loss, Some(0.0));
    }

    #[test]
    fn a_gap_is_found_wherever_it_is() {
        let gaps = |arrivals: &[i64], end| {
            let ProbeFigures { interval, gaps, .. } = figures(arrivals.iter().copied(), end);
            (interval.unwrap().max_ns / 1_000_000, gaps.unwrap())
        };
        let frames: Vec<i64> = (0..1000).step_by(10).collect();
        let stalled: Vec<i64> =
            frames.iter().copied().filter(|millis| !(300..700).contains(millis)).collect();
        assert_eq!(gaps(&frames, 1000), (10, 0));
        assert_eq!(gaps(&stalled, 1000), (410, 1), "in the middle");
        assert_eq!(gaps(&frames, 1400), (410, 1), "at the end");
    }
}
