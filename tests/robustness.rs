//! `oqtal robustness`: draws can be flown again, and results depend only on the arguments.

use crate::common::{Testbed, assert_refused, stderr};
use serde_json::Value;

fn study(testbed: &Testbed, threads: &str, words: &[&str]) -> Vec<u8> {
    let mut command = testbed.study(&[&["robustness"], words].concat());
    let output = command.env("RAYON_NUM_THREADS", threads).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    output.stdout
}

/// Words of a line, split as by a shell; only single quotes are supported.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut is_quoted = false;
    for character in line.chars() {
        match character {
            '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            other => words.last_mut().expect("there is one").push(other),
        }
    }
    words
}

#[test]
fn draws_do_not_depend_on_law_or_threads_and_can_be_flown_again() {
    let testbed = Testbed::new("robustness");
    let asked = ["--laws", "pid,oqtal-dt", "--spread", "everything", "--runs", "2"];
    let asked = [&asked[..], &["--gains", "configured", "--json"]].concat();
    let printed = study(&testbed, "1", &asked);
    assert!(printed == study(&testbed, "3", &asked), "one and three threads");
    let document: Value = serde_json::from_slice(&printed).unwrap();
    let draws = document["draws"].as_array().unwrap();
    assert_eq!(draws.len(), 2);
    assert_ne!(draws[0]["drawn"]["plant.mass-kg"], draws[1]["drawn"]["plant.mass-kg"]);
    for (draw, law) in draws.iter().zip(["pid", "oqtal-dt"]) {
        let expected = draw["laws"][law]["hover_rms_mm"].as_f64();
        let arguments = words(draw["arguments"].as_str().unwrap());
        let seed = draw["seed"].to_string();
        let own = ["--clock", "in-process", "--trajectory", "hover", "--controller", law];
        let own = own.into_iter().chain(["--seed", &seed]);
        let all: Vec<&str> = own.chain(arguments.iter().map(String::as_str)).collect();
        let flown = testbed.summary(&all);
        let again = flown["position_error_m"]["rms"].as_f64().unwrap() * 1e3;
        let expected = expected.unwrap_or_else(|| panic!("{law} landed: {draw:#}"));
        assert!((again - expected).abs() < 1e-6, "{law}: {again} mm, {expected} mm");
    }
    for file in ["robustness.html", "robustness.md", "robustness.json"] {
        assert!(testbed.path("results/robustness-1").join(file).is_file(), "{file}");
    }
}

#[test]
fn a_spread_of_a_file_is_drawn_from_and_identified_and_a_wrong_one_is_refused_with_its_line() {
    let testbed = Testbed::new("spread-file");
    testbed.write("lag.toml", "[plant]\nrate-lag-ms = { between = [60, 61] }\n");
    let words = ["--laws", "geometric", "--spread", "lag.toml", "--runs", "1", "--json"];
    let document: Value = serde_json::from_slice(&study(&testbed, "2", &words)).unwrap();
    let lag = document["draws"][0]["drawn"]["plant.rate-lag-ms"].as_f64().unwrap();
    assert!((60.0..61.0).contains(&lag));
    let other = ["--identified", "--wide", "--other-spreads", "drag.toml"];
    testbed.write("drag.toml", "[plant]\ndrag-per-s = { between = [0.5, 0.6] }\n");
    let words = [&words[..], &other].concat();
    let document: Value = serde_json::from_slice(&study(&testbed, "2", &words)).unwrap();
    let drag = document["other_draws"]["drag.toml"][0]["drawn"]["plant.drag-per-s"].as_f64();
    assert!(drag.is_some_and(|drag| (0.5..0.6).contains(&drag)), "{drag:?}");
    let found = document["identified_draws"][0]["drawn"]["vehicle.rate-lag-ms"].as_f64().unwrap();
    assert!((found - lag).abs() < 3.0, "{found} ms identified, {lag} ms true");
    let wide = document["wide_draws"][0]["drawn"]["plant.rate-lag-ms"].as_f64().unwrap();
    assert!((59.5..61.5).contains(&wide) && wide != lag, "{wide} ms, {lag} ms");
    let known = &document["wide_identified_draws"][0]["drawn"];
    assert_eq!(known["plant.rate-lag-ms"].as_f64(), Some(wide));
    let found = known["vehicle.rate-lag-ms"].as_f64().unwrap();
    assert!((found - wide).abs() < 3.0, "{found} ms identified, {wide} ms true");
    testbed.write("wrong.toml", "[plant]\n\nrate-lag-ms = { betwen = [60, 61] }\n");
    let output = testbed.study(&["robustness", "--spread", "wrong.toml"]).output().unwrap();
    assert_refused(&output, 78, &["wrong.toml:3"]);
}

#[test]
fn a_spread_given_twice_or_without_a_name_is_refused() {
    let testbed = Testbed::new("spreads");
    for (others, part) in
        [("", "--other-spreads"), ("vehicle", "twice"), ("a.toml,a.toml", "twice")]
    {
        let output = testbed.study(&["robustness", "--other-spreads", others]).output().unwrap();
        assert_refused(&output, 64, &[part]);
    }
}
