//! Bodies of the topics.

use super::definition::{message, structure};
use super::field::{Field, Value, total_size};
use super::header::HEADER_SCHEMA;
use super::schema::{Message, schema};
use crate::code::Mode;
use crate::text::ShortText;
use crate::time::Time;

message! {
    /// Topic `truth`: true state of the vehicle. For cameras and observers, never for the daemon.
    TruthV1 = "oqtal.Truth.v1" {
        /// Instant of this sample.
        time: Time ["ns"],
        /// Index of the camera frame taken at this instant, from 1; 0 between frames.
        capture: u64 ["-"],
        /// Position of the centre of mass.
        position: [f64; 3] ["m, world"],
        /// Velocity.
        velocity: [f64; 3] ["m/s, world"],
        /// Attitude, scalar last.
        attitude: [f64; 4] ["body to world"],
        /// Body rate.
        rate: [f64; 3] ["rad/s, body"],
    }
}

message! {
    /// Topic `pose`: a pose measured by motion capture.
    PoseV1 = "oqtal.Pose.v1" {
        /// Position.
        position: [f64; 3] ["m, world"],
        /// Attitude as measured, scalar last; not exactly of unit norm.
        attitude: [f64; 4] ["body to world"],
        /// Mean distance of the markers from the rigid body fitted to them; NaN if unknown.
        residual_m: f64 ["m"],
        /// Error of `captured_at` that 99 poses of 100 do not exceed, where it is estimated from a camera system's own clock; 0
        /// where it is exact.
        capture_uncertainty_s: f64 ["s"],
        /// Number of the rigid body in the camera system, from 1.
        body: u32 ["-"],
        /// 1 if the cameras see the body, 0 if they lost it: position and attitude are then invalid.
        tracked: u8 ["flag"],
        /// 1 if the pose is emulated or from a recording, 0 if cameras measured it.
        simulated: u8 ["flag"],
    }
}

message! {
    /// Topic `command`: the daemon's command to the vehicle.
    CommandV1 = "oqtal.Command.v1" {
        /// [`crate::code::Actuation`]: meaning of the numbers.
        actuation: u8 ["code"],
        /// Attitude sticks `[delta_r, delta_p, delta_y]` of Eq. (61); zero for torque. With an attitude: the rates that bring it
        /// about, for an axis whose rate the vehicle takes in place of its angle.
        sticks: [f64; 3] ["-1..1, body"],
        /// Torque; zero for other actuations.
        torque: [f64; 3] ["N m, body"],
        /// Attitude that the vehicle is to hold, or that sticks or torque are to bring about, scalar last; zeros if motors are
        /// off.
        attitude: [f64; 4] ["body to world"],
        /// Collective thrust `delta_c` of Eq. (61), as a share of the vehicle's greatest thrust.
        thrust: f64 ["0..1"],
    }
}

message! {
    /// Topic `vehicle`: state of the vehicle, from the plant or the bridge, once per command applied. A bridge publishes it in every
    /// period, with or without a command.
    VehicleV1 = "oqtal.Vehicle.v1" {
        /// Sequence of the command that this is about.
        command_sequence: u64 ["-"],
        /// Commands missed between those that arrived, in total.
        lost: u64 ["-"],
        /// Battery voltage; NaN if unknown.
        battery_v: f64 ["V"],
        /// Share of the latest requests to the vehicle that were answered; NaN if none are made.
        link_quality: f64 ["0..1"],
        /// Time of a command on the wire once its last byte was handed to it: computed from the rate of a line, measured by round trips
        /// over a network; 0 without a wire.
        wire_ns: i64 ["ns"],
        /// Known part of the time from a command's last byte on the wire to its effect; 0 if `applied_at` is the effect.
        air_ns: i64 ["ns"],
        /// Position by the vehicle's own estimator; NaN if it has none or does not report it.
        estimate_position: [f64; 3] ["m, world"],
        /// Attitude by the vehicle's own estimator, scalar last; zeros if it does not report it.
        estimate_attitude: [f64; 4] ["body to world"],
        /// Body rate by the vehicle's own gyroscope; void while the next is unset.
        body_rate: [f64; 3] ["rad/s, body"],
        /// Instant of that body rate: of its measurement, or of its arrival where the vehicle's clock is not known;
        /// [`Time::UNSET`] if the vehicle does not report it.
        body_rate_at: Time ["ns"],
        /// Instant of the last valid reply of a vehicle behind a bridge; [`Time::UNSET`] before it and for another vehicle.
        answered_at: Time ["ns"],
        /// Time without set-points after which the vehicle acts by itself, by its report or configuration; 0 if unknown.
        time_out_s: f64 ["s"],
        /// 1 if the motors run; 0 does not mean that they are off unless the link says that they are reported.
        armed: u8 ["flag"],
        /// 1 while the motors are being started; a flight begins when they run. With `armed` = 1: while they are being stopped.
        starting: u8 ["flag"],
        /// [`crate::code::VehicleLink`]: whether the vehicle answers, and reports the state of its motors.
        link: u8 ["code"],
        /// 1 while an operator's stop keeps the motors off, whatever is commanded.
        stopped: u8 ["flag"],
        /// 1 if the vehicle is simulated: only such a vehicle may take off without an operator.
        simulated: u8 ["flag"],
        /// [`crate::code::ControlHolder`]: holder of control over the vehicle.
        control: u8 ["code"],
        /// [`crate::code::VehicleRefusal`]: reason for which the last request was not executed.
        refusal: u8 ["code"],
        /// [`crate::code::EstimatorState`] of the vehicle itself.
        estimator: u8 ["code"],
        /// Last error text of the vehicle since its motors ran; padded with zeros.
        text: ShortText ["text"],
    }
}

message! {
    /// Topic `telemetry`: state, decisions and counters of the daemon in one tick.
    TelemetryV1 = "oqtal.Telemetry.v1" {
        /// Instant of the tick: when the daemon woke.
        time: Time ["ns"],
        /// Number of the tick, from 1.
        tick: u64 ["-"],
        /// Sequence of the command published in this tick.
        command_sequence: u64 ["-"],
        /// Time since the mission began; NaN before.
        mission_s: f64 ["s"],
        /// Time since the mission began at which its landing is planned; NaN before.
        planned_landing_s: f64 ["s"],
        /// Estimated position at the capture of the newest accepted pose, `pose_captured_at`; so are the next three.
        position: [f64; 3] ["m, world"],
        /// Estimated velocity.
        velocity: [f64; 3] ["m/s, world"],
        /// Estimated attitude, scalar last.
        attitude: [f64; 4] ["body to world"],
        /// Estimated body rate.
        rate: [f64; 3] ["rad/s, body"],
        /// Reference position.
        reference_position: [f64; 3] ["m, world"],
        /// Velocity of the reference; NaN when not flying, as the next.
        reference_velocity: [f64; 3] ["m/s, world"],
        /// Yaw of the reference.
        reference_yaw: f64 ["rad, world"],
        /// Velocity commanded by the position loops; NaN when not flying.
        velocity_command: [f64; 3] ["m/s, world"],
        /// Commanded attitude, scalar last; NaN when not flying.
        attitude_command: [f64; 4] ["body to world"],
        /// Attitude sticks sent.
        sticks: [f64; 3] ["-1..1, body"],
        /// Torque sent.
        torque: [f64; 3] ["N m, body"],
        /// Attitude sent, scalar last; zeros if motors are off.
        attitude_sent: [f64; 4] ["body to world"],
        /// Collective thrust sent, as a share of the vehicle's greatest thrust.
        thrust: f64 ["0..1"],
        /// Feedback of the errors of attitude and rate in the law's rotation command, before the limits; NaN when not flying, as the
        /// next three.
        proportional_term: [f64; 3] ["-1..1 or N m, body"],
        /// Integral action in that command.
        integral_term: [f64; 3] ["-1..1 or N m, body"],
        /// Motion of the reference and gyroscopic torque in that command.
        feed_forward_term: [f64; 3] ["-1..1 or N m, body"],
        /// Compensation of the estimated disturbance in that command.
        disturbance_term: [f64; 3] ["-1..1 or N m, body"],
        /// Age of the newest accepted pose at this tick; NaN if there was none yet.
        pose_age_s: f64 ["s"],
        /// Delay of the daemon's wake-up after the deadline it asked for, or after the pose's arrival.
        wakeup_lateness_ns: i64 ["ns"],
        /// Riccati equations solved so far, the first included.
        riccati_solves: u64 ["-"],
        /// Riccati equations that had no solution, so that the last gain was kept.
        riccati_failures: u64 ["-"],
        /// Ticks so far whose command was sent more than one period after it was due; it is due with its pose, or at the tick's deadline.
        deadline_misses: u64 ["-"],
        /// Camera frames that never became a pose, in total.
        poses_lost: u64 ["-"],
        /// Poses that were superseded by a newer one before the daemon read them, in total.
        poses_superseded: u64 ["-"],
        /// Poses refused by the guard, in total.
        poses_refused: u64 ["-"],
        /// Capture of the newest accepted pose, by its stamp; [`Time::UNSET`] before the first.
        pose_captured_at: Time ["ns"],
        /// Publication of that pose.
        pose_published_at: Time ["ns"],
        /// Number of its camera frame.
        pose_sequence: u64 ["-"],
        /// Position as measured.
        pose_position: [f64; 3] ["m, world"],
        /// Attitude as measured, scalar last.
        pose_attitude: [f64; 4] ["body to world"],
        /// Distance of the markers from the fitted body, as measured; NaN if unknown.
        pose_residual_m: f64 ["m"],
        /// Position at that capture by the motion tracker; NaN if the law does not fly on it, as the next three.
        filter_position: [f64; 3] ["m, world"],
        /// Velocity by the tracker.
        filter_velocity: [f64; 3] ["m/s, world"],
        /// Attitude by the tracker, scalar last.
        filter_attitude: [f64; 4] ["body to world"],
        /// Body rate by the tracker.
        filter_rate: [f64; 3] ["rad/s, body"],
        /// Measured position minus the one that the tracker expected; NaN for other laws and on the floor, as the next two.
        innovation_position: [f64; 3] ["m, world"],
        /// Rotation from the attitude expected by the tracker to the measured one.
        innovation_attitude: [f64; 3] ["rad, body"],
        /// Squares of both innovations over their expected variances, mean of the axes: 1 for a filter with a correct noise model.
        nis: [f64; 2] ["-"],
        /// Measured standard deviation of the position along each axis.
        pose_noise_m: f64 ["m"],
        /// Measured standard deviation of the attitude about each axis.
        pose_noise_rad: f64 ["rad, body"],
        /// Evidence that poses are not those of the vehicle, over its limits: rotation, direction of the path, drift of the attitude.
        pose_evidence: [f64; 3] ["-"],
        /// Rate over the commanded one by the model adapted in flight; NaN if none is, as the next four.
        adapted_rate_gain: [f64; 3] ["-, body"],
        /// Lag of the rate by that model.
        adapted_rate_lag_s: f64 ["s"],
        /// Delay of commands behind their reported effect by that model.
        adapted_delay_s: f64 ["s"],
        /// Thrust over the mass by that model, relative to the configured one.
        adapted_thrust_gain: f64 ["-"],
        /// Lag of the thrust by that model.
        adapted_thrust_lag_s: f64 ["s"],
        /// [`crate::obstacle::ArmingObstacles`]: conditions that prevent a flight; 0 in flight.
        obstacles: u32 ["-"],
        /// [`crate::code::Mode`]: activity of the daemon.
        mode: u8 ["code"],
        /// [`crate::code::SafetyState`] of the daemon.
        state: u8 ["code"],
        /// [`crate::code::Cause`] of the state.
        cause: u8 ["code"],
        /// `oqtal_control::trajectory::Phase` of the mission as a number.
        phase: u8 ["code"],
        /// 1 if this tick belongs to the scored window of the flight.
        scored: u8 ["flag"],
        /// 1 if this tick used a new pose, 0 if it acted on its deadline.
        fresh: u8 ["flag"],
        /// 1 while the adapted model predicts worse than the configured one, which is flown in its place.
        fell_back: u8 ["flag"],
        /// 1 if the attitude command hit its limit.
        saturated: u8 ["flag"],
        /// Times in this flight at which the fallback law took over from a law that failed.
        handovers: u64 ["-"],
        /// [`crate::code::HandoverCause`] of the last of them.
        handover_cause: u8 ["code"],
        /// 1 if the fallback law computed the command of this tick.
        fallback: u8 ["flag"],
    }
}

message! {
    /// Topic `input`: inputs of the daemon's loop, in the order in which it acted on them: enough to execute the same turns again
    /// from a recording of the other topics. Once for the start of the daemon, for each turn in which a sample was taken or a tick
    /// made, for each request of an operator, and for a loss of files.
    InputV1 = "oqtal.Input.v1" {
        /// Instant of the turn: when the daemon woke.
        time: Time ["ns"],
        /// Writer of the pose taken, as in its header; 0 if none was taken.
        pose_source: u64 ["-"],
        /// Number of the pose taken among those of its writer; 0 if none was taken.
        pose_number: u64 ["-"],
        /// Writer of the vehicle message taken, as in its header; 0 if none was taken.
        vehicle_source: u64 ["-"],
        /// Number of the vehicle message taken among those of its writer; 0 if none was taken.
        vehicle_number: u64 ["-"],
        /// Number of the message on topic `read/pose` with the pose as the daemon read it; 0 if no fault alters poses.
        pose_read: u64 ["-"],
        /// Number of the message on topic `read/vehicle` with the vehicle message as the daemon read it; 0 if no fault alters such messages.
        vehicle_read: u64 ["-"],
        /// Number of the message on topic `external` with the answer of an external law; 0 if none was asked.
        external_number: u64 ["-"],
        /// Writer of the reference taken, as in its header; 0 if none was taken.
        reference_source: u64 ["-"],
        /// Number of the reference taken among those of its writer; 0 if none was taken.
        reference_number: u64 ["-"],
        /// Sequence of the command published in this turn; 0 if no tick was made.
        command_sequence: u64 ["-"],
        /// Number of a request, as in [`super::EventV1`]; 0 for a request without such a message.
        event: u64 ["-"],
        /// [`crate::code::InputKind`] of this record.
        kind: u8 ["code"],
        /// [`crate::code::OperatorCommand`] of a request; at the start, of the one awaited from the command that started the daemon.
        request: u8 ["code"],
        /// [`crate::code::Answer`] to the request.
        answer: u8 ["code"],
        /// [`crate::code::Cause`] of a refusal; at the start, of the Stop in which the daemon begins.
        cause: u8 ["code"],
        /// 1 if the operator's stop was raised since the turn before.
        stop: u8 ["flag"],
        /// 1 if the daemon knew that the processes of the instance run with different configurations.
        configs_differ: u8 ["flag"],
        /// At the start: 1 if the automatic flight at start-up was cancelled.
        stays: u8 ["flag"],
    }
}

message! {
    /// Topic `reference`: the motion that a planner requests, in place of the configured trajectory.
    ReferenceV1 = "oqtal.Reference.v1" {
        /// Instant of this motion, by the clock of the flight. Between samples the daemon extrapolates from it.
        time: Time ["ns"],
        /// Instant until which the sample is followed, by the same clock.
        valid_until: Time ["ns"],
        /// [`crate::code::ReferenceKind`].
        kind: u8 ["code"],
        /// Position; of a reference of the attitude, only the height counts.
        position: [f64; 3] ["m, world"],
        /// Velocity.
        velocity: [f64; 3] ["m/s, world"],
        /// Acceleration.
        acceleration: [f64; 3] ["m/s^2, world"],
        /// Jerk.
        jerk: [f64; 3] ["m/s^3, world"],
        /// 3-2-1 yaw.
        yaw: f64 ["rad, world"],
        /// Rate of the yaw.
        yaw_rate: f64 ["rad/s, world"],
        /// Attitude as scalar-last quaternion, for a reference of the attitude.
        attitude: [f64; 4] ["body to world"],
        /// Body rate, for a reference of the attitude.
        rate: [f64; 3] ["rad/s, body"],
    }
}

message! {
    /// Topics `health/NAME`: health of a process, twice a second and on every change.
    HealthV1 = "oqtal.Health.v1" {
        /// Instant of this message, by the clock of the machine, whatever clock drives the flight.
        time: Time ["ns"],
        /// Hash of the effective configuration: processes with different hashes were started from different files. `OWN_CONFIG` for an
        /// emulated vehicle behind a radio, which need not agree.
        config_hash: u64 ["-"],
        /// [`crate::code::SafetyState`], for the daemon.
        state: u8 ["code"],
        /// [`crate::code::Mode`], for the daemon.
        mode: u8 ["code"],
        /// [`crate::code::Cause`] of the state, for the daemon.
        cause: u8 ["code"],
        /// Changes of the daemon's condition that are missing in its log.
        unlogged: u64 ["-"],
        /// Turns of the loop that ended more than a control period after they were due, in total.
        late_turns: u64 ["-"],
        /// 1 while the loop runs late: three turns in a row were late, and less than a second has passed since the last late one.
        runs_late: u8 ["flag"],
        /// [`crate::obstacle::ArmingObstacles`] of the daemon.
        obstacles: u32 ["-"],
    }
}

impl TelemetryV1 {
    /// Whether a mission is active, flown or only observed.
    pub fn is_armed(&self) -> bool {
        Mode::from_code(self.mode).is_some_and(Mode::is_armed)
    }
}

impl HealthV1 {
    /// The configuration hash of an emulated vehicle behind a radio: like that of a real one, its configuration is its own.
    pub const OWN_CONFIG: u64 = 0;

    /// The configuration hash \[-\]; `None` for a process whose configuration need not agree with that of the others.
    pub fn compared_config(&self) -> Option<u64> {
        Some(self.config_hash).filter(|hash| *hash != Self::OWN_CONFIG)
    }
}

message! {
    /// Topics `clock/NAME/advance`: the leader advances the virtual time of a process.
    TimeAdvanceV1 = "oqtal.TimeAdvance.v1" {
        /// The instant of the turn; [`Time::UNSET`] in the start barrier, before virtual time begins.
        now: Time ["ns"],
    }
}

message! {
    /// Topics `clock/NAME/done`: the process has executed its turn.
    TurnDoneV1 = "oqtal.TurnDone.v1" {
        /// Sequence number of the time advance that this answers.
        advance: u64 ["-"],
        /// The next event of the process; [`Time::UNSET`] for none.
        next: Time ["ns"],
        /// 1 if the process published something that the next process in the loop has to read at once.
        published: u8 ["flag"],
    }
}
