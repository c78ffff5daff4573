//! iceoryx2 in its stock configuration: a publish-subscribe service, an event, and a thread that waits on its listener.

use iceoryx2::node::Node;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{NodeBuilder, ServiceName, SignalHandlingMode, ipc};
use iceoryx2::service::port_factory::{event, publish_subscribe};
use oqtal_bus::paths::InstancePaths;
use oqtal_runtime::process::Failure;

use super::mechanism::{Mechanism, system};
use super::parcel::{Parcel, ParcelReceiver, ParcelSender};

const NAME: &str = "parcel";

/// The sending end.
#[derive(Debug)]
pub struct IceoryxSender {
    publisher: Publisher<ipc::Service, Parcel, ()>,
    notifier: Notifier<ipc::Service>,
    _node: Node<ipc::Service>,
}

impl IceoryxSender {
    /// The sending end at `place`.
    ///
    /// # Errors
    /// iceoryx2 refuses.
    pub fn open(place: &InstancePaths) -> Result<Self, Failure> {
        let node = node(place)?;
        let (data, event) = services(&node)?;
        let publisher = data.publisher_builder().create().map_err(|e| failed("publishing", &e))?;
        let notifier = event.notifier_builder().create().map_err(|e| failed("notifying", &e))?;
        Ok(Self { publisher, notifier, _node: node })
    }
}

impl ParcelSender for IceoryxSender {
    fn send(&mut self, parcel: &Parcel) -> Result<(), Failure> {
        let sample = self.publisher.loan_uninit().map_err(|e| failed("loaning", &e))?;
        sample.write_payload(*parcel).send().map_err(|e| failed("sending", &e))?;
        self.notifier.notify().map(drop).map_err(|e| failed("notifying", &e))
    }
}

/// The receiving end.
#[derive(Debug)]
pub struct IceoryxReceiver {
    subscriber: Subscriber<ipc::Service, Parcel, ()>,
    listener: Listener<ipc::Service>,
    _node: Node<ipc::Service>,
}

impl IceoryxReceiver {
    /// The receiving end at `place`.
    ///
    /// # Errors
    /// iceoryx2 refuses.
    pub fn create(place: &InstancePaths) -> Result<Self, Failure> {
        let node = node(place)?;
        let (data, event) = services(&node)?;
        let subscriber =
            data.subscriber_builder().create().map_err(|e| failed("subscribing", &e))?;
        let listener = event.listener_builder().create().map_err(|e| failed("listening", &e))?;
        Ok(Self { subscriber, listener, _node: node })
    }
}

impl ParcelReceiver for IceoryxReceiver {
    fn receive(&mut self) -> Result<Parcel, Failure> {
        // One wake-up may stand for several messages.
        loop {
            if let Some(sample) = self.subscriber.receive().map_err(|e| failed("taking", &e))? {
                return Ok(*sample.payload());
            }
            match self.listener.blocking_wait(|_| {}) {
                Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
                Err(error) => return Err(failed("waiting", &error)),
            }
        }
    }
}

type Services =
    (publish_subscribe::PortFactory<ipc::Service, Parcel, ()>, event::PortFactory<ipc::Service>);

/// Paths of the bare services, beside the instance `latency-PID-NUMBER` at `place`: nothing of the bus is shared with them. The
/// name is short because iceoryx2 puts it twice into the path of a socket, which the kernel limits to 107 bytes.
#[must_use]
pub fn beside(place: &InstancePaths) -> InstancePaths {
    let process = place.instance.split('-').nth(1).unwrap_or_default();
    let instance = format!("b-{process}");
    InstancePaths { instance, ..place.clone() }
}

fn node(place: &InstancePaths) -> Result<Node<ipc::Service>, Failure> {
    let place = beside(place);
    let config = place.prepare()?;
    let created = NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>();
    created.map_err(|error| failed("joining", &error))
}

fn services(node: &Node<ipc::Service>) -> Result<Services, Failure> {
    let name = ServiceName::new(NAME).map_err(|e| failed("naming", &e))?;
    let data = node.service_builder(&name).publish_subscribe::<Parcel>().open_or_create();
    let event = node.service_builder(&name).event().open_or_create();
    Ok((data.map_err(|e| failed("opening", &e))?, event.map_err(|e| failed("opening", &e))?))
}

fn failed(what: &str, error: &dyn std::fmt::Debug) -> Failure {
    system(Mechanism::Iceoryx2Listener, what, &format!("{error:?}"))
}
