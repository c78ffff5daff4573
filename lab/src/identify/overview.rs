//! An identification as text for the terminal.

use oqtal_observe::explain::wrapped;
use oqtal_observe::plot::unit::{MISSING, rounded};

use super::camera_figures::PoseLatency;
use super::finding::{FindingRule, ParameterFinding, rules, with_interval};
use super::fit::{FitResult, StartingPoints};
use super::identification::Identification;
use super::lifting::CURVATURE;
use super::residuals::ResidualTest;
use super::turning::FAST;
use crate::text_table::{self, NamedRow};

/// The headings of the findings.
pub const HEADINGS: [&str; 5] = ["", "value", "± (95 %)", "before", "change"];

/// Excess of the sum of squares below which two optima are equally likely \[-\].
const INDISTINCT: f64 = 1e-3;

/// Share of saturated commands above which they are remarked upon \[0..1\].
const TOLD_SATURATION: f64 = 0.005;

/// Cells of a finding, in the order of [`HEADINGS`].
pub fn cells(finding: &ParameterFinding) -> [String; 5] {
    let ParameterFinding { name, unit, value, half_width, before, .. } = finding;
    let (value_text, half) = match half_width {
        half if half.is_infinite() => (rounded(*value, 3), MISSING.to_owned()),
        half if *half == 0.0 => (rounded(*value, 4), "given".to_owned()),
        half => with_interval(*value, *half),
    };
    let name = if *unit == "-" { (*name).to_owned() } else { format!("{name} [{unit}]") };
    let before_text = before.map_or_else(|| MISSING.to_owned(), |before| rounded(before, 4));
    let change = match before {
        _ if !finding.is_shown() => "not determined".to_owned(),
        Some(before) if *before != 0.0 => format!("{:+.1} %", 100.0 * (value / before - 1.0)),
        _ => MISSING.to_owned(),
    };
    [name, value_text, half, before_text, change]
}

/// Remark on the correlation of the residuals.
fn whiteness(residuals: &[ResidualTest]) -> String {
    let coloured = residuals.iter().filter(|test| !test.is_white);
    let coloured: Vec<&str> = coloured.map(|test| &*test.name).collect();
    match coloured.as_slice() {
        [] => "residuals: no correlation found on any axis".to_owned(),
        names => format!(
            "residuals: not white ({}): vehicle or cameras have effects that the model lacks; the intervals may be several times too narrow",
            names.join("; ")
        ),
    }
}

/// Remarks on missing manoeuvres, residuals and cameras, one per line.
pub fn remarks(identification: &Identification) -> Vec<String> {
    let mut lines = Vec::new();
    for finding in identification.findings.iter().filter(|finding| !finding.is_shown()) {
        lines.push(not_shown(finding, identification.estimate.turning.models.len()));
    }
    if identification.estimate.turning.models.len() > 1 {
        lines.push(
            "rate biases and pushes: each flight has its own, those of the first are shown"
                .to_owned(),
        );
    }
    lines.push(whiteness(&identification.residuals));
    let fits = &identification.estimate;
    let (turning, lifting) = (&fits.turning, &fits.lifting);
    lines.extend(other_optima(("rotation", FAST), &turning.starts, &turning.fit));
    lines.extend(other_optima(("translation", CURVATURE), &lifting.starts, &lifting.fit));
    let hidden = identification.findings.iter().find(|f| f.name == rules::HIDDEN_DELAY.name);
    if hidden.is_some_and(|hidden| hidden.value + hidden.half_width < 0.0) {
        let effect = "part of the delay is counted as rate lag; their sum is right if roll and pitch have equal lags";
        lines.push(format!("commands seem to act before their stamps: {effect}"));
    }
    lines.extend(assumed_mass(&identification.findings));
    lines.extend(of_thrust(identification));
    lines.push(cameras(identification));
    lines
}

/// Remark on a greatest thrust that was computed with the configured mass; `None` where the scale of the vehicle was given.
fn assumed_mass(findings: &[ParameterFinding]) -> Option<String> {
    let value = |rule: FindingRule| findings.iter().find(|it| it.name == rule.name);
    let (thrust, ratio) = (value(rules::THRUST)?, value(rules::THRUST_PER_MASS)?);
    value(rules::MASS).is_none().then(|| {
        let mass_kg = rounded(thrust.value / ratio.value, 4);
        format!(
            "greatest thrust: that of the configured mass, {mass_kg} kg: flights determine only the thrust over the mass; give the weighed one by --mass"
        )
    })
}

/// Remarks on lag, curvature and range of the thrust.
fn of_thrust(identification: &Identification) -> Vec<String> {
    let mut lines = Vec::new();
    if identification.has_prompt_thrust {
        let reason = "the lag of the rotors is then inside the rate loop";
        let effect =
            "it is in the delay, and missing in rate lag and thrust lag; their sums are right";
        lines.push(format!("thrust that follows immediately: {reason}: {effect}"));
    }
    if identification.has_curved_thrust {
        lines.push(
            "the thrust is curved over its command: `greatest thrust` is that of the straight line through the hover, as [vehicle] needs it, and not the thrust at full stick"
                .to_owned(),
        );
    }
    let saturated_share = identification.saturated_share;
    if saturated_share > TOLD_SATURATION {
        let percent = rounded(1e2 * saturated_share, 2);
        lines.push(format!(
            "thrust at the end of its range for {percent} % of the time in the air: saturated rotors give less than commanded, so the intervals of thrust and drag are too narrow"
        ));
    }
    lines
}

/// Remark on a value that `recordings` recordings do not determine.
fn not_shown(finding: &ParameterFinding, recordings: usize) -> String {
    let name = finding.name;
    let wide = "not determined, and not written. Its interval is too wide";
    match (recordings, finding.missing) {
        (1, Some(motion)) => {
            format!("{name}: not determined, and not written. Missing: {motion}")
        }
        (1, None) => format!("{name}: {wide}: {}", finding.reason().unwrap_or_default()),
        (_, Some(motion)) => format!(
            "{name}: {wide}: the recordings may contradict each other (identify each alone), or lack {motion}"
        ),
        (_, None) => format!(
            "{name}: {wide}: the recordings may contradict each other (identify each alone), or the model, which assumes {}, may not fit",
            finding.unfit.unwrap_or_default()
        ),
    }
}

/// Remark on fits that ended in another optimum than the best; `None` if all agree in the first `reported` parameters, those written to
/// `[vehicle]`.
fn other_optima(
    (name, reported): (&str, usize),
    starts: &StartingPoints,
    fit: &FitResult,
) -> Option<String> {
    let (count, (elsewhere, excess_ratio)) = (starts.count, starts.elsewhere(fit, reported));
    let best = match excess_ratio {
        close if close < INDISTINCT => {
            "as likely: the flight does not determine the parameters in which they differ"
        }
        _ => "less likely: the best is taken",
    };
    let percent = rounded(1e2 * excess_ratio.max(0.0), 2);
    (elsewhere > 0).then(|| {
        format!(
            "{name}: {elsewhere} of {count} starting points lead to other parameters, with squares {percent} % greater; {best}"
        )
    })
}

fn cameras(identification: &Identification) -> String {
    let latency = |figures: &Option<PoseLatency>| match figures {
        Some(PoseLatency { median_ms, p95_ms }) => {
            format!("latency {median_ms:.1} ms, 95 of 100 below {p95_ms:.1} ms")
        }
        None => "no latency".to_owned(),
    };
    let at_rest = match &identification.at_rest {
        Some(rest) => {
            let (mm, deg, poses) = (rest.position_mm, rest.attitude_deg, rest.poses);
            format!(
                "at rest {mm:.2} mm and {deg:.2} deg over {poses} poses, {}",
                latency(&identification.latency_at_rest)
            )
        }
        None => "no poses at rest".to_owned(),
    };
    let in_flight = latency(&identification.latency_in_flight);
    format!("cameras, by their own stamps: {at_rest}; in flight {in_flight}")
}

/// The findings as a table of at most 80 columns, and the remarks below it.
pub fn text(identification: &Identification) -> String {
    let [name, figures @ ..] = HEADINGS.map(str::to_owned);
    let row = |finding: &ParameterFinding| {
        let [name, figures @ ..] = cells(finding);
        (vec![name], figures.to_vec())
    };
    let rows: Vec<NamedRow> = identification.findings.iter().map(row).collect();
    let table = text_table::blocks(&[name], &figures, &rows);
    let remarks = remarks(identification);
    let remarks: Vec<String> = remarks.iter().map(|line| wrapped(line, 2)).collect();
    let first = too_little_motion(identification).map_or(String::new(), |line| line + "\n\n");
    format!("{first}{table}\n{}", remarks.join("\n"))
}

/// Headline for flights that determine less than half of the vehicle.
fn too_little_motion(identification: &Identification) -> Option<String> {
    let keys = identification.keys();
    let shown = keys.iter().filter(|key| identification.values(key).is_some()).count();
    let lacks = |key: &&&str| identification.of_key(key).iter().all(|it| it.missing.is_some());
    let lacking = keys.iter().filter(lacks).count();
    (2 * lacking > keys.len()).then(|| {
        let all = keys.len();
        wrapped(
            &format!(
                "These flights move too little: they determine {shown} of {all} parameters. Fly `oqtal fly --trajectory excitation`, and identify that flight."
            ),
            0,
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thrust_that_was_computed_with_the_configured_mass_is_told() {
        let [thrust, ratio] =
            [rules::THRUST.found(10.0, 0.1, None), rules::THRUST_PER_MASS.found(20.0, 0.2, None)];
        let told = assumed_mass(&[ratio.clone(), thrust.clone()]).unwrap();
        assert!(told.contains("configured mass, 0.5000 kg") && told.ends_with("--mass"), "{told}");
        assert_eq!(assumed_mass(&[ratio, rules::MASS.given(0.5, None), thrust]), None);
    }
}
