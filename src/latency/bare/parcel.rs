//! Message transmitted by every mechanism, and the two ends of a mechanism.

use std::io;

use iceoryx2::prelude::ZeroCopySend;
use oqtal_bus::message::{Header, Message, PoseV1};
use oqtal_bus::time::Time;

/// Size of a message, that of a pose with its header \[words of 64 bits\].
pub(super) const WORDS: usize = (size_of::<Header>() + PoseV1::SIZE).div_ceil(8);

/// A message of the size of a pose with its header.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("oqtal.Parcel.v1")]
#[repr(C)]
pub struct Parcel {
    /// Instant of sending; [`Time::UNSET`] in the last message.
    pub(super) sent_at: Time,
    filling: [u64; WORDS - 1],
}

/// Sender of a mechanism: sends a message and wakes the receiver.
pub type ParcelSender = Box<dyn FnMut(&Parcel) -> io::Result<()>>;

/// Receiver of a mechanism: sleeps without limit until a message arrives, and receives it.
pub type ParcelReceiver = Box<dyn FnMut() -> io::Result<Parcel>>;

impl Parcel {
    /// A message sent now.
    pub fn now() -> Self {
        Self { sent_at: Time::now(), filling: [1; WORDS - 1] }
    }

    /// The last message.
    pub const LAST: Self = Self { sent_at: Time::UNSET, filling: [0; WORDS - 1] };

    pub(super) fn words(&self) -> [u64; WORDS] {
        let mut words = [0; WORDS];
        words[0] = self.sent_at.nanos();
        words[1..].copy_from_slice(&self.filling);
        words
    }

    pub(super) fn of_words(words: &[u64; WORDS]) -> Self {
        let mut filling = [0; WORDS - 1];
        filling.copy_from_slice(&words[1..]);
        Self { sent_at: Time::from_nanos(words[0]), filling }
    }
}
