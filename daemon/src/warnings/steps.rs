//! Warning of a step of the reference after which the daemon lands the vehicle (F44), since it does not arrive in time. The configured
//! law flies the model of `[vehicle]` along the reference: the outer loops, their limits, the lags, the delays and the drag all count.

use oqtal_config::Config;
use oqtal_control::trajectory::{FlightPlan, Phase, Reference};

use super::model_flight::ModelFlight;
use crate::supervisor::FAR_OFF_MS;

/// Shortest step that is looked at \[m\].
const LEAST_STEP_M: f64 = 0.1;
/// Time after the last step that is flown, and before the first one \[s\].
const AFTER_S: f64 = 15.0;
const BEFORE_S: f64 = 0.2;
/// Longest part of a flight that is flown, from the first step on \[s\].
const LONGEST_S: f64 = 120.0;
/// Margin by which the vehicle may be further from its reference than the model, and for longer \[m, s\], because of disturbances and sag.
/// In 400 simulated flights of steps from 2 to 5 m with 0.8 to 1.8 m/s, of all laws with the shipped vehicle and one with lags of 60 and 75
/// ms and a curved thrust, every step after which the daemon landed had a warning, and so had 7 % of the others.
const SPARE_M: f64 = 0.15;
const SPARE_S: f64 = 0.1;
/// Distance, over the length of all steps, beyond which the law cannot fly the model at all \[-\]; a landing is then not caused by a step.
const ASTRAY: f64 = 2.0;
/// Step of the search for a limit that does not end the flight \[m\], and maximum number of steps \[-\].
const LIMIT_STEP_M: f64 = 0.1;
const MOST_STEPS: u32 = 40;
/// Factors of the speed that are flown \[-\].
const FASTER: [f64; 4] = [1.25, 1.5, 2.0, 3.0];
/// Share of the speed limit that a remedy uses at most \[-\].
const SPEED_SHARE: f64 = 0.8;

/// Part of a flight in which steps of the reference act.
#[derive(Clone, Copy)]
struct Steps {
    /// First and last instant \[s\].
    window: [f64; 2],
    /// Length of all steps \[m\].
    length_m: f64,
}

/// Warning of a step of the reference from which the vehicle is further than the daemon allows for too long.
pub(super) fn too_far(
    plan: &FlightPlan,
    samples: &[(f64, Reference)],
    config: &Config,
) -> Option<String> {
    let limit_m = config.safety.tracking_limit_m;
    let steps = steps(samples).filter(|steps| steps.length_m > limit_m - SPARE_M)?;
    let distances = distances(plan, config, &steps)?;
    let (t_s, distance_m) = far_since(&distances, limit_m)?;
    let speed_m_s = config.position.horizontal_velocity_limit_m_s;
    let suffices = |speed_m_s: &f64| {
        let mut faster = config.clone();
        faster.position.horizontal_velocity_limit_m_s = *speed_m_s;
        let flown = self::distances(plan, &faster, &steps);
        flown.is_some_and(|distances| far_since(&distances, limit_m).is_none())
    };
    let remedies = [
        (1..=MOST_STEPS)
            .map(|step| tenths(limit_m + f64::from(step) * LIMIT_STEP_M))
            .find(|limit_m| far_since(&distances, *limit_m).is_none())
            .map(|limit_m| format!("set safety.tracking-limit-m to {limit_m}")),
        FASTER
            .map(|times| tenths(times * speed_m_s))
            .into_iter()
            .filter(|speed_m_s| *speed_m_s <= SPEED_SHARE * config.safety.speed_limit_m_s)
            .find(suffices)
            .map(|speed_m_s| format!("set position.horizontal-velocity-limit-m-s to {speed_m_s}")),
    ];
    Some(format!(
        "the reference steps: from {t_s:.1} s after arming on, the vehicle is up to {distance_m:.2} m from it. At position.horizontal-velocity-limit-m-s = {speed_m_s} it may be further from it than safety.tracking-limit-m = {limit_m} for {} s, after which the daemon lands it; make the step smaller{}",
        FAR_OFF_MS as f64 * 1e-3,
        remedies.iter().flatten().map(|remedy| format!(", or {remedy}")).collect::<String>()
    ))
}

/// The least number of tenths that is not below `value`, but for its rounding.
fn tenths(value: f64) -> f64 {
    (value * 10.0 - 1e-6).ceil() / 10.0
}

/// The steps of the reference; `None` without any.
fn steps(samples: &[(f64, Reference)]) -> Option<Steps> {
    let step = |pair: &[(f64, Reference)]| {
        let ((before_s, before), (after_s, after)) = (pair[0], pair[1]);
        // A motion that the velocity of the reference does not explain is a step.
        let moved = (before.velocity + after.velocity) * (0.5 * (after_s - before_s));
        (before_s, (after.position - before.position - moved).norm())
    };
    let steps = samples.windows(2).map(step).filter(|(_, step_m)| *step_m > LEAST_STEP_M);
    let steps: Vec<(f64, f64)> = steps.collect();
    let ((first_s, _), (last_s, _)) = (steps.first()?, steps.last()?);
    let window = [(first_s - BEFORE_S).max(0.0), (last_s + AFTER_S).min(first_s + LONGEST_S)];
    Some(Steps { window, length_m: steps.iter().map(|(_, step_m)| step_m).sum() })
}

/// When the model begins to be further than `limit_m` \[m\] from its reference for longer than the daemon allows \[s\], and its greatest
/// distance from then on \[m\].
fn far_since(distances: &[(f64, f64)], limit_m: f64) -> Option<(f64, f64)> {
    let mut since: Option<(f64, f64)> = None;
    for (t_s, distance_m) in distances {
        let is_far = *distance_m > limit_m - SPARE_M;
        since = is_far.then(|| since.map_or((*t_s, *distance_m), |(t, d)| (t, d.max(*distance_m))));
        if since.is_some_and(|(from_s, _)| t_s - from_s > FAR_OFF_MS as f64 * 1e-3 - SPARE_S) {
            return since;
        }
    }
    None
}

/// Flies the model along `plan` where `steps` act, or until the landing: its distance from the reference over time \[s, m\], zero where an
/// attitude is prescribed. `None` if the law cannot fly it.
fn distances(plan: &FlightPlan, config: &Config, steps: &Steps) -> Option<Vec<(f64, f64)>> {
    let [from_s, to_s] = steps.window;
    let mut flight = ModelFlight::at(&plan.sample(from_s), from_s, config)?;
    let period_s = 1.0 / config.loop_rate_hz();
    let mut distances = Vec::new();
    for tick in 1..=((to_s - from_s) / period_s) as u64 {
        let now_s = from_s + tick as f64 * period_s;
        let reference = plan.sample(now_s);
        if reference.phase == Phase::Landing {
            break;
        }
        let motion = flight.tick(tick, (now_s, period_s), &reference)?;
        let distance_m = match reference.attitude {
            Some(_) => 0.0,
            None => (motion.position - reference.position).norm(),
        };
        if distance_m > ASTRAY * steps.length_m {
            return None;
        }
        distances.push((now_s, distance_m));
    }
    Some(distances)
}
