//! Events of the receiver that are logged.

use oqtal_bus::time::Span;

/// Event of the server's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockEvent {
    /// The clock is known.
    Known {
        /// Error of an instant of capture that 99 of 100 do not exceed.
        uncertainty: Span,
    },
    /// The clock is not known: no poses until it is.
    Unknown,
    /// The clock was set by a small step; poses continue.
    Stepped,
    /// Frames have no stamps from which the clock can be estimated: no poses.
    Undated,
}

/// Event for the log, passed from the real-time thread to the background thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReceiverNote {
    /// Frames come.
    Receiving,
    /// No frames come.
    Silent,
    /// Event of the server's clock.
    Clock {
        /// Route of the body whose stamps they are; `None` if all bodies have the same.
        body: Option<usize>,
        /// The event.
        event: ClockEvent,
    },
    /// The cameras see a body.
    BodySeen {
        /// Route of the body.
        route: usize,
    },
    /// The cameras do not see a body any more.
    BodyLost {
        /// Route of the body.
        route: usize,
    },
    /// The server has no such body any more.
    BodyMissing {
        /// Route of the body.
        route: usize,
    },
    /// Another body of the server has the name of a route, and is not received.
    BodyRefused {
        /// The route.
        route: usize,
        /// Number of the body that is not received \[-\].
        key: i64,
    },
    /// The machine was suspended.
    Suspended {
        /// Duration of the suspension.
        length: Span,
    },
    /// Frames were lost, repeated, out of order, late or damaged in the last seconds.
    Troubled {
        /// Lost frames \[-\].
        lost: u64,
        /// Frames that came twice \[-\].
        repeated: u64,
        /// Frames that came after a later one \[-\].
        out_of_order: u64,
        /// Frames that waited too long on their way \[-\].
        late: u64,
        /// Messages that could not be read \[-\].
        damaged: u64,
    },
}

impl ReceiverNote {
    /// Writes the event to the log; `names` are those of the bodies.
    pub fn log(self, names: &[String]) {
        match self {
            Self::Receiving => tracing::info!("frames come"),
            Self::Silent => tracing::warn!("no frames come: connecting again"),
            Self::Clock { body, event } => {
                let name = body.and_then(|route| names.get(route));
                event.log(&name.map_or_else(String::new, |name| format!(" for `{name}`")));
            }
            Self::Suspended { length } => tracing::warn!(
                "the machine was suspended for {:.1} s: poses from before are old",
                length.seconds()
            ),
            Self::Troubled { lost, repeated, out_of_order, late, damaged } => tracing::warn!(
                lost,
                repeated,
                out_of_order,
                late,
                damaged,
                "frames of the last seconds; `oqtal receiver probe` examines the connection"
            ),
            Self::BodySeen { .. }
            | Self::BodyLost { .. }
            | Self::BodyMissing { .. }
            | Self::BodyRefused { .. } => self.log_body(names),
        }
    }

    /// Writes an event of one body to the log.
    fn log_body(self, names: &[String]) {
        let name = |route: usize| names.get(route).map_or("?", String::as_str);
        match self {
            Self::BodySeen { route } => tracing::info!("the cameras see `{}`", name(route)),
            Self::BodyLost { route } => tracing::warn!(
                "the cameras do not see `{}`: are its markers covered, is it in the volume?",
                name(route)
            ),
            Self::BodyMissing { route } => tracing::warn!(
                "the server has no body `{}` any more: was it renamed or switched off?",
                name(route)
            ),
            Self::BodyRefused { route, key } => tracing::warn!(
                "the server has a second body `{}`, number {key}, which is not received: give each body a name of its own",
                name(route)
            ),
            // The others are of no body.
            _ => {}
        }
    }
}

impl ClockEvent {
    /// Writes the event to the log; `whose` names the body in words, or is empty.
    fn log(self, whose: &str) {
        match self {
            Self::Known { uncertainty } => tracing::info!(
                uncertainty_us = uncertainty.nanos() / 1000,
                "the server's clock is known{whose}"
            ),
            Self::Unknown => tracing::warn!(
                "no poses{whose} until the server's clock is known again: its frames paused, or it was set or restarted"
            ),
            Self::Stepped => tracing::warn!(
                "the server's clock was set by some milliseconds{whose}: switch its time service off while flying"
            ),
            Self::Undated => tracing::warn!(
                "no poses{whose}: frames have no usable stamps; switch the server's time stamps on, or set `receiver.stamps = \"arrival\"`"
            ),
        }
    }
}
