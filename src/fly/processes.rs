//! A flight through processes over the bus, in real time or in lockstep.

use std::sync::Mutex;
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Verb};
use oqtal_bus::config::ClockKind;
use oqtal_bus::control::ControlClient;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::pace::{Pace, StopFlag};
use oqtal_bus::place::Place;
use oqtal_bus::process::{Exit, Failure, place_of};
use oqtal_bus::program::say;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Party;

use super::Mission;
use super::crew::{Crew, PATIENCE};
use super::in_process::REVIEW;
use super::observer::Observer;
use super::output::Output;
use super::progress::{Interrupts, Progress};
use crate::flight::Flight;
use crate::kernel::{Observed, OneProcessor};
use crate::recorder::Recorder;

/// How often the observer listens in real time: well before a buffer of a thousand milliseconds is full.
const LISTEN: Duration = Duration::from_millis(20);
/// How often the crew is looked after.
const WATCH: Duration = Duration::from_millis(20);

/// Flies `mission` through processes of their own, and leaves nothing behind.
///
/// # Errors
/// A process could not be started, never came, or ended in flight.
pub fn fly(mission: &Mission, output: &Output, interrupts: &Interrupts) -> Result<Flight, Failure> {
    let place = place_of(&mission.config)?;
    let result = fly_at(mission, output, (&place, interrupts));
    // A killed process cleans up nothing.
    if let Ok(bus) = Bus::open(&place) {
        bus.leave();
    }
    result
}

fn fly_at(
    mission: &Mission,
    output: &Output,
    (place, interrupts): (&Place, &Interrupts),
) -> Result<Flight, Failure> {
    let bus = Bus::open(place)?;
    // The ears are open before anybody speaks.
    let mut observer = Observer::new(&bus)?;
    refuse_company(&bus, &mission.config.instance.name)?;
    let lockstep = mission.config.clock.kind == ClockKind::Lockstep;
    let _here = lockstep.then(OneProcessor::stay);
    let mut crew = Crew::start(mission, &output.config(), output.directory())?;
    let stop = StopFlag::default();
    let watch = Watch { place, stop: &stop, over: StopFlag::default(), fallen: Mutex::new(None) };
    let flight = std::thread::scope(|threads| {
        let (watch, crew) = (&watch, &mut crew);
        threads.spawn(move || watch.run(crew, interrupts));
        // However the recording ends, the watch ends with it.
        let _over = watch.over.set_on_drop();
        record(mission, &bus, &mut observer, &stop)
    });
    crew.dismiss();
    if let Some(failure) = watch.fallen.into_inner().unwrap_or_else(|poison| poison.into_inner()) {
        return Err(failure);
    }
    if observer.lost() > 0 {
        let lost = observer.lost();
        say(&format!("oqtal: {lost} samples were not recorded: this machine is overloaded"));
    }
    let flight = flight?;
    say_what_is_lacking(&flight);
    Ok(flight)
}

/// In virtual time nothing is asked of the kernel.
fn say_what_is_lacking(flight: &Flight) {
    let Some(daemon) = &flight.daemon else { return };
    let lacking = daemon.realtime.lacks(&flight.config.realtime);
    if flight.config.clock.kind == ClockKind::Real && !lacking.is_empty() {
        say(&format!(
            "oqtal: this machine did not grant {}; `oqtal doctor` says how to get it",
            lacking.join(" and ")
        ));
    }
}

/// A daemon that already runs on this instance is somebody else's: it must not be made to fly.
fn refuse_company(bus: &Bus, instance: &str) -> Result<(), Failure> {
    let status = ControlRequestV1 { verb: Verb::Status.code() };
    match bus.control_client()?.ask(status, Span::from_millis(100))? {
        None => Ok(()),
        Some(_) => {
            let message = format!(
                "a daemon already runs on instance `{instance}`; stop it, or fly on another --instance"
            );
            Err(Failure::new(Exit::Peer, message))
        }
    }
}

/// Asks the daemon to fly and records until the flight is over, or `stop` is set.
fn record(
    mission: &Mission,
    bus: &Bus,
    observer: &mut Observer,
    stop: &StopFlag,
) -> Result<Flight, Failure> {
    let client = bus.control_client()?;
    if mission.recording.is_none() {
        ask_to_fly(&client, stop)?;
    }
    let mut recorder = Recorder::new(&mission.config);
    let progress = Progress::new(mission.expected());
    let mut clock = Clock::new(mission, bus, stop)?;
    let wall = Time::now();
    let mut first = None;
    let mut now = Time::UNSET;
    let mut daemon = None;
    while let Some(instant) = clock.next_review()? {
        now = instant;
        let heard = observer.listen(&mut recorder)?;
        progress.show(&recorder);
        daemon = daemon.or_else(|| Observed::of(observer.daemon()?));
        // A recording begins with its first pose, whenever the daemon began.
        let begun = if mission.recording.is_some() { recorder.sees() } else { heard };
        if begun || clock.is_virtual() {
            first.get_or_insert((now, Time::now()));
        } else if first.is_none() && Time::now().since(wall) > PATIENCE {
            return Err(never_came(mission));
        }
        let flown = first.map_or(Span::ZERO, |(began, _)| now.since(began));
        if !recorder.wire().answered()
            && mission.way.silence(&mission.config).is_some_and(|limit| flown >= limit)
        {
            progress.finish();
            return Err(mission.way.never_answered());
        }
        if recorder.outcome().is_some() || flown >= mission.patience() {
            break;
        }
    }
    progress.finish();
    let speed_factor = first.map_or(0.0, |(began, wall)| {
        now.since(began).seconds() / Time::now().since(wall).seconds().max(1e-9)
    });
    if let (Some(daemon), Some(pid)) = (&mut daemon, observer.daemon()) {
        daemon.look_again(pid);
    }
    let way = mission.way.clone();
    Ok(Flight { daemon, way, ..recorder.finish(mission.otherwise(), speed_factor) })
}

/// The recorder's clock: a look every few milliseconds, or a turn in virtual time.
enum Clock {
    Real(StopFlag),
    Virtual { pace: Box<Pace>, next: Option<Time>, end: Time },
}

impl Clock {
    fn new(mission: &Mission, bus: &Bus, stop: &StopFlag) -> Result<Self, Failure> {
        Ok(match mission.config.clock.kind {
            ClockKind::Real => Self::Real(stop.clone()),
            ClockKind::Lockstep | ClockKind::InProcess => Self::Virtual {
                pace: Box::new(Pace::follower(bus, Party::Recorder, stop.clone())?),
                next: None,
                end: Time::VIRTUAL_START + mission.patience(),
            },
        })
    }

    /// Waits until it is time to listen again; `None` once asked to stop.
    fn next_review(&mut self) -> Result<Option<Time>, Failure> {
        match self {
            Self::Real(stop) => {
                std::thread::sleep(LISTEN);
                Ok((!stop.is_set()).then(Time::now))
            }
            Self::Virtual { pace, next, end } => {
                let now = pace.wait(*next)?;
                *next = now.map(|now| (now + REVIEW).min(*end));
                Ok(now)
            }
        }
    }

    fn is_virtual(&self) -> bool {
        matches!(self, Self::Virtual { .. })
    }
}

fn ask_to_fly(client: &ControlClient, stop: &StopFlag) -> Result<(), Failure> {
    let give_up = Time::now() + PATIENCE;
    let request = ControlRequestV1 { verb: Verb::Fly.code() };
    while Time::now() < give_up && !stop.is_set() {
        match client.ask(request, Span::from_millis(200))? {
            Some(response) if response.answer == Answer::Refused.code() => {
                return Err(Failure::new(Exit::Flight, "the daemon refuses to fly"));
            }
            Some(_) => return Ok(()),
            None => {}
        }
    }
    if stop.is_set() {
        // Why is known to whoever set it.
        return Ok(());
    }
    Err(Failure::new(Exit::Peer, "the daemon never answered; see daemon.log beside the report"))
}

fn never_came(mission: &Mission) -> Failure {
    let instance = &mission.config.instance.name;
    let message =
        format!("nothing is heard of the daemon on instance `{instance}`; see its daemon.log");
    Failure::new(Exit::Peer, message)
}

/// Looks after the crew and the operator while the flight is recorded.
struct Watch<'a> {
    place: &'a Place,
    stop: &'a StopFlag,
    over: StopFlag,
    fallen: Mutex<Option<Failure>>,
}

impl Watch<'_> {
    fn run(&self, crew: &mut Crew, interrupts: &Interrupts) {
        // Without a watch there is no flight, however the watch ended.
        let _stop = self.stop.set_on_drop();
        let client = Bus::open(self.place).and_then(|bus| Ok((bus.control_client()?, bus)));
        while !self.over.is_set() {
            if let Some(failure) = crew.fallen() {
                self.give_up(failure);
                return;
            }
            let operator = client.as_ref().ok().map(|(client, _)| client);
            if interrupts.next().is_some_and(|verb| !self.passes_on(operator, verb)) {
                self.give_up(Failure::new(Exit::Flight, "interrupted"));
                return;
            }
            std::thread::sleep(WATCH);
        }
    }

    /// Passes an operator's request on; `false` if there is no flight that could end by it.
    fn passes_on(&self, client: Option<&ControlClient>, verb: Verb) -> bool {
        let request = ControlRequestV1 { verb: verb.code() };
        let response = client.and_then(|client| client.ask(request, Span::from_millis(500)).ok());
        response.flatten().is_some_and(|response| response.answer != Answer::Refused.code())
    }

    fn give_up(&self, failure: Failure) {
        if let Ok(mut fallen) = self.fallen.lock() {
            *fallen = Some(failure);
        }
    }
}
