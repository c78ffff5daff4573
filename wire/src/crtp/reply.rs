//! Packets from the vehicle to the host, by their meaning.

use super::logging::{DATA, LogFields, SETTINGS, put_value};
use super::packet::{CrtpPacket, CrtpPort};
use super::request::{CREATE_BLOCK, GET_STATE, RESET_LOGGING, START_BLOCK};
use super::supervision::{Supervision, SupervisorCommand};
use super::table::{ELEMENT, INFO, TableElement, TableInfo, TableKind};
use super::value::{CrtpValue, LogType};
use crate::bytes::{ByteOrder, ByteReader};

/// Text by which a Crazyflie names itself.
const SOURCE: &[u8] = b"Bitcraze Crazyflie";
/// Bit that marks an answer of the supervisor.
const ANSWER: u8 = 0x80;

/// Settings of the log port, in answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum LogCommand {
    /// A block was to be started.
    Start = START_BLOCK,
    /// All blocks were to be deleted.
    Reset = RESET_LOGGING,
    /// A block was to be made.
    Create = CREATE_BLOCK,
}

impl LogCommand {
    const ALL: [Self; 3] = [Self::Start, Self::Reset, Self::Create];
}

/// Message of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CrtpReply<'a> {
    /// Nothing.
    Null,
    /// A piece of text.
    Console(&'a [u8]),
    /// The bytes that the host sent.
    Echo(u64),
    /// A Crazyflie is there.
    Source,
    /// Version of the protocol \[-\].
    ProtocolVersion(u8),
    /// State of the supervisor.
    Supervision(Supervision),
    /// Answer to a request to arm, to disarm or to recover: whether it was granted.
    Granted(SupervisorAnswer),
    /// Size and CRC of a table.
    TableInfo(TableKind, TableInfo),
    /// Element of a table.
    TableElement(TableKind, TableElement<'a>),
    /// The table has no element of the requested number.
    NoElement(TableKind),
    /// Value of a parameter that was read.
    Parameter(u16, CrtpValue),
    /// Value of a parameter that was written.
    Written(u16, CrtpValue),
    /// Unknown parameter.
    NoParameter(u16),
    /// Number of memories \[-\].
    MemoryCount(u8),
    /// Answer to a setting of the log port: block, and 0 or the reason for a refusal \[-\].
    Log(LogCommand, u8, u8),
    /// Values of a log block.
    LogData {
        /// The block \[-\].
        block: u8,
        /// Clock of the vehicle, which wraps after 4.66 h \[ms\].
        clock_ms: u32,
        /// The values.
        values: LogFields<'a>,
    },
}

/// Answer of a vehicle's supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupervisorAnswer {
    /// Whether arming was requested, and not recovery.
    pub is_arming: bool,
    /// Whether the request was granted.
    pub granted: bool,
}

impl<'a> CrtpReply<'a> {
    /// The message of `packet`; `None` if it is not known here.
    pub fn read(packet: &'a CrtpPacket) -> Option<Self> {
        if packet.is_null() {
            return Some(Self::Null);
        }
        let payload = packet.payload();
        match (CrtpPort::from_wire(packet.port())?, packet.channel()) {
            (CrtpPort::Console, 0) => Some(Self::Console(payload)),
            (CrtpPort::LinkService, 0) => match payload {
                [0, stamp @ ..] => Some(Self::Echo(u64::from_le_bytes(stamp.try_into().ok()?))),
                _ => None,
            },
            (CrtpPort::LinkService, 1) => payload.starts_with(SOURCE).then_some(Self::Source),
            (CrtpPort::Platform, 1) => match payload {
                [0, version, ..] => Some(Self::ProtocolVersion(*version)),
                _ => None,
            },
            (CrtpPort::Platform, 0) => read_granted(payload),
            (CrtpPort::Supervisor, _) => read_supervisor(payload),
            (CrtpPort::Parameters, 0) => read_table(TableKind::Parameters, payload),
            (CrtpPort::Logging, 0) => read_table(TableKind::Logging, payload),
            (CrtpPort::Parameters, channel) => read_parameter(channel, payload),
            (CrtpPort::Memory, 0) => match payload {
                [1, count, ..] => Some(Self::MemoryCount(*count)),
                _ => None,
            },
            (CrtpPort::Logging, SETTINGS) => read_logging(payload),
            (CrtpPort::Logging, DATA) => read_data(payload),
            _ => None,
        }
    }

    /// Packet of this reply. Packets of log data are made by [`CrtpReply::log_data`].
    pub fn packet(&self) -> CrtpPacket {
        let of = CrtpPacket::new;
        match self {
            Self::Null => CrtpPacket::NULL,
            Self::Console(text) => of(CrtpPort::Console, 0, text),
            Self::Echo(stamp) => of(CrtpPort::LinkService, 0, &[0]).with(&stamp.to_le_bytes()),
            Self::Source => {
                let padding = [0; super::MAX_CRTP_PAYLOAD - SOURCE.len()];
                of(CrtpPort::LinkService, 1, SOURCE).with(&padding)
            }
            Self::ProtocolVersion(version) => of(CrtpPort::Platform, 1, &[0, *version, 0, 0, 0]),
            Self::Supervision(state) => {
                of(CrtpPort::Supervisor, 0, &[GET_STATE | ANSWER]).with(&state.bits().to_le_bytes())
            }
            Self::Granted(answer) => {
                let command = if answer.is_arming { 1 } else { 2 };
                of(CrtpPort::Platform, 0, &[command, u8::from(answer.granted)])
            }
            Self::TableInfo(table, info) => info.packet(*table),
            Self::TableElement(table, element) => element.packet(*table),
            Self::NoElement(table) => table.packet(ELEMENT),
            Self::Parameter(id, value) => {
                of(CrtpPort::Parameters, 1, &id.to_le_bytes()).with(&[0]).with(value.as_bytes())
            }
            Self::Written(id, value) => {
                of(CrtpPort::Parameters, 2, &id.to_le_bytes()).with(value.as_bytes())
            }
            // No such entry, as the errors of C number it.
            Self::NoParameter(id) => of(CrtpPort::Parameters, 1, &id.to_le_bytes()).with(&[2]),
            Self::MemoryCount(count) => of(CrtpPort::Memory, 0, &[1, *count]),
            Self::Log(command, block, reason) => {
                of(CrtpPort::Logging, SETTINGS, &[*command as u8, *block, *reason])
            }
            Self::LogData { block, clock_ms, values } => {
                data_head(*block, *clock_ms).with(values.rest())
            }
        }
    }

    /// Packet of the log data of `block` at `clock_ms`, with each value \[-\] in its type.
    pub fn log_data(
        block: u8,
        clock_ms: u32,
        values: impl Iterator<Item = (LogType, f64)>,
    ) -> CrtpPacket {
        let head = data_head(block, clock_ms);
        values.fold(head, |packet, (kind, number)| put_value(packet, kind, number))
    }
}

impl SupervisorAnswer {
    /// Packet by which the supervisor's own port answers `command`, from protocol 12 on, in the state `state`.
    pub fn packet(&self, command: SupervisorCommand, state: Supervision) -> CrtpPacket {
        let (code, holds) = match command {
            SupervisorCommand::Arm(_) => (1, state.contains(Supervision::ARMED)),
            SupervisorCommand::Recover => (2, !state.contains(Supervision::CRASHED)),
            SupervisorCommand::EmergencyStop => (3, true),
            SupervisorCommand::KeepAlive => (4, true),
        };
        let fields = [code | ANSWER, u8::from(self.granted), u8::from(holds)];
        CrtpPacket::new(CrtpPort::Supervisor, 1, &fields)
    }
}

fn data_head(block: u8, clock_ms: u32) -> CrtpPacket {
    let [low, middle, high, _] = clock_ms.to_le_bytes();
    CrtpPacket::new(CrtpPort::Logging, DATA, &[block, low, middle, high])
}

fn read_granted<'a>(payload: &[u8]) -> Option<CrtpReply<'a>> {
    let (is_arming, granted) = match payload {
        [1, granted, ..] => (true, *granted != 0),
        [2, granted, ..] => (false, *granted != 0),
        _ => return None,
    };
    Some(CrtpReply::Granted(SupervisorAnswer { is_arming, granted }))
}

fn read_supervisor<'a>(payload: &[u8]) -> Option<CrtpReply<'a>> {
    let (command, fields) = payload.split_first()?;
    if command & ANSWER == 0 {
        return None;
    }
    match (command & !ANSWER, fields) {
        (GET_STATE, [low, rest @ ..]) => {
            let high = rest.first().copied().unwrap_or_default();
            let state = Supervision::from_wire(u16::from_le_bytes([*low, high]));
            Some(CrtpReply::Supervision(state))
        }
        (command, [granted, ..]) => read_granted(&[command, *granted]),
        _ => None,
    }
}

fn read_table(table: TableKind, payload: &[u8]) -> Option<CrtpReply<'_>> {
    let mut fields = ByteReader::new(payload, ByteOrder::Little);
    match fields.u8()? {
        INFO => TableInfo::read(fields).map(|info| CrtpReply::TableInfo(table, info)),
        ELEMENT if fields.rest().is_empty() => Some(CrtpReply::NoElement(table)),
        ELEMENT => TableElement::read(fields).map(|it| CrtpReply::TableElement(table, it)),
        _ => None,
    }
}

fn read_parameter<'a>(channel: u8, payload: &[u8]) -> Option<CrtpReply<'a>> {
    let (id, fields) = payload.split_first_chunk()?;
    let id = u16::from_le_bytes(*id);
    match (channel, fields) {
        (1, [0, value @ ..]) => {
            CrtpValue::from_wire(value).map(|value| CrtpReply::Parameter(id, value))
        }
        (1, [_]) => Some(CrtpReply::NoParameter(id)),
        (2, value) => CrtpValue::from_wire(value).map(|value| CrtpReply::Written(id, value)),
        _ => None,
    }
}

fn read_logging<'a>(payload: &[u8]) -> Option<CrtpReply<'a>> {
    let [command, block, reason, ..] = payload else { return None };
    let command = LogCommand::ALL.into_iter().find(|known| *known as u8 == *command)?;
    Some(CrtpReply::Log(command, *block, *reason))
}

fn read_data(payload: &[u8]) -> Option<CrtpReply<'_>> {
    let [block, low, middle, high, values @ ..] = payload else { return None };
    let clock_ms = u32::from_le_bytes([*low, *middle, *high, 0]);
    Some(CrtpReply::LogData { block: *block, clock_ms, values: LogFields::new(values) })
}
