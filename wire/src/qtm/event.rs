//! Events of a measurement.

/// Event of a server, also its answer to `GetState`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QtmEvent {
    /// 1: a measurement is open; its data can be streamed.
    Connected,
    /// 2: the measurement is closed; there is no data.
    ConnectionClosed,
    /// 3: a capture has started.
    CaptureStarted,
    /// 4: the capture has ended.
    CaptureStopped,
    /// 8: a recorded measurement is played.
    RtFromFileStarted,
    /// 9: the playing has ended.
    RtFromFileStopped,
    /// 12: the server is shutting down.
    ShuttingDown,
    /// 13: the capture is saved.
    CaptureSaved,
    /// 16: a client has sent a trigger.
    Trigger,
    /// Any other: calibration, reprocessing, changed settings.
    Other(u8),
}

/// Events that also change the state of the server.
const NAMED: [(u8, QtmEvent); 9] = [
    (1, QtmEvent::Connected),
    (2, QtmEvent::ConnectionClosed),
    (3, QtmEvent::CaptureStarted),
    (4, QtmEvent::CaptureStopped),
    (8, QtmEvent::RtFromFileStarted),
    (9, QtmEvent::RtFromFileStopped),
    (12, QtmEvent::ShuttingDown),
    (13, QtmEvent::CaptureSaved),
    (16, QtmEvent::Trigger),
];

impl QtmEvent {
    /// The event of a number on the wire.
    pub fn from_number(number: u8) -> Self {
        let named = NAMED.iter().find(|(known, _)| *known == number);
        named.map_or(Self::Other(number), |(_, event)| *event)
    }

    /// Number on the wire \[-\].
    pub fn number(self) -> u8 {
        match self {
            Self::Other(number) => number,
            named => NAMED.iter().find(|(_, event)| *event == named).map_or(0, |(n, _)| *n),
        }
    }

    /// Whether the event changes the state of the measurement, as reported by `GetState`.
    pub fn is_state(self) -> bool {
        !matches!(self.number(), 11 | 12 | 13 | 16)
    }
}
