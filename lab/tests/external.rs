//! An external law in an in-process flight: it flies; whatever it answers, no vehicle is lost.

mod pd;
mod sabotage;

use oqtal_bus::code::HandoverCause;
use oqtal_bus::message::{ExternalV1, StateV1};
use oqtal_config::{Config, Setting};
use oqtal_daemon::ExternalLaw;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation::fly_with_law;
use oqtal_observe::flight::{Flight, Outcome};
use oqtal_observe::summary::Summary;

use pd::PositionPd;
use sabotage::{Sabotage, Saboteur};

/// A mission under an external law, with these settings.
pub fn mission(settings: &[&str]) -> Mission {
    let external = ["control.controller=external"];
    let settings = external.iter().chain(settings).map(|text| Setting::parse("--set", text));
    let settings: Vec<Setting> = settings.collect::<Result<_, _>>().unwrap();
    Mission::new(Config::from_settings(&settings).unwrap()).unwrap()
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

/// Flies `sabotage` in a flight of `seed`; returns the outcome and the number of hand-overs.
fn sabotaged(sabotage: Sabotage, seed: usize) -> (Outcome, u64, HandoverCause) {
    let trajectory = sabotage::TRAJECTORIES[seed % sabotage::TRAJECTORIES.len()];
    let returns = ["external.return-answers=0", "external.return-answers=20"][seed / 5 % 2];
    let seed_setting = format!("clock.seed={seed}");
    let mut settings = vec![seed_setting.as_str(), returns];
    settings.extend_from_slice(sabotage::ROOM);
    settings.extend_from_slice(trajectory);
    let flight = fly_with_law(&mission(&settings), &mut Saboteur::new(sabotage, seed)).unwrap();
    let (count, cause) = handovers(&flight);
    (flight.outcome, count, cause)
}

/// `OQTAL_TEST_SABOTAGE_RUNS` flights, by default 5 of each kind.
#[test]
fn f70_no_vehicle_is_lost_whatever_a_law_answers() {
    let runs = std::env::var("OQTAL_TEST_SABOTAGE_RUNS").ok().and_then(|text| text.parse().ok());
    let kinds = Sabotage::ALL.len();
    let runs: usize = runs.unwrap_or(5 * kinds);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let results = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|worker| {
                scope.spawn(move || {
                    let seeds = (worker..runs).step_by(threads);
                    let fly = |seed| (seed, sabotaged(Sabotage::ALL[seed % kinds], seed / kinds));
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
            if *outcome != Outcome::Landed {
                lost.push(format!("{kind:?} {}: {outcome}, {count} {cause}", seed / kinds));
            }
        }
    }
    println!("{} flights, {} lost", results.len(), lost.len());
    assert!(lost.is_empty(), "{lost:#?}");
}
