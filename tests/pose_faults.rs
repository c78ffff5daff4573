//! Poses that are plausible one by one and are not those of the vehicle, F58, and flights that must not be ended by their tests.
//! OQTAL_TEST_POSE_FAULTS sets the number of seeds of the faults, OQTAL_TEST_POSE_FLIGHTS that of flights without a fault,
//! OQTAL_TEST_POSE_SEED the first of both. Thresholds were chosen on seeds below 200 000.

use std::ops::Range;
use std::sync::Mutex;

use crate::chaos::{mission, on_all_processors};
use crate::common::random::{Random, length};
use oqtal_bus::code::{Cause, SafetyState};
use oqtal_control::controller::ControllerName;
use oqtal_lab::simulation::fly;
use oqtal_observe::flight::{Flight, FlightSample, Outcome};

/// First seed of the flights of this test.
const FIRST_SEED: u64 = 400_000;
/// Times of faults after arming \[s\]: over the shape; over the take-off; about a corner of the square, where the reference jumps.
const IN_FLIGHT: Range<f64> = 9.0..13.0;
const IN_TAKE_OFF: Range<f64> = 0.0..3.1;
const AT_CORNER: Range<f64> = 11.6..12.0;
/// Laws of the study of faults.
const LAWS: [&str; 4] = ["pid", "oqtal", "geometric", "oqtal-dt"];

/// Result of a fault.
#[derive(Clone, Debug)]
#[expect(dead_code, reason = "the flight is printed if a bound is exceeded")]
struct Reaction {
    /// Settings of the flight.
    flight: String,
    /// Time from the fault to the change of state \[s\]; infinite without one.
    after_s: f64,
    /// Distance of the vehicle then from its place at the fault \[m\], or the greatest one.
    moved_m: f64,
    state: SafetyState,
    cause: Cause,
}

/// Flies with `faults` and returns the reaction to the one at `at_s` \[s\] after arming; `None` if the flight ended before.
fn react(settings: &[String], faults: &[String], at_s: f64) -> Option<Reaction> {
    let injected = format!("fault.inject={faults:?}");
    let flown = fly(&mission(&[settings, std::slice::from_ref(&injected)].concat())).unwrap();
    let armed = flown.armed().next()?.telemetry.time;
    let elapsed_s = |sample: &FlightSample| sample.telemetry.time.since(armed).seconds() - at_s;
    let faulty: Vec<_> = flown.samples.iter().filter(|sample| elapsed_s(sample) >= 0.0).collect();
    let begin = faulty.first()?.position();
    let moved = |sample: &FlightSample| (sample.position() - begin).norm();
    let changed = |sample: &&&FlightSample| sample.telemetry.state > SafetyState::Degraded.code();
    let flight = settings.join(" ") + " " + &injected;
    let Some(sample) = faulty.iter().find(changed) else {
        let moved_m = faulty.iter().map(|sample| moved(sample)).fold(0.0, f64::max);
        let (state, cause) = (SafetyState::Nominal, Cause::None);
        return Some(Reaction { flight, after_s: f64::INFINITY, moved_m, state, cause });
    };
    Some(Reaction {
        flight,
        after_s: elapsed_s(sample),
        moved_m: moved(sample),
        state: SafetyState::from_code(sample.telemetry.state)?,
        cause: Cause::from_code(sample.telemetry.cause)?,
    })
}

/// Reactions to `fault` of every law in every shape, `seeds` each, of a vehicle that reports its rates or not; prints their
/// distribution.
fn study(
    fault: impl Fn(u64) -> String + Sync,
    shapes: &[&str],
    at_s: Range<f64>,
    has_gyroscope: bool,
) -> Vec<Reaction> {
    let seeds = length("OQTAL_TEST_POSE_FAULTS", 1);
    let first = length("OQTAL_TEST_POSE_SEED", FIRST_SEED);
    let mut all = Vec::new();
    for shape in shapes {
        let found = Mutex::new(Vec::new());
        on_all_processors(seeds * LAWS.len() as u64, |index| {
            let (law, seed) = (LAWS[index as usize % LAWS.len()], first + index);
            let settings = vec![
                format!("control.controller={law}"),
                format!("trajectory.kind={shape}"),
                format!("clock.seed={seed}"),
                format!("plant.gyroscope={has_gyroscope}"),
            ];
            let share = (seed % 40) as f64 / 40.0;
            let at_s = at_s.start + share * (at_s.end - at_s.start);
            let reaction = react(&settings, &[format!("pose:{}@{at_s}", fault(index))], at_s);
            found.lock().unwrap().push(reaction.expect("a flight until the fault"));
        });
        let found = found.into_inner().unwrap();
        print(&format!("{shape} at {at_s:?} s"), &fault(0), &found);
        all.extend(found);
    }
    all
}

fn print(shape: &str, fault: &str, found: &[Reaction]) {
    let mut times: Vec<f64> = found.iter().map(|reaction| reaction.after_s).collect();
    times.sort_by(f64::total_cmp);
    let moved_m = found.iter().map(|reaction| reaction.moved_m).fold(0.0, f64::max);
    let quantile = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    let ends: std::collections::BTreeSet<String> =
        found.iter().map(|reaction| format!("{} {}", reaction.state, reaction.cause)).collect();
    let [least, median, high, most] = [0.0, 0.5, 0.9, 1.0].map(quantile);
    println!(
        "{fault:<20} {shape:<27} {:>4} flights: {least:.2} {median:.2} {high:.2} {most:.2} s, \
         {moved_m:.2} m: {}",
        found.len(),
        ends.into_iter().collect::<Vec<_>>().join("; ")
    );
}

/// A frozen pose with noise of 0.1 to 2 mm and 0.04 to 0.8 deg.
fn frozen(index: u64) -> String {
    format!("frozen-noise={}mm", [0.5, 0.1, 1.0, 2.0][(index / LAWS.len() as u64) as usize % 4])
}

/// Requires a reaction within a second, or 1.5 m.
fn require_in_time(all: &[Reaction]) {
    let is_late = |reaction: &&Reaction| reaction.after_s > 1.0 && reaction.moved_m > 1.5;
    let late: Vec<_> = all.iter().filter(is_late).collect();
    assert!(late.is_empty(), "{} of {}: {late:#?}", late.len(), all.len());
}

#[test]
fn f58_a_frozen_pose_with_noise_ends_a_flight_in_motion() {
    require_in_time(&study(frozen, &["circle", "lemniscate", "square"], IN_FLIGHT, true));
}

/// Rates that fail repeatedly are not used: rotations are compared with the commands.
#[test]
fn f58_a_frozen_pose_is_found_although_reports_of_rates_fail_again_and_again() {
    let failures = ["slow=6Hz", "slow=3Hz", "delayed=160ms", "intermittent=80%"];
    on_all_processors((failures.len() * LAWS.len()) as u64, |index| {
        let (law, failure) = (LAWS[index as usize % 4], failures[index as usize / 4]);
        let settings = [
            format!("control.controller={law}"),
            "trajectory.kind=hover".to_owned(),
            format!("clock.seed={}", FIRST_SEED + index),
            "plant.gyroscope=true".to_owned(),
        ];
        let faults = [format!("vehicle:{failure}@0.5"), "pose:frozen-noise=0.5mm@10".to_owned()];
        let reaction = react(&settings, &faults, 10.0).unwrap();
        assert!(reaction.after_s < 2.5 && reaction.moved_m < 1.0, "{reaction:?}");
    });
}

/// Reports that a radio loses for a moment cost the evidence of that moment alone.
#[test]
fn f58_a_frozen_pose_is_found_although_reports_of_rates_have_a_gap() {
    let gaps = [(0.1, 0.2), (0.1, 0.4), (1.0, 0.3), (2.0, 0.3)];
    on_all_processors((gaps.len() * LAWS.len()) as u64, |index| {
        let (law, (before_s, gap_s)) = (LAWS[index as usize % 4], gaps[index as usize / 4]);
        let settings = [
            format!("control.controller={law}"),
            "trajectory.kind=circle".to_owned(),
            format!("clock.seed={}", FIRST_SEED + index),
        ];
        let gap = format!("vehicle:off@{}+{gap_s}", 10.0 - before_s);
        let faults = [gap, "pose:frozen-noise=0.5mm@10".to_owned()];
        let reaction = react(&settings, &faults, 10.0).unwrap();
        assert!(reaction.after_s < 0.7 && reaction.moved_m < 1.0, "{reaction:?}");
    });
}

/// A heading that turns slowly, as of a planner that computes it, does not end the oscillation.
#[test]
fn f58_a_frozen_pose_is_found_although_the_reference_heading_turns_slowly() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("points.csv");
    std::fs::write(&file, "t,x,y,z,yaw_deg\n0,0,0,1,0\n40,0,0,1,10\n").unwrap();
    for (index, law) in LAWS.into_iter().enumerate() {
        let settings = [
            format!("control.controller={law}"),
            "trajectory.kind=waypoints".to_owned(),
            format!("trajectory.waypoints-file={file:?}"),
            format!("clock.seed={}", FIRST_SEED + index as u64),
        ];
        let faults = ["pose:frozen-noise=0.5mm@14".to_owned()];
        let reaction = react(&settings, &faults, 14.0).unwrap();
        assert!(reaction.after_s < 2.5 && reaction.moved_m < 1.0, "{reaction:?}");
    }
}

#[test]
fn f58_a_frozen_pose_with_noise_ends_a_flight_at_a_corner() {
    for has_gyroscope in [true, false] {
        require_in_time(&study(frozen, &["square"], AT_CORNER, has_gyroscope));
    }
}

#[test]
fn f58_a_vehicle_whose_pose_freezes_in_a_take_off_stays_near() {
    for (has_gyroscope, bound_m) in [(true, 3.0), (false, 11.0)] {
        for reaction in study(frozen, &["hover"], IN_TAKE_OFF, has_gyroscope) {
            assert!(reaction.moved_m <= bound_m, "{reaction:?}");
        }
    }
}

#[test]
fn f58_a_frozen_pose_with_noise_ends_a_hover() {
    for reaction in study(frozen, &["hover"], IN_FLIGHT, true) {
        assert!(reaction.after_s <= 2.2 && reaction.moved_m <= 1.5, "{reaction:?}");
    }
}

#[test]
fn f58_a_mirrored_pose_ends_a_flight_in_the_first_metre() {
    for reaction in study(|_| "mirror".to_owned(), &["hover", "circle", "square"], IN_FLIGHT, true)
    {
        assert!(reaction.moved_m <= 1.0 && reaction.after_s < 6.0, "{reaction:?}");
    }
}

#[test]
fn f58_the_heading_of_a_vehicle_without_rates_shows_that_poses_are_frozen() {
    let shapes = ["hover", "circle", "lemniscate", "square"];
    for reaction in study(frozen, &shapes, IN_FLIGHT, false) {
        assert!(reaction.after_s <= 2.0, "{reaction:?}");
    }
}

/// States of a flight under `oqtal-dt` with `fault`, in order.
fn states(shape: &str, settings: &[&str], fault: &str, seed: u64) -> Vec<SafetyState> {
    let own = [
        "control.controller=oqtal-dt".to_owned(),
        format!("trajectory.kind={shape}"),
        format!("clock.seed={seed}"),
        format!("fault.inject=[{fault:?}]"),
    ];
    let others = settings.iter().map(|text| (*text).to_owned());
    let flown = fly(&mission(&own.into_iter().chain(others).collect::<Vec<_>>())).unwrap();
    let states = flown.armed().chain(flown.samples.last());
    let mut states: Vec<_> = states.map(|sample| sample.telemetry.state).collect();
    states.dedup();
    states.into_iter().filter_map(SafetyState::from_code).collect()
}

/// After wrong poses the motion is not known: level and without poses, such a vehicle would slide or climb away.
#[test]
fn f48_a_vehicle_does_not_descend_without_poses_if_they_were_wrong_before_and_does_if_they_are_lost()
 {
    use SafetyState::{Descend, Stop};
    let attitude = ["vehicle.interface=attitude"];
    for seed in FIRST_SEED..FIRST_SEED + 3 {
        for (shape, fault) in [
            ("hover", "pose:drift=0.5m/s@9.3+0.15"),
            ("lemniscate", "pose:frozen-noise=1mm@9.3+0.3"),
        ] {
            let states = states(shape, &attitude, fault, seed);
            assert!(states.contains(&Stop) && !states.contains(&Descend), "{shape}: {states:?}");
        }
        let lost = states("circle", &attitude, "pose:off@9.3+0.5", seed);
        assert!(lost.contains(&Descend) && !lost.contains(&Stop), "{lost:?}");
    }
}

#[test]
fn f59_a_law_that_follows_a_path_turned_against_the_attitude_far_away_is_stopped_and_does_not_land()
{
    for seed in FIRST_SEED..FIRST_SEED + 3 {
        let states = states("hover", &[], "pose:rotate=90deg@8", seed);
        assert!(!states.contains(&SafetyState::Land), "{states:?}");
        assert_eq!(states.last(), Some(&SafetyState::Stop));
    }
}

/// Settings of a flight without a fault: any law, shape, cameras, noise told or not, plant, wind, gusts, pushes and losses.
fn innocent(seed: u64) -> Vec<String> {
    let random = &mut Random(seed << 32);
    let shapes = ["hover", "circle", "lemniscate", "square", "step", "attitude-chirp"];
    let mut settings = vec![
        format!("clock.seed={seed}"),
        format!("control.controller={}", random.pick(&ControllerName::NAMES)),
        format!("trajectory.kind={}", random.pick(&shapes)),
        format!("mocap.preset={}", random.pick(&["ideal", "qualisys", "measured", "room"])),
        format!("plant.fidelity={}", random.pick(&["eq61", "rotors"])),
        format!("plant.gyroscope={}", random.one_in(2)),
    ];
    if random.one_in(2) {
        settings.push(format!("mocap.attitude-noise-deg={:.3}", random.between(0.02, 0.8)));
        settings.push(format!("mocap.position-noise-mm={:.3}", random.between(0.05, 2.0)));
        settings.push("control.predictive.filter.attitude-noise-deg=0.2".to_owned());
        settings.push("control.predictive.filter.position-noise-mm=0.5".to_owned());
    }
    if random.one_in(2) {
        settings.extend(other_plant(random));
    }
    if random.one_in(3) {
        let (x, y) = (random.between(-0.8, 0.8), random.between(-0.8, 0.8));
        settings.push(format!("plant.force-n=[{x:.3}, {y:.3}, {:.3}]", random.between(-0.1, 0.1)));
        settings.push(format!("plant.gust-sd-m-s2={:.3}", random.between(0.03, 0.6)));
    }
    if random.one_in(4) {
        let push = [(); 3].map(|()| format!("{:.2}", random.between(-1.5, 1.5))).join(",");
        let (at_s, for_s) = (random.between(4.0, 15.0), random.between(0.1, 3.0));
        settings.push(format!("plant.disturb=[\"force@{at_s:.1}+{for_s:.1}={push}N\"]"));
    }
    if random.one_in(3) {
        settings.push(format!("mocap.dropout-probability={:.3}", random.between(0.0, 0.05)));
        settings.push(format!("plant.command-loss-probability={:.3}", random.between(0.0, 0.1)));
    }
    settings
}

/// A plant about twice as far off its model as in the spread of `oqtal robustness`, each axis for itself.
fn other_plant(random: &mut Random) -> Vec<String> {
    let common = random.between(0.7, 1.3);
    let rates = [(); 3].map(|()| format!("{:.3}", 2.0 * common * random.between(0.8, 1.2)));
    vec![
        format!("plant.rate-authority-rad-s=[{}]", rates.join(", ")),
        format!("plant.rate-lag-ms={:.1}", random.between(20.0, 110.0)),
        format!("plant.hidden-delay-ms={:.1}", random.between(0.0, 30.0)),
        format!("plant.mass-kg={:.3}", 0.5 * random.between(0.8, 1.2)),
        format!("plant.thrust-lag-ms={:.1}", random.between(10.0, 110.0)),
    ]
}

/// Whether a test of the poses ended the flight.
fn is_accused(flight: &Flight) -> bool {
    flight.samples.iter().map(|sample| &sample.telemetry).any(|tick| {
        tick.cause == Cause::Contradiction.code() && tick.state > SafetyState::Degraded.code()
    })
}

#[test]
fn no_flight_with_right_poses_is_ended_by_the_tests_of_poses() {
    let count = length("OQTAL_TEST_POSE_FLIGHTS", 24);
    let first = length("OQTAL_TEST_POSE_SEED", FIRST_SEED);
    let (ended, landed) = (Mutex::new(Vec::new()), Mutex::new(0_u64));
    let greatest = Mutex::new([[0.0_f64; 3]; 2]);
    on_all_processors(count, |index| {
        let settings = innocent(first + index);
        let flight = fly(&mission(&settings)).unwrap();
        let has_gyroscope = usize::from(flight.config.plant.gyroscope);
        for evidence in flight.samples.iter().map(|sample| sample.telemetry.pose_evidence) {
            let greatest = &mut greatest.lock().unwrap()[has_gyroscope];
            *greatest = std::array::from_fn(|test| greatest[test].max(evidence[test]));
        }
        *landed.lock().unwrap() += u64::from(flight.outcome == Outcome::Landed);
        if is_accused(&flight) {
            ended.lock().unwrap().push(format!("{}: {}", flight.outcome, settings.join(" ")));
        }
    });
    let (ended, landed) = (ended.into_inner().unwrap(), landed.into_inner().unwrap());
    println!(
        "{count} flights, {landed} landed, {} ended by a test of poses; greatest evidence without \
         rates, with rates: {:.2?}",
        ended.len(),
        greatest.into_inner().unwrap()
    );
    assert!(ended.is_empty(), "{}:\n  {}", ended.len(), ended.join("\n  "));
    assert!(landed >= count / 2, "{landed} of {count} landed");
}

/// In a slow circle the tilt that balances drag is as large as the one towards the centre.
#[test]
fn f59_a_slow_circle_with_right_poses_is_nominal() {
    for (law, period_s) in [("oqtal-dt", 12), ("pid", 16), ("oqtal-dt", 16), ("oqtal-dt", 20)] {
        let settings = [
            format!("control.controller={law}"),
            "trajectory.kind=circle".to_owned(),
            format!("trajectory.circle.period-s={period_s}"),
        ];
        for seed in FIRST_SEED..FIRST_SEED + 4 {
            let flown = fly(&mission(&[&settings[..], &[format!("clock.seed={seed}")]].concat()));
            let flown = flown.unwrap();
            let has_disagreed =
                |sample: &FlightSample| sample.telemetry.cause == Cause::Contradiction.code();
            assert!(!flown.armed().any(has_disagreed), "{law}, {period_s} s, seed {seed}");
        }
    }
}
