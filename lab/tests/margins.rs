//! Linear model of the attitude loop, compared with the flown loop.

use oqtal_config::{Config, Setting};
use oqtal_lab::robustness::linear::LinearLoop;
use oqtal_lab::robustness::margins::{LoopPair, greatest_difference};
use oqtal_lab::robustness::probed::{self, ClosedLoops};

fn pair(settings: &[Setting], axis: usize) -> LoopPair {
    let config = Config::from_settings(settings).unwrap();
    let linear = LinearLoop::new(&config, axis).unwrap().response();
    let flown = probed::flown(settings, (axis, ClosedLoops::Attitude)).unwrap();
    LoopPair { law: config.control.controller.to_string(), axis: "", linear, flown, hover: None }
}

fn law(name: &str) -> Setting {
    Setting::flag("test", "control.controller", name)
}

#[test]
fn the_margins_of_the_linear_model_are_those_that_are_flown() {
    // A lag that the model of the vehicle lacks, and a delay that does not appear in stamps.
    let differing = [
        Setting::flag("test", "plant.rate-lag-ms", 65.0),
        Setting::flag("test", "plant.hidden-delay-ms", 8.0),
    ];
    // The loop runs at 50 Hz, on every second pose.
    let cameras = [Setting::flag("test", "mocap.rate-hz", 100.0)];
    let hidden = [Setting::flag("test", "plant.hidden-delay-ms", 20.0)];
    let cases: [(&str, &[Setting], usize); 5] = [
        ("oqtal", &[], 0),
        ("oqtal-dt", &[], 0),
        ("oqtal-dt", &differing, 2),
        ("geometric", &hidden, 0),
        ("oqtal", &cameras, 0),
    ];
    for (name, more, axis) in cases {
        let pair = pair(&[&[law(name)][..], more].concat(), axis);
        let apart = greatest_difference(&pair);
        assert!(apart < 0.1, "{name}, axis {axis}: {apart}");
    }
}

/// A hidden delay reduces the delay margin, of the model and in flight, by its own length.
#[test]
fn a_loop_with_less_delay_margin_left_is_nearer_to_oscillation() {
    let margins = |hidden_ms: f64| {
        let settings =
            [law("geometric"), Setting::flag("test", "plant.hidden-delay-ms", hidden_ms)];
        let pair = pair(&settings, 0);
        [pair.linear, pair.flown].map(|response| response.margins())
    };
    for (none, some) in margins(0.0).into_iter().zip(margins(20.0)) {
        assert!((none.delay_ms - some.delay_ms - 20.0).abs() < 0.5, "{none:?}, {some:?}");
        assert!(some.disk < none.disk && some.sensitivity > none.sensitivity);
    }
}

#[test]
fn a_hover_oscillates_beyond_its_delay_margin_and_not_below_it() {
    let response = |hidden_ms: f64| {
        let hidden = Setting::flag("test", "plant.hidden-delay-ms", hidden_ms);
        probed::flown(&[law("geometric"), hidden], (0, ClosedLoops::Hover))
    };
    let margin_ms = response(0.0).unwrap().margins().delay_ms;
    let attitude = pair(&[law("geometric")], 0).flown.margins().delay_ms;
    assert!(margin_ms < attitude, "the position loop takes a part: {margin_ms}, {attitude}");
    assert!(response(0.85 * margin_ms).is_ok() && response(1.15 * margin_ms).is_err());
}
