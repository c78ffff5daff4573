//! The part that precedes every message body: sequence, origin, time stamps.

use iceoryx2::prelude::ZeroCopySend;

use super::definition::structure;
use super::field::{Field, Value};
use super::schema::{FNV_OFFSET, schema};
use crate::origin::Origin;
use crate::time::Time;

structure! {
    /// Instants at which the sample that a message is about passed the stations of the loop; [`Time::UNSET`] for stations that
    /// it has not reached.
    #[derive(Eq, ZeroCopySend)]
    #[type_name("oqtal.Stamps.v1")]
    Stamps {
        /// The truth sample that the cameras used was taken.
        captured_at: Time ["ns"],
        /// The frame of a real camera system arrived at this machine; unset for emulated cameras.
        pose_received_at: Time ["ns"],
        /// The pose was handed to the bus.
        pose_published_at: Time ["ns"],
        /// The daemon woke to it.
        woken_at: Time ["ns"],
        /// The daemon's computation ended.
        computed_at: Time ["ns"],
        /// The command was handed to the bus.
        command_published_at: Time ["ns"],
        /// The plant or the bridge took the command off the bus.
        received_at: Time ["ns"],
        /// The command first acted: on the plant, after its radio delay; on the bridge, when its last byte went to the wire.
        applied_at: Time ["ns"],
    }
}

structure! {
    /// Header of every message.
    #[derive(Eq, ZeroCopySend)]
    #[type_name("oqtal.Header.v1")]
    Header {
        /// Number of this message among those of its writer on this topic, from 1: a gap is a loss.
        sequence: u64 ["-"],
        /// Sequence of the pose that this message is about; 0 for none.
        pose_sequence: u64 ["-"],
        /// [`super::Message::SCHEMA`] of the body.
        schema: u64 ["-"],
        /// Writer of the message, as [`Origin::bits`]: process id in the lower, host number in the upper half.
        source: u64 ["-"],
        ;
        /// The stations passed so far.
        stamps: Stamps,
    }
}

impl Header {
    /// Process that wrote the message.
    #[must_use]
    pub const fn origin(&self) -> Origin {
        Origin::from_bits(self.source)
    }
}

/// Schema of the header, which every body's schema continues.
pub(super) const HEADER_SCHEMA: u64 =
    schema(schema(FNV_OFFSET, "oqtal.Stamps.v1", Stamps::TABLE), "oqtal.Header.v1", Header::TABLE);
