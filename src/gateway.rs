//! `oqtal gateway run`: references and requests of programs in any language.
//!
//! The protocol is in docs/references.md. Programs on this machine use `gateway.sock` in the directory of the instance; its mode
//! admits the owner of the instance and root only, and the kernel states the sender of each datagram. Programs on the network need
//! a key.

mod protocol;
mod request;
mod session;
mod socket;
mod stream_holder;
mod udp;

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Subcommand};
use oqtal_bus::bus::Bus;
use oqtal_bus::message::{ReferenceV1, Stamps};
use oqtal_bus::port::Writer;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::REFERENCE;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_config::Config;
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths, stop_on_signals};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::StopFlag;

use protocol::{Content, GatewayReply};
use request::{Executor, RequestQueues};
use socket::{GatewaySocket, Incoming, Received, Sender, UnixGateway};
use stream_holder::StreamHolder;
use udp::{GatewayKey, UdpGateway};

use crate::daemon_config::daemon_config;

/// Name of the socket in the directory of the instance.
const SOCKET: &str = "gateway.sock";
/// Time after the loss of files for which programs can still reach the processes that land.
const LONGEST_LOSS: Span = Span::from_millis(10_000);

/// Time between two turns above which the gateway was held up: datagrams that wait then were sent after the turn before, and are dated by it.
const LONGEST_TURN: Span = Span::from_millis(30);
/// Time between two readings of the daemon's configuration.
const CONFIG_PERIOD: Span = Span::from_millis(1000);

/// `oqtal gateway`.
#[derive(Subcommand, Debug)]
pub enum GatewayCommand {
    /// Pass references and requests of programs to the daemon, until interrupted
    Run(GatewayArgs),
}

/// Arguments of `oqtal gateway run`.
#[derive(Args, Debug)]
pub struct GatewayArgs {
    /// Serve this address of the network in place of the Unix socket; port 0 is any free one
    #[arg(long, value_name = "ADDRESS:PORT", requires = "key")]
    udp: Option<SocketAddr>,
    /// File with the key of the programs on the network: 64 hexadecimal digits, readable by its owner only
    #[arg(long, value_name = "FILE", requires = "udp")]
    key: Option<PathBuf>,
    #[command(flatten)]
    common: CommonArgs,
}

impl GatewayCommand {
    /// Serves a socket until it is interrupted.
    ///
    /// # Errors
    /// The instance belongs to another user (exit code 77), another gateway serves it (75), the key is unsuitable (65, 77), or the
    /// bus refuses.
    pub fn execute(&self) -> Result<Exit, Failure> {
        let Self::Run(GatewayArgs { udp, key, common }) = self;
        // Read with the caller's rights.
        let key = key.as_deref().map(GatewayKey::read).transpose()?;
        let config = Config::load(&common.config, &common.settings()?)?;
        let stop = stop_on_signals()?;
        let paths = instance_paths(&config)?;
        paths.become_owner()?;
        // Closed after the socket: its directory is removed only if it is empty.
        let bus = Bus::open(&paths)?;
        let socket: Box<dyn GatewaySocket> = match udp.zip(key) {
            Some((address, key)) => Box::new(UdpGateway::bind(address, key)?),
            None => Box::new(UnixGateway::bind(&paths.directory().join(SOCKET))?),
        };
        say(&format!("oqtal: gateway at {}; Ctrl-C ends", socket.address()));
        tell_writer(&bus);
        let executor = Executor::new(&paths, &*socket, &stop);
        std::thread::scope(|threads| {
            let gateway = Gateway {
                bus: &bus,
                references: None,
                holder: StreamHolder::default(),
                longest: longest_validity(&config),
                requests: executor.start(threads),
                whole_at: Time::now(),
                configured_at: Time::UNSET,
            };
            gateway.run(&*socket, &stop)
        })?;
        Ok(Exit::Ok)
    }
}

/// Ports of the gateway.
struct Gateway<'a> {
    bus: &'a Bus,
    /// Opened with the first reference: the topic has one writer.
    references: Option<Writer<ReferenceV1>>,
    /// Program whose references are followed.
    holder: StreamHolder,
    /// Longest validity of a reference for an instance without a daemon's configuration.
    longest: Span,
    requests: RequestQueues<'a>,
    /// Instant at which the files of the instance were last found.
    whole_at: Time,
    /// Instant at which the daemon's configuration was last read.
    configured_at: Time,
}

impl Gateway<'_> {
    /// Serves `socket` until `stop` is set.
    ///
    /// # Errors
    /// Files of the instance were lost, or the operating system refuses (exit code 71).
    fn run(mut self, socket: &dyn GatewaySocket, stop: &StopFlag) -> Result<(), Failure> {
        let mut datagram = vec![0; protocol::LONGEST_DATAGRAM + 1];
        let (mut running_at, mut held_since) = (Time::now(), None);
        while !stop.is_set() {
            self.require_files()?;
            let now = Time::now();
            if now.since(running_at) > LONGEST_TURN {
                held_since.get_or_insert(running_at);
            }
            running_at = now;
            match socket.receive(&mut datagram)? {
                Incoming::Empty => {
                    held_since = None;
                    socket.wait();
                }
                Incoming::Ignored => {}
                Incoming::Datagram(Received { content, sender }) => {
                    let sent_after = held_since.unwrap_or(now);
                    let served = self.serve(&datagram[content], sender, (sent_after, now));
                    if let Err((sender, reason)) = served {
                        socket.reply(&sender, &GatewayReply::refused(reason).to_json());
                    }
                }
            }
        }
        Ok(())
    }

    /// Fails if the instance's files have been lost for longer than a landing: other processes use those of its next run.
    fn require_files(&mut self) -> Result<(), Failure> {
        let now = Time::now();
        if !self.bus.is_lost() {
            self.whole_at = now;
        }
        if now.since(self.whole_at) < LONGEST_LOSS {
            return Ok(());
        }
        let directory = self.bus.paths().directory();
        let reason =
            "files of the instance were removed; start its processes and the gateway again";
        Err(Failure::new(Exit::System, format!("{}: {reason}", directory.display())))
    }

    /// Publishes a reference, or passes a request to the thread that replies; the sender and the reason of a refusal otherwise. The
    /// datagram was sent between the two instants.
    fn serve(
        &mut self,
        datagram: &[u8],
        sender: Sender,
        (after, now): (Time, Time),
    ) -> Result<(), (Sender, String)> {
        match protocol::parse(datagram, after) {
            Ok(Content::Reference(reference)) => {
                self.follow(*reference, &sender, now).map_err(|reason| (sender, reason))
            }
            Ok(Content::Request { command, arguments }) => {
                self.requests.push((&command, arguments), sender, (after, now))
            }
            Err(reason) => Err((sender, reason)),
        }
    }

    fn follow(&mut self, reference: ReferenceV1, sender: &Sender, now: Time) -> Result<(), String> {
        if !self.holder.is_busy(now) && now.since(self.configured_at) > CONFIG_PERIOD {
            self.configured_at = now;
            // The daemon may have been started again, with another configuration.
            let of_daemon = daemon_config(self.bus.paths());
            self.holder.longest = of_daemon.as_ref().map_or(self.longest, longest_validity);
        }
        if !self.holder.admit(sender, reference.valid_until, now)? {
            return Ok(());
        }
        self.publish(reference).map_err(|failure| failure.message)
    }

    fn publish(&mut self, reference: ReferenceV1) -> Result<(), Failure> {
        let writer = match &mut self.references {
            Some(writer) => writer,
            none => none.insert(self.bus.writer(&REFERENCE)?),
        };
        writer.send(0, Stamps::default(), reference)?;
        Ok(())
    }
}

/// Prints which other process is the writer of references, because those of programs at this gateway are refused.
fn tell_writer(bus: &Bus) {
    if let Ok(Some(writer)) = bus.holder(&REFERENCE) {
        say(&format!(
            "oqtal: references are refused here until {writer} ends, which publishes its own"
        ));
    }
}

/// Longest validity of a reference by `config`.
fn longest_validity(config: &Config) -> Span {
    Span::from_seconds(config.reference.longest_validity_ms * 1e-3)
}
