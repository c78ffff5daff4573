//! iceoryx2 in its stock configuration: a publish-subscribe service, an event, and a thread that waits on its listener.

use std::fmt::Debug;
use std::fs;
use std::io;

use iceoryx2::node::Node;
use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::prelude::{NodeBuilder, ServiceName, SignalHandlingMode, ipc};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use oqtal_bus::paths::InstancePaths;

use super::parcel::{Parcel, ParcelReceiver, ParcelSender};

const NAME: &str = "parcel";

/// The services, with the node that holds them.
type Services = (
    Node<ipc::Service>,
    publish_subscribe::PortFactory<ipc::Service, Parcel, ()>,
    event::PortFactory<ipc::Service>,
);

/// Sender beside `place`.
///
/// # Errors
/// iceoryx2 refuses.
pub fn sender(place: &InstancePaths) -> io::Result<ParcelSender> {
    let (node, data, event) = services(place)?;
    let publisher = data.publisher_builder().create().map_err(failed("publishing"))?;
    let notifier = event.notifier_builder().create().map_err(failed("notifying"))?;
    Ok(Box::new(move |parcel| {
        let _node = &node;
        let sample = publisher.loan_uninit().map_err(failed("loaning"))?;
        sample.write_payload(*parcel).send().map_err(failed("sending"))?;
        notifier.notify().map(drop).map_err(failed("notifying"))
    }))
}

/// Receiver beside `place`.
///
/// # Errors
/// iceoryx2 refuses.
pub fn receiver(place: &InstancePaths) -> io::Result<ParcelReceiver> {
    let (node, data, event) = services(place)?;
    let subscriber = data.subscriber_builder().create().map_err(failed("subscribing"))?;
    let listener = event.listener_builder().create().map_err(failed("listening"))?;
    Ok(Box::new(move || {
        let _node = &node;
        // One wake-up may represent several messages.
        loop {
            if let Some(sample) = subscriber.receive().map_err(failed("receiving"))? {
                return Ok(*sample.payload());
            }
            match listener.blocking_wait(|_| {}) {
                Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
                Err(error) => return Err(failed("waiting")(error)),
            }
        }
    }))
}

/// Paths of the bare services, beside the instance `latency-PID-NUMBER` at `place`, without anything shared with the bus. The
/// name is short because iceoryx2 uses it twice in the path of a socket, which the kernel limits to 107 bytes.
fn beside(place: &InstancePaths) -> InstancePaths {
    let process = place.instance.split('-').nth(1).unwrap_or_default();
    let instance = format!("b-{process}");
    InstancePaths { instance, ..place.clone() }
}

/// Removes the files of the services beside `place`, whose processes have ended or were killed.
pub fn remove(place: &InstancePaths) {
    // A new node removes what dead nodes left. A directory that cannot be removed occupies a few kilobytes.
    drop(services(place));
    let _ = fs::remove_dir_all(beside(place).directory());
}

fn services(place: &InstancePaths) -> io::Result<Services> {
    let config = beside(place).prepare().map_err(io::Error::other)?;
    let node = NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .map_err(failed("joining"))?;
    let name = ServiceName::new(NAME).map_err(failed("naming"))?;
    let data = node.service_builder(&name).publish_subscribe::<Parcel>().open_or_create();
    let event = node.service_builder(&name).event().open_or_create();
    let (data, event) = (data.map_err(failed("opening"))?, event.map_err(failed("opening"))?);
    Ok((node, data, event))
}

fn failed<E: Debug>(what: &'static str) -> impl Fn(E) -> io::Error {
    move |error| io::Error::other(format!("{what} failed: {error:?}"))
}
