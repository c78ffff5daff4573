//! True motion of a vehicle from the simulator within its autopilot, over MAVLink: `SIM_STATE` of ArduPilot,
//! `HIL_STATE_QUATERNION` of PX4, and the request for them.

use mavlink::dialects::common::{
    COMMAND_LONG_DATA, HIL_STATE_QUATERNION_DATA, MavAutopilot, MavCmd, MavMessage, SIM_STATE_DATA,
};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, Message};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::stream::{Decoder, Grammar, Verdict};

/// System and component ids of this end: a program on the ground that controls nothing.
const OWN_SYSTEM: u32 = 254;
const OWN_COMPONENT: u8 = 191;
/// Time between two reports that is asked for \[us\]; an autopilot sends as often as it can, up to that.
const INTERVAL_US: f32 = 4000.0;
/// Ids of the messages that carry the truth.
const TRUTH_MESSAGES: [f32; 2] = [108.0, 115.0];
/// Radius of the earth at the equator \[m\], by which simulators of vehicles place them on a plane.
const EARTH_M: f64 = 6_378_137.0;
/// One count of latitude and longitude \[rad\].
const DEGREE_E7: f64 = 1e-7 * std::f64::consts::PI / 180.0;

/// Bytes of a MAVLink 2 packet around its payload: start, header, checksum \[bytes\].
const AROUND_PAYLOAD: usize = 12;
/// Bytes of a signature \[bytes\].
const SIGNATURE: usize = 13;
/// Bit of the incompatibility flags of a signed packet.
const SIGNED: u8 = 1;

/// Motion of a vehicle as its simulator reports it, in axes north, east, down and forward, right, down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedMotion {
    /// Position from a point that all reports share \[m, north-east-down\].
    pub position: Vector3<f64>,
    /// Step in which the position is reported, by axis \[m\].
    pub step: Vector3<f64>,
    /// Velocity \[m/s, north-east-down\].
    pub velocity: Vector3<f64>,
    /// Attitude \[forward-right-down to north-east-down\].
    pub attitude: UnitQuaternion<f64>,
    /// Rate \[rad/s, forward-right-down\].
    pub rate: Vector3<f64>,
}

/// What a packet says to one who wants the truth.
#[derive(Clone, Debug)]
enum SimulatorReport {
    /// An autopilot is there: its system and component ids.
    Heartbeat(u8, u8),
    /// True motion: position in counts, and what else is reported.
    Motion(SurveyedMotion),
}

/// Motion with its position on the earth.
#[derive(Clone, Copy, Debug)]
struct SurveyedMotion {
    /// Latitude and longitude \[1e-7 deg\].
    degrees_e7: [i32; 2],
    /// Altitude \[m\], and the step in which it is reported \[m\].
    altitude: (f64, f64),
    velocity: [f64; 3],
    /// Scalar first.
    attitude: [f32; 4],
    rate: [f32; 3],
}

/// Decoder of the truth in a stream of MAVLink packets, whatever else the stream carries.
#[derive(Debug, Default)]
pub struct SimulatorDecoder {
    packets: Decoder<MavlinkPackets>,
    /// Latitude and longitude of the first report \[1e-7 deg\].
    reference: Option<[i32; 2]>,
}

/// Packets of MAVLink 2.
#[derive(Clone, Copy, Debug)]
struct MavlinkPackets;

impl Grammar for MavlinkPackets {
    type Event = SimulatorReport;

    const START: u8 = 0xFD;

    fn inspect(bytes: &[u8]) -> Verdict<SimulatorReport> {
        let [_, length, flags, ..] = bytes else { return Verdict::Wait(3) };
        let signature = if flags & SIGNED == 0 { 0 } else { SIGNATURE };
        let length = usize::from(*length) + AROUND_PAYLOAD + signature;
        if flags & !SIGNED != 0 {
            return Verdict::Noise;
        }
        if bytes.len() < length {
            return Verdict::Wait(length);
        }
        let mut packet = MAVLinkV2MessageRaw::new();
        packet.as_mut_slice()[..length].copy_from_slice(&bytes[..length]);
        let id = packet.message_id();
        if <MavMessage as Message>::extra_crc(id) == 0 {
            // Messages of other dialects have checksums that are not known here.
            return Verdict::Accept(length, None);
        }
        if packet.has_valid_crc::<MavMessage>() {
            Verdict::Accept(length, report(&packet))
        } else {
            Verdict::Damaged
        }
    }
}

fn report(packet: &MAVLinkV2MessageRaw) -> Option<SimulatorReport> {
    let message =
        MavMessage::parse(mavlink::MavlinkVersion::V2, packet.message_id(), packet.payload());
    match message.ok()? {
        MavMessage::HEARTBEAT(heartbeat)
            if heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID =>
        {
            let system = u8::try_from(packet.system_id()).ok()?;
            Some(SimulatorReport::Heartbeat(system, packet.component_id()))
        }
        MavMessage::SIM_STATE(state) => Some(SimulatorReport::Motion(sim_state(&state))),
        MavMessage::HIL_STATE_QUATERNION(state) => Some(SimulatorReport::Motion(hil_state(&state))),
        _ => None,
    }
}

fn sim_state(state: &SIM_STATE_DATA) -> SurveyedMotion {
    SurveyedMotion {
        degrees_e7: [state.lat_int, state.lon_int],
        altitude: (f64::from(state.alt), 0.0),
        velocity: [state.vn, state.ve, state.vd].map(f64::from),
        attitude: [state.q1, state.q2, state.q3, state.q4],
        rate: [state.xgyro, state.ygyro, state.zgyro],
    }
}

fn hil_state(state: &HIL_STATE_QUATERNION_DATA) -> SurveyedMotion {
    SurveyedMotion {
        degrees_e7: [state.lat, state.lon],
        altitude: (f64::from(state.alt) * 1e-3, 1e-3),
        velocity: [state.vx, state.vy, state.vz].map(|speed| f64::from(speed) * 1e-2),
        attitude: state.attitude_quaternion,
        rate: [state.rollspeed, state.pitchspeed, state.yawspeed],
    }
}

impl SimulatorDecoder {
    /// Takes received bytes, and passes what they report to `heartbeat` (system and component ids) and `motion`.
    pub fn push(
        &mut self,
        bytes: &[u8],
        mut heartbeat: impl FnMut(u8, u8),
        mut motion: impl FnMut(ReportedMotion),
    ) {
        for report in self.packets.push(bytes) {
            match report {
                SimulatorReport::Heartbeat(system, component) => heartbeat(system, component),
                SimulatorReport::Motion(surveyed) => {
                    let reference = *self.reference.get_or_insert(surveyed.degrees_e7);
                    motion(surveyed.on_plane(reference));
                }
            }
        }
    }
}

impl SurveyedMotion {
    /// The motion on the plane that touches the earth at `reference`.
    fn on_plane(&self, reference: [i32; 2]) -> ReportedMotion {
        let [latitude, longitude] = [0, 1].map(|axis| {
            (f64::from(self.degrees_e7[axis]) - f64::from(reference[axis])) * DEGREE_E7 * EARTH_M
        });
        let narrowing = (f64::from(reference[0]) * DEGREE_E7).cos();
        let (altitude, altitude_step) = self.altitude;
        let step = DEGREE_E7 * EARTH_M;
        let [w, x, y, z] = self.attitude.map(f64::from);
        ReportedMotion {
            position: Vector3::new(latitude, longitude * narrowing, -altitude),
            step: Vector3::new(step, step * narrowing, altitude_step),
            velocity: self.velocity.into(),
            attitude: UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)),
            rate: self.rate.map(f64::from).into(),
        }
    }
}

/// Packets that ask the autopilot with these ids for its simulator's truth; `sequence` counts the packets of this end.
#[must_use]
pub fn truth_requests(system: u8, component: u8, sequence: u8) -> [Vec<u8>; 2] {
    let number = [0, 1].map(|packet| sequence.wrapping_add(packet));
    std::array::from_fn(|index| {
        let command = COMMAND_LONG_DATA {
            target_system: system,
            target_component: component,
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            param1: TRUTH_MESSAGES[index],
            param2: INTERVAL_US,
            ..COMMAND_LONG_DATA::default()
        };
        packet(number[index], &MavMessage::COMMAND_LONG(command))
    })
}

fn packet(sequence: u8, message: &MavMessage) -> Vec<u8> {
    let header = MavHeader { system_id: OWN_SYSTEM, component_id: OWN_COMPONENT, sequence };
    let mut packet = MAVLinkV2MessageRaw::new();
    packet.serialize_message(header, message);
    packet.raw_bytes().to_vec()
}
