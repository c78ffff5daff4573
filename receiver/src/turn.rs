//! One turn of the receiver over its ports: read the sockets, publish the newest pose of each body. No call blocks or logs, and none
//! allocates while the connection is open.

use std::io;
use std::os::fd::{AsFd, OwnedFd};

use oqtal_bus::code::Cause;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, PoseV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::POSE;
use oqtal_bus::transport::{Publish, Transport};
use oqtal_runtime::health::Health;
use oqtal_runtime::turn::{Turn, TurnClock};
use rustix::event::epoll;

use crate::background::{ReceiverHandle, StreamPart};
use crate::definitions::BodyDefinitions;
use crate::note::ReceiverNote;
use crate::receiver::PoseReceiver;
use crate::stream::CameraStream;
use crate::watch::ReceiverWatch;

/// Period of the checks for keep-alive messages and silence, and of the looks at bodies and clock.
const UPKEEP_PERIOD: Span = Span::from_millis(100);

/// The sockets that wake the receiver.
#[derive(Debug)]
pub struct SocketSet(OwnedFd);

impl SocketSet {
    /// An empty set.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn new() -> io::Result<Self> {
        Ok(Self(epoll::create(epoll::CreateFlags::CLOEXEC)?))
    }

    /// A descriptor that is readable while a socket of the set is.
    ///
    /// # Errors
    /// The operating system refuses.
    pub fn descriptor(&self) -> io::Result<OwnedFd> {
        self.0.try_clone()
    }

    /// Adds the sockets of a stream. They leave the set when they are closed.
    fn add(&self, stream: &dyn CameraStream) -> io::Result<()> {
        for socket in stream.sockets().into_iter().flatten() {
            epoll::add(
                &self.0,
                socket.as_fd(),
                epoll::EventData::new_u64(0),
                epoll::EventFlags::IN,
            )?;
        }
        Ok(())
    }

    fn remove(&self, stream: &dyn CameraStream) {
        for socket in stream.sockets().into_iter().flatten() {
            // The socket is closed soon in any case.
            let _ = epoll::delete(&self.0, socket.as_fd());
        }
    }
}

/// The turn of the receiver; the bodies' poses go to a writer each, in the order of their routes.
#[derive(Debug)]
pub struct ReceiverTurn<T: Transport> {
    receiver: PoseReceiver,
    watch: ReceiverWatch,
    writers: Vec<T::Writer<PoseV1>>,
    sockets: SocketSet,
    stream: Option<Box<dyn CameraStream>>,
    handle: ReceiverHandle,
    health: Health,
    /// Time without a frame after which a connection is given up.
    silence: Span,
    connected_at: Time,
    next_upkeep: Time,
}

/// Parts of a [`ReceiverTurn`].
#[derive(Debug)]
pub struct TurnParts {
    /// Converter of frames to poses.
    pub receiver: PoseReceiver,
    /// The sockets that wake the loop.
    pub sockets: SocketSet,
    /// The hand-off to the background thread.
    pub handle: ReceiverHandle,
    /// Counts the frames.
    pub health: Health,
    /// Time without a frame after which a connection is given up.
    pub silence: Span,
}

impl<T: Transport> ReceiverTurn<T> {
    /// Opens a writer on each of `buses`, one for each body.
    ///
    /// # Errors
    /// Another process publishes poses on one of the instances, or the transport failed.
    pub fn open<'a>(buses: impl Iterator<Item = &'a T>, parts: TurnParts) -> Result<Self, BusError>
    where
        T: 'a,
    {
        let writers = buses.map(|bus| bus.writer(&POSE)).collect::<Result<Vec<_>, _>>()?;
        let TurnParts { receiver, sockets, handle, health, silence } = parts;
        let watch = ReceiverWatch::new(writers.len());
        Ok(Self {
            receiver,
            watch,
            writers,
            sockets,
            stream: None,
            handle,
            health,
            silence,
            connected_at: Time::UNSET,
            next_upkeep: Time::UNSET,
        })
    }

    /// Receives from `stream` from now on.
    pub fn set_stream(&mut self, stream: Box<dyn CameraStream>, now: Time) {
        self.connected_at = now;
        // A new connection may be to another server with another clock, frame count and bodies.
        self.receiver.forget();
        let added = self.sockets.add(&*stream);
        if let Some(before) = self.stream.replace(stream) {
            self.handle.reply(StreamPart::Stream(before));
        }
        if added.is_err() {
            self.give_up();
        }
    }

    /// Passes on something for the log.
    pub fn note(&mut self, note: ReceiverNote) {
        self.handle.note(note);
    }

    /// Health for the instance of the body of a route.
    pub fn health_of(&self, route: usize, now: Time) -> HealthV1 {
        let silent = now.since(self.receiver.arrived_at()) > self.silence;
        let cause = match self.watch.trouble(route) {
            _ if self.stream.is_none() => Cause::NoPose,
            // Some servers send frames only while they have a body: then a missing body is the reason for the silence.
            Cause::NoBody => Cause::NoBody,
            _ if silent => Cause::NoPose,
            trouble => trouble,
        };
        let unlogged = self.handle.dropped_notes();
        HealthV1 { cause: cause.code(), unlogged, ..HealthV1::default() }
    }

    /// Hands a lost stream to the background thread, which closes it and connects again.
    fn give_up(&mut self) {
        if let Some(stream) = self.stream.take() {
            self.sockets.remove(&*stream);
            let Self { watch, handle, .. } = self;
            watch.silence(&mut |note| handle.note(note));
            self.handle.reply(StreamPart::Stream(stream));
        }
    }

    /// Applies definitions that were read. Definitions of a closed stream are freed on the background thread.
    fn apply_definitions(&mut self, definitions: Box<BodyDefinitions>) {
        match &mut self.stream {
            Some(stream) => stream.apply_definitions(definitions),
            None => self.handle.reply(StreamPart::Definitions(definitions)),
        }
    }

    /// Sends keep-alive messages, closes a silent connection, and notes changes.
    fn keep_up(&mut self, now: Time) {
        if now < self.next_upkeep {
            return;
        }
        self.next_upkeep = now + UPKEEP_PERIOD;
        let Self { stream: Some(stream), receiver, watch, handle, .. } = self else { return };
        let gates = if stream.gate_per_body() { self.writers.len() } else { 1 };
        watch.look(now, (receiver, gates), &|route| stream.has(route), &mut |note| {
            handle.note(note)
        });
        if let Some(refused) = stream.take_refused() {
            handle.note(ReceiverNote::BodyRefused { route: refused.route, key: refused.key });
        }
        let received_at = receiver.arrived_at().max(self.connected_at);
        if stream.maintain(now).is_err() || now.since(received_at) > self.silence {
            self.give_up();
        }
    }
}

impl<T: Transport> Turn for ReceiverTurn<T> {
    fn next_event(&self, _now: Time) -> Option<Time> {
        Some(self.next_upkeep)
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        match self.handle.request() {
            Some(StreamPart::Stream(stream)) => self.set_stream(stream, clock.now()),
            Some(StreamPart::Definitions(definitions)) => self.apply_definitions(definitions),
            None => {}
        }
        let Self { stream, receiver, .. } = self;
        let received = stream.as_mut().map(|stream| stream.receive(&|| clock.now(), receiver));
        for (route, writer) in self.writers.iter_mut().enumerate() {
            if let Some(delivery) = self.receiver.take(route) {
                writer.send(delivery.frame, delivery.stamps_at(clock.now()), delivery.pose)?;
                clock.announce(writer)?;
                self.health.count_input();
            }
        }
        if let Some(Err(_)) = received {
            self.give_up();
        }
        if let Some(definitions) = self.stream.as_mut().and_then(|stream| stream.take_definitions())
        {
            self.handle.reply(StreamPart::Definitions(definitions));
        }
        self.keep_up(clock.now());
        Ok(())
    }

    /// Health for the instance of the first body.
    fn health(&self, now: Time) -> HealthV1 {
        self.health_of(0, now)
    }
}
