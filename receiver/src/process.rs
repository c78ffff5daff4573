//! The process: from the configuration to the loop.

use std::os::fd::OwnedFd;

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::HealthV1;
use oqtal_bus::time::{Span, Time};
use oqtal_config::{ClockKind, Config, parse_option};
use oqtal_control::options::OptionError;
use oqtal_runtime::awake::AwakeInterval;
use oqtal_runtime::background::with_background;
use oqtal_runtime::handoff::handoff;
use oqtal_runtime::health::Heartbeat;
use oqtal_runtime::loop_clock::LoopClock;
use oqtal_runtime::process::{Exit, Failure, ProcessContext, instance_paths};
use oqtal_runtime::process_loop;
use oqtal_runtime::turn::{Turn, TurnClock};

use crate::attempt::CameraConnection;
use crate::background::Connector;
use crate::connect::connect_to_all;
use crate::note::ReceiverNote;
use crate::receiver::PoseReceiver;
use crate::turn::{ReceiverTurn, SocketSet, TurnParts};
use oqtal_wire::link::CameraLink;

/// The link that a configuration names; `None` if it names none.
///
/// # Errors
/// `receiver.link` is not a link.
pub fn link(config: &Config) -> Result<Option<CameraLink>, OptionError> {
    parse_option("receiver.link", &config.receiver.link, "a link")
}

/// The link, with a body at least.
fn link_to_bodies(config: &Config) -> Result<CameraLink, Failure> {
    let located = |error: OptionError| Failure::from(config.locate(&error));
    let required = |allowed: &str| {
        let found = format!("`{}`", config.receiver.link);
        located(OptionError::new("receiver.link", found, allowed))
    };
    if config.clock.kind != ClockKind::Real {
        let message = "a camera system needs clock.kind = \"real\"";
        return Err(Failure::new(Exit::Usage, message));
    }
    let link = link(config).map_err(located)?;
    let link = link.ok_or_else(|| {
        required("a link, as in qtm:HOST,body=NAME; name it there or with --link, or let `oqtal receiver discover` find it")
    })?;
    if link.bodies.is_empty() {
        return Err(required(
            "a link with a body, as in qtm:HOST,body=NAME; `oqtal receiver discover` lists them",
        ));
    }
    Ok(link)
}

/// Checks whether the receiver could run with `config`. No server is contacted.
///
/// # Errors
/// There is no link, it is malformed, or the clock is virtual.
pub fn check(config: &Config) -> Result<(), Failure> {
    link_to_bodies(config).map(drop)
}

/// Publishes the poses of a camera system until a stop is requested.
///
/// # Errors
/// Like [`check`]; there is no server or no such body; another process publishes poses; the bus breaks.
pub fn run(context: &ProcessContext) -> Result<(), Failure> {
    let ReceiverParts { mut turn, descriptor, connector, buses: _buses } = open(context)?;
    let clock = LoopClock::polled(descriptor, context.stop.clone());
    let period = Span::period_of(context.config.control.rate_hz);
    let awake = AwakeInterval::of(&context.config, context.role);
    let mut clock = clock.counted_in(context.health.clone(), period).awake_in(awake);
    with_background(
        context,
        || Ok(connector),
        || {
            context.enter_realtime();
            Ok(process_loop::run(&mut turn, &mut clock, None)?)
        },
    )
}

/// Opens the parts of the receiver; frames come from then on.
///
/// # Errors
/// Like [`run`].
pub fn open(context: &ProcessContext) -> Result<ReceiverParts, Failure> {
    let link = link_to_bodies(&context.config)?;
    let buses = open_buses(context, &link)?;
    let refused = |error: std::io::Error| {
        Failure::new(Exit::System, format!("making a set of sockets failed: {error}"))
    };
    let sockets = SocketSet::new().map_err(refused)?;
    let descriptor = sockets.descriptor().map_err(refused)?;
    let (handle, background) = handoff();
    let options = &context.config.receiver;
    let parts = TurnParts {
        receiver: PoseReceiver::new(options, link.bodies.len()),
        sockets,
        handle,
        health: context.health.clone(),
        silence: Span::from_seconds(options.silence_ms * 1e-3),
    };
    let mut turn = ReceiverTurn::open(buses.iter(), parts)?;
    let heartbeats = buses.iter().map(|bus| context.heartbeat(bus)).collect::<Result<_, _>>()?;
    // Last, since frames come from then on.
    let CameraConnection { stream, server, .. } = connect_to_all(&link)?;
    tracing::info!(link = link.to_string(), "{server}: connected");
    turn.set_stream(stream, Time::now());
    let connector = Connector::new(background, link, context.health.clone());
    Ok(ReceiverParts { turn: BeatingTurn { turn, heartbeats }, descriptor, connector, buses })
}

/// Joins the instance of every body.
fn open_buses(context: &ProcessContext, link: &CameraLink) -> Result<Vec<Bus>, Failure> {
    let mut buses = Vec::with_capacity(link.bodies.len());
    for body in &link.bodies {
        let mut config = context.config.clone();
        if let Some(instance) = &body.instance {
            config.instance.name.clone_from(instance);
        }
        buses.push(context.join(&instance_paths(&config)?)?);
    }
    Ok(buses)
}

/// Parts of a receiver, for its loop and for its background thread.
#[derive(Debug)]
pub struct ReceiverParts {
    /// The turn of the loop.
    pub turn: BeatingTurn,
    /// Readable when the turn has something to receive.
    pub descriptor: OwnedFd,
    /// Worker of the background thread.
    pub connector: Connector,
    /// The instances of the bodies.
    pub buses: Vec<Bus>,
}

/// A turn with a heartbeat on every instance.
#[derive(Debug)]
pub struct BeatingTurn {
    turn: ReceiverTurn<Bus>,
    heartbeats: Vec<Heartbeat>,
}

impl Turn for BeatingTurn {
    fn next_event(&self, now: Time) -> Option<Time> {
        self.turn.next_event(now)
    }

    fn turn<C: TurnClock>(&mut self, clock: &mut C) -> Result<(), BusError> {
        self.turn.turn(clock)?;
        let mut suspended = None;
        for (route, heartbeat) in self.heartbeats.iter_mut().enumerate() {
            let health = self.turn.health_of(route, clock.now());
            suspended = suspended.max(heartbeat.beat_unlogged(health)?);
        }
        if let Some(length) = suspended {
            self.turn.note(ReceiverNote::Suspended { length });
        }
        Ok(())
    }

    fn health(&self, now: Time) -> HealthV1 {
        self.turn.health(now)
    }
}
