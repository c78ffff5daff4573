//! `oqtal latency`: latency of each hop of the loop, compared with bare mechanisms of the operating system in the same run.
//!
//! | file | subject |
//! |---|---|
//! | `rig.rs` | the processes of a measurement |
//! | `camera.rs`, `vehicle.rs` | stand-ins at the two ends of the chain |
//! | `bare.rs`, `bare/` | bare mechanisms that transmit a message |
//! | `condition.rs` | with and without cache warm-up; with camera jitter |
//! | `pairs.rs`, `sleep.rs` | periodic wake-up compared with cyclictest |
//! | `figures.rs`, `show.rs` | figures as JSON, and as tables |
//! | `wire.rs`, `wire/` | from the cameras' datagram to the command's, beside a program in Python |

mod bare;
mod camera;
mod condition;
mod figures;
mod pairs;
mod part;
mod record;
mod rig;
mod show;
mod sleep;
mod vehicle;
mod wire;

use std::time::Duration;

use clap::Args;
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Answer, Cause, OperatorCommand};
use oqtal_bus::error::BusError;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths, stop_on_signals};
use oqtal_runtime::program::{print, say};
use oqtal_runtime::stop::StopFlag;

use condition::RigCondition;
use figures::{ConditionFigures, LatencyFigures};
use oqtal_observe::kernel::ThreadScheduling;
use oqtal_observe::loop_monitor::LoopMonitor;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::status::word;
use oqtal_operator::request::silent;
use rig::Rig;
use wire::ChainFigures;

use crate::daemon_config::daemon_config;

pub use part::PartArgs;

/// Time-out for the start and take-off of the test chain.
const START_TIMEOUT: Span = Span::from_millis(10_000);
/// Time within which a running daemon publishes a tick.
const SILENCE: Span = Span::from_millis(1500);
/// Approximate time for starting and ending the processes of a condition \[s\].
const STARTING_S: f64 = 3.0;
/// Time after the start during which measurements are discarded.
const WARM_UP: Span = Span::from_millis(500);
/// Polling period: short enough that no buffer overflows, long enough not to disturb the loop.
const POLL_PERIOD: Duration = Duration::from_millis(100);

/// Arguments of `oqtal latency`.
#[derive(Args, Clone, Debug)]
pub struct LatencyArgs {
    /// Measure the running instance, without affecting it, instead of a test chain
    #[arg(long)]
    attach: bool,
    /// With --attach: measure the bare mechanisms, too
    #[arg(long, requires = "attach")]
    bare: bool,
    /// Measure from the cameras' datagram to the command's: emulated QTM server, receiver, daemon and bridge over MAVLink, beside a
    /// program in Python if `python3` has qtm_rt and pymavlink; needs CAP_NET_RAW
    #[arg(long, conflicts_with = "attach")]
    wire: bool,
    /// Duration of the measurement under each condition [s]
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3000))]
    seconds: u32,
    /// Print one JSON document instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl LatencyArgs {
    /// Measures, and prints the figures.
    ///
    /// # Errors
    /// With --attach no daemon is running, or it ended during the measurement (exit code 75); or a process could not be started or ended.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(&self.common.config, &self.common.settings()?)?;
        let stop = stop_on_signals()?;
        if self.wire {
            let figures = self.wire(&config, &stop)?;
            print(&if self.json { figures.to_json() } else { figures.text() })?;
            return Ok(Exit::Ok);
        }
        let figures =
            if self.attach { self.attach(&config, &stop)? } else { self.at_rest(&config, &stop)? };
        print(&if self.json { figures.to_json() } else { show::text(&figures) })?;
        figures.ended.map_or(Ok(Exit::Ok), |reason| Err(Failure::new(Exit::Peer, reason)))
    }

    /// Measures the chains from datagram to datagram, and the bare mechanisms.
    fn wire(&self, config: &Config, stop: &StopFlag) -> Result<ChainFigures, Failure> {
        wire::measure(config, self.seconds, stop, || {
            let (_, figures) = self.under(RigCondition::ALL[0], config, stop)?;
            Ok(wire::BARE_MECHANISMS.map(|mechanism| figures.bare[mechanism.name()]))
        })
    }

    fn span(&self) -> Span {
        Span::from_millis(i64::from(self.seconds) * 1000)
    }

    /// Approximate duration of the measurement without a running instance \[s\].
    fn expected_s(&self) -> f64 {
        let seconds = f64::from(self.seconds);
        let chains = RigCondition::ALL.len() as f64 * (seconds + STARTING_S);
        let pairs = f64::from(pairs::PAIRS) * (seconds / 2.0).floor().max(1.0);
        chains + if pairs::is_installed() { pairs } else { 0.0 }
    }

    /// Measures the test chain and the bare mechanisms under each condition, then periodic wake-up and cyclictest.
    fn at_rest(&self, config: &Config, stop: &StopFlag) -> Result<LatencyFigures, Failure> {
        let [regular, others @ ..] = RigCondition::ALL;
        say(&format!("this takes about {:.0} s; Ctrl-C ends it early", self.expected_s()));
        let (rig, mut figures) = self.under(regular, config, stop)?;
        figures.conditions = vec![ConditionFigures::of(regular, &figures)];
        for condition in others {
            if !stop.is_set() {
                let (_, measured) = self.under(condition, config, stop)?;
                figures.conditions.push(ConditionFigures::of(condition, &measured));
            }
        }
        if !pairs::is_installed() {
            say("cyclictest is not installed (package rt-tests): periodic wake-up is not compared");
            return Ok(figures);
        }
        // cyclictest takes whole seconds.
        let each = Span::from_millis(i64::from((self.seconds / 2).max(1)) * 1000);
        let all = f64::from(pairs::PAIRS) * each.seconds();
        say(&format!("periodic wake-up and cyclictest side by side: {all:.0} s"));
        let pairs = pairs::run(&rig, each, &figures.realtime, stop)?;
        Ok(figures.with_pairs(pairs))
    }

    /// Measures the test chain and the bare mechanisms under `condition`; ends the chain and keeps its directory with the rig.
    fn under(
        &self,
        condition: RigCondition,
        config: &Config,
        stop: &StopFlag,
    ) -> Result<(Rig, LatencyFigures), Failure> {
        let mut rig = Rig::new(&condition.applied_to(config))?;
        let bus = Bus::open(rig.place())?;
        let mut observation = Observation::open(&bus)?;
        rig.start_chain()?;
        rig.start_bare()?;
        say(&format!("test chain {}, and bare mechanisms: {} s", condition.name(), self.seconds));
        take_off(&bus, &mut observation, &mut rig)?;
        let figures = self.observe(&mut observation, Some(&mut rig), stop)?;
        rig.stop_chain();
        Ok((rig, figures))
    }

    /// Measures a running instance.
    fn attach(&self, config: &Config, stop: &StopFlag) -> Result<LatencyFigures, Failure> {
        let place = instance_paths(config)?;
        place.become_owner()?;
        let bus = Bus::open(&place)?.for_observer();
        // The bare mechanisms run on the processors and with the priority of the daemon, whatever the settings of this command.
        let mut running = daemon_config(&place).unwrap_or_else(|| config.clone());
        running.instance = config.instance.clone();
        let figures = self.attach_to(&bus, &running, stop);
        drop(bus);
        figures
    }

    fn attach_to(
        &self,
        bus: &Bus,
        config: &Config,
        stop: &StopFlag,
    ) -> Result<LatencyFigures, Failure> {
        let mut observation = Observation::open(bus)?;
        let give_up = Time::now() + SILENCE;
        while observation.monitor.latest().is_none() {
            if Time::now() >= give_up {
                return Err(no_daemon(bus.paths()));
            }
            std::thread::sleep(Duration::from_millis(10));
            observation.poll()?;
        }
        let mut rig = if self.bare { Some(Rig::new(config)?) } else { None };
        if let Some(rig) = &mut rig {
            rig.start_bare()?;
        }
        say(&format!("instance `{}`: {} s", config.instance.name, self.seconds));
        self.observe(&mut observation, rig.as_mut(), stop)
    }

    /// Observes for the requested time, or until interrupted.
    fn observe(
        &self,
        observation: &mut Observation,
        mut rig: Option<&mut Rig>,
        stop: &StopFlag,
    ) -> Result<LatencyFigures, Failure> {
        let from = Time::now() + WARM_UP;
        let end = from + self.span();
        let daemon = observation.monitor.daemon_pid();
        let realtime = daemon.and_then(ThreadScheduling::of).unwrap_or_default();
        observation.monitor.restart(from);
        let mut ended = None;
        while Time::now() < end && !stop.is_set() && ended.is_none() {
            std::thread::sleep(POLL_PERIOD);
            observation.poll()?;
            rig.as_mut().map_or(Ok(()), |rig| rig.check())?;
            ended = observation.end_of(daemon, from);
        }
        let bare = rig.map(|rig| rig.finish(from, Time::now())).transpose()?;
        let figures = LatencyFigures::new(&observation.monitor, bare.as_ref(), realtime);
        let measured_s =
            observation.monitor.latest().map_or(0.0, |it| it.time.since(from).seconds());
        let ended = ended.map(|reason| {
            format!("{reason} after {measured_s:.1} s: the figures are those until then")
        });
        Ok(LatencyFigures { measured_s, ended, ..figures })
    }
}

/// Observer of the measured instance, and the monitor that receives its samples.
struct Observation {
    observer: BusObserver,
    monitor: LoopMonitor,
}

impl Observation {
    fn open(bus: &Bus) -> Result<Self, BusError> {
        let monitor = LoopMonitor::new(Time::now());
        Ok(Self { observer: BusObserver::open(bus, &LoopMonitor::TOPICS)?, monitor })
    }

    fn poll(&mut self) -> Result<(), BusError> {
        self.observer.poll(Time::now(), &mut self.monitor)
    }

    /// Why the measurement of the process `daemon`, which began at `from`, ends; `None` while its ticks arrive.
    fn end_of(&self, daemon: Option<u32>, from: Time) -> Option<&'static str> {
        let newest_at = self.monitor.latest().map_or(from, |tick| tick.time);
        let is_another = self.monitor.daemon_pid() != daemon;
        if is_another || daemon.and_then(ThreadScheduling::of).is_none() {
            Some("the daemon ended")
        } else if Time::now().since(newest_at) >= SILENCE {
            Some("the daemon published no more ticks")
        } else {
            None
        }
    }
}

/// Requests a flight, and waits until the vehicle is armed.
fn take_off(bus: &Bus, observation: &mut Observation, rig: &mut Rig) -> Result<(), Failure> {
    let client = bus.control_client()?;
    let request = ControlRequestV1::of(OperatorCommand::Fly);
    let give_up = Time::now() + START_TIMEOUT;
    let mut asked = false;
    while !observation.monitor.is_armed() {
        rig.check()?;
        if Time::now() >= give_up {
            return Err(Failure::new(Exit::Peer, "the test chain did not begin to fly"));
        }
        if !asked && let Some(response) = client.ask(request, Span::from_millis(200))? {
            if response.answer == Answer::Refused.code() {
                let cause = word(Cause::from_code(response.cause));
                let message = format!("the daemon of the test chain refuses to fly: {cause}");
                return Err(Failure::new(Exit::Flight, message));
            }
            asked = true;
        }
        std::thread::sleep(Duration::from_millis(10));
        observation.poll()?;
    }
    Ok(())
}

fn no_daemon(paths: &InstancePaths) -> Failure {
    let silent = silent(paths);
    if silent.exit == Exit::Permission {
        return silent;
    }
    let instance = &paths.instance;
    let message = format!(
        "no daemon was observed on instance `{instance}` in real time; start one, name another with --instance, \
         or leave --attach out to measure a test chain"
    );
    Failure::new(Exit::Peer, message)
}
