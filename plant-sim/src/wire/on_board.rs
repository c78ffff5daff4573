//! Emulated on-board computer: commands to motors and set-points, answers. Pure.
//!
//! The computer flies by the newest command that it could decode. The command's checksum is a sum of words: a pair of wrong bits
//! passes if one is set and the other cleared at the same place of two words. Values out of range are rejected as well; the others
//! are flown. At one wrong bit in a hundred a quarter of the commands can be decoded, and of these six in a thousand are wrong
//! (`six_commands_in_a_thousand_are_wrong_at_one_wrong_bit_in_a_hundred`): one every eleven seconds at 60 Hz, which acts until the
//! next one is decoded.

use oqtal_bus::code::Actuation;
use oqtal_bus::message::{CommandV1, TruthV1};
use oqtal_bus::time::{Span, Time};
use oqtal_config::PlantOptions;
use oqtal_control::euler::EulerAngles;
use oqtal_control::quaternion::Attitude;
use oqtal_wire::asctec::{
    ControlInput, Descriptor, HostCommand, Imu, LlStatus, MAX_TELEMETRY, Poll, Scales, Status,
    StickMeaning, Sticks, acknowledgement_frame,
};

use super::motors::MotorSwitch;

/// Height above which the vehicle reports that it flies \[m\].
const FLYING_M: f64 = 0.05;

/// Measurements of the on-board computer.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    /// Motion of the vehicle; its own sensors are perfect.
    pub truth: TruthV1,
    /// Battery voltage \[V\].
    pub battery_v: f64,
}

/// On-board computer of a Hummingbird.
#[derive(Clone, Debug)]
pub struct OnBoard {
    scales: Scales,
    /// Gain of the vehicle's attitude loop \[1/s\].
    attitude_gain: f64,
    timeout: Span,
    motors: MotorSwitch,
    sticks: Sticks,
    received_at: Option<Time>,
}

impl OnBoard {
    /// The on-board computer of `plant` with these scales.
    #[must_use]
    pub fn new(plant: &PlantOptions, scales: Scales) -> Self {
        let millis = |millis: f64| Span::from_seconds(millis * 1e-3);
        Self {
            scales,
            attitude_gain: plant.attitude_gain_per_s,
            timeout: millis(plant.wire.time_out_ms),
            motors: MotorSwitch::new(millis(plant.wire.motor_switch_ms)),
            sticks: Sticks::default(),
            received_at: None,
        }
    }

    /// Instant at which the motors stop if no command arrives.
    #[must_use]
    pub fn next_event(&self) -> Option<Time> {
        self.received_at.map(|at| at + self.timeout)
    }

    /// Stops the motors if the command timeout has passed at `now`.
    pub fn tick(&mut self, now: Time) {
        if self.next_event().is_some_and(|at| at <= now) {
            self.received_at = None;
            self.halt();
        }
    }

    /// Executes a message, and appends the reply to `answer`.
    pub fn execute(
        &mut self,
        now: Time,
        command: &HostCommand,
        measured: &Measured,
        answer: &mut Vec<u8>,
    ) {
        match command {
            HostCommand::Control(input) => {
                self.control(now, input);
                answer.extend(acknowledgement_frame(Descriptor::ControlInput));
            }
            HostCommand::Poll(poll) => self.report(now, *poll, measured, answer),
            HostCommand::EmergencyStop => self.halt(),
        }
    }

    /// Command that the vehicle follows in the state `truth`; "disarmed" while the motors are stopped.
    #[must_use]
    pub fn command(&self, truth: &TruthV1) -> CommandV1 {
        if !self.motors.is_running() {
            return CommandV1::default();
        }
        let Sticks { roll, pitch, yaw, thrust } = self.sticks;
        let base = CommandV1 { thrust, ..CommandV1::default() };
        match self.scales.sticks {
            StickMeaning::BodyRate => CommandV1 {
                actuation: Actuation::Sticks.code(),
                sticks: [roll, pitch, yaw],
                ..base
            },
            StickMeaning::Attitude => {
                // The heading ahead of the present one towards which the attitude loop turns at the commanded yaw rate.
                let yaw = angles(truth).yaw + yaw / self.attitude_gain;
                let attitude = EulerAngles { roll, pitch, yaw }.xyzw();
                CommandV1 { actuation: Actuation::Attitude.code(), attitude, ..base }
            }
        }
    }

    /// Whether the motors run.
    #[must_use]
    pub fn motors_run(&self) -> bool {
        self.motors.is_running()
    }

    fn control(&mut self, now: Time, input: &ControlInput) {
        self.received_at = Some(now);
        let takes = |axis: i16| input.enabled & axis != 0;
        let switches = self.scales.is_motor_switch(input)
            && takes(ControlInput::ENABLE_YAW)
            && takes(ControlInput::ENABLE_THRUST);
        self.motors.command(now, switches);
        // Axes that the host does not command are the pilot's, who keeps the sticks centred.
        let centred = |axis: i16, counts: i16| if takes(axis) { counts } else { 0 };
        self.sticks = self.scales.decode(&ControlInput {
            pitch: centred(ControlInput::ENABLE_PITCH, input.pitch),
            roll: centred(ControlInput::ENABLE_ROLL, input.roll),
            yaw: if switches { 0 } else { centred(ControlInput::ENABLE_YAW, input.yaw) },
            thrust: centred(ControlInput::ENABLE_THRUST, input.thrust),
            enabled: input.enabled,
        });
    }

    fn halt(&mut self) {
        self.motors.stop();
        self.sticks = Sticks::default();
    }

    fn report(&self, now: Time, poll: Poll, measured: &Measured, answer: &mut Vec<u8>) {
        let mut frame = [0; MAX_TELEMETRY];
        if poll.contains(Poll::LL_STATUS) {
            let length = self.status(now, measured).write_frame(&mut frame);
            answer.extend(&frame[..length]);
        }
        if poll.contains(Poll::IMU_CALC) {
            let length = self.scales.encode_imu(&imu(measured)).write_frame(&mut frame);
            answer.extend(&frame[..length]);
        }
    }

    fn status(&self, now: Time, measured: &Measured) -> LlStatus {
        let status = Status {
            battery_v: measured.battery_v,
            motors_on: self.motors.is_running(),
            flying: measured.truth.position[2] > FLYING_M,
        };
        let up_time = self.motors.up_time(now).seconds().min(f64::from(i16::MAX)) as i16;
        LlStatus { up_time, ..status.into() }
    }
}

fn angles(truth: &TruthV1) -> EulerAngles {
    let attitude = Attitude::from_xyzw(truth.attitude).unwrap_or_default();
    EulerAngles::from_attitude(&attitude)
}

fn imu(measured: &Measured) -> Imu {
    let truth = &measured.truth;
    Imu {
        angles: angles(truth).vector().into(),
        rate: truth.rate,
        height: truth.position[2],
        climb: truth.velocity[2],
    }
}
