//! Packets from the host to the vehicle, by their meaning.

use super::logging::{LogBlock, SETTINGS};
use super::packet::{CrtpPacket, CrtpPort};
use super::pose::{CrtpPose, FULL_POSE, PACKED_POSES, PackedPoses};
use super::setpoint::LegacySetpoint;
use super::supervision::SupervisorCommand;
use super::table::{ELEMENT, INFO, TableKind};
use super::value::CrtpValue;

/// Commands of the log port's settings.
pub(super) const START_BLOCK: u8 = 3;
pub(super) const RESET_LOGGING: u8 = 5;
pub(super) const CREATE_BLOCK: u8 = 6;

/// Reads the supervisor's state.
pub(super) const GET_STATE: u8 = 0x0C;

/// Message of a host.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CrtpRequest {
    /// Nothing; a radio sends it so that the vehicle can answer.
    Null,
    /// Bytes that the vehicle sends back.
    Echo(u64),
    /// Asks for the source identification of the link service.
    Source,
    /// Asks for the protocol version.
    ProtocolVersion,
    /// Asks for the supervisor's state, from protocol 12 on.
    Supervision,
    /// Command to the supervisor by its own port, from protocol 12 on.
    Supervisor(SupervisorCommand),
    /// The same command by the ports that had it before.
    LegacySupervisor(SupervisorCommand),
    /// Set-point of roll, pitch, yaw rate and thrust.
    Setpoint(LegacySetpoint),
    /// Stops the motors; not latched.
    Stop,
    /// No further set-points follow; the last one remains valid for this time \[ms\].
    EndOfSetpoints(u32),
    /// Pose of the vehicle that receives it.
    Pose(CrtpPose),
    /// Poses of several vehicles.
    Poses(PackedPoses),
    /// Asks for size and CRC of a table.
    TableInfo(TableKind),
    /// Asks for an element of a table by its number.
    TableElement(TableKind, u16),
    /// Reads a parameter by its number.
    ReadParameter(u16),
    /// Writes a parameter by its number.
    WriteParameter(u16, CrtpValue),
    /// Asks how many memories there are.
    MemoryCount,
    /// Deletes all log blocks.
    ResetLogging,
    /// Makes a log block.
    CreateBlock(LogBlock),
    /// Starts a log block.
    StartBlock {
        /// Number of the block \[-\].
        id: u8,
        /// Period \[10 ms\].
        period: u8,
    },
}

impl CrtpRequest {
    /// The packet of this message.
    pub fn packet(&self) -> CrtpPacket {
        let of = CrtpPacket::new;
        match self {
            Self::Null => CrtpPacket::NULL,
            // The first byte marks a measurement of the delay.
            Self::Echo(stamp) => of(CrtpPort::LinkService, 0, &[0]).with(&stamp.to_le_bytes()),
            Self::Source => of(CrtpPort::LinkService, 1, &[0]),
            Self::ProtocolVersion => of(CrtpPort::Platform, 1, &[0]),
            Self::Supervision => of(CrtpPort::Supervisor, 0, &[GET_STATE]),
            Self::Supervisor(command) => supervisor(*command),
            Self::LegacySupervisor(command) => legacy_supervisor(*command),
            Self::Setpoint(setpoint) => setpoint.packet(),
            Self::Stop => of(CrtpPort::GenericCommander, 0, &[0]),
            Self::EndOfSetpoints(millis) => {
                of(CrtpPort::GenericCommander, 1, &[0]).with(&millis.to_le_bytes())
            }
            Self::Pose(pose) => pose.packet(),
            Self::Poses(poses) => poses.packet(),
            Self::TableInfo(table) => table.packet(INFO),
            Self::TableElement(table, id) => table.packet(ELEMENT).with(&id.to_le_bytes()),
            Self::ReadParameter(id) => of(CrtpPort::Parameters, 1, &id.to_le_bytes()),
            Self::WriteParameter(id, value) => {
                of(CrtpPort::Parameters, 2, &id.to_le_bytes()).with(value.as_bytes())
            }
            Self::MemoryCount => of(CrtpPort::Memory, 0, &[1]),
            Self::ResetLogging => of(CrtpPort::Logging, SETTINGS, &[RESET_LOGGING]),
            Self::CreateBlock(block) => block.create_packet(CREATE_BLOCK),
            Self::StartBlock { id, period } => {
                of(CrtpPort::Logging, SETTINGS, &[START_BLOCK, *id, *period])
            }
        }
    }

    /// The message of `packet`; `None` if it is not known here.
    pub fn read(packet: &CrtpPacket) -> Option<Self> {
        if packet.is_null() {
            return Some(Self::Null);
        }
        let payload = packet.payload();
        match (CrtpPort::from_wire(packet.port())?, packet.channel()) {
            (CrtpPort::LinkService, 0) => match payload {
                [0, stamp @ ..] => Some(Self::Echo(u64::from_le_bytes(stamp.try_into().ok()?))),
                _ => None,
            },
            (CrtpPort::LinkService, 1) => Some(Self::Source),
            (CrtpPort::Platform, 1) => {
                (payload.first() == Some(&0)).then_some(Self::ProtocolVersion)
            }
            (CrtpPort::Platform, 0) => read_platform(payload),
            (CrtpPort::Supervisor, channel) => read_supervisor(channel, payload),
            (CrtpPort::Commander, 0) => LegacySetpoint::read(payload).map(Self::Setpoint),
            (CrtpPort::GenericCommander, channel) => read_generic(channel, payload),
            (CrtpPort::Localization, 1) => read_localization(payload),
            (CrtpPort::Parameters, 0) => read_table(TableKind::Parameters, payload),
            (CrtpPort::Logging, 0) => read_table(TableKind::Logging, payload),
            (CrtpPort::Parameters, channel) => read_parameter(channel, payload),
            (CrtpPort::Memory, 0) => (payload.first() == Some(&1)).then_some(Self::MemoryCount),
            (CrtpPort::Logging, SETTINGS) => read_logging(payload),
            _ => None,
        }
    }
}

fn supervisor(command: SupervisorCommand) -> CrtpPacket {
    let of = |payload: &[u8]| CrtpPacket::new(CrtpPort::Supervisor, 1, payload);
    match command {
        SupervisorCommand::Arm(arm) => of(&[1, u8::from(arm)]),
        SupervisorCommand::Recover => of(&[2]),
        SupervisorCommand::EmergencyStop => of(&[3]),
        SupervisorCommand::KeepAlive => of(&[4]),
    }
}

fn legacy_supervisor(command: SupervisorCommand) -> CrtpPacket {
    match command {
        SupervisorCommand::Arm(arm) => CrtpPacket::new(CrtpPort::Platform, 0, &[1, u8::from(arm)]),
        SupervisorCommand::Recover => CrtpPacket::new(CrtpPort::Platform, 0, &[2]),
        SupervisorCommand::EmergencyStop => CrtpPacket::new(CrtpPort::Localization, 1, &[3]),
        SupervisorCommand::KeepAlive => CrtpPacket::new(CrtpPort::Localization, 1, &[4]),
    }
}

fn read_platform(payload: &[u8]) -> Option<CrtpRequest> {
    let command = match payload {
        [1, arm, ..] => SupervisorCommand::Arm(*arm != 0),
        [2, ..] => SupervisorCommand::Recover,
        _ => return None,
    };
    Some(CrtpRequest::LegacySupervisor(command))
}

fn read_supervisor(channel: u8, payload: &[u8]) -> Option<CrtpRequest> {
    let command = match (channel, payload) {
        (0, [GET_STATE, ..]) => return Some(CrtpRequest::Supervision),
        (1, [1, arm, ..]) => SupervisorCommand::Arm(*arm != 0),
        (1, [2, ..]) => SupervisorCommand::Recover,
        (1, [3, ..]) => SupervisorCommand::EmergencyStop,
        (1, [4, ..]) => SupervisorCommand::KeepAlive,
        _ => return None,
    };
    Some(CrtpRequest::Supervisor(command))
}

fn read_generic(channel: u8, payload: &[u8]) -> Option<CrtpRequest> {
    match (channel, payload) {
        (0, [0, ..]) => Some(CrtpRequest::Stop),
        (1, [0, millis @ ..]) => {
            millis.try_into().ok().map(u32::from_le_bytes).map(CrtpRequest::EndOfSetpoints)
        }
        _ => None,
    }
}

fn read_localization(payload: &[u8]) -> Option<CrtpRequest> {
    let legacy = |command| Some(CrtpRequest::LegacySupervisor(command));
    match payload {
        [3] => legacy(SupervisorCommand::EmergencyStop),
        [4] => legacy(SupervisorCommand::KeepAlive),
        [FULL_POSE, fields @ ..] => CrtpPose::read(fields).map(CrtpRequest::Pose),
        [PACKED_POSES, fields @ ..] => Some(CrtpRequest::Poses(PackedPoses::read(fields))),
        _ => None,
    }
}

fn read_table(table: TableKind, payload: &[u8]) -> Option<CrtpRequest> {
    match payload {
        [INFO, ..] => Some(CrtpRequest::TableInfo(table)),
        [ELEMENT, low, high, ..] => {
            Some(CrtpRequest::TableElement(table, u16::from_le_bytes([*low, *high])))
        }
        _ => None,
    }
}

fn read_parameter(channel: u8, payload: &[u8]) -> Option<CrtpRequest> {
    let (id, value) = payload.split_first_chunk()?;
    let id = u16::from_le_bytes(*id);
    match channel {
        1 => Some(CrtpRequest::ReadParameter(id)),
        2 => CrtpValue::from_wire(value).map(|value| CrtpRequest::WriteParameter(id, value)),
        _ => None,
    }
}

fn read_logging(payload: &[u8]) -> Option<CrtpRequest> {
    match payload {
        [RESET_LOGGING, ..] => Some(CrtpRequest::ResetLogging),
        [CREATE_BLOCK, id, fields @ ..] => {
            LogBlock::read(*id, fields).map(CrtpRequest::CreateBlock)
        }
        [START_BLOCK, id, period, ..] => Some(CrtpRequest::StartBlock { id: *id, period: *period }),
        _ => None,
    }
}
