//! A change of settings in flight.

use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::text::LongText;
use oqtal_bus::time::Time;
use oqtal_config::{Config, Setting};

use super::Cycle;
use crate::live::LiveSettings;

const LIMITS: [&str; 2] =
    ["position.tilt-limit-deg=25", "position.vertical-acceleration-limit-m-s2=3"];

fn config(settings: &[&str]) -> Config {
    let settings = settings.iter().map(|text| Setting::parse("test", text));
    Config::from_settings(&settings.collect::<Result<Vec<_>, _>>().unwrap()).unwrap()
}

fn cycle(config: &Config) -> Cycle {
    Cycle::new(config, crate::trajectory(config).unwrap(), Time::VIRTUAL_START).unwrap()
}

/// Limits, envelope and both laws, restarted.
fn parts(cycle: &mut Cycle) -> String {
    let guarded = cycle.guarded.as_mut().unwrap();
    guarded.restart();
    cycle.control.reset();
    format!("{:?} {guarded:?} {:?}", cycle.supervision.safety(), cycle.control)
}

#[test]
fn f70_limits_set_in_flight_are_those_of_fence_envelope_and_fallback_as_if_configured() {
    for law in ["control.fallback=geometric", "control.controller=external"] {
        let started = config(&[law]);
        let mut changed = cycle(&started);
        let text = LongText::of_lines(LIMITS).unwrap();
        let request = ControlRequestV1 { text, ..ControlRequestV1::of(OperatorCommand::Set) };
        let settings = LiveSettings::new(&started, &[]);
        let mut prepared = settings.prepare(OperatorCommand::Set, &request).unwrap();
        let before = parts(&mut changed);
        changed.change(Time::VIRTUAL_START, &mut prepared.change);
        let after = parts(&mut changed);
        assert_ne!(before, after, "{law}");
        assert_eq!(after, parts(&mut cycle(&config(&[law, LIMITS[0], LIMITS[1]]))), "{law}");
    }
}
