//! Header of every message: sequence, origin, time stamps.

use iceoryx2::prelude::ZeroCopySend;

use super::definition::structure;
use super::field::{Field, Value};
use super::schema::{FNV_OFFSET, schema};
use crate::origin::Origin;
use crate::time::Time;

structure! {
    /// Instants at which the data behind a message passed the stages of the loop; [`Time::UNSET`] for stages not reached.
    #[derive(Eq, ZeroCopySend)]
    #[type_name("oqtal.Stamps.v1")]
    Stamps {
        /// The truth sample used by the cameras was taken.
        captured_at: Time ["ns"],
        /// The frame of a real camera system arrived at this machine; unset for emulated cameras.
        pose_received_at: Time ["ns"],
        /// The pose was handed to the bus.
        pose_published_at: Time ["ns"],
        /// The daemon woke up for it.
        woken_at: Time ["ns"],
        /// The daemon's computation ended.
        computed_at: Time ["ns"],
        /// The command was handed to the bus.
        command_published_at: Time ["ns"],
        /// The plant or the bridge took the command from the bus.
        received_at: Time ["ns"],
        /// The command first took effect: at the plant, after its radio delay; at the bridge, when its last byte was sent.
        applied_at: Time ["ns"],
    }
}

structure! {
    /// Header of every message.
    #[derive(Eq, ZeroCopySend)]
    #[type_name("oqtal.Header.v1")]
    Header {
        /// Number of this message among the messages of its writer on this topic, from 1; a gap is a loss.
        sequence: u64 ["-"],
        /// Sequence of the pose that this message belongs to; 0 for none.
        pose_sequence: u64 ["-"],
        /// [`super::Message::SCHEMA`] of the body.
        schema: u64 ["-"],
        /// Writer of the message, as [`Origin::bits`]: process id in the lower, host number in the upper half.
        source: u64 ["-"],
        ;
        /// Stages passed so far.
        stamps: Stamps,
    }
}

impl Stamps {
    /// Table of the fields.
    pub const FIELDS: &'static [Field] = Self::TABLE;

    /// Instants in the order of [`Stamps::FIELDS`] \[ns\].
    pub fn to_words(&self) -> [u64; 8] {
        [
            self.captured_at,
            self.pose_received_at,
            self.pose_published_at,
            self.woken_at,
            self.computed_at,
            self.command_published_at,
            self.received_at,
            self.applied_at,
        ]
        .map(Time::nanos)
    }

    /// Inverse of [`Stamps::to_words`] \[ns\].
    pub fn from_words(words: [u64; 8]) -> Self {
        let mut instants = words.into_iter().map(Time::from_nanos);
        let mut next = || instants.next().unwrap_or_default();
        Self {
            captured_at: next(),
            pose_received_at: next(),
            pose_published_at: next(),
            woken_at: next(),
            computed_at: next(),
            command_published_at: next(),
            received_at: next(),
            applied_at: next(),
        }
    }
}

impl Header {
    /// Table of the fields before the stamps.
    pub const FIELDS: &'static [Field] = Self::TABLE;

    /// Process that wrote the message.
    pub const fn origin(&self) -> Origin {
        Origin::from_bits(self.source)
    }
}

/// Schema of the header; every body's schema continues it.
pub(super) const HEADER_SCHEMA: u64 =
    schema(schema(FNV_OFFSET, "oqtal.Stamps.v1", Stamps::TABLE), "oqtal.Header.v1", Header::TABLE);
