//! Stand-ins as processes: `oqtal latency-part NAME run`.

use std::process::ExitCode;

use clap::{Args, ValueEnum};
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Job, ProcessCommand, execute};

use super::bare::{Mechanism, receive_all};
use super::{camera, sleep, vehicle};

/// Word of the command line that starts a stand-in.
pub const COMMAND: &str = "latency-part";

/// Arguments of `oqtal latency-part`.
#[derive(Args, Clone, Debug)]
pub struct PartArgs {
    /// The process
    #[arg(value_enum)]
    part: Part,
    #[command(subcommand)]
    command: ProcessCommand,
}

/// A measuring process.
#[derive(Clone, Copy, Debug, ValueEnum)]
#[value(rename_all = "snake_case")]
enum Part {
    /// Publish poses and send by each bare mechanism
    Camera,
    /// Receive commands
    Vehicle,
    /// Wake every millisecond
    Periodic,
    /// Receive by a futex
    Futex,
    /// Receive by an eventfd
    Eventfd,
    /// Receive by a Unix datagram socket
    UnixDatagram,
    /// Receive by a UDP socket
    UdpSocket,
    /// Receive by a listener of iceoryx2
    Iceoryx2Listener,
}

impl PartArgs {
    /// Runs the process with the settings of the process that it replaces. Returns when a stop is requested.
    pub fn execute(&self) -> ExitCode {
        // Receivers are not listed as processes that obey operators.
        let (role, job): (Role, Job) = match self.part {
            Part::Camera => (Role::Mocap, camera::run),
            Part::Vehicle => (Role::Plant, vehicle::run),
            Part::Periodic => (Role::Recorder, sleep::run),
            Part::Futex => (Role::Recorder, |context| receive_all(context, Mechanism::Futex)),
            Part::Eventfd => (Role::Recorder, |context| receive_all(context, Mechanism::Eventfd)),
            Part::UnixDatagram => {
                (Role::Recorder, |context| receive_all(context, Mechanism::UnixDatagram))
            }
            Part::UdpSocket => {
                (Role::Recorder, |context| receive_all(context, Mechanism::UdpSocket))
            }
            Part::Iceoryx2Listener => {
                (Role::Recorder, |context| receive_all(context, Mechanism::Iceoryx2Listener))
            }
        };
        // The process that starts this one has checked the configuration.
        execute(role, &self.command, job, |_| Ok(()))
    }
}
