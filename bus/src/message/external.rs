//! Bodies of the topics `state` and `external`: the question to an external attitude law, and its answer. Every field has 8 bytes, so that
//! the encoded bodies are the structures of `examples/external_law/oqtal_law.h`.

use super::definition::{message, structure};
use super::field::{Field, Value, total_size};
use super::header::HEADER_SCHEMA;
use super::schema::{Message, schema};
use crate::time::Time;

message! {
    /// Topic `state`: state and reference for the instant at which the command of a tick takes effect, as passed to an external
    /// law.
    StateV1 = "oqtal.State.v1" {
        /// Number of this question since the daemon started, from 1.
        sequence: u64 ["-"],
        /// Number of the flight since the daemon started, from 1: a law restarts its integrals when it changes.
        flight: u64 ["-"],
        /// 1 if the answer to the last question was flown; a law may stop its integrals while it is 0.
        flown: u64 ["-"],
        /// Instant of the tick.
        time: Time ["ns"],
        /// Predicted instant of the command's effect, for which state and reference are given.
        acts_at: Time ["ns"],
        /// Instant after which an answer is not used; [`Time::UNSET`] in virtual time.
        answer_by: Time ["ns"],
        /// Period of the loop.
        period_s: f64 ["s"],
        /// Position.
        position: [f64; 3] ["m, world"],
        /// Velocity.
        velocity: [f64; 3] ["m/s, world"],
        /// Attitude, scalar last.
        attitude: [f64; 4] ["body to world"],
        /// Body rate.
        rate: [f64; 3] ["rad/s, body"],
        /// Thrust along body z.
        thrust: f64 ["N"],
        /// Estimated acceleration by causes other than thrust, weight and drag.
        acceleration_bias: [f64; 3] ["m/s^2, world"],
        /// Estimated error of the rotation command: subtract it from the rates; of a vehicle commanded by torque, an angular
        /// acceleration.
        demand_bias: [f64; 3] ["rad/s or rad/s^2, body"],
        /// Reference position.
        reference_position: [f64; 3] ["m, world"],
        /// Velocity of the reference; zero where its position jumps.
        reference_velocity: [f64; 3] ["m/s, world"],
        /// Yaw of the reference.
        reference_yaw: f64 ["rad, world"],
        /// Attitude prescribed in place of the horizontal position, scalar last; NaN if none is.
        reference_attitude: [f64; 4] ["body to world"],
        /// Body rate of the prescribed attitude; NaN if none is.
        reference_rate: [f64; 3] ["rad/s, body"],
        /// Rates that the fallback law commands in this tick.
        fallback_rate: [f64; 3] ["rad/s, body"],
        /// Torque that it commands.
        fallback_torque: [f64; 3] ["N m, body"],
        /// Attitude that it commands, scalar last.
        fallback_attitude: [f64; 4] ["body to world"],
        /// Thrust that it commands.
        fallback_thrust: f64 ["N"],
        /// Mass of the vehicle in the model that predicts the state: the configured one, or the adapted one.
        mass: f64 ["kg"],
        /// Gravity, along -z of the world.
        gravity: f64 ["m/s^2"],
        /// Greatest thrust.
        greatest_thrust: f64 ["N"],
        /// Greatest rate that can be commanded about each axis.
        greatest_rate: [f64; 3] ["rad/s, body"],
        /// Greatest torque about each axis.
        greatest_torque: f64 ["N m, body"],
        /// Acceleration of the reference, also of a `goto` or a stop on the way; zero where a planner sends none, or where its references
        /// do not continue one another.
        reference_acceleration: [f64; 3] ["m/s^2, world"],
        /// Jerk of the trajectory or of the planner; zero on the way of a `goto` and where a planner sends none.
        reference_jerk: [f64; 3] ["m/s^3, world"],
    }
}

message! {
    /// Topic `external`: the command of an external law. An answer has the fields up to `thrust`; the daemon adds the others.
    ExternalV1 = "oqtal.External.v1" {
        /// Number of the question that is answered: `sequence` of [`StateV1`]; 0 without an answer.
        sequence: u64 ["-"],
        /// Commanded rates, for a vehicle with `vehicle.interface` "rate"; for one with "attitude", sent with the attitude.
        rate: [f64; 3] ["rad/s, body"],
        /// Commanded torque, for a vehicle with `vehicle.interface` "torque".
        torque: [f64; 3] ["N m, body"],
        /// Commanded attitude, scalar last, for a vehicle with `vehicle.interface` "attitude"; not used by others.
        attitude: [f64; 4] ["body to world"],
        /// Commanded thrust along body z.
        thrust: f64 ["N"],
        /// Number of the question of this tick.
        question: u64 ["-"],
        /// Instant at which the question was sent.
        asked_at: Time ["ns"],
        /// Instant at which the answer was received, the answer to an earlier question with this one; [`Time::UNSET`] without an
        /// answer.
        answered_at: Time ["ns"],
        /// [`crate::code::HandoverCause`]: reason against the answer; 0 if there is none.
        verdict: u8 ["code"],
        /// 1 if the answer is the command of this tick, unchanged or in transition to it.
        flown: u8 ["flag"],
    }
}
