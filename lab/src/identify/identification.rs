//! An identification: from flights to findings, tests of the residuals, and settings.

use oqtal_config::{Setting, VehicleOptions};
use oqtal_control::statistics::median;
use oqtal_runtime::process::{Exit, Failure};
use serde::Serialize;

use super::camera_figures::{PoseLatency, RestFigures};
use super::data::{FlightData, saturated_share};
use super::estimate::{VehicleFit, estimate};
use super::finding::{FindingRule, INTERVAL, ParameterFinding, rules};
use super::fit::FitResult;
use super::flown_motion::FlownMotion;
use super::lifting::CURVATURE;
use super::residuals::ResidualTest;
use super::rotation::RotationPass;
use super::translation::TranslationPass;

/// Names of the axes of the body.
const BODY_AXES: [&str; 3] = ["roll", "pitch", "yaw"];
/// Names of the axes of the world.
const WORLD_AXES: [&str; 3] = ["x", "y", "z"];

/// Lag of the thrust below which the rotors appear to follow immediately \[s\].
const PROMPT_S: f64 = 3e-3;

/// Known scale of the vehicle; flights alone determine only the thrust over the mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// Unknown; the thrust is computed with the configured mass.
    Unknown,
    /// The mass \[kg\].
    Mass(f64),
    /// The greatest thrust \[N\].
    Thrust(f64),
}

/// Parameters of a vehicle, identified from its flights.
#[derive(Clone, Debug, Serialize)]
pub struct Identification {
    /// The parameters.
    pub findings: Vec<ParameterFinding>,
    /// Tests of the residuals, for each axis of attitude and position.
    pub residuals: Vec<ResidualTest>,
    /// Noise at rest; `None` without poses at rest.
    pub at_rest: Option<RestFigures>,
    /// Latency of the poses at rest.
    pub latency_at_rest: Option<PoseLatency>,
    /// Latency of the poses in flight.
    pub latency_in_flight: Option<PoseLatency>,
    /// Correlation time of the gusts \[s\].
    pub gust_s: f64,
    /// Whether the lag of the thrust is so short that the delay must include the lag of the rotors.
    pub has_prompt_thrust: bool,
    /// Whether the thrust is curved over its command; its value is then the thrust per commanded share where it equals the weight.
    pub has_curved_thrust: bool,
    /// Share of the commands in the air whose thrust is at an end of its range \[0..1\].
    pub saturated_share: f64,
    /// Number of poses used \[-\].
    pub poses: usize,
    /// The fits, for plots.
    #[serde(skip)]
    pub estimate: VehicleFit,
}

/// Identifies the vehicle that flew `flights`, starting from the parameters `configured`; `scale` is the known scale.
///
/// # Errors
/// A flight is too short or does not contain enough motion (exit code 65).
pub fn identify(
    flights: &[FlightData],
    configured: &VehicleOptions,
    scale: Scale,
) -> Result<Identification, Failure> {
    let estimate = estimate(flights, configured).ok_or_else(|| {
        let reason = "a flight is too short to identify the vehicle: at least two seconds in the air are needed, \
                      best those of `oqtal fly --trajectory excitation`";
        Failure::new(Exit::Data, reason)
    })?;
    let stamped_s = stamped(flights);
    let findings = [
        rotation(&estimate, configured, stamped_s),
        translation(&estimate, configured, scale),
        noise(&estimate),
    ];
    let motion = FlownMotion::of(flights);
    let with_reason = |finding: ParameterFinding| {
        let assumption = motion.assumption(&finding);
        finding.with_assumption(assumption)
    };
    Ok(Identification {
        findings: findings.concat().into_iter().map(with_reason).collect(),
        residuals: residuals(&estimate),
        at_rest: RestFigures::of(flights),
        latency_at_rest: PoseLatency::of(flights, |data| &data.rest),
        latency_in_flight: PoseLatency::of(flights, |data| &data.air),
        gust_s: estimate.lifting.noise.gust_s,
        has_prompt_thrust: may_be_prompt(&estimate.lifting.fit),
        has_curved_thrust: estimate.has_curved_thrust,
        saturated_share: saturated_share(flights),
        poses: flights.iter().map(|data| data.air.len()).sum(),
        estimate,
    })
}

/// Whether the lag of the thrust may be as short as [`PROMPT_S`] and has a sufficiently narrow interval.
fn may_be_prompt(fit: &FitResult) -> bool {
    let (lag_s, sd_s) = of(fit, 1, 1.0);
    found(&rules::THRUST_LAG, (fit, 1, 1e3), None).is_shown() && lag_s - INTERVAL * sd_s < PROMPT_S
}

/// Median delay of commands by their stamps \[s\].
fn stamped(flights: &[FlightData]) -> Option<f64> {
    median(flights.iter().filter_map(|data| data.stamped_delay_s))
}

/// Value and standard deviation of a parameter of a fit, in its unit times `factor`.
fn of(fit: &FitResult, index: usize, factor: f64) -> (f64, f64) {
    let (value, sd) = fit.of(index);
    (value * factor, sd * factor)
}

/// The finding of `rule` by a parameter of a fit, whose unit times `factor` is that of the finding.
fn found(
    rule: &FindingRule,
    (fit, index, factor): (&FitResult, usize, f64),
    before: Option<f64>,
) -> ParameterFinding {
    let (value, sd) = of(fit, index, factor);
    rule.found(value, sd, before)
}

fn rotation(
    estimate: &VehicleFit,
    configured: &VehicleOptions,
    stamped_s: Option<f64>,
) -> Vec<ParameterFinding> {
    let fit = &estimate.turning.fit;
    let (delay_ms, sd_ms) = of(fit, 0, 1e3);
    let delay = rules::DELAY.found(delay_ms, sd_ms, Some(configured.command_delay_ms));
    let hidden = stamped_s.map(|stamped_s| delay_ms - stamped_s * 1e3);
    let hidden = hidden.map(|hidden_ms| rules::HIDDEN_DELAY.found(hidden_ms, sd_ms, None));
    let lag = found(&rules::RATE_LAG, (fit, 1, 1e3), Some(configured.rate_lag_ms));
    let [delay, lag] = delay.together(lag);
    let mut findings: Vec<_> = [Some(delay), hidden, Some(lag)].into_iter().flatten().collect();
    for (axis, rule) in rules::AUTHORITY.iter().enumerate() {
        let before = Some(configured.rate_authority_rad_s[axis]);
        findings.push(found(rule, (fit, 2 + axis, 1.0), before));
    }
    for (axis, rule) in rules::RATE_BIAS.iter().enumerate() {
        findings.push(found(rule, (fit, 6 + axis, 1f64.to_degrees()), None));
    }
    findings
}

fn translation(
    estimate: &VehicleFit,
    configured: &VehicleOptions,
    scale: Scale,
) -> Vec<ParameterFinding> {
    let fit = &estimate.lifting.fit;
    let (ratio, sd) = match estimate.has_curved_thrust {
        true => estimate.lifting.thrust_at_hover(),
        false => of(fit, 0, 1.0),
    };
    let before = (Some(configured.mass_kg), Some(configured.max_thrust_n));
    let mut findings = vec![rules::THRUST_PER_MASS.found(
        ratio,
        sd,
        Some(configured.max_thrust_n / configured.mass_kg),
    )];
    match scale {
        Scale::Unknown => {
            let mass_kg = configured.mass_kg;
            findings.push(rules::THRUST.found(ratio * mass_kg, sd * mass_kg, before.1));
        }
        Scale::Mass(mass_kg) => {
            findings.push(rules::MASS.given(mass_kg, before.0));
            findings.push(rules::THRUST.found(ratio * mass_kg, sd * mass_kg, before.1));
        }
        Scale::Thrust(thrust_n) => {
            let mass_kg = thrust_n / ratio;
            findings.push(rules::MASS.found(mass_kg, mass_kg * sd / ratio, before.0));
            findings.push(rules::THRUST.given(thrust_n, before.1));
        }
    }
    findings.push(found(&rules::THRUST_LAG, (fit, 1, 1e3), Some(configured.thrust_lag_ms)));
    findings.push(found(&rules::THRUST_CURVE, (&estimate.curved.fit, CURVATURE, 1.0), None));
    let (drag, sd) = of(fit, 2, 1.0);
    findings.push(rules::DRAG.found(drag.max(0.0), sd, Some(configured.drag_per_s)));
    for (axis, rule) in rules::PUSH.iter().enumerate() {
        findings.push(found(rule, (fit, 4 + axis, 1.0), None));
    }
    findings
}

fn noise(estimate: &VehicleFit) -> Vec<ParameterFinding> {
    let (turning, lifting) = (&estimate.turning, &estimate.lifting);
    let count: usize = turning.passes.iter().map(|pass| 3 * pass.innovations.values.len()).sum();
    let sd_ratio = (2.0 * count as f64).sqrt().recip();
    let attitude_deg = turning.noise.measured_rad.to_degrees();
    let position_mm = lifting.noise.measured_m * 1e3;
    let gust = lifting.noise.gust_ratio * lifting.noise.measured_m;
    vec![
        rules::GUST.found(gust, f64::INFINITY, None),
        rules::ATTITUDE_NOISE.found(attitude_deg, attitude_deg * sd_ratio, None),
        rules::POSITION_NOISE.found(position_mm, position_mm * sd_ratio, None),
    ]
}

fn residuals(estimate: &VehicleFit) -> Vec<ResidualTest> {
    let (turning, lifting) = (&estimate.turning, &estimate.lifting);
    let mut tests = Vec::new();
    for (axis, name) in BODY_AXES.iter().enumerate() {
        let of_turn =
            |pass: &RotationPass| pass.innovations.normalised(turning.noise.measured_rad, axis);
        let turned: Vec<f64> = turning.passes.iter().flat_map(of_turn).collect();
        tests.push(ResidualTest::of(format!("attitude, {name}"), &turned));
    }
    for (axis, name) in WORLD_AXES.iter().enumerate() {
        let of_lift =
            |pass: &TranslationPass| pass.innovations.normalised(lifting.noise.measured_m, axis);
        let lifted: Vec<f64> = lifting.passes.iter().flat_map(of_lift).collect();
        tests.push(ResidualTest::of(format!("position, {name}"), &lifted));
    }
    tests
}

impl Identification {
    /// Findings for a key, one per component.
    pub fn of_key(&self, key: &str) -> Vec<&ParameterFinding> {
        self.findings.iter().filter(|finding| finding.key == Some(key)).collect()
    }

    /// Keys with findings, in order, without duplicates.
    pub fn keys(&self) -> Vec<&'static str> {
        let mut keys: Vec<&'static str> = Vec::new();
        for key in self.findings.iter().filter_map(|finding| finding.key) {
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        keys
    }

    /// Findings as settings; keys without a determined value are omitted.
    pub fn settings(&self) -> Vec<Setting> {
        let setting = |key: &'static str| {
            let values = self.values(key)?;
            Some(match values.as_slice() {
                [value] => Setting::flag("identify", key, *value),
                several => Setting::flag("identify", key, several.to_vec()),
            })
        };
        self.keys().into_iter().filter_map(setting).chain(self.plant_delays()).collect()
    }

    /// The delay of commands for a simulated vehicle, in the stamps and beyond, if the flights determine that their stamps lack a part.
    pub fn plant_delays(&self) -> Vec<Setting> {
        let finding = |rule: &FindingRule| self.findings.iter().find(|it| it.name == rule.name);
        let (delay, hidden) = (finding(&rules::DELAY), finding(&rules::HIDDEN_DELAY));
        let Some((delay, hidden)) = delay.filter(|it| it.is_shown()).zip(hidden) else {
            return Vec::new();
        };
        if hidden.value <= hidden.half_width {
            return Vec::new();
        }
        let set = |key, value| Setting::flag("identify", key, value);
        vec![
            set("plant.command-delay-ms", delay.value - hidden.value),
            set("plant.hidden-delay-ms", hidden.value),
        ]
    }

    /// Values of a key, with the configured value for undetermined components; `None` if no component is determined.
    pub fn values(&self, key: &str) -> Option<Vec<f64>> {
        let findings = self.of_key(key);
        let is_any_shown = findings.iter().any(|finding| finding.is_shown());
        let value = |finding: &&ParameterFinding| match finding.before {
            Some(before) if !finding.is_shown() => before,
            _ => finding.value,
        };
        is_any_shown.then(|| findings.iter().map(value).collect())
    }

    /// `configured` with the determined values replaced.
    pub fn vehicle(&self, configured: &VehicleOptions) -> VehicleOptions {
        let mut vehicle = configured.clone();
        let set = |rule: &FindingRule, target: &mut f64| {
            let value = rule.key.and_then(|key| self.values(key));
            *target = value.map_or(*target, |values| values[0]);
        };
        set(&rules::DELAY, &mut vehicle.command_delay_ms);
        set(&rules::RATE_LAG, &mut vehicle.rate_lag_ms);
        set(&rules::THRUST, &mut vehicle.max_thrust_n);
        set(&rules::MASS, &mut vehicle.mass_kg);
        set(&rules::THRUST_LAG, &mut vehicle.thrust_lag_ms);
        set(&rules::DRAG, &mut vehicle.drag_per_s);
        let rates = rules::AUTHORITY[0].key.and_then(|key| self.values(key));
        let rates = rates.and_then(|rates| <[f64; 3]>::try_from(rates).ok());
        vehicle.rate_authority_rad_s = rates.unwrap_or(vehicle.rate_authority_rad_s);
        vehicle
    }
}
