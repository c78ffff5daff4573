//! Checks of a camera system: findings against flying with it at the rate of the loop.

use std::ops::Range;

use oqtal_config::Config;

use super::figures::ProbeFigures;
use super::finding::{ProbeFinding, Severity};
use crate::clock::MAX_DRIFT;

/// A check: its name, severity and remedy, and what it finds.
type ProbeCheck = (&'static str, Severity, &'static str, fn(&ProbeFigures) -> Option<String>);

/// Rate of the cameras over that of the loop below which no flight is possible \[-\].
const TOO_SLOW: f64 = 0.66;
/// Interval between two frames, in periods of the loop, above which there is advice \[-\].
const GAP_PERIODS: f64 = 3.0;
const LOSS_REMEDY: &str = "connect by cable to a switch of its own";
const TCP_REMEDY: &str = "connect by cable to a switch of its own, or take transport=tcp";

/// The checks, in the order in which they are printed. Each is explained in docs/cameras.md.
const CHECKS: &[ProbeCheck] = &[
    (
        "frames",
        Severity::Problem,
        "start the real-time measurement, allow the data port in the firewall, or take another transport",
        |f| (f.counts.arrived == 0).then(|| "none came".to_owned()),
    ),
    (
        "frames",
        Severity::Problem,
        "see whether the camera software still measures, and whether its computer is connected; start the probe again",
        |f| {
            f.silent_from_s
                .map(|s| format!("none after {s:.1} s; the figures are those until then"))
        },
    ),
    (
        "longest gap",
        Severity::Problem,
        "connect by cable, not by radio; motors stop after safety.coast-ms without a pose",
        |f| over(f.interval?.max_ns, f.coast_ms..f64::INFINITY),
    ),
    (
        "longest gap",
        Severity::Advice,
        "connect by cable, not by radio; close other programs on the cameras' computer",
        |f| over(f.interval?.max_ns, GAP_PERIODS * 1e3 / f.loop_hz..f.coast_ms),
    ),
    ("lost frames", Severity::Problem, LOSS_REMEDY, |f| lost(f, !f.has_tcp, f.loss_warning..2.0)),
    ("lost frames", Severity::Problem, TCP_REMEDY, |f| lost(f, f.has_tcp, f.loss_warning..2.0)),
    ("lost frames", Severity::Advice, LOSS_REMEDY, |f| lost(f, !f.has_tcp, 0.01..f.loss_warning)),
    ("lost frames", Severity::Advice, TCP_REMEDY, |f| lost(f, f.has_tcp, 0.01..f.loss_warning)),
    (
        "order of frames",
        Severity::Advice,
        "look for two paths or two servers in the network",
        |f| {
            let wrong = f.counts.repeated + f.counts.out_of_order;
            (wrong > 0).then(|| format!("{wrong} frames came twice or too late"))
        },
    ),
    (
        "damaged messages",
        Severity::Advice,
        "look for another program that sends to this port",
        |f| (f.damaged > 0).then(|| f.damaged.to_string()),
    ),
    (
        "clock",
        Severity::Problem,
        "probe again; if it stays so, set receiver.stamps = \"arrival\": network delays then become errors of the stamps",
        |f| {
            (f.counts.arrived > 100 && !f.clock?.known)
                .then(|| "the server's stamps do not follow a clock".to_owned())
        },
    ),
    (
        "clock",
        Severity::Advice,
        "while flying, switch the time service of the cameras' computer off and do not restart the measurement: after a step of more than 25 ms there are no poses for half a second",
        |f| {
            let times = f.clock?.relearned;
            (times > 0).then(|| format!("steps of the server's clock: {times}"))
        },
    ),
    (
        "drift",
        Severity::Problem,
        "a time service that corrects a clock changes its rate: switch it off on both computers and probe again; if it stays so, set receiver.stamps = \"arrival\"",
        |f| {
            let drift_ppm = f.clock?.drift_ppm;
            (drift_ppm.abs() > 0.95e6 * MAX_DRIFT && f.seconds >= 5.0)
                .then(|| format!("{drift_ppm:.0} ppm; the estimate ends at ±200 ppm"))
        },
    ),
    (
        "delays",
        Severity::Advice,
        "connect by cable; close other programs on the cameras' computer; take UDP where the protocol has both (QTM: transport=udp)",
        |f| over(f.clock?.residual_p99_ns, 10.0..f64::INFINITY),
    ),
    (
        "tracking",
        Severity::Problem,
        "put the vehicle into the volume, look at its markers in the camera software",
        |f| bodies(f, |tracked| tracked == 0.0),
    ),
    ("tracking", Severity::Advice, "add markers, uncover them, or recalibrate the cameras", |f| {
        bodies(f, |tracked| tracked > 0.0 && tracked < 0.99)
    }),
    (
        "noise",
        Severity::Advice,
        "recalibrate the cameras, enlarge the markers or their distances",
        |f| {
            let noise = f.noise?;
            let position_mm = noise.position_mm.into_iter().fold(0.0, f64::max);
            let attitude_deg = noise.attitude_deg.into_iter().fold(0.0, f64::max);
            (position_mm > 2.0 || attitude_deg > 1.0)
                .then(|| format!("{position_mm:.2} mm, {attitude_deg:.2} deg"))
        },
    ),
];

/// Fills in the rate of the loop of `config`, and the advice on it for these cameras.
pub fn set_rates(figures: &mut ProbeFigures, config: &Config) {
    let wanted_hz = config.control.rate_hz;
    figures.rate_advice = figures.camera_rate_hz.and_then(|hz| config.camera_rate_advice(hz));
    let is_flown = figures.camera_rate_hz.is_some_and(|hz| hz >= TOO_SLOW * wanted_hz);
    let advised = figures.rate_advice.as_ref().filter(|_| is_flown);
    figures.loop_hz = advised.map_or(wanted_hz, |advice| advice.loop_hz);
}

/// Findings against flying with these figures.
pub fn findings(figures: &ProbeFigures) -> Vec<ProbeFinding> {
    let found = CHECKS.iter().filter_map(|(name, severity, remedy, check)| {
        let found = check(figures)?;
        Some(ProbeFinding { name, severity: *severity, found, remedy: (*remedy).into() })
    });
    rate(figures).into_iter().chain(found).collect()
}

/// The share of lost frames in words if it is in `range`, for a link that is `meant`.
fn lost(figures: &ProbeFigures, meant: bool, range: Range<f64>) -> Option<String> {
    let loss = figures.loss?;
    let limit = figures.loss_warning;
    let beyond = if loss >= limit {
        format!(", above safety.pose-loss-warning, {limit}")
    } else {
        String::new()
    };
    (meant && loss > 0.0 && range.contains(&loss)).then(|| format!("{:.1} %{beyond}", loss * 100.0))
}

/// The advice on the rates; a problem if cameras are too slow for the configured loop.
fn rate(figures: &ProbeFigures) -> Option<ProbeFinding> {
    let (rate_hz, advice) = (figures.camera_rate_hz?, figures.rate_advice.clone()?);
    let is_too_slow = rate_hz < TOO_SLOW * figures.loop_hz;
    let severity = if is_too_slow { Severity::Problem } else { Severity::Advice };
    Some(ProbeFinding { name: "rate", severity, found: advice.found, remedy: advice.remedy.into() })
}

/// The duration in words if it is above the start of `range_ms` and at most its end \[ms\].
fn over(nanos: i64, range_ms: Range<f64>) -> Option<String> {
    let ms = nanos as f64 * 1e-6;
    (ms > range_ms.start && ms <= range_ms.end).then(|| format!("{ms:.0} ms"))
}

/// The bodies whose share of tracked frames is `wrong`, in words.
fn bodies(figures: &ProbeFigures, wrong: fn(f64) -> bool) -> Option<String> {
    // A body that is in no frame, although others are, is not seen.
    let absent = (figures.counts.arrived > 0).then_some(0.0);
    let known = figures.bodies.iter().filter(|body| !body.is_unknown);
    let seen = known.filter_map(|body| Some((&body.name, body.tracked.or(absent)?)));
    let words: Vec<String> = seen
        .filter(|(_, tracked)| wrong(*tracked))
        .map(|(name, tracked)| format!("`{name}` {:.0} %", tracked * 100.0))
        .collect();
    (!words.is_empty()).then(|| words.join(", "))
}

#[cfg(test)]
mod tests {
    use super::super::figures::{BodyFigures, ClockFigures, IntervalFigures, NoiseFigures};
    use super::*;
    use crate::gate::FrameCounts;
    use crate::probe::FitnessVerdict;

    fn good() -> ProbeFigures {
        ProbeFigures {
            seconds: 10.0,
            camera_rate_hz: Some(100.0),
            loss: Some(0.0),
            loss_warning: 0.05,
            coast_ms: 250.0,
            loop_hz: 60.0,
            interval: Some(IntervalFigures { max_ns: 12_000_000, ..IntervalFigures::default() }),
            clock: Some(ClockFigures { known: true, ..ClockFigures::default() }),
            bodies: vec![BodyFigures { id: 1, tracked: Some(1.0), ..BodyFigures::default() }],
            counts: FrameCounts { arrived: 1000, ..FrameCounts::default() },
            ..ProbeFigures::default()
        }
    }

    fn names(figures: &ProbeFigures) -> Vec<(&'static str, Severity)> {
        findings(figures).into_iter().map(|finding| (finding.name, finding.severity)).collect()
    }

    #[test]
    fn a_good_system_is_fit_and_each_fault_is_found() {
        use Severity::{Advice, Problem};
        assert_eq!(names(&good()), []);
        assert_eq!(FitnessVerdict::of(&[]), FitnessVerdict::Fit);
        for (max_ns, severity) in [(60_000_000, Advice), (300_000_000, Problem)] {
            let interval = Some(IntervalFigures { max_ns, ..IntervalFigures::default() });
            assert_eq!(names(&ProbeFigures { interval, ..good() }), [("longest gap", severity)]);
        }
        let clock = Some(ClockFigures { drift_ppm: 200.0, ..good().clock.unwrap() });
        assert_eq!(names(&ProbeFigures { clock, ..good() }), [("drift", Problem)]);
        let noise = Some(NoiseFigures { position_mm: [0.1, 3.0, 0.1], ..NoiseFigures::default() });
        assert_eq!(names(&ProbeFigures { noise, ..good() }), [("noise", Advice)]);
        for (tracked, severity) in [(0.0, Problem), (0.9, Advice)] {
            let bodies = vec![BodyFigures { tracked: Some(tracked), ..good().bodies[0].clone() }];
            assert_eq!(names(&ProbeFigures { bodies, ..good() }), [("tracking", severity)]);
        }
    }

    #[test]
    fn rates_are_fit_once_they_are_configured_as_advised() {
        let config = |poses_hz: f64, loop_hz: f64| {
            let mut config = Config::default();
            (config.safety.pose_rate_hz, config.control.rate_hz) = (poses_hz, loop_hz);
            config
        };
        let probed = |camera_rate_hz, config: &Config| {
            let mut figures = ProbeFigures { camera_rate_hz: Some(camera_rate_hz), ..good() };
            set_rates(&mut figures, config);
            (names(&figures), figures.to_string())
        };
        use Severity::{Advice, Problem};
        for (rate_hz, poses_hz, loop_hz, severity, verdict) in [
            (30.0, 30.0, 30.0, Problem, "for a loop of 60 Hz"),
            (40.0, 40.0, 40.0, Advice, "for a loop of 40 Hz, set as advised"),
            (50.0, 50.0, 50.0, Advice, "for a loop of 50 Hz, set as advised"),
            (100.0, 100.0, 50.0, Advice, "for a loop of 50 Hz, set as advised"),
            (240.0, 240.0, 60.0, Advice, "for a loop of 60 Hz, set as advised"),
        ] {
            let (found, text) = probed(rate_hz, &config(60.0, 60.0));
            assert_eq!(found, [("rate", severity)], "{rate_hz}");
            assert!(text.ends_with(verdict), "{text}");
            let (found, text) = probed(rate_hz, &config(poses_hz, loop_hz));
            assert_eq!(found, [], "{rate_hz}");
            assert!(text.ends_with(&format!("for a loop of {loop_hz} Hz")), "{text}");
        }
        let (found, text) = probed(100.0, &config(100.0, 60.0));
        assert_eq!(found, [("rate", Advice)], "one pose in two is not 60 Hz");
        assert!(text.ends_with("for a loop of 50 Hz, set as advised"), "{text}");
    }

    #[test]
    fn the_longest_gap_is_compared_with_the_configured_limits() {
        let longest = |max_ns, coast_ms, loop_hz| {
            let interval = Some(IntervalFigures { max_ns, ..IntervalFigures::default() });
            names(&ProbeFigures { interval, coast_ms, loop_hz, ..good() })
        };
        assert_eq!(longest(300_000_000, 500.0, 60.0), [("longest gap", Severity::Advice)]);
        assert_eq!(longest(60_000_000, 250.0, 40.0), []);
    }

    #[test]
    fn losses_are_within_the_limit_of_the_daemon_and_their_remedy_is_one_that_the_link_has() {
        use Severity::{Advice, Problem};
        for (loss, has_tcp, severity) in [
            (0.03, false, Advice),
            (0.03, true, Advice),
            (0.06, false, Problem),
            (0.06, true, Problem),
        ] {
            let found = findings(&ProbeFigures { loss: Some(loss), has_tcp, ..good() });
            let [ProbeFinding { name: "lost frames", severity: found, ref remedy, .. }] = found[..]
            else {
                panic!("{found:?}")
            };
            assert_eq!((found, remedy.contains("transport=tcp")), (severity, has_tcp));
        }
    }

    #[test]
    fn silence_is_a_problem() {
        let silent = ProbeFigures {
            counts: FrameCounts::default(),
            camera_rate_hz: None,
            loss: None,
            ..good()
        };
        assert_eq!(names(&silent), [("frames", Severity::Problem)]);
        assert_eq!(FitnessVerdict::of(&findings(&silent)), FitnessVerdict::Unfit);
    }
}
