//! An external law in an in-process flight: it flies; whatever it answers, no vehicle is lost.

pub mod pd;
mod propagation;
mod sabotage;

use oqtal_bus::code::{Cause, HandoverCause, SafetyState};
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_bus::time::Span;
use oqtal_config::{Config, Setting};
use oqtal_daemon::{ExternalLaw, LawPort, without_answer};
use oqtal_lab::mission::Mission;
use oqtal_lab::replay::{RecordedWaypoints, replay};
use oqtal_lab::simulation::{fly_recorded, fly_with_law};
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_observe::recording::{InputHistory, RecordingFile, play};
use oqtal_observe::summary::Summary;

use crate::config;
use pd::PositionPd;
use propagation::Watched;
use sabotage::{Sabotage, Saboteur};

/// A mission under an external law, with these settings.
pub fn mission(settings: &[&str]) -> Mission {
    Mission::new(config(&[&["control.controller=external"], settings].concat())).unwrap()
}

/// Number of hand-overs in the flight, and the reason for the last.
fn handovers(flight: &Flight) -> (u64, HandoverCause) {
    let worst = flight.samples.iter().max_by_key(|sample| sample.telemetry.handovers);
    let last = worst.map(|sample| sample.telemetry).unwrap_or_default();
    (last.handovers, HandoverCause::from_code(last.handover_cause).unwrap())
}

#[test]
fn an_external_law_flies_the_square_and_the_same_bits_twice() {
    let mission = mission(&["clock.seed=7"]);
    let flights = [0, 1].map(|_| fly_with_law(&mission, &mut PositionPd::default()).unwrap());
    let summaries = flights.each_ref().map(Summary::of);
    assert_eq!(summaries[0].trajectory_hash, summaries[1].trajectory_hash);
    assert_eq!(summaries[0].outcome, Outcome::Landed, "{:?}", summaries[0].shortfall);
    assert_eq!(handovers(&flights[0]), (0, HandoverCause::None));
    let flown = flights[0].scored().filter(|sample| sample.telemetry.fallback == 0).count();
    assert_eq!(flown, flights[0].scored().count());
    let error_m = summaries[0].position_error_m.as_ref().unwrap().mean;
    assert!(error_m < 0.3, "{error_m} m");
}

#[test]
fn an_external_law_flies_a_vehicle_commanded_by_attitudes() {
    let mission = mission(&["vehicle.interface=attitude", "clock.seed=7"]);
    let flight = fly_with_law(&mission, &mut PositionPd::default()).unwrap();
    assert_eq!((flight.outcome, handovers(&flight).0), (Outcome::Landed, 0));
    assert!(flight.scored().all(|sample| sample.telemetry.fallback == 0));
}

/// The bias of an adapted model is small: a law that computed its thrust with another mass would hover low.
#[test]
fn an_external_law_without_an_integral_holds_its_height_with_an_adapted_mass() {
    let mission = mission(&["trajectory.kind=hover", "plant.mass-kg=0.55", "clock.seed=7"]);
    let flight = fly_with_law(&mission, &mut PositionPd::default()).unwrap();
    let adapted = flight.samples.iter().any(|sample| sample.telemetry.adapted_thrust_gain < 0.97);
    assert!(adapted, "the model is adapted");
    let errors: Vec<f64> = flight
        .scored()
        .filter_map(|sample| {
            Some(sample.truth?.position[2] - sample.telemetry.reference_position[2])
        })
        .collect();
    let mean_m = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(mean_m.abs() < 5e-3, "{mean_m} m");
}

/// A law that answers once, then no more.
struct Once(u32);

impl ExternalLaw for Once {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        self.0 += 1;
        (self.0 < 400).then(|| PositionPd::default().command(state))
    }
}

#[test]
fn f70_a_law_that_stops_answering_is_replaced_in_that_tick_without_a_jump() {
    let mission = mission(&["trajectory.kind=hover", "trajectory.hover.duration-s=5"]);
    let flight = fly_with_law(&mission, &mut Once(0)).unwrap();
    assert_eq!(flight.outcome, Outcome::Landed);
    assert_eq!(handovers(&flight), (1, HandoverCause::Missing));
    let steps = flight.samples.windows(2).filter(|pair| pair[0].telemetry.phase == 3);
    let thrust = |sample: &oqtal_observe::flight::FlightSample| sample.telemetry.thrust;
    let jump = steps.map(|pair| (thrust(&pair[1]) - thrust(&pair[0])).abs()).fold(0.0, f64::max);
    assert!(jump < 0.067, "{jump} of the greatest thrust: the slew of a tick");
}

/// A law that ends after its 600th answer.
struct Ending(u32);

impl ExternalLaw for Ending {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        self.0 += 1;
        let good = PositionPd::default().command(state);
        Some(if self.has_ended() { without_answer(HandoverCause::Ended) } else { good })
    }

    fn has_ended(&self) -> bool {
        self.0 > 600
    }
}

#[test]
fn a_flight_in_one_process_ends_with_its_law_and_not_by_an_operator() {
    let mission = mission(&["trajectory.kind=hover", "clock.kind=in-process"]);
    let flight = fly_with_law(&mission, &mut Ending(0)).unwrap();
    assert_eq!(handovers(&flight), (1, HandoverCause::Ended));
    assert_eq!(flight.cause().as_deref(), Some("the law ended"));
    let told = flight.shortfall().unwrap();
    assert!(told.ends_with("the law ended") && !told.contains("operator"), "{told}");
}

/// A law that leaves every question out whose number is a multiple of this one.
struct Gaps(u64);

impl ExternalLaw for Gaps {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        (!state.sequence.is_multiple_of(self.0)).then(|| PositionPd::default().command(state))
    }
}

/// Numbers of ticks that the fallback flew after each failure of a law that leaves out every question of a multiple of `every`.
fn interruptions(every: u64) -> Vec<usize> {
    let hover = ["trajectory.kind=hover", "trajectory.hover.duration-s=8"];
    let mission = mission(&[&hover[..], &["external.return-answers=5"]].concat());
    let flight = fly_with_law(&mission, &mut Gaps(every)).unwrap();
    let flown = flight.samples.iter().map(|sample| sample.telemetry.fallback);
    let from_law: Vec<_> = flown.skip_while(|fallback| *fallback != 0).collect();
    let runs = from_law.split(|fallback| *fallback == 0).map(<[u8]>::len).filter(|run| *run > 0);
    let mut runs: Vec<_> = runs.collect();
    // The landing is the fallback's.
    runs.pop();
    runs
}

#[test]
fn f70_a_law_that_fails_soon_after_each_return_returns_later_but_returns() {
    // It flies for 54 commands after each return.
    let steady = interruptions(60);
    assert!(steady.len() >= 7 && steady.iter().all(|ticks| *ticks == 5), "{steady:?}");
    // The fallback flies for 5, 10 and 20 ticks. In the third of these the law fails at the 18th, and must then give 5 good commands.
    let soon = interruptions(18);
    assert!(soon.len() >= 10 && soon[..2] == [5, 10], "{soon:?}");
    assert!(soon[2..].iter().all(|ticks| *ticks == 23), "{soon:?}");
}

/// Flies `sabotage` in a flight of `seed` with the settings `further`; returns the outcome and the number of hand-overs.
fn sabotaged(sabotage: Sabotage, seed: usize, further: &str) -> (Outcome, u64, HandoverCause) {
    let trajectory = sabotage::TRAJECTORIES[seed % sabotage::TRAJECTORIES.len()];
    let returns = ["external.return-answers=0", "external.return-answers=20"][seed / 5 % 2];
    let seed_setting = format!("clock.seed={seed}");
    let mut settings = vec![seed_setting.as_str(), returns];
    settings.extend_from_slice(sabotage::ROOM);
    settings.extend_from_slice(trajectory);
    settings.extend(further.split_whitespace());
    let flight = fly_with_law(&mission(&settings), &mut Saboteur::new(sabotage, seed)).unwrap();
    let (count, cause) = handovers(&flight);
    (flight.outcome, count, cause)
}

/// `OQTAL_TEST_SABOTAGE_RUNS` flights, by default 5 of each kind, from number `OQTAL_TEST_SABOTAGE_FROM` on, with the further settings
/// `OQTAL_TEST_SABOTAGE_SET`, separated by spaces: of another plant, or another fallback.
#[test]
fn f70_no_vehicle_is_lost_whatever_a_law_answers() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let kinds = Sabotage::ALL.len();
    let runs: usize = number("OQTAL_TEST_SABOTAGE_RUNS").unwrap_or(5 * kinds);
    let first = number("OQTAL_TEST_SABOTAGE_FROM").unwrap_or(0);
    let further = std::env::var("OQTAL_TEST_SABOTAGE_SET").unwrap_or_default();
    let further = &further;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let results = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|worker| {
                scope.spawn(move || {
                    let seeds = (first + worker..first + runs).step_by(threads);
                    let fly = |seed| {
                        (seed, sabotaged(Sabotage::ALL[seed % kinds], seed / kinds, further))
                    };
                    seeds.map(fly).collect::<Vec<_>>()
                })
            })
            .collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect::<Vec<_>>()
    });
    let mut lost = Vec::new();
    for (index, kind) in Sabotage::ALL.into_iter().enumerate() {
        let of_kind: Vec<_> = results.iter().filter(|(seed, _)| seed % kinds == index).collect();
        let handed: usize = of_kind.iter().filter(|(_, (_, count, _))| *count > 0).count();
        println!("{kind:?}: {} flights, {handed} with a hand-over", of_kind.len());
        for (seed, (outcome, count, cause)) in of_kind {
            // A law that drives to the fence again and again is held there, and its flight ends late.
            if *outcome == Outcome::Timeout {
                println!("{kind:?} {}: still flies, {count} hand-overs", seed / kinds);
            } else if *outcome != Outcome::Landed {
                lost.push(format!("{kind:?} {}: {outcome}, {count} {cause}", seed / kinds));
            }
        }
    }
    println!("{} flights, {} lost", results.len(), lost.len());
    assert!(lost.is_empty(), "{lost:#?}");
}

/// INDI turns this vehicle slower than its own rate loop would.
#[test]
fn f70_the_envelope_knows_a_fallback_that_is_slower_than_the_vehicle() {
    for seed in [6449, 6457] {
        let slow = "control.fallback=indi vehicle.preset=crazyflie-2.1";
        let (outcome, count, cause) = sabotaged(Sabotage::FullStick, seed, slow);
        assert_eq!(outcome, Outcome::Landed, "{seed}: {count} {cause}");
        assert!(count > 0, "{seed}");
    }
}

#[test]
fn f70_the_fallback_takes_over_in_the_first_tick_whose_answer_leads_out_of_the_envelope() {
    let kinds = [
        Sabotage::FullStick,
        Sabotage::WrongSign,
        Sabotage::Runaway,
        Sabotage::NoThrust,
        Sabotage::FullThrust,
        Sabotage::WrongVelocity,
    ];
    let mut compared = 0;
    for (kind, seed) in kinds.into_iter().flat_map(|kind| (0..4).map(move |seed| (kind, seed))) {
        let seed_setting = format!("clock.seed={seed}");
        let fixed = "control.predictive.adaptation.adapt=false";
        let mut settings = vec![seed_setting.as_str(), fixed, "external.return-answers=0"];
        settings.extend_from_slice(sabotage::ROOM);
        settings.extend_from_slice(sabotage::TRAJECTORIES[seed % 4]);
        let law = Saboteur::new(kind, seed);
        let mut watched = Watched { law, leads_out: Vec::new() };
        let flight = fly_with_law(&mission(&settings), &mut watched).unwrap();
        assert_eq!(flight.outcome, Outcome::Landed, "{kind:?} {seed}");
        let taken = flight.samples.iter().find(|sample| sample.telemetry.handovers > 0);
        let taken = taken.map(|sample| sample.telemetry.time);
        let flown = flight.samples.iter().filter(|sample| sample.telemetry.fallback == 0);
        let flown: Vec<_> = flown.map(|sample| sample.telemetry.time).collect();
        for (time, [small, large]) in watched.leads_out {
            assert!(!(large && flown.contains(&time)), "{kind:?} {seed}: flown at {time:?}");
            if Some(time) == taken {
                assert!(small, "{kind:?} {seed}: no reason at {time:?}");
                compared += 1;
            }
        }
    }
    assert!(compared >= 16, "{compared} hand-overs");
}

#[test]
fn f70_a_fallback_law_catches_a_built_in_law_that_does_not_hold_the_vehicle() {
    // Gains of the velocity far above those that the delay allows.
    let wild = [
        "control.controller=pid",
        "trajectory.kind=hover",
        "trajectory.hover.duration-s=8",
        "position.tilt-limit-deg=55",
        "position.horizontal-velocity-limit-m-s=3",
        "position.horizontal-velocity.kp=30",
    ];
    let flown = |fallback: &str| {
        let mission = mission(&[&wild[..], &[fallback]].concat());
        oqtal_lab::simulation::fly(&mission).unwrap()
    };
    let (alone, guarded) = (flown("control.fallback=auto"), flown("control.fallback=geometric"));
    assert!(alone.shortfall().is_some(), "lands early: too fast, or too far from its reference");
    assert_eq!(guarded.shortfall(), None);
    assert!(handovers(&guarded).0 > 0);
}

/// The reference of the external law oscillates in heading: otherwise frozen poses are not found in a hover.
#[test]
fn f58_frozen_poses_with_noise_end_a_flight_of_an_external_law_without_reported_rates() {
    for seed in 0..4 {
        let seed_setting = format!("clock.seed={seed}");
        let settings = [
            seed_setting.as_str(),
            "trajectory.kind=hover",
            "plant.gyroscope=false",
            "fault.inject=[\"pose:frozen-noise=0.5mm@10\"]",
        ];
        let flight = fly_with_law(&mission(&settings), &mut PositionPd::default()).unwrap();
        let mut flown = flight.armed().map(|sample| sample.telemetry);
        let armed = flown.next().unwrap().time;
        let reaction = flown.find(|tick| tick.state > SafetyState::Degraded.code());
        let reaction = reaction.expect("the poses are found");
        assert_eq!(Cause::from_code(reaction.cause), Some(Cause::Contradiction), "{seed}");
        let after_s = reaction.time.since(armed).seconds() - 10.0;
        assert!((0.0..2.0).contains(&after_s), "{seed}: {after_s} s");
    }
}

/// A law whose answers are received this long after their questions.
struct Slow(Span);

impl ExternalLaw for Slow {
    fn reset(&mut self) {}

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let answered_at = state.time + self.0;
        Some(ExternalV1 { answered_at, ..PositionPd::default().command(state) })
    }
}

#[test]
fn a_replay_takes_recorded_answers_that_exceed_the_budget_as_late() {
    let mission = mission(&["trajectory.kind=hover", "trajectory.hover.duration-s=2"]);
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("slow.mcap");
    let mut slow = Slow(Span::from_millis(3));
    let recorder = Some(crate::live::recorder(&mission, &path));
    fly_recorded(&mission, recorder, LawPort::of(&mut slow), |_| None).unwrap();
    let file = RecordingFile::read(&path).unwrap();
    let mut inputs = InputHistory::default();
    play(&file, &mut inputs).unwrap();
    let histories = inputs.finish();
    let replayed = |budget_us: &str| {
        let settings = ["clock.kind=real", &format!("external.budget-us={budget_us}")]
            .map(|text| Setting::parse("test", text).unwrap());
        let config = Config::parse("test", &file.config_text().unwrap(), &settings).unwrap();
        replay(&config, &RecordedWaypoints::of(&file).unwrap(), &histories[0]).unwrap()
    };
    assert!(replayed("3500").is_identical());
    let late = replayed("2500");
    assert!(late.ticks.iter().all(|tick| tick.telemetry.fallback == 1), "no answer is in time");
    let causes = late.ticks.iter().map(|tick| tick.telemetry.handover_cause);
    assert_eq!(causes.max(), Some(HandoverCause::Missing.code()));
}
