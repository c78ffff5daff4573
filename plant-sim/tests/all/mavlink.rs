//! The emulated autopilots in virtual time: telemetry, arming, set-points and their time-out.

use oqtal_bus::time::{Span, Time};
use oqtal_plant_sim::wire::MavlinkVehicle;
use oqtal_wire::link::{AutopilotKind, LinkSpec, MavlinkLink};
use oqtal_wire::mavlink::{
    AttitudeTarget, CommandKind, MavlinkAddress, MavlinkContent, MavlinkDecoder, MavlinkEncoder,
    SetpointKind, VehicleCommandLong,
};

use crate::{START, calm};

const VEHICLE: MavlinkAddress = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };

/// Host of one vehicle.
struct Host {
    vehicle: MavlinkVehicle,
    encoder: MavlinkEncoder,
    now: Time,
    received: Vec<MavlinkContent>,
}

impl Host {
    fn new(kind: AutopilotKind) -> Self {
        let link = match "mavlink:udpin:127.0.0.1:14550".parse() {
            Ok(LinkSpec::Mavlink(link)) => MavlinkLink { autopilot: Some(kind), ..link },
            other => panic!("{other:?}"),
        };
        let own = MavlinkAddress { system: 255, component: 190 };
        let vehicle = MavlinkVehicle::new(&calm(&[]), &link, START).unwrap();
        Self { vehicle, encoder: MavlinkEncoder::new(own), now: START, received: Vec::new() }
    }

    fn send(&mut self, content: &MavlinkContent) {
        let packet = self.encoder.encode(content).unwrap();
        self.vehicle.host_writes(self.now, packet.as_bytes());
    }

    fn command(&mut self, kind: CommandKind) {
        let command = VehicleCommandLong { target: VEHICLE, kind, confirmation: 0 };
        self.send(&MavlinkContent::Command(command));
    }

    /// Advances by `millis`; a thrust, if given, is sent every 20 ms.
    fn pass(&mut self, millis: i64, thrust: Option<f64>) {
        let mut decoder = MavlinkDecoder::new();
        for _ in 0..millis / 20 {
            if let Some(thrust) = thrust {
                let kind = SetpointKind::Rates([0.0; 3]);
                let target = AttitudeTarget { target: VEHICLE, time_ms: 0, kind, thrust };
                self.send(&MavlinkContent::AttitudeTarget(target));
            }
            self.now = self.now + Span::from_millis(20);
            self.vehicle.advance(self.now, |_| ());
            let received = &mut self.received;
            self.vehicle.host_reads(self.now, |bytes| {
                received.extend(decoder.push(bytes).map(|packet| packet.content));
            });
        }
    }

    fn count(&self, is_kind: fn(&MavlinkContent) -> bool) -> usize {
        self.received.iter().filter(|content| is_kind(content)).count()
    }
}

#[test]
fn an_armed_autopilot_follows_setpoints_and_has_its_rules_without_them() {
    for (kind, mode) in [(AutopilotKind::ArduPilot, 20), (AutopilotKind::Px4, 6)] {
        let mut host = Host::new(kind);
        host.pass(2000, Some(0.0));
        let heartbeats = host.count(|content| matches!(content, MavlinkContent::Heartbeat(_)));
        assert!((2..=3).contains(&heartbeats), "{kind:?}: {heartbeats}");
        host.command(CommandKind::SetMode { mode, sub_mode: 0 });
        host.command(CommandKind::Arm { run: true, is_forced: false });
        host.pass(2500, Some(0.0));
        assert!(host.vehicle.board().motors_run(), "{kind:?}: {:?}", host.received);
        host.pass(500, Some(0.9));
        assert!(host.vehicle.plant().truth().position[2] > 0.1, "{kind:?}");
        host.pass(1500, None);
        let texts = host.count(|content| matches!(content, MavlinkContent::Text(_)));
        assert_eq!(texts, usize::from(kind == AutopilotKind::Px4), "{kind:?}");
        assert!(host.vehicle.board().motors_run(), "{kind:?}");
    }
}
