//! The vehicle's supervisor: whether it can be armed, is armed, flies, or must be restarted; and the commands that it takes.

/// First protocol version whose supervisor has its own port \[-\].
pub const SUPERVISOR_PROTOCOL: u8 = 12;

/// State of the supervisor: bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Supervision(u16);

impl Supervision {
    /// A request to arm would be accepted.
    pub const CAN_BE_ARMED: Self = Self(1 << 0);
    /// The vehicle is armed.
    pub const ARMED: Self = Self(1 << 1);
    /// The vehicle arms automatically.
    pub const ARMS_ITSELF: Self = Self(1 << 2);
    /// The motors may run.
    pub const CAN_FLY: Self = Self(1 << 3);
    /// The vehicle flies, or has flown within the last 2 s.
    pub const FLYING: Self = Self(1 << 4);
    /// The vehicle lies on its side or its back.
    pub const TUMBLED: Self = Self(1 << 5);
    /// The vehicle is locked until it is restarted.
    pub const LOCKED: Self = Self(1 << 6);
    /// The vehicle has crashed and must be recovered.
    pub const CRASHED: Self = Self(1 << 7);

    /// State of these bits; unknown ones are kept.
    pub const fn from_wire(bits: u16) -> Self {
        Self(bits)
    }

    /// The bits as on the wire \[-\].
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// Whether all bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The bits of both.
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Command to the supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SupervisorCommand {
    /// Arms or disarms.
    Arm(bool),
    /// Ends the state after a crash.
    Recover,
    /// Stops the motors at once, and locks the vehicle until it is restarted.
    EmergencyStop,
    /// Keeps the motors from being stopped; once sent, it must be repeated within every second.
    KeepAlive,
}
