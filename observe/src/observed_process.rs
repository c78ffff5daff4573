//! A process of an observed instance, by its health messages.

use oqtal_bus::message::{Header, HealthV1};
use oqtal_bus::topic::Role;

/// A process of the instance.
#[derive(Clone, Copy, Debug)]
pub struct ObservedProcess {
    /// Role of the process.
    pub role: Role,
    /// Header of the newest health message.
    pub header: Header,
    /// Newest health message.
    pub health: HealthV1,
    /// Whether the newest health message is older than the time-out.
    pub is_silent: bool,
}

impl ObservedProcess {
    /// Process id \[-\].
    pub fn pid(&self) -> u32 {
        self.header.origin().process()
    }
}
