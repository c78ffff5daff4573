//! Processes at the two ends of a mechanism.

use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use oqtal_bus::time::Time;
use oqtal_bus::topic::Role;
use oqtal_runtime::process::{Exit, Failure, ProcessContext};
use rustix::event::EventfdFlags;
use rustix::process::Signal;

use super::mechanism::Mechanism;
use super::parcel::{Parcel, ParcelReceiver, ParcelSender};
use super::{iceoryx, shared, sockets};
use crate::latency::record::Record;

/// Failure of an operation of `mechanism`.
pub fn failed(mechanism: Mechanism, what: &str, error: &io::Error) -> Failure {
    Failure::new(Exit::System, format!("{}: {what} failed: {error}", mechanism.name()))
}

/// Opens the sender of `mechanism`; the receiver exists already.
///
/// # Errors
/// The operating system refuses.
pub fn open_sender(
    mechanism: Mechanism,
    context: &ProcessContext,
) -> Result<ParcelSender, Failure> {
    let file = file(context, mechanism, "port");
    let opened = match mechanism {
        Mechanism::Futex => shared::futex_sender(&file),
        Mechanism::Eventfd => shared::eventfd_sender(&file),
        Mechanism::UnixDatagram => sockets::unix_sender(&file),
        Mechanism::UdpSocket => sockets::udp_sender(&file),
        Mechanism::Iceoryx2Listener => iceoryx::sender(&context.paths()?),
    };
    opened.map_err(|error| failed(mechanism, "opening", &error))
}

fn open_receiver(
    mechanism: Mechanism,
    context: &ProcessContext,
) -> Result<ParcelReceiver, Failure> {
    let file = file(context, mechanism, "port");
    let opened = match mechanism {
        Mechanism::Futex => shared::futex_receiver(&file),
        Mechanism::Eventfd => shared::eventfd_receiver(&file),
        Mechanism::UnixDatagram => sockets::unix_receiver(&file),
        Mechanism::UdpSocket => sockets::udp_receiver(&file),
        Mechanism::Iceoryx2Listener => iceoryx::receiver(&context.paths()?),
    };
    opened.map_err(|error| failed(mechanism, "opening", &error))
}

/// Directory for files exchanged by the measuring processes of an instance, in memory, so that no process waits for a disk. It is
/// created for each measurement, with an unpredictable name and for this user only.
pub fn directory(instance: &str) -> PathBuf {
    Path::new("/dev/shm").join(format!("oqtal-{instance}"))
}

/// A file of a mechanism: `port`, `ready` or `record`.
pub fn file(context: &ProcessContext, mechanism: Mechanism, kind: &str) -> PathBuf {
    directory(&context.config.instance.name).join(format!("{}.{kind}", mechanism.name()))
}

/// Counter of [`Mechanism::Eventfd`]. It has no name, so sender and receiver are started with it as standard input.
///
/// # Errors
/// The operating system refuses.
pub fn counter() -> Result<OwnedFd, Failure> {
    rustix::event::eventfd(0, EventfdFlags::CLOEXEC)
        .map_err(|error| failed(Mechanism::Eventfd, "opening", &error.into()))
}

/// Receives messages of `mechanism` until the last one, and saves the latency of each.
///
/// # Errors
/// The operating system refuses.
pub fn receive_all(context: &ProcessContext, mechanism: Mechanism) -> Result<(), Failure> {
    // SIGKILL: the process may be asleep in the kernel when its parent dies, and would not notice a request to end.
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|error| failed(mechanism, "setting the parent-death signal", &error.into()))?;
    let mut record = Record::with_room();
    let mut receive = open_receiver(mechanism, context)?;
    context.enter_realtime_as(Role::Daemon);
    Record::default().save(&file(context, mechanism, "ready"))?;
    loop {
        let parcel = receive().map_err(|error| failed(mechanism, "receiving", &error))?;
        let received_at = Time::now();
        if parcel == Parcel::LAST {
            return record.save(&file(context, mechanism, "record"));
        }
        record.add(parcel.sent_at, received_at);
    }
}
