//! A Crazyflie, for the rules of the bridge.

use oqtal_bridge::{Bridge, Crtp, TableStore, transport};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{Config, Setting};
use oqtal_wire::crtp::{
    CrtpPacket, CrtpReply, CrtpRequest, LogBlock, LogCommand, LogType, ParameterType, Supervision,
    SupervisorAnswer, SupervisorCommand, TableElement, TableInfo, TableKind,
};
use oqtal_wire::xbee::Address;

use super::protocol::{Protocol, ProtocolVehicle, Understood};

/// The row of this protocol.
pub const PROTOCOL: Protocol = Protocol { name: "crtp", bridge, vehicle };

/// A vehicle that arms by itself, and that another host flies and has set up.
pub const FLOWN: Protocol = Protocol {
    name: "crtp, flown by another host",
    bridge,
    vehicle: || {
        let block = LogBlock::new(1).with(LOGS[0].2, 0).with(LOGS[1].2, 1);
        let block = Some(block);
        Box::new(Crazyflie { is_armed: true, is_flown: true, block, reported_at: Time::UNSET })
    },
};

/// Roll rate at full stick, as shipped \[rad/s\].
const AUTHORITY: f64 = 2.0;
const REPORT_PERIOD: Span = Span::from_millis(100);

const LOGS: [(&str, &str, LogType); 2] =
    [("pm", "vbat", LogType::F32), ("supervisor", "info", LogType::U16)];
const PARAMETERS: [(&str, &str); 3] = [
    ("flightmode", "stabModeRoll"),
    ("flightmode", "stabModePitch"),
    ("flightmode", "stabModeYaw"),
];

fn bridge(now: Time) -> Bridge {
    let preset = Setting::flag("test", "vehicle.preset", "crazyflie-2.1");
    let config = Config::load(&[], &[preset]).unwrap();
    let link = "crtp:udp:127.0.0.1:19850".parse().unwrap();
    let protocol = Crtp::new(&config, TableStore::without_file(), None).unwrap();
    Bridge::new(&config, Box::new(protocol), transport(&link, Address::BROADCAST), now)
}

pub fn vehicle() -> Box<dyn ProtocolVehicle> {
    let block = None;
    Box::new(Crazyflie { is_armed: false, is_flown: false, block, reported_at: Time::UNSET })
}

struct Crazyflie {
    is_armed: bool,
    /// Whether it arms by itself, and flies by the set-points of another host.
    is_flown: bool,
    block: Option<LogBlock>,
    reported_at: Time,
}

impl ProtocolVehicle for Crazyflie {
    fn take(&mut self, _: Time, frame: &[u8], answers: &mut Vec<Vec<u8>>) -> Understood {
        let packet = CrtpPacket::parse(frame).unwrap();
        let request = CrtpRequest::read(&packet).unwrap();
        let mut say = |reply: CrtpReply| answers.push(reply.packet().as_bytes().to_vec());
        match request {
            CrtpRequest::Setpoint(setpoint) => {
                assert!(setpoint.thrust == 0 || self.block.is_some(), "flown before the set-up");
                return match setpoint.thrust {
                    0 => Understood::Zero,
                    _ => Understood::Flight(setpoint.roll / AUTHORITY),
                };
            }
            CrtpRequest::Supervisor(command) => {
                if let SupervisorCommand::Arm(arm) = command {
                    self.is_armed = arm;
                }
                let answer = SupervisorAnswer { is_arming: true, granted: true };
                answers.push(answer.packet(command, self.state()).as_bytes().to_vec());
                return Understood::Motors;
            }
            CrtpRequest::Source => say(CrtpReply::Source),
            CrtpRequest::ProtocolVersion => say(CrtpReply::ProtocolVersion(12)),
            CrtpRequest::Echo(stamp) => say(CrtpReply::Echo(stamp)),
            CrtpRequest::ResetLogging => {
                self.block = None;
                say(CrtpReply::Log(LogCommand::Reset, 0, 0));
            }
            CrtpRequest::TableInfo(table) => say(CrtpReply::TableInfo(table, info(table))),
            CrtpRequest::TableElement(table, id) => {
                say(CrtpReply::TableElement(table, element(table, id).unwrap()));
            }
            CrtpRequest::WriteParameter(id, value) => say(CrtpReply::Written(id, value)),
            CrtpRequest::CreateBlock(block) => {
                self.block = Some(block);
                say(CrtpReply::Log(LogCommand::Create, block.id, 0));
            }
            CrtpRequest::StartBlock { id, .. } => say(CrtpReply::Log(LogCommand::Start, id, 0)),
            _ => {}
        }
        Understood::Word
    }

    fn tick(&mut self, now: Time, answers: &mut Vec<Vec<u8>>) {
        let Some(block) = self.block else { return };
        if now.since(self.reported_at) < REPORT_PERIOD {
            return;
        }
        self.reported_at = now;
        let value = |id: u16| if id == 0 { 3.9 } else { f64::from(self.state().bits()) };
        let values = block.variables().iter().map(|(kind, id)| (*kind, value(*id)));
        answers.push(CrtpReply::log_data(block.id, 0, values).as_bytes().to_vec());
    }

    fn manual_override(&mut self, motors_on: bool, _: bool) {
        self.is_armed = motors_on;
    }

    fn motors_on(&self) -> bool {
        self.is_armed
    }

    fn told_piloted(&self) -> bool {
        false
    }
}

impl Crazyflie {
    fn state(&self) -> Supervision {
        let armed = Supervision::ARMED.with(Supervision::CAN_FLY);
        match self.is_armed {
            true if self.is_flown => armed.with(Supervision::ARMS_ITSELF).with(Supervision::FLYING),
            true => armed,
            false => Supervision::CAN_BE_ARMED,
        }
    }
}

fn element(table: TableKind, id: u16) -> Option<TableElement<'static>> {
    let place = usize::from(id);
    let (group, name, kind) = match table {
        TableKind::Logging => {
            LOGS.get(place).map(|(group, name, kind)| (*group, *name, *kind as u8))
        }
        TableKind::Parameters => {
            PARAMETERS.get(place).map(|(group, name)| (*group, *name, ParameterType::U8 as u8))
        }
    }?;
    Some(TableElement { id, kind, group, name })
}

fn info(table: TableKind) -> TableInfo {
    TableInfo::of((0..).map_while(|id| element(table, id)))
}
