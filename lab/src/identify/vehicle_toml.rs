//! Findings as a configuration file.

use super::digits::with_interval;
use super::finding::ParameterFinding;
use super::identification::Identification;

/// Column of the remarks \[characters\].
const REMARKS_AT: usize = 40;

/// `[vehicle]` and the noise of the filters in TOML, based on the preset of this name: the interval beside each value, and a
/// remark in place of an undetermined value.
pub fn toml(identification: &Identification, preset: &str) -> String {
    let mut text = format!(
        "# The vehicle, identified by `oqtal identify` from {} poses in the air. Behind each value: its 95 % interval\n\
         # and the configured value. Keys that are not here keep their values.\n",
        identification.poses
    );
    let mut section = "";
    for key in identification.keys() {
        let (own, name) = key.rsplit_once('.').unwrap_or(("", key));
        if own != section {
            text += &format!("\n[{own}]\n");
            if own == "vehicle" {
                text += &format!("preset = \"{preset}\"\n");
            }
            section = own;
        }
        text += &line(identification, key, name);
    }
    text
}

fn line(identification: &Identification, key: &str, name: &str) -> String {
    let findings = identification.of_key(key);
    let remarks: Vec<String> = findings.iter().map(|finding| remark(finding)).collect();
    let remark = remarks.join("; ");
    let Some(values) = identification.values(key) else {
        return format!("# {name}: {remark}\n");
    };
    let half =
        |finding: &&&ParameterFinding| if finding.is_shown() { finding.half_width } else { 0.0 };
    let numbers: Vec<String> = values
        .iter()
        .zip(findings.iter().map(|finding| half(&finding)))
        .map(|(value, half_width)| with_decimals(with_interval(*value, half_width).0))
        .collect();
    let numbers = match numbers.as_slice() {
        [number] => number.clone(),
        several => format!("[{}]", several.join(", ")),
    };
    format!("{:<REMARKS_AT$}# {remark}\n", format!("{name} = {numbers}"))
}

/// `number` as a floating-point number of TOML.
fn with_decimals(number: String) -> String {
    if number.contains('.') { number } else { number + ".0" }
}

fn remark(finding: &ParameterFinding) -> String {
    let ParameterFinding { value, half_width, before, missing, .. } = finding;
    let before = before.map_or(String::new(), |before| format!(", before {before}"));
    match missing {
        Some(motion) => {
            let (value, half) = with_interval(*value, *half_width);
            format!("not shown ({value} ± {half}{before}), missing: {motion}")
        }
        None if *half_width == 0.0 => format!("given{before}"),
        None => format!("± {}{before}", with_interval(*value, *half_width).1),
    }
}
