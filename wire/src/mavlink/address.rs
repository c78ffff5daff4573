//! Addresses: a system, and a component of it.

/// Sender or receiver of messages; 0 stands for all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MavlinkAddress {
    /// System \[-\].
    pub system: u8,
    /// Component of the system \[-\].
    pub component: u8,
}

impl MavlinkAddress {
    /// All systems and components.
    pub const ALL: Self = Self { system: 0, component: 0 };
    /// Component of an autopilot \[-\].
    pub const AUTOPILOT: u8 = 1;
    /// Component of a companion computer, or of a program in its place \[-\].
    pub const COMPUTER: u8 = 191;

    /// Whether a message to `target` is for this address.
    pub fn is_meant_by(self, target: Self) -> bool {
        let is = |own: u8, wanted: u8| wanted == 0 || wanted == own;
        is(self.system, target.system) && is(self.component, target.component)
    }
}
