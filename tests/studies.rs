//! Studies: failed flights are counted and not hidden, interrupted studies are resumed, the README's table is what its command
//! prints.

use rustix::process::Signal;
use serde_json::Value;

use crate::common::sources::read;
use crate::common::{Running, Testbed, assert_refused, stderr, wait_for};

const CAMPAIGN: [&str; 5] = ["campaign", "--controllers", "pid,oqtal-dt", "--runs", "2"];

fn document(testbed: &Testbed, words: &[&str]) -> Value {
    serde_json::from_str(&testbed.succeeds(words)).unwrap()
}

fn rows<'a>(document: &'a Value, key: &str) -> &'a Vec<Value> {
    document[key].as_array().unwrap_or_else(|| panic!("{key}: {document:#}"))
}

#[test]
fn a_campaign_compares_a_disturbed_hover_and_a_circle_and_has_a_row_for_each_test_and_flight() {
    let testbed = Testbed::new("first-campaign");
    let campaign = document(&testbed, &[&CAMPAIGN[..], &["--json"]].concat());
    let of = |law: &str| rows(&campaign, "rows").iter().find(|row| row["controller"] == law);
    let [pid, ours] = ["pid", "oqtal-dt"].map(|law| of(law).unwrap());
    let worst = |row: &Value| row["disturbed_hover_max_mm"].as_f64().unwrap();
    assert!(worst(pid) > 2.0 * worst(ours), "{} mm, {} mm", worst(pid), worst(ours));
    assert!(pid["circle_error_m"].is_number() && pid["position_error_m"]["mean"].is_number());
    // Four tests on the square, the disturbed hover and the circle; two laws, two runs.
    assert_eq!((rows(&campaign, "tests").len(), rows(&campaign, "flights").len()), (12, 24));
    assert!(rows(&campaign, "flights").iter().all(|flight| flight["outcome"] == "landed"));
    assert!(rows(&campaign, "failures").is_empty());
    let text = testbed.succeeds(&CAMPAIGN);
    for said in ["all 24 flights landed", "--controller oqtal-dt", "results/campaign-2"] {
        assert!(text.contains(said), "{said} in\n{text}");
    }
    assert!(text.lines().all(|line| line.chars().count() <= 120), "{text}");
    assert!(testbed.path("results/campaign-2/campaign.csv").is_file());
    // Results say what they are of, and the configuration beside them is read back as it is.
    assert_eq!(campaign["command"], "oqtal campaign --controllers pid,oqtal-dt --runs 2");
    let again = ["check", "results/campaign-1/config.toml"];
    let checked = testbed.succeeds(&again);
    let copy = std::fs::read_to_string(testbed.path(again[1])).unwrap();
    assert!(copy.starts_with("# Configuration of `oqtal campaign --controllers pid,oqtal-dt"));
    let is_setting = |line: &&str| !line.starts_with('#');
    let [checked, copy] = [&*checked, copy.trim_end()].map(|text| text.lines().filter(is_setting));
    assert!(checked.eq(copy));
}

#[test]
fn columns_without_a_meaning_are_left_out_and_the_rest_is_in_the_table() {
    let testbed = Testbed::new("circle-campaign");
    let text = testbed.succeeds(&[&CAMPAIGN[..], &["--trajectory", "circle"]].concat());
    for said in ["settled to 5 cm", "overshoot", "Riccati", "best"] {
        assert!(!text.contains(said), "{said} in\n{text}");
    }
    assert!(text.contains("mean position [m]") && text.contains("doublet settled"), "{text}");
}

/// A vehicle that is too heavy for its motors never takes off.
#[test]
fn failed_flights_are_counted_with_cause_seeds_and_a_command_that_flies_one_again() {
    let testbed = Testbed::new("failures");
    let heavy = ["--plant", "mass-kg=2.0"];
    let campaign = document(&testbed, &[&CAMPAIGN[..], &["--json"], &heavy].concat());
    let failures = rows(&campaign, "failures");
    assert!(!failures.is_empty(), "{campaign:#}");
    let first = &failures[0];
    assert_eq!((&first["count"], &first["of"]), (&Value::from(2), &Value::from(2)));
    assert_eq!(first["seeds"], Value::from(vec![200, 201]));
    let again: Vec<&str> = first["again"].as_str().unwrap().split(' ').skip(1).collect();
    let output = testbed.study(&again).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{again:?}: {}", stderr(&output));
    let text = testbed.succeeds(&[&CAMPAIGN[..], &heavy].concat());
    assert!(text.contains("24 of 24 flights did not land"), "{text}");
    let key = "plant.mass-kg=0.5,2.0";
    let words = ["sweep", key, "--laws", "pid", "--seeds", "200-201"];
    let rows = testbed.succeeds(&[&words[..], &["--json", "--out", "a.csv"]].concat());
    for row in rows.lines().map(|row| serde_json::from_str::<Value>(row).unwrap()) {
        assert_eq!(row["command"], format!("oqtal {}", words.join(" ")));
        assert!(row["version"].is_string() && row["config_hash"].is_string(), "{row}");
    }
    assert!(testbed.path("a.csv").is_file() && testbed.path("a.config.toml").is_file());
    let sweep = testbed.succeeds(&words);
    for said in ["100 %", "0 %", "8 of 16 flights did not land", "seeds 200, 201; again: oqtal fly"]
    {
        assert!(sweep.contains(said), "{said} in\n{sweep}");
    }
}

/// A fence close around the square: some laws overshoot into its soft border, where the safety holds them.
#[test]
fn flights_that_the_fence_held_are_counted_and_not_averaged() {
    let testbed = Testbed::new("held");
    let near = ["--set", "plant.disturb=[\"gust@16+2=6,0,0m/s\"]", "--set", "fence.x-m=[-2.0,0.8]"];
    let words = ["campaign", "--controllers", "pid", "--runs", "1", "--trajectory", "hover"];
    let margin = ["--set", "fence.soft-margin-m=0.6"];
    let campaign = document(&testbed, &[&words[..], &["--json"], &near, &margin].concat());
    let held = |of: &&Value| of["cause"] == "held by the fence" && of["test"] == "hover";
    let flight = rows(&campaign, "flights").iter().find(held).unwrap();
    assert_eq!((&flight["outcome"], &flight["hover_rms_mm"]), (&"landed".into(), &Value::Null));
    let failure = rows(&campaign, "failures").iter().find(held).unwrap();
    assert_eq!(failure["seeds"], Value::from(vec![200]));
    let doublet = ["--set", "fence.y-m=[-2.0,2.0]", "--set", "fence.x-m=[-2.5,2.5]"];
    let small = ["--set", "fence.soft-margin-m=0.5"];
    let words = ["campaign", "--controllers", "oqtal-dt", "--runs", "1", "--trajectory", "hover"];
    let text = testbed.succeeds(&[&words[..], &doublet, &small].concat());
    let remedy = "attitude-doublet, held or stopped by the fence: enlarge the fence (fence.y-m), or set \
                  trajectory.attitude-doublet.angle-deg=";
    assert!(text.contains(remedy), "{text}");
}

#[test]
fn a_law_without_gains_that_land_does_not_keep_the_others_from_being_tuned() {
    let testbed = Testbed::new("tune-some");
    let bad = "control.lqr.attitude-weight=0.0001";
    let words = ["tune", "lqr", "pid", "--budget", "1", "--seeds", "101-101", "--set", bad];
    let output = testbed.study(&[&words[..], &["--out", "g"]].concat()).output().unwrap();
    let (text, told) = (String::from_utf8_lossy(&output.stdout), stderr(&output));
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(
        told.trim_end().ends_with("1 of 2 searches found no gains, for the reasons above: lqr")
    );
    assert!(told.contains("no room for others than the configured gains"), "{told}");
    assert!(text.contains("no others were tried, since --budget 1 has no room"), "{text}");
    assert!(testbed.path("g/pid.toml").is_file() && !testbed.path("g/lqr.toml").exists());
    assert!(!testbed.path("g/study.journal").exists());
}

#[test]
fn an_interrupted_table_3_keeps_its_finished_searches() {
    let testbed = Testbed::new("table-3");
    let words = ["reproduce", "table-3", "--json", "--out", "part"];
    let journal = testbed.path("part/study.journal");
    let kept = || std::fs::read_to_string(&journal).map_or(0, |text| text.lines().count());
    let running = Running::start(&mut testbed.study(&words));
    wait_for("a finished search", || (kept() > 1).then_some(()));
    running.signal(Signal::TERM);
    let output = running.wait();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("--resume"), "{}", stderr(&output));
    let before = kept();
    assert!((2..13).contains(&before), "{before} of 12 searches, and a head");
}

#[test]
fn an_interrupted_campaign_is_resumed_with_the_result_of_an_uninterrupted_one() {
    let testbed = Testbed::new("resumed");
    let words = ["campaign", "--controllers", "pid", "--runs", "30", "--json", "--out"];
    let whole = testbed.succeeds(&[&words[..], &["whole"]].concat());
    let part = [&words[..], &["part"]].concat();
    let journal = testbed.path("part/study.journal");
    let flown = || std::fs::read_to_string(&journal).map_or(0, |text| text.lines().count());
    let running = Running::start(&mut testbed.study(&part));
    wait_for("some flights", || (flown() > 4).then_some(()));
    running.signal(Signal::INT);
    let output = running.wait();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("--resume"), "{}", stderr(&output));
    let before = flown();
    let refused = testbed.study(&part).output().unwrap();
    assert_refused(&refused, 64, &["interrupted study", "--resume", "--force"]);
    let resumed = testbed.succeeds(&[&part[..], &["--resume"]].concat());
    assert!(before > 4 && resumed == whole, "{before} lines before");
    assert!(!journal.exists());
    assert_refused(&testbed.study(&part).output().unwrap(), 64, &["exists already", "--force"]);
    let again = testbed.study(&[&part[..], &["--resume"]].concat()).output().unwrap();
    assert_eq!(again.status.code(), Some(64), "{}", stderr(&again));
}

#[test]
fn a_search_that_finds_nothing_leaves_no_file_of_gains() {
    let testbed = Testbed::new("nothing-found");
    let words = ["tune", "pid", "--budget", "1", "--seeds", "101-101", "--out", "gains"];
    for _ in 0..2 {
        let heavy = [&words[..], &["--plant", "mass-kg=2"]].concat();
        assert_refused(&testbed.study(&heavy).output().unwrap(), 1, &["no room for others"]);
        assert_eq!(std::fs::read_dir(testbed.path("gains")).unwrap().count(), 0);
    }
}

/// The numbers of the row of the README's table of results that begins with `name`.
fn published(name: &str) -> Vec<f64> {
    let text = read("README.md");
    let row = text.lines().find(|line| line.starts_with(&format!("| {name}")));
    let row = row.unwrap_or_else(|| panic!("no row `{name}` in the README"));
    let cells = row.trim_matches('|').split('|').skip(1);
    cells.map(|cell| cell.split_whitespace().next().unwrap().parse().unwrap()).collect()
}

/// Relative difference allowed between 500 draws and a few \[-\].
const FEW_DRAWS: f64 = 0.35;

#[test]
fn the_table_of_the_readme_is_what_its_command_prints() {
    let testbed = Testbed::new("readme-table");
    assert!(read("README.md").contains("oqtal robustness --runs 500"), "the command is beside it");
    let short = document(&testbed, &["robustness", "--runs", "6", "--json"]);
    let headline = rows(&short, "tables").iter().find(|table| table["table"] == "headline");
    let headline = headline.unwrap();
    let published_rows = [
        ("`oqtal-dt`, shipped", "oqtal-dt, shipped"),
        ("`oqtal-dt`, gains tuned", "oqtal-dt, tuned"),
        ("best of six", "best of 6"),
    ];
    for (name, row) in published_rows {
        let starts = |of: &&Value| of["controller"].as_str().unwrap().starts_with(row);
        let flown = rows(headline, "rows").iter().find(starts).unwrap();
        let keys = ["hover_p95_mm", "chirp_median_deg", "jitter_median_rad_s"];
        for (key, published) in keys.iter().zip(published(name)) {
            let figure = flown[*key].as_f64().unwrap();
            let apart = (figure / published - 1.0).abs();
            assert!(apart < FEW_DRAWS, "{name}, {key}: {figure}, in the README {published}");
        }
    }
}
