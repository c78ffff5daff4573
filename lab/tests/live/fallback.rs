//! Settings in flight under a fallback: it flies with the gains of the daemon's start.

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::time::Span;
use oqtal_lab::simulation::online::OnlineFlight;
use oqtal_observe::flight::Outcome;

use super::{fly_for, hover, is_done, request};

/// Settings of the law and of the loops around it; the fallback is the same law.
#[test]
fn f70_a_setting_that_fails_is_not_one_of_the_fallback() {
    for (law, set) in [
        ("lqr", "control.lqr.integral-weight=1e300"),
        ("lqr", "control.lqr.attitude-weight=1e-9 control.lqr.integral-weight=0.0"),
        ("lqr", "control.predictive.command-bandwidth-rad-s=0.1"),
        ("geometric", "control.geometric.attitude-gain=1e-6"),
        ("oqtal-dt", "control.predictive.command-bandwidth-rad-s=0.1"),
    ] {
        let own = ["controller", "fallback"].map(|key| format!("control.{key}={law}"));
        let more =
            [own[0].as_str(), &own[1], "control.stack=predictive", "plant.force-n=[0.2,0,0]"];
        let mission = hover(6.0, &more);
        let mut flight = OnlineFlight::begin(&mission).unwrap();
        fly_for(&mut flight, 7.0);
        let fly = request("circle");
        flight.change(OperatorCommand::Trajectory, &fly).unwrap().unwrap();
        fly_for(&mut flight, 2.0);
        assert!(is_done(&flight.change(OperatorCommand::Set, &request(set)).unwrap().unwrap()));
        fly_for(&mut flight, 20.0);
        assert!(flight.request(OperatorCommand::Land).is_ok(), "{law}, {set}");
        flight.end_after(Span::from_millis(20_000));
        let flown = flight.finish().unwrap();
        let handovers = flown.samples.iter().map(|sample| sample.telemetry.handovers).max();
        assert_eq!(flown.outcome, Outcome::Landed, "{law}, {set}, hand-overs {handovers:?}");
    }
}
