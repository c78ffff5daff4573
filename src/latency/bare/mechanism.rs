//! Mechanisms measured without the bus.

/// Measured mechanism.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mechanism {
    /// A futex on a word in shared memory: the lower bound.
    Futex,
    /// An eventfd, with the message in shared memory.
    Eventfd,
    /// A Unix datagram socket.
    UnixDatagram,
    /// A UDP socket over the loopback interface.
    UdpSocket,
    /// Publish-subscribe and events of iceoryx2 in its stock configuration.
    Iceoryx2Listener,
}

impl Mechanism {
    /// All mechanisms.
    pub const ALL: [Self; 5] =
        [Self::Futex, Self::Eventfd, Self::UnixDatagram, Self::UdpSocket, Self::Iceoryx2Listener];

    /// Name in figures and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Futex => "futex",
            Self::Eventfd => "eventfd",
            Self::UnixDatagram => "unix_datagram",
            Self::UdpSocket => "udp_socket",
            Self::Iceoryx2Listener => "iceoryx2_listener",
        }
    }
}
