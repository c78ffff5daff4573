//! `oqtal tune --live` on running processes.

use rustix::process::Signal;

use crate::common::{SERVICES, Testbed, stderr, wait_for};

/// A hover with a vehicle that is heavier and slower than configured.
const SETTINGS: [&str; 8] = [
    "--set",
    "trajectory.kind=hover",
    "--set",
    "trajectory.hover.duration-s=3600",
    "--set",
    "plant.mass-kg=0.6",
    "--set",
    "plant.rate-authority-rad-s=[1.6,1.6,1.6]",
];

#[test]
fn a_vehicle_that_hovers_is_tuned_and_hovers_better() {
    let testbed = Testbed::new("tune-live");
    let tune = ["tune", "--live", "--apply", "--budget", "16", "--out", "tuned"];
    testbed.refuses(&tune, 75, &["no daemon answers", "oqtal daemon run"]);
    let _running =
        SERVICES.map(|process| testbed.start(&[&[process, "run"], &SETTINGS[..]].concat()));
    testbed.wait_for_daemon();
    testbed.refuses(&tune, 1, &["does not fly", "oqtal ctl arm"]);
    testbed.take_off(&testbed.bus());
    // Refused during the take-off.
    wait_for("hover", || {
        let hover = testbed.oqtal(&["ctl", "hover"]).output().unwrap();
        hover.status.success().then_some(())
    });

    ends_the_excitation_when_interrupted(&testbed);
    let output = testbed.oqtal(&tune).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("full stick, roll") && text.contains("oqtal ctl undo"), "{text}");
    // The integral action of the position loops holds 0.1 kg more with an error of 0.2 m.
    let line = text.lines().find(|line| line.starts_with("hover, RMS")).unwrap();
    let numbers = line.split(' ').filter_map(|word| word.parse::<f64>().ok());
    let [_, before, after] = numbers.collect::<Vec<_>>()[..] else { panic!("{line}") };
    assert!(after < before, "{line}");
    for name in ["excitation.mcap", "oqtal.toml", "oqtal.html"] {
        assert!(testbed.path("tuned").join(name).is_file(), "no {name}");
    }
    let changed = testbed.oqtal(&["ctl", "get"]).output().unwrap();
    let changed = String::from_utf8(changed.stdout).unwrap();
    assert!(changed.contains("\ncontrol.oqtal.attitude-weight="), "{changed}");
    testbed.refuses(&tune, 64, &["tuned/excitation.mcap", "--out"]);
}

fn ends_the_excitation_when_interrupted(testbed: &Testbed) {
    let course = || {
        let answer = testbed.oqtal(&["ctl", "get"]).output().unwrap();
        String::from_utf8(answer.stdout).unwrap()
    };
    let tuning = testbed.start(&["tune", "--live", "--out", "interrupted"]);
    wait_for("excitation", || course().contains("brief-excitation").then_some(()));
    tuning.signal(Signal::INT);
    let output = tuning.wait();
    assert!(stderr(&output).contains("a hover was requested and accepted"), "{}", stderr(&output));
    assert!(course().contains("hover"), "{}", course());
}
