//! What the processes say to each other: plain data of fixed layout, in SI units, with unit and frame at every field.
//!
//! Two guards against a mismatch of versions: the type name carries the version, and the header carries a hash of the
//! fields, made from the definition itself, so that a field added without a new version is refused too.
//! Enumerations travel as `u8`: a value from another process may be anything, and [`crate::code`] decodes it.

use iceoryx2::prelude::ZeroCopySend;

use crate::time::Time;

/// A message body: what a topic carries behind its [`Header`].
pub trait Message: ZeroCopySend + Copy + std::fmt::Debug + 'static {
    /// Hash of the wire name and of every field's name and type, those of the header included.
    const SCHEMA: u64;
}

/// FNV-1a, 64 bits: the hash of schemas, configurations and trajectories.
#[must_use]
pub const fn fnv1a(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    hash
}

/// The start value of [`fnv1a`].
pub const FNV_OFFSET: u64 = 0xcbf2_9ce4_8422_2325;

/// A structure of fixed layout, and the hash of the fields that its definition names, on top of the hash of what it holds or
/// follows.
macro_rules! layout {
    ($(#[$meta:meta])* $name:ident = $wire:literal on $base:expr, {
        $($(#[$field_meta:meta])* $field:ident: $type:ty,)*
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, ZeroCopySend)]
        #[type_name($wire)]
        #[repr(C)]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }

        impl $name {
            const LAYOUT: u64 = fnv1a(
                $base,
                concat!($wire, $(";", stringify!($field), ":", stringify!($type)),*).as_bytes(),
            );
        }
    };
}

/// A message body. Its schema covers the header before it.
macro_rules! message {
    ($(#[$meta:meta])* $name:ident = $wire:literal { $($fields:tt)* }) => {
        layout! { $(#[$meta])* $name = $wire on Header::LAYOUT, { $($fields)* } }

        impl Message for $name {
            const SCHEMA: u64 = Self::LAYOUT;
        }
    };
}

layout! {
    /// When the sample that a message is about passed each station of the loop; [`Time::UNSET`] for stations still ahead.
    #[derive(Eq)]
    Stamps = "oqtal.Stamps.v1" on FNV_OFFSET, {
        /// The truth sample that the cameras used was taken.
        captured_at: Time,
        /// The pose was handed to the bus.
        pose_published_at: Time,
        /// The daemon woke to it.
        woken_at: Time,
        /// The daemon's computation ended.
        computed_at: Time,
        /// The command was handed to the bus.
        command_published_at: Time,
        /// The plant or the bridge took the command off the bus.
        received_at: Time,
        /// The command first acted: on the plant, after its radio delay; on the bridge, when its last byte went to the wire.
        applied_at: Time,
    }
}

layout! {
    /// What precedes every message body.
    #[derive(Eq)]
    Header = "oqtal.Header.v1" on Stamps::LAYOUT, {
        /// Counts this writer's messages on this topic from 1: a gap is a loss.
        sequence: u64,
        /// The sequence of the pose that this message is about; 0 for none.
        pose_sequence: u64,
        /// [`Message::SCHEMA`] of the body.
        schema: u64,
        /// Process id of the writer.
        source: u64,
        /// The stations passed so far.
        stamps: Stamps,
    }
}

message! {
    /// Topic `truth`: where the vehicle really is. For cameras and observers, never for the daemon.
    TruthV1 = "oqtal.Truth.v1" {
        /// Instant of this sample.
        time: Time,
        /// Index of the camera frame taken at this instant, from 1; 0 between frames.
        capture: u64,
        /// Position of the centre of mass \[m, world\].
        position: [f64; 3],
        /// Velocity \[m/s, world\].
        velocity: [f64; 3],
        /// Attitude, scalar last \[body to world\].
        attitude: [f64; 4],
        /// Body rate \[rad/s, body\].
        rate: [f64; 3],
    }
}

message! {
    /// Topic `pose`: what motion capture says.
    PoseV1 = "oqtal.Pose.v1" {
        /// Position \[m, world\].
        position: [f64; 3],
        /// Attitude, scalar last \[body to world\]; as measured, so not exactly of unit norm.
        attitude: [f64; 4],
        /// 1 if the cameras see the body, 0 if they lost it (the numbers then mean nothing).
        tracked: u8,
    }
}

message! {
    /// Topic `command`: what the daemon wants of the vehicle.
    CommandV1 = "oqtal.Command.v1" {
        /// [`crate::code::Actuation`]: neutral, sticks or torque.
        actuation: u8,
        /// Attitude sticks `[delta_r, delta_p, delta_y]` of Eq. (61) \[-1..1, body\]; zero unless sticks are meant.
        sticks: [f64; 3],
        /// Torque \[N m, body\]; zero unless torque is meant.
        torque: [f64; 3],
        /// The attitude that sticks or torque are to bring about, scalar last \[body to world\], for a vehicle that holds one
        /// by itself; zeros in a neutral command.
        attitude: [f64; 4],
        /// Collective thrust `delta_c` of Eq. (61) \[0..1 of the vehicle's greatest thrust\].
        thrust: f64,
    }
}

message! {
    /// Topic `vehicle`: what the plant or the bridge says about the vehicle, once per command applied. A bridge says it in
    /// every period, with or without a command.
    VehicleV1 = "oqtal.Vehicle.v1" {
        /// Sequence of the command that this is about.
        command_sequence: u64,
        /// Commands missed between those that arrived, in total.
        lost: u64,
        /// Battery voltage \[V\]; NaN if unknown.
        battery_v: f64,
        /// Share of the requests to the vehicle that were answered lately \[0..1\]; NaN if none are made.
        link_quality: f64,
        /// What a command's bytes take on the wire once the last one was handed to it \[ns\]; 0 without a wire.
        wire_ns: i64,
        /// From a command's last byte on the wire to its effect, as far as it is known \[ns\]; 0 if `applied_at` is the effect.
        air_ns: i64,
        /// 1 if the motors run.
        armed: u8,
        /// 1 while the motors are being started: a flight begins when they run.
        starting: u8,
        /// 1 if the vehicle answers.
        link: u8,
        /// 1 if nothing really flies: what may take off without an operator.
        simulated: u8,
    }
}

message! {
    /// Topic `telemetry`: everything the daemon knew and decided in one tick.
    TelemetryV1 = "oqtal.Telemetry.v1" {
        /// The tick's instant: when the daemon woke.
        time: Time,
        /// Counts ticks from 1.
        tick: u64,
        /// Sequence of the command published in this tick.
        command_sequence: u64,
        /// Time since the mission began \[s\]; NaN before.
        mission_s: f64,
        /// Estimated position \[m, world\].
        position: [f64; 3],
        /// Estimated velocity \[m/s, world\].
        velocity: [f64; 3],
        /// Estimated attitude, scalar last \[body to world\].
        attitude: [f64; 4],
        /// Estimated body rate \[rad/s, body\].
        rate: [f64; 3],
        /// Reference position \[m, world\].
        reference_position: [f64; 3],
        /// The position loops' commanded velocity \[m/s, world\]; NaN when not flying.
        velocity_command: [f64; 3],
        /// The commanded attitude, scalar last \[body to world\]; NaN when not flying.
        attitude_command: [f64; 4],
        /// Attitude sticks sent \[-1..1, body\].
        sticks: [f64; 3],
        /// Torque sent \[N m, body\].
        torque: [f64; 3],
        /// Collective thrust sent \[0..1\].
        thrust: f64,
        /// Age of the newest believed pose at this tick \[s\]; NaN if there was none yet.
        pose_age_s: f64,
        /// How late the daemon woke after the deadline it asked for, or after the pose's arrival \[ns\].
        wakeup_lateness_ns: i64,
        /// Riccati equations solved so far, the first included.
        riccati_solves: u64,
        /// Riccati equations that had no solution, so that the last gain was kept.
        riccati_failures: u64,
        /// Ticks so far whose command came later than one period after its pose.
        deadline_misses: u64,
        /// Camera frames that never became a pose, in total.
        poses_lost: u64,
        /// Poses that a newer one overtook before this process looked, in total.
        poses_superseded: u64,
        /// Poses refused by the guard, in total.
        poses_refused: u64,
        /// [`crate::code::Mode`]: what the daemon is doing.
        mode: u8,
        /// [`crate::code::SafetyState`]: how far it trusts its poses.
        state: u8,
        /// [`crate::code::Cause`] of the state.
        cause: u8,
        /// `oqtal_control::trajectory::Phase` of the mission as a number.
        phase: u8,
        /// 1 if this tick belongs to the scored window of the flight.
        scored: u8,
        /// 1 if this tick used a new pose, 0 if it acted on its deadline.
        fresh: u8,
        /// 1 if the attitude command hit its limit.
        saturated: u8,
    }
}

message! {
    /// Topics `health/NAME`: whether a process is well, twice a second and on every change.
    HealthV1 = "oqtal.Health.v1" {
        /// When this was said, by the monotonic clock of the machine, whatever clock drives the flight.
        time: Time,
        /// Hash of the effective configuration: processes that disagree were started from different files.
        config_hash: u64,
        /// [`crate::code::SafetyState`], for the daemon.
        state: u8,
        /// [`crate::code::Mode`], for the daemon.
        mode: u8,
        /// [`crate::code::Cause`] of the state, for the daemon.
        cause: u8,
        /// Changes of the daemon's condition that its log missed.
        unlogged: u64,
    }
}

message! {
    /// Service `control`: what an operator asks of the daemon.
    ControlRequestV1 = "oqtal.ControlRequest.v1" {
        /// [`crate::code::OperatorCommand`].
        command: u8,
    }
}

message! {
    /// Service `control`: what the daemon answers.
    ControlResponseV1 = "oqtal.ControlResponse.v1" {
        /// [`crate::code::Answer`].
        answer: u8,
        /// [`crate::code::Mode`] after the request.
        mode: u8,
        /// [`crate::code::SafetyState`] after the request.
        state: u8,
        /// [`crate::code::Cause`] of the state, or of the refusal.
        cause: u8,
    }
}

message! {
    /// Topics `clock/NAME/advance`: the leader advances the virtual time of a process.
    TimeAdvanceV1 = "oqtal.TimeAdvance.v1" {
        /// The instant of the turn; [`Time::UNSET`] in the start barrier, before virtual time begins.
        now: Time,
    }
}

message! {
    /// Topics `clock/NAME/done`: the process has executed its turn.
    TurnDoneV1 = "oqtal.TurnDone.v1" {
        /// Sequence number of the time advance that this answers \[-\].
        advance: u64,
        /// The next event of the process; [`Time::UNSET`] for none.
        next: Time,
        /// 1 if it published something that the next process in the loop has to read at once.
        published: u8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_schema_differs() {
        let schemas = [
            TruthV1::SCHEMA,
            PoseV1::SCHEMA,
            CommandV1::SCHEMA,
            VehicleV1::SCHEMA,
            TelemetryV1::SCHEMA,
            HealthV1::SCHEMA,
            ControlRequestV1::SCHEMA,
            ControlResponseV1::SCHEMA,
            TimeAdvanceV1::SCHEMA,
            TurnDoneV1::SCHEMA,
        ];
        let distinct: std::collections::BTreeSet<_> = schemas.iter().collect();
        assert_eq!(distinct.len(), schemas.len());
    }

    message! {
        /// A message like any other.
        ProbeV1 = "oqtal.Probe.v1" {
            /// A field.
            field: u8,
        }
    }

    #[test]
    fn a_schema_covers_the_header_and_the_stamps_before_the_body() {
        const STAMPS: &str = "oqtal.Stamps.v1;captured_at:Time;pose_published_at:Time;woken_at:Time;computed_at:Time;\
                              command_published_at:Time;received_at:Time;applied_at:Time";
        const HEADER: &str =
            "oqtal.Header.v1;sequence:u64;pose_sequence:u64;schema:u64;source:u64;stamps:Stamps";
        let all = [STAMPS, HEADER, "oqtal.Probe.v1;field:u8"].concat();
        assert_eq!(ProbeV1::SCHEMA, fnv1a(FNV_OFFSET, all.as_bytes()));
    }

    #[test]
    fn fnv1a_agrees_with_its_published_test_value() {
        // Fowler, Noll, Vo: FNV-1a 64 of "foobar".
        assert_eq!(fnv1a(FNV_OFFSET, b"foobar"), 0x8594_4171_f739_67e8);
    }
}
