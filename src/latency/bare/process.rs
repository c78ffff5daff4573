//! The processes at the ends of a mechanism.

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use oqtal_bus::time::Time;
use oqtal_runtime::process::{Failure, Job, ProcessContext};
use rustix::event::EventfdFlags;
use rustix::process::Signal;

use super::eventfd::Eventfd;
use super::futex::Futex;
use super::iceoryx::{IceoryxReceiver, IceoryxSender};
use super::mechanism::{Mechanism, system};
use super::parcel::{Parcel, ParcelReceiver, ParcelSender};
use super::udp_socket::UdpEnd;
use super::unix_datagram::{DatagramReceiver, DatagramSender};
use crate::latency::record::Record;

/// The work of the process that receives the messages of `mechanism`.
#[must_use]
pub fn receiver_job(mechanism: Mechanism) -> Job {
    match mechanism {
        Mechanism::Futex => |context| receive_all(context, Mechanism::Futex),
        Mechanism::Eventfd => |context| receive_all(context, Mechanism::Eventfd),
        Mechanism::UnixDatagram => |context| receive_all(context, Mechanism::UnixDatagram),
        Mechanism::UdpSocket => |context| receive_all(context, Mechanism::UdpSocket),
        Mechanism::Iceoryx2Listener => |context| receive_all(context, Mechanism::Iceoryx2Listener),
    }
}

/// Opens the sending end of `mechanism`; the receiving end exists.
///
/// # Errors
/// The operating system refuses.
pub fn open_sender(
    mechanism: Mechanism,
    context: &ProcessContext,
) -> Result<Box<dyn ParcelSender>, Failure> {
    let file = file(context, mechanism, "port");
    Ok(match mechanism {
        Mechanism::Futex => Box::new(Futex::open(&file)?),
        Mechanism::Eventfd => Box::new(Eventfd::open(&file)?),
        Mechanism::UnixDatagram => Box::new(DatagramSender::open(&file)?),
        Mechanism::UdpSocket => Box::new(UdpEnd::open(&file)?),
        Mechanism::Iceoryx2Listener => Box::new(IceoryxSender::open(&context.paths()?)?),
    })
}

fn open_receiver(
    mechanism: Mechanism,
    context: &ProcessContext,
) -> Result<Box<dyn ParcelReceiver>, Failure> {
    let file = file(context, mechanism, "port");
    Ok(match mechanism {
        Mechanism::Futex => Box::new(Futex::create(&file)?),
        Mechanism::Eventfd => Box::new(Eventfd::create(&file)?),
        Mechanism::UnixDatagram => Box::new(DatagramReceiver::create(&file)?),
        Mechanism::UdpSocket => Box::new(UdpEnd::create(&file)?),
        Mechanism::Iceoryx2Listener => Box::new(IceoryxReceiver::create(&context.paths()?)?),
    })
}

/// Directory in which the measuring processes of an instance exchange files: in memory, so that no disk is waited for. It is made new
/// for each measurement, with a name that nobody can guess and for this user only.
#[must_use]
pub fn directory(instance: &str) -> PathBuf {
    Path::new("/dev/shm").join(format!("oqtal-{instance}"))
}

/// A file of a mechanism: `port`, `ready` or `record`.
#[must_use]
pub fn file(context: &ProcessContext, mechanism: Mechanism, kind: &str) -> PathBuf {
    directory(&context.config.instance.name).join(format!("{}.{kind}", mechanism.name()))
}

/// The counter of [`Mechanism::Eventfd`]. Sender and receiver are started with it as standard input, since it has no name.
///
/// # Errors
/// The operating system refuses.
pub fn counter() -> Result<OwnedFd, Failure> {
    rustix::event::eventfd(0, EventfdFlags::CLOEXEC)
        .map_err(|error| system(Mechanism::Eventfd, "opening", &error))
}

/// Receives messages until the last one, and saves the latency of each.
fn receive_all(context: &ProcessContext, mechanism: Mechanism) -> Result<(), Failure> {
    // SIGKILL: the process may be asleep in the kernel when its parent dies, and would not notice a request to end.
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))
        .map_err(|error| system(mechanism, "binding to the parent's life", &error))?;
    let mut record = Record::with_room();
    let mut receiver = open_receiver(mechanism, context)?;
    context.enter_realtime();
    Record::default().save(&file(context, mechanism, "ready"))?;
    loop {
        let parcel = receiver.receive()?;
        let received_at = Time::now();
        if parcel == Parcel::LAST {
            return record.save(&file(context, mechanism, "record"));
        }
        record.add(parcel.sent_at, received_at);
    }
}
