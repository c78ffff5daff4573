//! A flight through processes over the bus, in real time or in lockstep.

use std::sync::Mutex;
use std::time::Duration;

use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, OperatorCommand};
use oqtal_bus::control::ControlClient;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::Role;
use oqtal_config::ClockKind;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Exit, Failure, instance_paths};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::StopFlag;

use super::output::Output;
use super::process_group::{PATIENCE, ProcessGroup};
use super::progress::{Interrupts, Progress};
use super::vehicle::VehicleLink;
use oqtal_lab::mission::Mission;
use oqtal_lab::simulation::REVIEW;
use oqtal_observe::flight::Flight;
use oqtal_observe::kernel::{Observed, OneProcessor};
use oqtal_observe::observer::Observer;
use oqtal_observe::recorder::Recorder;

/// How often the observer listens in real time: well before a buffer of a thousand milliseconds is full.
const LISTEN: Duration = Duration::from_millis(20);
/// How often the processes is looked after.
const WATCH: Duration = Duration::from_millis(20);

/// Flies `mission` through processes of their own, and leaves nothing behind.
///
/// # Errors
/// A process could not be started, never came, or ended in flight.
pub fn fly(
    mission: &Mission,
    link: &VehicleLink,
    (output, interrupts): (&Output, &Interrupts),
) -> Result<Flight, Failure> {
    let place = instance_paths(&mission.config)?;
    let result = fly_at((mission, link), output, (&place, interrupts));
    // A killed process cleans up nothing.
    if let Ok(bus) = Bus::open(&place) {
        drop(bus);
    }
    result
}

fn fly_at(
    (mission, link): (&Mission, &VehicleLink),
    output: &Output,
    (place, interrupts): (&InstancePaths, &Interrupts),
) -> Result<Flight, Failure> {
    let bus = Bus::open(place)?;
    // The ears are open before anybody speaks.
    let mut observer = Observer::new(&bus)?;
    refuse_company(&bus, &mission.config.instance.name)?;
    let lockstep = mission.config.clock.kind == ClockKind::Lockstep;
    let _here = lockstep.then(OneProcessor::stay);
    let mut processes = ProcessGroup::start((mission, link), &output.config(), output.directory())?;
    let stop = StopFlag::default();
    let watch = Watch { place, stop: &stop, over: StopFlag::default(), fallen: Mutex::new(None) };
    let flight = std::thread::scope(|threads| {
        let (watch, processes) = (&watch, &mut processes);
        threads.spawn(move || watch.run(processes, interrupts));
        // However the recording ends, the watch ends with it.
        let _over = watch.over.set_on_drop();
        record((mission, link), &bus, &mut observer, &stop)
    });
    processes.dismiss();
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
    let status = ControlRequestV1 { command: OperatorCommand::Status.code() };
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
    (mission, link): (&Mission, &VehicleLink),
    bus: &Bus,
    observer: &mut Observer<Bus>,
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
            && link.silence(&mission.config).is_some_and(|limit| flown >= limit)
        {
            progress.finish();
            return Err(link.never_answered());
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
    let command_path = link.command_path();
    Ok(Flight { daemon, command_path, ..recorder.finish(mission.otherwise(), speed_factor) })
}

/// The recorder's clock: a look every few milliseconds, or a turn in virtual time.
enum Clock {
    Real(StopFlag),
    Virtual { pace: Box<LoopClock>, next: Option<Time>, end: Time },
}

impl Clock {
    fn new(mission: &Mission, bus: &Bus, stop: &StopFlag) -> Result<Self, Failure> {
        Ok(match mission.config.clock.kind {
            ClockKind::Real => Self::Real(stop.clone()),
            ClockKind::Lockstep | ClockKind::InProcess => Self::Virtual {
                pace: Box::new(LoopClock::follower(bus, Role::Recorder, stop.clone())?),
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
    let request = ControlRequestV1 { command: OperatorCommand::Fly.code() };
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

/// Looks after the processes and the operator while the flight is recorded.
struct Watch<'a> {
    place: &'a InstancePaths,
    stop: &'a StopFlag,
    over: StopFlag,
    fallen: Mutex<Option<Failure>>,
}

impl Watch<'_> {
    fn run(&self, processes: &mut ProcessGroup, interrupts: &Interrupts) {
        // Without a watch there is no flight, however the watch ended.
        let _stop = self.stop.set_on_drop();
        let client = Bus::open(self.place).and_then(|bus| Ok((bus.control_client()?, bus)));
        while !self.over.is_set() {
            if let Some(failure) = processes.fallen() {
                self.give_up(failure);
                return;
            }
            let operator = client.as_ref().ok().map(|(client, _)| client);
            if interrupts.next().is_some_and(|command| !self.passes_on(operator, command)) {
                self.give_up(Failure::new(Exit::Flight, "interrupted"));
                return;
            }
            std::thread::sleep(WATCH);
        }
    }

    /// Passes an operator's request on; `false` if there is no flight that could end by it.
    fn passes_on(&self, client: Option<&ControlClient>, command: OperatorCommand) -> bool {
        let request = ControlRequestV1 { command: command.code() };
        let response = client.and_then(|client| client.ask(request, Span::from_millis(500)).ok());
        response.flatten().is_some_and(|response| response.answer != Answer::Refused.code())
    }

    fn give_up(&self, failure: Failure) {
        if let Ok(mut fallen) = self.fallen.lock() {
            *fallen = Some(failure);
        }
    }
}
