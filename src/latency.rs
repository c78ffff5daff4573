//! `oqtal latency`: where the time goes, beside what the machine gives bare in the same run.
//!
//! | file | subject |
//! |---|---|
//! | `rig.rs` | the processes of a measurement |
//! | `camera.rs`, `vehicle.rs` | stand-ins at the two ends of the chain |
//! | `bare.rs`, `bare/` | other ways to hand a message over |
//! | `ears.rs` | what an instance says of itself |
//! | `pairs.rs`, `sleep.rs` | periodic wake-up against cyclictest |
//! | `figures.rs`, `show.rs` | JSON and tables |

mod bare;
mod camera;
mod ears;
mod figures;
mod pairs;
mod part;
mod record;
mod rig;
mod show;
mod sleep;
mod vehicle;

use std::time::Duration;

use clap::Args;
use oqtal_bus::bus::Bus;
use oqtal_bus::code::OperatorCommand;
use oqtal_bus::message::ControlRequestV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths};
use oqtal_runtime::program::{print, say};
use oqtal_runtime::stop::StopFlag;

use ears::Ears;
use figures::Figures;
use oqtal_observe::kernel::Realtime;
use rig::Rig;

pub use part::Part;

/// A process has so long to come up and fly.
const PATIENCE: Span = Span::from_millis(10_000);
/// A running daemon is heard at least every few periods.
const SILENCE: Span = Span::from_millis(1500);
/// What is measured while processes warm up does not count.
const WARM_UP: Span = Span::from_millis(500);
/// How often is listened: long before a buffer is full, and seldom, so that it is not felt.
const LISTEN: Duration = Duration::from_millis(100);

/// What to measure.
#[derive(Args, Clone, Debug)]
pub struct LatencyArgs {
    /// Look at the running instance instead of a chain at rest, without disturbing it
    #[arg(long)]
    attach: bool,
    /// With --attach: measure the bare mechanisms, too
    #[arg(long, requires = "attach")]
    bare: bool,
    /// How long [s]
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=3000))]
    seconds: u32,
    /// Print one JSON document instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    common: CommonArgs,
}

impl LatencyArgs {
    /// Measures, and prints what was found.
    ///
    /// # Errors
    /// With --attach no daemon is heard (exit code 75); a process could not be started or ended.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let config = Config::load(self.common.config.as_deref(), &self.common.settings()?)?;
        let stop = StopFlag::default();
        let flag = stop.clone();
        ctrlc::set_handler(move || flag.set())
            .map_err(|e| Failure::new(Exit::System, format!("handling signals failed: {e}")))?;
        let figures =
            if self.attach { self.attach(&config, &stop)? } else { self.at_rest(&config, &stop)? };
        print(&if self.json { figures.to_json() } else { show::text(&figures) })?;
        Ok(Exit::Ok)
    }

    fn span(&self) -> Span {
        Span::from_millis(i64::from(self.seconds) * 1000)
    }

    /// The chain at rest beside the bare mechanisms, then our periodic wake-up against cyclictest.
    fn at_rest(&self, config: &Config, stop: &StopFlag) -> Result<Figures, Failure> {
        let mut rig = Rig::new(config)?;
        let bus = Bus::open(rig.place())?;
        let mut ears = Ears::open(&bus, Time::now())?;
        rig.start_chain()?;
        rig.start_bare()?;
        say(&format!("the chain at rest, and bare: {} s", self.seconds));
        take_off(&bus, &mut ears, &mut rig)?;
        let figures = self.listen(&mut ears, Some(&mut rig), stop)?;
        rig.stop_chain();
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

    /// A running instance.
    fn attach(&self, config: &Config, stop: &StopFlag) -> Result<Figures, Failure> {
        let place = instance_paths(config)?;
        place.become_owner()?;
        let bus = Bus::open(&place)?;
        let figures = self.attach_to(&bus, config, stop);
        drop(bus);
        figures
    }

    fn attach_to(&self, bus: &Bus, config: &Config, stop: &StopFlag) -> Result<Figures, Failure> {
        let mut ears = Ears::open(bus, Time::now())?;
        let give_up = Time::now() + SILENCE;
        while ears.latest().is_none() {
            if Time::now() >= give_up {
                return Err(nobody(&config.instance.name));
            }
            std::thread::sleep(Duration::from_millis(10));
            ears.listen()?;
        }
        let mut rig = if self.bare { Some(Rig::new(config)?) } else { None };
        if let Some(rig) = &mut rig {
            rig.start_bare()?;
        }
        say(&format!("instance `{}`: {} s", config.instance.name, self.seconds));
        self.listen(&mut ears, rig.as_mut(), stop)
    }

    /// Listens for the time asked for, or until interrupted.
    fn listen(
        &self,
        ears: &mut Ears,
        mut rig: Option<&mut Rig>,
        stop: &StopFlag,
    ) -> Result<Figures, Failure> {
        let from = Time::now() + WARM_UP;
        let end = from + self.span();
        ears.restart(from);
        while Time::now() < end && !stop.is_set() {
            std::thread::sleep(LISTEN);
            ears.listen()?;
            rig.as_mut().map_or(Ok(()), |rig| rig.check())?;
        }
        let realtime = ears.daemon().and_then(Realtime::of).unwrap_or_default();
        let bare = rig.map(|rig| rig.finish(from, Time::now())).transpose()?;
        Ok(Figures::new(ears, bare.as_ref(), realtime))
    }
}

/// Asks the daemon to fly, and waits until the vehicle is told to.
fn take_off(bus: &Bus, ears: &mut Ears, rig: &mut Rig) -> Result<(), Failure> {
    let client = bus.control_client()?;
    let request = ControlRequestV1 { command: OperatorCommand::Fly.code() };
    let give_up = Time::now() + PATIENCE;
    let mut asked = false;
    while !ears.is_armed() {
        rig.check()?;
        if Time::now() >= give_up {
            return Err(Failure::new(Exit::Peer, "the chain at rest never came to fly"));
        }
        asked = asked || client.ask(request, Span::from_millis(200))?.is_some();
        std::thread::sleep(Duration::from_millis(10));
        ears.listen()?;
    }
    Ok(())
}

fn nobody(instance: &str) -> Failure {
    let message = format!(
        "no daemon is heard on instance `{instance}` in real time; start one, name another with --instance, \
         or leave --attach out to measure the chain at rest"
    );
    Failure::new(Exit::Peer, message)
}
