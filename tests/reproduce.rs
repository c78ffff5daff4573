//! Required results of `oqtal reproduce`, `campaign` and `tune`, from their JSON output.

use crate::common::{Testbed, assert_refused, json, stderr};
use serde_json::Value;

/// Runs `oqtal` with the given arguments and returns its JSON document.
fn printed(testbed: &Testbed, words: &[&str]) -> Value {
    serde_json::from_str(&testbed.succeeds(words)).unwrap()
}

fn reproduced(what: &str) -> Value {
    let testbed = Testbed::new("reproduce");
    printed(&testbed, &["reproduce", what, "--json"])
}

fn rows(table: &Value) -> &Vec<Value> {
    table["rows"].as_array().expect("a table has rows")
}

/// Row of a law whose settings contain `settings`.
fn row<'a>(table: &'a Value, controller: &str, variant: &str, settings: &str) -> &'a Value {
    let text = |row: &Value, key: &str| row[key].as_str().unwrap_or_default().to_owned();
    let matches = |row: &&Value| {
        text(row, "controller") == controller
            && text(row, "variant") == variant
            && text(row, "settings").contains(settings)
    };
    rows(table)
        .iter()
        .find(matches)
        .unwrap_or_else(|| panic!("no {controller} {settings}: {table:#}"))
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("no {key} in {row:#}"))
}

fn assert_near(row: &Value, key: &str, expected: f64, share: f64) {
    let found = number(row, key);
    assert!((found / expected - 1.0).abs() <= share, "{key} = {found}, not {expected}");
}

#[test]
fn table_4_is_reproduced_where_possible() {
    let table = reproduced("table-4");
    assert_eq!(table["table"], "IV");
    let oqtal = row(&table, "oqtal", "as-printed", "60 Hz hold, centred cells");
    assert_near(oqtal, "quaternion_error_norm", 0.0050, 0.05);
    assert_near(oqtal, "effort_norm", 0.0998, 0.03);
    assert_near(oqtal, "position_error", 2.81, 0.05);
    assert_eq!(oqtal["riccati_solves"], 1);
    let floor = row(&table, "oqtal", "as-printed", "floor cells");
    assert!(number(floor, "riccati_solves") > 100.0, "{floor}");
    let without = row(&table, "oqtal", "as-printed", "without omega_d");
    let ratio = number(without, "position_error") / number(oqtal, "position_error");
    assert!(ratio > 100.0, "{ratio}");
    let lqr = row(&table, "lqr", "as-printed", "centred cells");
    assert!(number(lqr, "quaternion_error_norm") > 100.0 * number(oqtal, "quaternion_error_norm"));
    let ours = row(&table, "oqtal-dt", "ours", "");
    assert!(number(ours, "position_error") <= 0.06, "{ours}");
    assert!(number(ours, "quaternion_error_norm") <= 1e-4, "{ours}");
    assert!(number(ours, "effort_norm") <= 0.115, "{ours}");
    assert_eq!(rows(&table).iter().filter(|row| row["variant"] == "paper").count(), 3);
}

#[test]
fn table_3_is_tuned_better_than_printed() {
    let table = reproduced("table-3");
    let fitness = |weights: &str| {
        let tuned = |row: &&Value| {
            row["weights"] == weights
                && row["variant"] == "as-printed"
                && row["settings"] == "c omega, fitness of norms"
        };
        let row = rows(&table).iter().find(tuned).unwrap();
        number(row, "fitness")
    };
    assert!(fitness("[10, 1]") <= 0.21, "{}", fitness("[10, 1]"));
    assert!(fitness("[100, 1]") <= 0.78, "{}", fitness("[100, 1]"));
    assert!(fitness("[1, 1]") <= 0.13, "{}", fitness("[1, 1]"));
}

#[test]
fn the_claim_of_the_sweep_holds_for_errors_and_not_for_effort() {
    let table = reproduced("sweep");
    let claim = |criterion: &str, rival: &str| {
        let about = |row: &&Value| {
            let settings = row["settings"].as_str().unwrap();
            settings.starts_with(criterion) && settings.ends_with(rival)
        };
        rows(&table).iter().find(about).unwrap()["claim"].as_str().unwrap().to_owned()
    };
    for rival in ["centred cells", "to the last bit"] {
        assert_eq!(claim("quaternion error", rival), "true");
        assert_eq!(claim("position error", rival), "true");
    }
    assert_eq!(claim("effort", "to the last bit"), "false");
    assert_eq!(claim("calculations", "to the last bit"), "false");
    let along = &table["tables"][0];
    for row in rows(along).iter().filter(|row| row["controller"] == "oqtal-dt") {
        assert!(row["position_error"].is_number(), "stable everywhere: {row}");
    }
    let kept = &table["tables"][1];
    for row in rows(kept) {
        let ours = row["controller"] == "oqtal-dt";
        assert_eq!((&row["pairs"], row["stable"] == 441), (&Value::from(441), ours), "{row:#}");
        assert_eq!(row["lost_from"], if ours { Value::Null } else { "2^12".into() }, "{row:#}");
    }
}

/// `oqtal-dt`, and the laws with tuned gains that fly without its prediction.
const TUNED: [&str; 2] = ["--controllers", "pid,lqr,oqtal,geometric,px4,indi,oqtal-dt"];

/// Plants that differ from the model: the benefit of feed-forward and prediction must not depend on an exact model.
#[test]
fn on_mismatched_plants_prediction_still_improves_the_chirp() {
    let testbed = Testbed::new("mismatched");
    let plants = [
        "rate-authority-rad-s=[1.6,1.6,1.6]",
        "rate-authority-rad-s=[2.4,2.4,2.4]",
        "command-delay-ms=30",
        "rate-lag-ms=30",
        "rate-lag-ms=80",
    ];
    for plant in plants {
        let words = ["campaign", "--gains", "tuned", "--runs", "2", "--json", "--plant", plant];
        let table = printed(&testbed, &[&words[..], &TUNED].concat());
        let chirp = |row: &Value| number(row, "chirp4_rms_deg");
        let ours = chirp(row(&table, "oqtal-dt", "ours", ""));
        let rivals = rows(&table).iter().filter(|row| row["controller"] != "oqtal-dt");
        let best = rivals.map(chirp).fold(f64::INFINITY, f64::min);
        assert!(best >= 1.5 * ours, "{plant}: {best} deg and {ours} deg");
    }
}

#[test]
fn oqtal_recovers_always_and_every_law_with_finite_commands() {
    let table = reproduced("recovery");
    for row in rows(&table) {
        assert_eq!(row["commands_finite"], "yes", "{row:#}");
        if row["controller"].as_str().unwrap().starts_with("oqtal") {
            assert!(row["recovered_s"].is_number(), "{row:#}");
        }
    }
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let testbed = Testbed::new("threads");
    let with = |threads: &str| {
        let mut command = testbed.study(&["reproduce", "step", "options", "--json"]);
        let output = command.env("RAYON_NUM_THREADS", threads).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        output.stdout
    };
    assert!(with("1") == with("3"));
}

#[test]
fn a_page_a_document_and_the_rows_are_written() {
    let testbed = Testbed::new("page");
    testbed.succeeds(&["reproduce", "figure-12", "--out", "here"]);
    let read = |name: &str| std::fs::read_to_string(testbed.path("here").join(name)).unwrap();
    let page = read("reproduction.html");
    assert!(page.contains("Fig. 12") && page.contains("<svg"));
    assert!(!["<script ", "<link", "src="].iter().any(|outside| page.contains(outside)));
    assert!(read("reproduction.md").contains("oqtal reproduce figure-12"));
    assert!(read("reproduction.json").contains("\"table\": \"IV\""));
}

#[test]
fn in_a_small_campaign_prediction_improves_every_figure_that_no_command_can() {
    let testbed = Testbed::new("campaign");
    let words = ["campaign", "--gains", "tuned", "--runs", "4", "--best", "2", "--json"];
    let table = printed(&testbed, &[&words[..], &TUNED].concat());
    for row in rows(&table) {
        for key in ["position_error_m", "velocity_error_m_s", "attitude_error_deg"] {
            assert!(row[key]["mean"].is_number() && row[key]["sd"].is_number(), "{key}: {row:#}");
        }
        assert_eq!((&row["runs"], &row["best"]), (&Value::from(4), &Value::from(2)));
    }
    let ours = row(&table, "oqtal-dt", "ours", "");
    let rivals = || rows(&table).iter().filter(|row| row["controller"] != "oqtal-dt");
    assert_eq!(rivals().count(), 6);
    // `indi` corrects faster than the others.
    for (key, times, of_indi) in
        [("chirp4_rms_deg", 3.0, 3.0), ("hover_rms_mm", 2.0, 1.6), ("doublet_settle_s", 1.8, 1.2)]
    {
        for row in rivals() {
            let times = if row["controller"] == "indi" { of_indi } else { times };
            let (other, ours) = (number(row, key), number(ours, key));
            assert!(other >= times * ours, "{key}: {} {other} and {ours}", row["controller"]);
        }
    }
}

#[test]
fn a_campaign_in_lockstep_gives_the_results_of_one_process() {
    let testbed = Testbed::new("campaign-clocks");
    let campaign = |clock: &str| {
        let words = ["campaign", "--controllers", "oqtal-dt", "--runs", "1", "--json"];
        let output = testbed
            .study(&words)
            .args(["--clock", clock, "--out", clock])
            .env("OQTAL_INSTANCE__NAME", testbed.instance())
            .env("OQTAL_INSTANCE__ROOT", testbed.path("run"))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        let mut results = json(&output);
        // With the clock and the directory.
        results["command"].take();
        results
    };
    assert!(campaign("lockstep") == campaign("in-process"));
    assert!(testbed.path("lockstep").join("oqtal-dt-square-200").join("config.toml").is_file());
}

#[test]
fn a_law_is_tuned_within_its_budget_and_the_configuration_loads() {
    let testbed = Testbed::new("tune");
    // The result does not depend on the number of threads that evaluate a batch.
    let found = [("one.toml", "1"), ("three.toml", "3")].map(|(file, threads)| {
        let words = ["tune", "pid", "--budget", "12", "--out", file];
        let output = testbed.study(&words).env("RAYON_NUM_THREADS", threads).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        std::fs::read_to_string(testbed.path(file)).unwrap()
    });
    assert_eq!(found[0], found[1]);
    assert!(testbed.succeeds(&["check", "one.toml"]).contains("controller = \"pid\""));
}

#[test]
fn unknown_arguments_are_usage_errors() {
    let testbed = Testbed::new("unknown");
    for words in [["reproduce", "table-6"], ["tune", "nothing"], ["campaign", "--runs=0"]] {
        assert_refused(&testbed.study(&words).output().unwrap(), 64, &[]);
    }
}

#[test]
fn a_campaign_uses_the_gains_and_the_vehicle_of_fly() {
    let testbed = Testbed::new("campaign-own");
    let own = ["--plant", "rate-lag-ms=70", "--set", "vehicle.mass-kg=0.6"];
    let flight = ["fly", "--clock", "in-process", "--seed", "300", "--trajectory", "circle"];
    let flight = printed(&testbed, &[&flight[..], &["--json"], &own].concat());
    let words = ["campaign", "--controllers", "oqtal", "--seeds", "300-301", "--trajectory"];
    printed(&testbed, &[&words[..], &["circle", "--out", "own", "--json"], &own].concat());
    let csv = std::fs::read_to_string(testbed.path("own/campaign.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!((rows.len(), &rows[0][..3]), (3, &["controller", "seed", "position_error_m"][..]));
    let error: f64 = rows[1][2].parse().unwrap();
    assert_eq!(rows[1][..2], ["oqtal", "300"]);
    assert!((error - number(&flight["position_error_m"], "mean")).abs() < 1e-12, "{csv}");
}

#[test]
fn laws_tuned_for_a_vehicle_are_compared_on_it() {
    let testbed = Testbed::new("tune-own");
    let own = ["--set", "vehicle.mass-kg=0.6"];
    let tune = ["tune", "pid", "oqtal", "--budget", "8", "--seeds", "101-101", "--out", "gains"];
    testbed.succeeds(&[&tune[..], &own].concat());
    let words = ["campaign", "--gains", "gains", "--controllers", "pid,oqtal", "--runs", "1"];
    let table = printed(&testbed, &[&words[..], &["--json"], &own].concat());
    assert!(rows(&table).iter().all(|row| row["settings"] == "gains of gains"), "{table:#}");
    let missing = testbed.study(&["campaign", "--gains", "gains", "--runs", "1"]).output();
    assert_refused(&missing.unwrap(), 78, &["oqtal tune lqr --out gains"]);
}

#[test]
fn a_sweep_prints_a_document_for_each_combination_and_law() {
    let testbed = Testbed::new("sweep");
    let words = ["sweep", "plant.rate-lag-ms=40:60:2", "plant.mass-kg=0.5,0.55", "--laws", "pid"];
    let sweep = |more: &[&str]| testbed.succeeds(&[&words[..], &["--seeds", "200"], more].concat());
    let text = sweep(&["--json", "--out", "sweep.csv"]);
    let documents: Vec<Value> =
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(documents.len(), 4);
    assert_eq!(documents[3]["plant.rate-lag-ms"], 60.0);
    assert!(documents.iter().all(|row| row["landed"] == 1.0 && row["hover_rms_mm"].is_number()));
    let csv = std::fs::read_to_string(testbed.path("sweep.csv")).unwrap();
    assert!(csv.starts_with(
        "plant.rate-lag-ms,plant.mass-kg,controller,landed,as_planned,position_error_m"
    ));
    assert_eq!(csv.lines().count(), 5);
    let table = sweep(&[]);
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
}
