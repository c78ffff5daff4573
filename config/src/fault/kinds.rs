//! Targets and kinds of faults: the kinds of each target, and their magnitudes.

/// Words of the command line for the variants of an enumeration.
macro_rules! words {
    ($(#[$meta:meta])* $name:ident { $($(#[$variant_meta:meta])* $variant:ident = $word:literal,)* }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name { $($(#[$variant_meta])* $variant,)* }

        impl $name {
            /// Every variant, in order.
            pub const ALL: [Self; [$($word),*].len()] = [$(Self::$variant),*];

            /// The word on the command line.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $word,)* }
            }
        }
    };
}

words! {
    /// Topic or process that a fault affects.
    FaultTarget {
        /// Poses read by the daemon.
        Pose = "pose",
        /// Commands read by plant-sim or bridge.
        Command = "command",
        /// States of the vehicle read by the daemon.
        Vehicle = "vehicle",
        /// The simulated radio, between the receipt of a command and its effect.
        Radio = "radio",
        /// The process daemon.
        Daemon = "daemon",
        /// The process plant-sim.
        PlantSim = "plant-sim",
        /// The process mocap-emu.
        MocapEmu = "mocap-emu",
        /// The process bridge.
        Bridge = "bridge",
        /// The process receiver.
        Receiver = "receiver",
        /// The files of the instance.
        Files = "files",
    }
}

words! {
    /// Kind of failure.
    FaultKind {
        /// No samples arrive.
        Off = "off",
        /// The last value is repeated with new sequence numbers.
        Stuck = "stuck",
        /// Every number is arbitrary: random bits, not a number, infinities.
        Garbage = "garbage",
        /// Plausible but false: a pose shifted or turned, a command scaled, a vehicle with stopped motors.
        Wrong = "wrong",
        /// The last pose is repeated with noise of this standard deviation.
        FrozenNoise = "frozen-noise",
        /// Poses have additional noise of this standard deviation.
        Noise = "noise",
        /// Poses drift away at this constant rate.
        Drift = "drift",
        /// Poses are mirrored.
        Mirror = "mirror",
        /// The path is turned about the vertical by this angle, and the attitude is not.
        Rotate = "rotate",
        /// Samples arrive at most at this rate; each turn of a process takes longer by this time.
        Slow = "slow",
        /// All samples are delayed by this time.
        Delayed = "delayed",
        /// Each sample is missing with this probability.
        Intermittent = "intermittent",
        /// The process is killed, and restarted at the end of the fault.
        Kill = "kill",
        /// The process is suspended, and continued at the end of the fault.
        Stop = "stop",
        /// The files are removed.
        Removed = "removed",
    }
}

words! {
    /// Unit of a magnitude.
    FaultUnit {
        /// Metres.
        Metre = "m",
        /// Degrees.
        Degree = "deg",
        /// Percent.
        Percent = "%",
        /// Milliseconds.
        Millisecond = "ms",
        /// Hertz.
        Hertz = "Hz",
        /// Millimetres.
        Millimetre = "mm",
        /// Metres per second.
        MetrePerSecond = "m/s",
        /// Degrees per second.
        DegreePerSecond = "deg/s",
    }
}

/// Magnitude of a fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Magnitude {
    /// The number \[unit of the next field\].
    pub value: f64,
    /// Unit of the number.
    pub unit: FaultUnit,
}

impl FaultTarget {
    /// Whether the target is a process.
    pub const fn is_process(self) -> bool {
        matches!(
            self,
            Self::Daemon | Self::PlantSim | Self::MocapEmu | Self::Bridge | Self::Receiver
        )
    }
}

/// Magnitude allowed for a kind: unit, default, least and greatest value \[unit\].
type Allowed = (FaultUnit, f64, f64, f64);

/// Kind of fault with its allowed targets.
pub(super) struct KindRule {
    pub(super) kind: FaultKind,
    targets: &'static [FaultTarget],
    /// Allowed magnitudes, the one with the default first; empty for a kind without magnitude.
    magnitudes: &'static [Allowed],
}

const TOPICS: &[FaultTarget] = &[FaultTarget::Pose, FaultTarget::Command, FaultTarget::Vehicle];
const LOSSY: &[FaultTarget] =
    &[FaultTarget::Pose, FaultTarget::Command, FaultTarget::Vehicle, FaultTarget::Radio];
const LOOPS: &[FaultTarget] =
    &[FaultTarget::Daemon, FaultTarget::PlantSim, FaultTarget::MocapEmu, FaultTarget::Bridge];
const PROCESSES: &[FaultTarget] = &[
    FaultTarget::Daemon,
    FaultTarget::PlantSim,
    FaultTarget::MocapEmu,
    FaultTarget::Bridge,
    FaultTarget::Receiver,
];

const RULES: [KindRule; 18] = {
    use FaultKind::{Delayed, Drift, FrozenNoise, Garbage, Intermittent, Kill, Mirror, Noise};
    use FaultKind::{Off, Removed, Rotate, Slow, Stop, Stuck, Wrong};
    use FaultTarget::{Command, Files, Pose, Vehicle};
    use FaultUnit::{Degree, DegreePerSecond, Hertz, Metre, MetrePerSecond, Millimetre};
    use FaultUnit::{Millisecond, Percent};
    const DISTANCE: Allowed = (Metre, 0.3, 0.0, 1000.0);
    const ANGLE: Allowed = (Degree, 180.0, -180.0, 180.0);
    const SHARE: Allowed = (Percent, 50.0, -1000.0, 1000.0);
    const RATE: Allowed = (Hertz, 10.0, 0.001, 1000.0);
    const DELAY: Allowed = (Millisecond, 60.0, 0.0, 10_000.0);
    const LOSS: Allowed = (Percent, 50.0, 0.0, 100.0);
    const LATE: Allowed = (Millisecond, 30.0, 0.0, 10_000.0);
    const POSITION_NOISE: Allowed = (Millimetre, 0.5, 0.0, 1000.0);
    const ATTITUDE_NOISE: Allowed = (Degree, 0.5, 0.0, 180.0);
    const POSITION_DRIFT: Allowed = (MetrePerSecond, 0.1, -100.0, 100.0);
    const ATTITUDE_DRIFT: Allowed = (DegreePerSecond, 0.5, -100.0, 100.0);
    const QUARTER_TURN: Allowed = (Degree, 90.0, -180.0, 180.0);
    [
        KindRule { kind: Off, targets: LOSSY, magnitudes: &[] },
        KindRule { kind: Stuck, targets: TOPICS, magnitudes: &[] },
        KindRule { kind: Garbage, targets: TOPICS, magnitudes: &[] },
        KindRule { kind: Wrong, targets: &[Pose], magnitudes: &[DISTANCE, ANGLE] },
        KindRule { kind: Wrong, targets: &[Command], magnitudes: &[SHARE] },
        KindRule { kind: Wrong, targets: &[Vehicle], magnitudes: &[] },
        KindRule { kind: FrozenNoise, targets: &[Pose], magnitudes: &[POSITION_NOISE] },
        KindRule { kind: Noise, targets: &[Pose], magnitudes: &[POSITION_NOISE, ATTITUDE_NOISE] },
        KindRule { kind: Drift, targets: &[Pose], magnitudes: &[POSITION_DRIFT, ATTITUDE_DRIFT] },
        KindRule { kind: Mirror, targets: &[Pose], magnitudes: &[] },
        KindRule { kind: Rotate, targets: &[Pose], magnitudes: &[QUARTER_TURN] },
        KindRule { kind: Slow, targets: TOPICS, magnitudes: &[RATE] },
        KindRule { kind: Delayed, targets: LOSSY, magnitudes: &[DELAY] },
        KindRule { kind: Intermittent, targets: LOSSY, magnitudes: &[LOSS] },
        KindRule { kind: Kill, targets: PROCESSES, magnitudes: &[] },
        KindRule { kind: Stop, targets: PROCESSES, magnitudes: &[] },
        KindRule { kind: Slow, targets: LOOPS, magnitudes: &[LATE] },
        KindRule { kind: Removed, targets: &[Files], magnitudes: &[] },
    ]
};

/// The kinds that `target` can have.
pub(super) fn kinds_of(target: FaultTarget) -> impl Iterator<Item = &'static KindRule> {
    static TABLE: [KindRule; RULES.len()] = RULES;
    TABLE.iter().filter(move |rule| rule.targets.contains(&target))
}

impl KindRule {
    /// The kind in the form of the grammar, with its defaults.
    pub(super) fn form(&self) -> String {
        let values =
            self.magnitudes.iter().map(|(unit, value, ..)| format!("={value}{}", unit.name()));
        let values: Vec<String> = values.collect();
        match values.is_empty() {
            true => self.kind.name().to_owned(),
            false => format!("{}[{}]", self.kind.name(), values.join("|")),
        }
    }

    /// The allowed magnitudes, as text.
    pub(super) fn allowed(&self) -> String {
        let ranges = self.magnitudes.iter();
        let ranges = ranges
            .map(|(unit, _, least, greatest)| format!("{least} to {greatest} {}", unit.name()));
        let ranges: Vec<String> = ranges.collect();
        if ranges.is_empty() { "no value".to_owned() } else { ranges.join(" or ") }
    }

    /// Magnitude from `text`, or the default without a text; `None` if it is not allowed.
    pub(super) fn magnitude(&self, text: Option<&str>) -> Option<Option<Magnitude>> {
        let Some(text) = text else {
            let default = self.magnitudes.first();
            return Some(default.map(|&(unit, value, ..)| Magnitude { value, unit }));
        };
        self.magnitudes.iter().find_map(|&(unit, _, least, greatest)| {
            let value: f64 = text.strip_suffix(unit.name())?.parse().ok()?;
            (least..=greatest).contains(&value).then_some(Some(Magnitude { value, unit }))
        })
    }
}
