//! The emulated vehicle with Betaflight in virtual time: channels of a host, motion, replies.

use oqtal_bus::time::{Span, Time};
use oqtal_plant_sim::wire::MspVehicle;
use oqtal_wire::msp::{
    MspChannelMap, MspDecoder, MspPacket, MspStatus, MspSticks, arming_obstacle, command,
};

use crate::{START, calm};

/// Values of the arming switch \[us\].
const ON: u16 = 1900;
const OFF: u16 = 1000;
const PERIOD: Span = Span::from_nanos(16_666_667);

struct Host {
    vehicle: MspVehicle,
    now: Time,
    status: MspStatus,
}

impl Host {
    fn new() -> Self {
        let vehicle =
            MspVehicle::new(&calm(&[("plant.wire.time-out-ms", 300.0.into())]), START).unwrap();
        Self { vehicle, now: START, status: MspStatus::default() }
    }

    /// Sends these sticks with the switch for some periods, or nothing.
    fn pass(&mut self, periods: usize, sent: Option<(MspSticks, u16)>) {
        for _ in 0..periods {
            let mut requests = vec![MspPacket::request(command::STATUS, &[])];
            requests.extend(sent.map(|(sticks, us)| {
                let payload = sticks.payload(MspChannelMap::FACTORY, Some((0, us)));
                MspPacket::request(command::CHANNELS, &payload)
            }));
            for request in requests {
                self.vehicle.host_writes(self.now, request.as_bytes());
            }
            self.now = self.now + PERIOD;
            self.vehicle.advance(self.now, |_| {});
            let (mut decoder, status) = (MspDecoder::new(), &mut self.status);
            self.vehicle.host_reads(self.now, |bytes| {
                for reply in decoder.push(bytes).filter(|reply| reply.command == command::STATUS) {
                    *status = MspStatus::read(reply.payload()).unwrap();
                }
            });
        }
    }
}

fn sticks(throttle: f64) -> MspSticks {
    MspSticks { throttle, ..MspSticks::ZERO }
}

#[test]
fn it_arms_by_the_switch_after_half_a_second_without_throttle() {
    let mut host = Host::new();
    host.pass(10, Some((MspSticks::ZERO, ON)));
    assert_eq!(arming_obstacle(&host.status), Some("RXLOSS"));
    host.pass(40, Some((MspSticks::ZERO, ON)));
    assert_eq!(arming_obstacle(&host.status), Some("NOT_DISARMED"));
    host.pass(10, Some((sticks(0.2), OFF)));
    assert_eq!(arming_obstacle(&host.status), Some("THROTTLE"));
    host.pass(10, Some((MspSticks::ZERO, OFF)));
    assert_eq!((host.status.is_armed(), arming_obstacle(&host.status)), (false, None));
    host.pass(10, Some((MspSticks::ZERO, ON)));
    assert!(host.status.is_armed() && host.vehicle.board().motors_run());
    host.pass(3, Some((MspSticks::ZERO, OFF)));
    assert!(host.vehicle.board().motors_run(), "after three frames");
    host.pass(4, Some((MspSticks::ZERO, OFF)));
    assert!(!host.vehicle.board().motors_run());
}

#[test]
fn it_flies_by_rates_and_falls_without_channels() {
    let mut host = Host::new();
    host.pass(40, Some((MspSticks::ZERO, OFF)));
    host.pass(10, Some((MspSticks::ZERO, ON)));
    host.pass(60, Some((sticks(0.9), ON)));
    assert!(host.vehicle.plant().truth().position[2] > 0.3);
    let roll = MspSticks { deflections: [0.5, 0.0, -0.25], throttle: 0.9 };
    host.pass(20, Some((roll, ON)));
    let rate = host.vehicle.plant().truth().rate;
    // Of 120 deg/s at full stick.
    let wanted = [60.0_f64, 0.0, -30.0].map(f64::to_radians);
    for (rate, wanted) in rate.into_iter().zip(wanted) {
        assert!((rate - wanted).abs() < 0.03, "{rate} rad/s in place of {wanted}");
    }
    host.pass(16, None);
    assert!(host.vehicle.board().motors_run(), "within 0.3 s");
    host.pass(6, None);
    assert!(!host.vehicle.board().motors_run());
    assert_eq!(arming_obstacle(&host.status), Some("RXLOSS"));
}
