//! The stand-ins as processes: `oqtal latency-part NAME run`.

use std::process::ExitCode;

use clap::Subcommand;
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Job, ProcessCommand, execute};

use super::bare::{Mechanism, receiver_job};
use super::{camera, sleep, vehicle};

/// Word of the command line that starts a stand-in.
pub const COMMAND: &str = "latency-part";

/// The measuring processes; each has the settings of the process that it replaces.
#[derive(Subcommand, Clone, Debug)]
#[command(rename_all = "snake_case")]
pub enum Part {
    /// Publish poses and send by each bare mechanism
    #[command(subcommand)]
    Camera(ProcessCommand),
    /// Receives commands
    #[command(subcommand)]
    Vehicle(ProcessCommand),
    /// Wakes every millisecond
    #[command(subcommand)]
    Periodic(ProcessCommand),
    /// Receives by a futex
    #[command(subcommand)]
    Futex(ProcessCommand),
    /// Receives by an eventfd
    #[command(subcommand)]
    Eventfd(ProcessCommand),
    /// Receives by a Unix datagram socket
    #[command(subcommand)]
    UnixDatagram(ProcessCommand),
    /// Receives by a UDP socket
    #[command(subcommand)]
    UdpSocket(ProcessCommand),
    /// Receives by a listener of iceoryx2
    #[command(subcommand)]
    Iceoryx2Listener(ProcessCommand),
}

impl Part {
    /// Runs the stand-in until asked to stop.
    #[must_use]
    pub fn execute(&self) -> ExitCode {
        let (role, command, job): (Role, &ProcessCommand, Job) = match self {
            Self::Camera(command) => (Role::Mocap, command, camera::run),
            Self::Vehicle(command) => (Role::Plant, command, vehicle::run),
            Self::Periodic(command) => (Role::Daemon, command, sleep::run),
            Self::Futex(command) => (Role::Daemon, command, receiver_job(Mechanism::Futex)),
            Self::Eventfd(command) => (Role::Daemon, command, receiver_job(Mechanism::Eventfd)),
            Self::UnixDatagram(command) => {
                (Role::Daemon, command, receiver_job(Mechanism::UnixDatagram))
            }
            Self::UdpSocket(command) => (Role::Daemon, command, receiver_job(Mechanism::UdpSocket)),
            Self::Iceoryx2Listener(command) => {
                (Role::Daemon, command, receiver_job(Mechanism::Iceoryx2Listener))
            }
        };
        // Its configuration was checked by the process that starts it.
        execute(role, command, job, |_| Ok(()))
    }
}
