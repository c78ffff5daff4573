//! The command `serve`: a standalone camera system, for tests of client software.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Args;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, ServeOptions};
use oqtal_runtime::process::{Exit, Failure, stop_on_signals};
use oqtal_runtime::program::{print, say};
use oqtal_runtime::stop::StopFlag;

use super::feed::FrameFeed;
use super::network::{NetworkThread, ServeCounters};
use super::opening::open;
use super::script::Script;
use super::server::Endpoint;
use super::spec::ServeSpec;
use crate::recording::{Recording, read_recording};
use crate::scene::SceneName;

/// Interval between lines of status.
const STATUS_INTERVAL: Span = Span::from_millis(1000);
/// Lateness of a frame, as after a suspension, above which the motion continues with it, instead of catching up.
const LONGEST_LAG: Span = Span::from_millis(1000);
/// Longest sleep, after which the stop flag is checked.
const LONGEST_SLEEP: Duration = Duration::from_millis(20);

/// Protocols and addresses that are served.
#[derive(Args, Clone, Debug)]
pub struct ServeArgs {
    /// Protocols, separated by commas; port 0 is any free port
    #[arg(
        long,
        value_name = "qtm[:PORT],vrpn[:PORT],natnet[:PORT]",
        default_value = "qtm,vrpn,natnet",
        value_parser = protocols
    )]
    protocol: String,
    /// Motion of the bodies
    #[arg(long, value_enum, default_value = "lemniscate")]
    scene: SceneName,
    /// Play a recording instead, again and again: CSV with named columns, TUM or EuRoC
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "rate"])]
    replay: Option<PathBuf>,
    /// Frames a second, 1 to 1000
    #[arg(long, value_name = "HZ", default_value = "100", value_parser = rate)]
    rate: f64,
    /// Name of a body; may be repeated, up to 32 times [default: quad]
    #[arg(long = "body", value_name = "NAME")]
    bodies: Vec<String>,
    /// Address of this machine at which clients are served [default: 127.0.0.1]
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Version of NatNet, from 3.0 on [default: 4.1]
    #[arg(long, value_name = "VERSION")]
    natnet_version: Option<String>,
    /// Group of NatNet's frames, or nothing for unicast alone [default: 239.255.42.99]
    #[arg(long, value_name = "ADDR")]
    multicast: Option<String>,
    /// Probability that a frame reaches no client
    #[arg(long, value_name = "P", default_value = "0", value_parser = probability)]
    loss: f64,
    /// Probability that a frame is sent twice
    #[arg(long, value_name = "P", default_value = "0", value_parser = probability)]
    repeat: f64,
    /// Probability that a frame is sent after the next one
    #[arg(long, value_name = "P", default_value = "0", value_parser = probability)]
    swap: f64,
    /// Seed of what is lost, repeated and swapped
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Print what is served as one JSON document
    #[arg(long)]
    json: bool,
}

/// Endpoints, bodies and rate, as JSON.
#[derive(Debug, serde::Serialize)]
struct ServeReport {
    endpoints: Vec<Endpoint>,
    bodies: Vec<String>,
    rate_hz: f64,
}

/// Checks names and ports, so that a mistake is reported as an error of the command line.
fn protocols(text: &str) -> Result<String, String> {
    match text.parse::<ServeSpec>() {
        Ok(spec) if spec.is_empty() => Err("name at least one of qtm, vrpn and natnet".to_owned()),
        Ok(_) => Ok(text.to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|rate| (1.0..=1000.0).contains(rate));
    rate.ok_or_else(|| "write a number from 1 to 1000".to_owned())
}

fn probability(text: &str) -> Result<f64, String> {
    let probability = text.parse().ok().filter(|p| (0.0..=1.0).contains(p));
    probability.ok_or_else(|| "write a number from 0 to 1".to_owned())
}

impl ServeArgs {
    /// Serves until SIGINT or SIGTERM.
    ///
    /// # Errors
    /// The recording or an option is invalid, or a port cannot be opened.
    pub fn execute(self) -> Result<Exit, Failure> {
        let options = self.options()?;
        let recording = self.replay.as_deref().map(read_recording).transpose()?;
        let rate_hz = recording.as_ref().map_or(self.rate, Recording::nominal_rate_hz);
        let bodies = match &self.bodies[..] {
            [] => vec![options.body.clone()],
            named => named.to_vec(),
        };
        let stop = stop_on_signals()?;
        let (feed, network) = open(&options, &bodies, (rate_hz, self.seed))?;
        self.report(&network, &bodies, rate_hz)?;
        let script = Script::new(recording, self.scene, rate_hz);
        let counters = network.counters();
        std::thread::scope(|threads| {
            // Set however the loop ends, also by a panic.
            let _stop = stop.set_on_drop();
            threads.spawn(|| network.run(&stop));
            play(script, (bodies.len(), &feed), &stop, &counters);
        });
        Ok(Exit::Ok)
    }

    /// The options of `[mocap.serve]`: defaults, changed by the command line.
    fn options(&self) -> Result<ServeOptions, Failure> {
        let mut options = Config::from_settings(&[])?.mocap.serve;
        options.protocols.clone_from(&self.protocol);
        options.loss_probability = self.loss;
        options.repeat_probability = self.repeat;
        options.swap_probability = self.swap;
        let texts = [
            (&self.listen, &mut options.listen),
            (&self.natnet_version, &mut options.natnet_version),
            (&self.multicast, &mut options.multicast),
        ];
        for (given, place) in texts {
            if let Some(given) = given {
                place.clone_from(given);
            }
        }
        Ok(options)
    }

    fn report(
        &self,
        network: &NetworkThread,
        bodies: &[String],
        rate_hz: f64,
    ) -> Result<(), Failure> {
        let endpoints = network.endpoints();
        if self.json {
            let report = ServeReport { endpoints, bodies: bodies.to_vec(), rate_hz };
            let text = serde_json::to_string(&report)
                .map_err(|error| Failure::new(Exit::Internal, error.to_string()))?;
            return print(&text);
        }
        let lines: Vec<String> = endpoints.iter().map(ToString::to_string).collect();
        print(&format!(
            "{}\n{} at {rate_hz:.1} Hz; Ctrl-C ends",
            lines.join("\n"),
            bodies.join(", ")
        ))
    }
}

/// Sends the frames when they are due and prints the numbers of clients and frames, until a stop is requested.
fn play(
    mut script: Script,
    (bodies, feed): (usize, &FrameFeed),
    stop: &StopFlag,
    counters: &ServeCounters,
) {
    let mut shown = (Time::now(), 0);
    let status = |clients: usize| {
        let frames = counters.frames.load(Ordering::Relaxed);
        say(&format!("{clients} clients, {frames} frames served"));
    };
    script.resume(Time::now());
    while !stop.is_set() {
        let (due, now) = (script.next_event(), Time::now());
        if now.since(due) > LONGEST_LAG {
            script.resume(now);
        } else if due <= now {
            feed.send(script.frame(bodies));
        } else {
            let wait = Duration::from_nanos(due.since(now).nanos().unsigned_abs());
            std::thread::sleep(wait.min(LONGEST_SLEEP));
        }
        let clients = counters.clients.load(Ordering::Relaxed);
        if clients != shown.1 && now.since(shown.0) > STATUS_INTERVAL {
            status(clients);
            shown = (now, clients);
        }
    }
    status(shown.1);
}
