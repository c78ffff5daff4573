//! `oqtal gateway run`: references and requests of programs in any language.
//!
//! The protocol is in docs/references.md. Programs on this machine use `gateway.sock` in the directory of the instance; its mode
//! admits the owner of the instance and root only, and the kernel states the sender of each datagram. Programs on the network need
//! a key.

mod protocol;
mod socket;
mod udp;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use clap::{Args, Subcommand};
use oqtal_bus::bus::Bus;
use oqtal_bus::message::{ReferenceV1, Stamps};
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::port::Writer;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::REFERENCE;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_config::Config;
use oqtal_operator::{AddressedInstance, CtlRequest};
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths, stop_on_signals};
use oqtal_runtime::program::say;
use oqtal_runtime::stop::StopFlag;

use protocol::{Content, GatewayReply};
use socket::{GatewaySocket, Received, Sender, UnixGateway};
use udp::{GatewayKey, UdpGateway};

/// Name of the socket in the directory of the instance.
const SOCKET: &str = "gateway.sock";
/// Number of requests, and of stops, that may wait for their execution.
const QUEUE: usize = 64;
/// Time after the loss of files for which programs can still reach the processes that land.
const LONGEST_LOSS: Span = Span::from_millis(10_000);

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
        let stop_count = AtomicU64::new(0);
        std::thread::scope(|threads| {
            let (socket, paths, stop_count, ends) = (&*socket, &paths, &stop_count, &stop);
            let execute_all = move |requests: Receiver<GatewayRequest>| {
                // At the end, requests still in the queue are dropped, except stops.
                let due = |it: &GatewayRequest| it.command == CtlRequest::Stop || !ends.is_set();
                requests
                    .into_iter()
                    .filter(due)
                    .for_each(|it| it.execute(paths, socket, stop_count));
            };
            let [(stops, to_stop), (others, to_answer)] = [(); 2].map(|()| sync_channel(QUEUE));
            // A request waits for a daemon that hangs: a stop does not wait for it.
            threads.spawn(move || execute_all(to_stop));
            threads.spawn(move || execute_all(to_answer));
            let references = None;
            let whole_at = Time::now();
            let longest = Span::from_seconds(config.reference.longest_validity_ms * 1e-3);
            let holder = StreamHolder { longest, ..StreamHolder::default() };
            let gateway =
                Gateway { bus: &bus, references, holder, stops, others, stop_count, whole_at };
            gateway.run(socket, &stop)
        })?;
        Ok(Exit::Ok)
    }
}

/// A request of a program.
struct GatewayRequest {
    command: CtlRequest,
    arguments: Vec<String>,
    sender: Sender,
    /// Number of stops that were requested before it \[-\].
    stops_before: u64,
}

impl GatewayRequest {
    /// Executes the request to the instance at `paths`, and replies. A request that waited while a stop was requested is refused: an
    /// `arm` must not take effect after it.
    fn execute(self, paths: &InstancePaths, socket: &dyn GatewaySocket, stop_count: &AtomicU64) {
        let Self { command, arguments, sender, stops_before } = self;
        if command != CtlRequest::Stop && stop_count.load(Ordering::Acquire) != stops_before {
            let reason = "a stop was requested after it".to_owned();
            socket.reply(&sender, &GatewayReply::refused(reason).to_json());
            return;
        }
        let address = AddressedInstance::at(paths);
        let sign = |request| sender.sign(request);
        let result = oqtal_operator::execute(&address, (command, &arguments), None, sign);
        let refused = |failure: Failure| GatewayReply::refused(failure.message);
        socket.reply(&sender, &result.map_or_else(refused, GatewayReply::done).to_json());
    }
}

/// Ports of the gateway.
struct Gateway<'a> {
    bus: &'a Bus,
    /// Opened with the first reference: the topic has one writer.
    references: Option<Writer<ReferenceV1>>,
    /// Program whose references are followed.
    holder: StreamHolder,
    stops: SyncSender<GatewayRequest>,
    others: SyncSender<GatewayRequest>,
    /// Number of stops requested so far.
    stop_count: &'a AtomicU64,
    /// Instant at which the files of the instance were last found.
    whole_at: Time,
}

/// Program whose references are followed: of two at a time the second one is refused.
#[derive(Debug, Default)]
struct StreamHolder {
    /// Process; 0: a program of the network.
    process: u32,
    /// Program, or its network address.
    program: String,
    /// End of the validity of its newest reference.
    until: Time,
    /// Longest time for which one reference keeps other programs out.
    longest: Span,
}

impl StreamHolder {
    /// Admits a reference of `sender` that is valid until `valid_until`.
    ///
    /// # Errors
    /// References of another program are in force.
    fn admit(&mut self, sender: &Sender, valid_until: Time, now: Time) -> Result<(), String> {
        let Self { process, program, .. } = &*self;
        let is_same = *process == sender.process && (*process != 0 || *program == sender.program);
        if !is_same && now < self.until {
            let place = if *process == 0 { String::new() } else { format!(", process {process}") };
            return Err(format!(
                "`{program}`{place} sends references already; end it, or wait until its last reference expires"
            ));
        }
        if !is_same {
            (self.process, self.program) = (sender.process, sender.program.clone());
        }
        self.until = valid_until.min(now + self.longest);
        Ok(())
    }
}

impl Gateway<'_> {
    /// Serves `socket` until `stop` is set.
    ///
    /// # Errors
    /// Files of the instance were lost, or the operating system refuses (exit code 71).
    fn run(mut self, socket: &dyn GatewaySocket, stop: &StopFlag) -> Result<(), Failure> {
        let mut datagram = vec![0; protocol::LONGEST_DATAGRAM + 1];
        while !stop.is_set() {
            self.require_files()?;
            let Some(Received { content, sender }) = socket.receive(&mut datagram)? else {
                continue;
            };
            if let Err((sender, reason)) = self.serve(&datagram[content], sender) {
                socket.reply(&sender, &GatewayReply::refused(reason).to_json());
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

    /// Executes a datagram, or passes it to the thread that replies; the sender and the reason of a refusal otherwise.
    fn serve(&mut self, datagram: &[u8], sender: Sender) -> Result<(), (Sender, String)> {
        let content = match protocol::parse(datagram, Time::now()) {
            Ok(content) => content,
            Err(reason) => return Err((sender, reason)),
        };
        let (command, arguments) = match content {
            Content::Reference(reference) => {
                let admitted = self.holder.admit(&sender, reference.valid_until, Time::now());
                let published = admitted
                    .and_then(|()| self.publish(*reference).map_err(|failure| failure.message));
                return published.map_err(|reason| (sender, reason));
            }
            Content::Request { command, arguments } => (command, arguments),
        };
        let command = match CtlRequest::named(&command) {
            Ok(command) => command,
            Err(reason) => return Err((sender, reason)),
        };
        let is_stop = command == CtlRequest::Stop;
        let stops_before = self.stop_count.fetch_add(u64::from(is_stop), Ordering::AcqRel);
        let thread = if is_stop { &self.stops } else { &self.others };
        let request = GatewayRequest { command, arguments, sender, stops_before };
        thread.try_send(request).map_err(|error| {
            let (TrySendError::Full(request) | TrySendError::Disconnected(request)) = error;
            (request.sender, format!("{QUEUE} requests wait for the daemon already"))
        })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_references_of_a_second_program_are_refused_until_those_of_the_first_expire() {
        let mut holder =
            StreamHolder { longest: Span::from_millis(500), ..StreamHolder::default() };
        let [first, second] =
            [5001, 5002].map(|port| Sender::network(([10, 0, 0, 7], port).into(), 1));
        let at = |millis| Time::VIRTUAL_START + Span::from_millis(millis);
        assert_eq!(holder.admit(&first, at(100), at(0)), Ok(()));
        let refusal = holder.admit(&second, at(150), at(50)).unwrap_err();
        assert!(refusal.starts_with("`10.0.0.7:5001` sends references already"), "{refusal}");
        assert_eq!(holder.admit(&first, at(150), at(50)), Ok(()));
        assert_eq!(holder.admit(&second, at(9000), at(150)), Ok(()));
        assert!(holder.admit(&first, at(700), at(600)).is_err());
        assert_eq!(holder.admit(&first, at(700), at(650)), Ok(()), "at most `longest`");
    }
}
