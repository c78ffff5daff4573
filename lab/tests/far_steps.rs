//! Steps of the reference after which the daemon lands the vehicle, and the remedies of the warning of them.

use oqtal_config::{Config, Setting};
use oqtal_daemon::{trajectory, warnings};
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation;

/// An excitation with steps of this length \[m\], of a vehicle that is slower than the shipped one and sags.
fn excitation(law: &str, travel_m: f64) -> Vec<Setting> {
    let own = [("control.controller", law), ("trajectory.kind", "excitation")];
    let own = own.map(|(key, value)| Setting::flag("test", key, value));
    let numbers = [
        ("trajectory.excitation.travel-m", travel_m),
        ("vehicle.rate-lag-ms", 60.0),
        ("vehicle.thrust-lag-ms", 75.0),
        ("vehicle.command-delay-ms", 42.0),
        ("vehicle.drag-per-s", 0.38),
        ("plant.thrust-exponent", 1.2),
    ];
    let numbers = numbers.map(|(key, value)| Setting::flag("test", key, value));
    own.into_iter().chain(numbers).collect()
}

/// The warning of the steps; `None` without one.
fn warning(settings: &[Setting]) -> Option<String> {
    let config = Config::from_settings(settings).unwrap();
    let all = warnings(&config, &trajectory(&config).unwrap());
    all.into_iter().find(|text| text.starts_with("the reference steps"))
}

fn cause(settings: &[Setting]) -> Option<String> {
    let mission = Mission::new(Config::from_settings(settings).unwrap()).unwrap();
    simulation::fly(&mission).unwrap().cause()
}

#[test]
fn steps_that_the_daemon_lands_are_warned_of_and_each_remedy_suffices() {
    for law in ["pid", "geometric", "px4", "indi", "mpc", "oqtal-dt"] {
        let settings = excitation(law, 4.0);
        let told = warning(&settings).unwrap_or_else(|| panic!("{law}: no warning"));
        let far = "landed by the daemon: far from its reference";
        assert_eq!(cause(&settings).as_deref(), Some(far), "{law}");
        let remedies: Vec<Setting> = told
            .split("or set ")
            .skip(1)
            .map(|text| {
                let (key, rest) = text.split_once(" to ").unwrap();
                let value: f64 = rest.split(',').next().unwrap().parse().unwrap();
                Setting::flag("test", key, value)
            })
            .collect();
        assert_eq!(remedies.len(), 2, "{law}: {told}");
        for remedy in remedies {
            let with = [&settings[..], std::slice::from_ref(&remedy)].concat();
            assert_eq!((warning(&with), cause(&with)), (None, None), "{law}: {remedy:?}");
        }
        let short = excitation(law, 1.5);
        assert_eq!((warning(&short), cause(&short)), (None, None), "{law}");
    }
}
