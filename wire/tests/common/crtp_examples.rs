//! Packets that cflib encoded, and what they say in the terms of this crate.

use oqtal_wire::crtp::{
    CrtpPacket, CrtpPose, CrtpRequest, CrtpValue, LegacySetpoint, LogBlock, LogType, ParameterType,
    SupervisorCommand, TableKind, compress, decompress,
};
use serde::Deserialize;

use super::hex;

/// Packet, and the fields that it was made of.
#[derive(Debug, Deserialize)]
struct Example {
    kind: String,
    fields: Vec<f64>,
    bytes: String,
}

impl Example {
    fn number<T: TryFrom<i64>>(&self, index: usize) -> T {
        T::try_from(self.fields[index] as i64).ok().unwrap()
    }

    fn table(&self) -> TableKind {
        [TableKind::Parameters, TableKind::Logging][self.number::<usize>(0)]
    }

    fn command(&self) -> SupervisorCommand {
        use SupervisorCommand::{Arm, EmergencyStop, KeepAlive, Recover};
        [Arm(false), Arm(true), Recover, EmergencyStop, KeepAlive][self.number::<usize>(0)]
    }

    fn block(&self) -> LogBlock {
        (1..self.fields.len()).step_by(2).fold(LogBlock::new(self.number(0)), |block, place| {
            block.with(LogType::from_wire(self.number(place)).unwrap(), self.number(place + 1))
        })
    }

    fn request(&self) -> CrtpRequest {
        match self.kind.as_str() {
            "setpoint" => CrtpRequest::Setpoint(LegacySetpoint {
                roll: self.fields[0],
                pitch: self.fields[1],
                yaw_rate: self.fields[2],
                thrust: self.number(3),
            }),
            "stop" => CrtpRequest::Stop,
            "end_of_setpoints" => CrtpRequest::EndOfSetpoints(self.number(0)),
            "pose" => CrtpRequest::Pose(CrtpPose {
                position: self.fields[..3].try_into().unwrap(),
                attitude: self.fields[3..].try_into().unwrap(),
            }),
            "supervisor" => CrtpRequest::Supervisor(self.command()),
            "legacy_supervisor" => CrtpRequest::LegacySupervisor(self.command()),
            "supervision" => CrtpRequest::Supervision,
            "source" => CrtpRequest::Source,
            "protocol_version" => CrtpRequest::ProtocolVersion,
            "null" => CrtpRequest::Null,
            "table_info" => CrtpRequest::TableInfo(self.table()),
            "table_element" => CrtpRequest::TableElement(self.table(), self.number(1)),
            "read_parameter" => CrtpRequest::ReadParameter(self.number(0)),
            "write_parameter" => {
                let kind = ParameterType::from_wire(self.number(1)).unwrap();
                let value = CrtpValue::of(kind, self.fields[2]);
                assert_eq!(value.number(kind), Some(self.fields[2]));
                CrtpRequest::WriteParameter(self.number(0), value)
            }
            "create_block" => CrtpRequest::CreateBlock(self.block()),
            "start_block" => CrtpRequest::StartBlock { id: self.number(0), period: self.number(1) },
            "memory_count" => CrtpRequest::MemoryCount,
            "reset_logging" => CrtpRequest::ResetLogging,
            other => panic!("unknown kind {other}"),
        }
    }

    fn check(&self) {
        if self.kind == "quaternion" {
            return self.check_quaternion();
        }
        let (request, bytes) = (self.request(), hex(&self.bytes));
        assert_eq!(request.packet().as_bytes(), bytes, "{self:?}");
        // Numbers are rounded to the wire's; what is read is what would be sent again.
        let read = CrtpRequest::read(&CrtpPacket::parse(&bytes).unwrap());
        let read = read.unwrap_or_else(|| panic!("{self:?} is not read"));
        assert_eq!(read.packet().as_bytes(), bytes, "{self:?}");
        if let (CrtpRequest::Setpoint(read), CrtpRequest::Setpoint(sent)) = (read, request) {
            let pairs =
                [(read.roll, sent.roll), (read.pitch, sent.pitch), (read.yaw_rate, sent.yaw_rate)];
            assert!(pairs.iter().all(|(read, sent)| (read - sent).abs() < 1e-6), "{self:?}");
        }
    }

    fn check_quaternion(&self) {
        let (attitude, theirs) = self.fields.split_at(4);
        let compressed = u32::from_str_radix(&self.bytes, 16).unwrap();
        assert_eq!(compress(attitude.try_into().unwrap()), compressed, "{self:?}");
        let apart = decompress(compressed).into_iter().zip(theirs).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f64::max) < 1e-9, "{self:?}");
    }
}

/// Checks every line of `examples` both ways: encoded here, and read here. Each kind must occur at least once.
pub fn check(examples: &str) {
    let examples: Vec<Example> =
        examples.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let mut kinds: Vec<&str> = examples.iter().map(|example| example.kind.as_str()).collect();
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds.len(), 19, "{kinds:?}");
    examples.iter().for_each(Example::check);
}
