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

use clap::{Args, Subcommand, ValueEnum};
use oqtal_bus::bus::Bus;
use oqtal_bus::message::{ReferenceV1, Stamps};
use oqtal_bus::port::Writer;
use oqtal_bus::time::Time;
use oqtal_bus::topic::REFERENCE;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_config::Config;
use oqtal_operator::{AddressedInstance, CtlRequest};
use oqtal_runtime::process::{CommonArgs, Exit, Failure, instance_paths, stop_on_signals};
use oqtal_runtime::program::say;

use protocol::{Content, GatewayReply};
use socket::{GatewaySocket, Received, Sender, UnixGateway};
use udp::{GatewayKey, UdpGateway};

/// Name of the socket in the directory of the instance.
const SOCKET: &str = "gateway.sock";

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
        let bus = Bus::open(&paths)?;
        let mut socket: Box<dyn GatewaySocket> = match udp.zip(key) {
            Some((address, key)) => Box::new(UdpGateway::bind(address, key)?),
            None => Box::new(UnixGateway::bind(&paths.directory().join(SOCKET))?),
        };
        say(&format!("oqtal: gateway at {}; Ctrl-C ends", socket.address()));
        let mut gateway = Gateway { bus, references: None };
        let mut datagram = vec![0; protocol::LONGEST_DATAGRAM];
        while !stop.is_set() {
            let Some(Received { content, sender }) = socket.receive(&mut datagram)? else {
                continue;
            };
            let reply = gateway.serve(&datagram[content], &sender);
            if let Some(reply) = reply {
                socket.reply(&sender, &reply.to_json());
            }
        }
        Ok(Exit::Ok)
    }
}

/// Ports of the gateway.
struct Gateway {
    bus: Bus,
    /// Opened with the first reference: the topic has one writer.
    references: Option<Writer<ReferenceV1>>,
}

impl Gateway {
    /// Executes a datagram; `None` for a reference that was passed on, which has no reply.
    fn serve(&mut self, datagram: &[u8], sender: &Sender) -> Option<GatewayReply> {
        let content = match protocol::parse(datagram, Time::now()) {
            Ok(content) => content,
            Err(reason) => return Some(GatewayReply::refused(reason)),
        };
        let result = match content {
            Content::Reference(reference) => match self.publish(*reference) {
                Ok(()) => return None,
                Err(failure) => Err(failure),
            },
            Content::Request { command, arguments } => self.request(&command, &arguments, sender),
        };
        Some(
            result
                .map_or_else(|failure| GatewayReply::refused(failure.message), GatewayReply::done),
        )
    }

    fn publish(&mut self, reference: ReferenceV1) -> Result<(), Failure> {
        let writer = match &mut self.references {
            Some(writer) => writer,
            none => none.insert(self.bus.writer(&REFERENCE)?),
        };
        writer.send(0, Stamps::default(), reference)?;
        Ok(())
    }

    fn request(
        &self,
        command: &str,
        arguments: &[String],
        sender: &Sender,
    ) -> Result<String, Failure> {
        let known = CtlRequest::from_str(command, false);
        let command = known.map_err(|reason| Failure::new(Exit::Usage, reason))?;
        let address = AddressedInstance::at(self.bus.paths());
        let sign = |request| sender.sign(request);
        oqtal_operator::execute(&address, (command, arguments), None, sign)
    }
}
