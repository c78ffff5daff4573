use super::*;
use crate::study::flights::NOMINAL;

/// A law whose vehicle a force moves to the fence during the chirp.
fn pushed_law() -> StudyLaw {
    let settings = [
        Setting::flag("test", "fence.x-m", vec![-3.0, 3.0]),
        Setting::flag("test", "fence.y-m", vec![-3.0, 3.0]),
        Setting::flag("test", "fence.z-m", vec![-0.5, 3.0]),
        Setting::flag("test", "plant.force-n", vec![0.06, 0.0, 0.0]),
    ];
    StudyLaw::new("px4", settings.to_vec(), "")
}

/// A law that assumes a much heavier vehicle: its thrust at the lower limit exceeds the weight, and the vehicle climbs through any
/// ceiling.
fn light_law() -> StudyLaw {
    let settings = [
        Setting::flag("test", "vehicle.mass-kg", 1.3),
        Setting::flag("test", "vehicle.max-thrust-n", 30.0),
        Setting::flag("test", "plant.mass-kg", 0.65),
    ];
    StudyLaw::new("geometric", settings.to_vec(), "")
}

fn remedies_of_a_pushed_chirp(changes: Changes) -> String {
    let law = pushed_law();
    let condition = FlightCondition { seed: 200, plant: NOMINAL, settings: Vec::new() };
    let groups = [((&law, &[&condition][..], Test::Chirp), true)];
    remedies(groups, changes)
}

#[test]
fn a_chirp_that_the_fence_held_has_a_duration_that_fits() {
    let remedy = remedies_of_a_pushed_chirp(Changes::All);
    assert!(
        remedy.contains(
            "attitude-chirp, held or stopped by the fence: enlarge the fence (fence.x-m), or"
        ),
        "{remedy}"
    );
    assert!(remedy.contains("set trajectory.attitude-chirp.sweep-s="), "{remedy}");
    assert!(remedy.contains("set plant.force-n=[0,0,0]"), "{remedy}");
}

#[test]
fn a_remedy_holds_for_every_flight_that_needed_more_room() {
    let law = pushed_law();
    let pushed = |force_n: f64| FlightCondition {
        seed: 200,
        plant: NOMINAL,
        settings: vec![Setting::flag("test", "plant.force-n", vec![force_n, 0.0, 0.0])],
    };
    let conditions = [0.06, 0.06, 0.06, 0.06, 0.06, 0.09].map(pushed);
    let all: Vec<&FlightCondition> = conditions.iter().collect();
    let of = |conditions| remedies([((&law, conditions, Test::Chirp), true)], Changes::InFlight);
    assert_ne!(of(&all[..5]), of(&all[5..]), "the last flight needs a shorter chirp");
    assert_eq!(of(&all), of(&all[5..]));
}

#[test]
fn remedies_of_more_flights_than_are_tried_say_so() {
    assert_eq!(part_tried(1, 1), "");
    assert_eq!(part_tried(1, 9), " (tried with 1 of these 9 flights)");
}

#[test]
fn in_flight_only_settings_that_a_daemon_accepts_are_remedies() {
    let remedy = remedies_of_a_pushed_chirp(Changes::InFlight);
    assert!(remedy.contains("request `set trajectory.attitude-chirp.sweep-s="), "{remedy}");
    assert!(!remedy.contains("plant.") && !remedy.contains("fence"), "{remedy}");
}

#[test]
fn a_vehicle_much_lighter_than_its_model_is_not_given_more_room() {
    let law = light_law();
    let condition = FlightCondition { seed: 200, plant: NOMINAL, settings: Vec::new() };
    let remedy = remedies([((&law, &[&condition][..], Test::Hover), true)], Changes::All);
    assert!(remedy.contains("more room does not help"), "{remedy}");
    assert!(remedy.contains("hovers at 21 % of its thrust"), "{remedy}");
}

#[test]
fn flights_that_more_room_helps_keep_their_remedies_beside_others() {
    let (pushed, light) = (pushed_law(), light_law());
    let condition = FlightCondition { seed: 200, plant: NOMINAL, settings: Vec::new() };
    let conditions = [&condition];
    let groups = [&light, &pushed].map(|law| ((law, &conditions[..], Test::Chirp), true));
    let remedy = remedies(groups, Changes::All);
    let lines: Vec<&str> = remedy.trim().lines().collect();
    let told = [("geometric", "more room does not help"), ("px4", "enlarge the fence")];
    assert_eq!(lines.len(), told.len(), "{remedy}");
    for (line, (law, text)) in lines.iter().zip(told) {
        assert!(line.contains(&format!(" by the fence, {law} with seed 200: {text}")), "{line}");
    }
}
