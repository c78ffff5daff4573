//! The emulated Crazyflie in virtual time: packets of a host, motion, replies.

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_plant_sim::wire::CrtpVehicle;
use oqtal_wire::crtp::{
    CrtpReply, CrtpRequest, CrtpValue, LegacySetpoint, LogBlock, LogType, ParameterType,
    Supervision, SupervisorCommand, TableKind,
};

use crate::START;

/// Host of one vehicle without disturbances.
struct Host {
    vehicle: CrtpVehicle,
    now: Time,
    replies: Vec<String>,
}

impl Host {
    fn new(change: impl FnOnce(&mut Config)) -> Self {
        let mut config = Config::default();
        let plant = &mut config.plant;
        (plant.gust_sd_m_s2, plant.rate_drift_deg_s, plant.force_n) = (0.0, [0.0; 3], [0.0; 3]);
        // Thrust-to-weight ratio of a Crazyflie.
        plant.max_thrust_n = 10.0;
        plant.wire.crtp.thrust_curve_n = [10.9, 0.0];
        change(&mut config);
        let vehicle = CrtpVehicle::new(&config, START).unwrap();
        Self { vehicle, now: START, replies: Vec::new() }
    }

    fn send(&mut self, request: CrtpRequest) {
        self.vehicle.host_writes(self.now, request.packet().as_bytes());
    }

    /// Advances by `millis`; a set-point, if given, is sent every 10 ms.
    fn pass(&mut self, millis: i64, setpoint: Option<LegacySetpoint>) {
        for _ in 0..millis / 10 {
            if let Some(setpoint) = setpoint {
                self.send(CrtpRequest::Setpoint(setpoint));
            }
            self.now = self.now + Span::from_millis(10);
            self.vehicle.advance(self.now, |_| ());
            while let Some(packet) = self.vehicle.host_receives(self.now) {
                self.replies.extend(CrtpReply::read(&packet).map(|reply| format!("{reply:?}")));
            }
        }
    }

    fn has_reply(&self, text: &str) -> bool {
        self.replies.iter().any(|reply| reply.contains(text))
    }

    /// Sets rates, arms, and climbs for half a second.
    fn fly(&mut self) {
        for id in [3, 4] {
            let rates = CrtpValue::of(ParameterType::U8, 0.0);
            self.send(CrtpRequest::WriteParameter(id, rates));
        }
        self.send(CrtpRequest::Supervisor(SupervisorCommand::Arm(true)));
        self.pass(100, Some(LegacySetpoint::ZERO));
        self.pass(500, Some(thrusting(0.7)));
        assert!(self.vehicle.plant().truth().position[2] > 0.1);
    }
}

fn thrusting(share: f64) -> LegacySetpoint {
    LegacySetpoint { thrust: (60_000.0 * share) as u16, ..LegacySetpoint::ZERO }
}

#[test]
fn thrust_is_locked_until_the_vehicle_is_armed_and_has_had_a_set_point_without() {
    let mut host = Host::new(|_| ());
    host.pass(300, Some(thrusting(0.7)));
    host.send(CrtpRequest::Supervisor(SupervisorCommand::Arm(true)));
    host.pass(300, Some(thrusting(0.7)));
    assert!(host.vehicle.board().motors_run() && host.has_reply("granted: true"));
    assert_eq!(host.vehicle.plant().truth().position[2], 0.0);
    host.pass(50, Some(LegacySetpoint::ZERO));
    host.pass(500, Some(thrusting(0.7)));
    assert!(host.vehicle.plant().truth().position[2] > 0.1);
}

#[test]
fn a_rate_about_each_axis_turns_the_vehicle_that_way() {
    for axis in 0..3 {
        let mut host = Host::new(|_| ());
        host.fly();
        let mut setpoint = thrusting(0.55);
        let rates = [&mut setpoint.roll, &mut setpoint.pitch, &mut setpoint.yaw_rate];
        *rates.into_iter().nth(axis).unwrap() = 0.5;
        host.pass(400, Some(setpoint));
        let rate = host.vehicle.plant().truth().rate;
        for (other, rate) in rate.into_iter().enumerate() {
            let wanted = if other == axis { 0.5 } else { 0.0 };
            assert!((rate - wanted).abs() < 0.05, "axis {axis}: {rate}");
        }
    }
}

#[test]
fn f65_in_silence_the_vehicle_levels_out_after_half_a_second_and_is_locked_after_two() {
    let mut host = Host::new(|_| ());
    host.fly();
    let tilted = LegacySetpoint { roll: 1.0, ..thrusting(0.55) };
    host.pass(300, Some(tilted));
    let tilt = |host: &Host| host.vehicle.plant().truth().attitude[0].abs();
    assert!(tilt(&host) > 0.1);
    host.pass(400, None);
    assert!(tilt(&host) > 0.1, "the last set-point acts on");
    host.pass(1400, None);
    assert!(tilt(&host) < 0.02 && host.vehicle.board().motors_run());
    host.pass(300, None);
    assert!(!host.vehicle.board().motors_run());
    host.send(CrtpRequest::Supervisor(SupervisorCommand::Arm(true)));
    host.pass(200, Some(LegacySetpoint::ZERO));
    assert!(host.has_reply("granted: false") && !host.vehicle.board().motors_run());
}

#[test]
fn reports_show_battery_supervisor_and_the_pose_that_was_sent() {
    let mut host = Host::new(|_| ());
    let block = LogBlock::new(1).with(LogType::F32, 0).with(LogType::U16, 1);
    host.send(CrtpRequest::CreateBlock(block));
    host.send(CrtpRequest::StartBlock { id: 1, period: 10 });
    host.send(CrtpRequest::TableInfo(TableKind::Logging));
    host.pass(1100, None);
    let reports = host.replies.iter().filter(|reply| reply.starts_with("LogData")).count();
    assert!((9..=11).contains(&reports), "{reports}");
    assert!(host.has_reply("TableInfo(Logging"));
}

#[test]
fn an_old_vehicle_has_no_supervisors_port() {
    let mut host = Host::new(|config| config.plant.wire.crtp.protocol = 7.0);
    host.send(CrtpRequest::Supervision);
    host.send(CrtpRequest::Supervisor(SupervisorCommand::Arm(true)));
    host.pass(200, None);
    assert!(host.replies.is_empty() && !host.vehicle.board().motors_run());
    host.send(CrtpRequest::LegacySupervisor(SupervisorCommand::Arm(true)));
    host.pass(200, None);
    assert!(host.has_reply("granted: true") && host.vehicle.board().motors_run());
    host.send(CrtpRequest::LegacySupervisor(SupervisorCommand::EmergencyStop));
    host.pass(200, None);
    assert!(!host.vehicle.board().motors_run());
}

#[test]
fn a_vehicle_that_arms_by_itself_reports_it() {
    let mut host = Host::new(|config| config.plant.wire.crtp.arms_itself = true);
    host.send(CrtpRequest::Supervision);
    host.pass(200, None);
    host.send(CrtpRequest::Supervision);
    host.pass(100, None);
    let state = Supervision::ARMED.with(Supervision::ARMS_ITSELF).with(Supervision::CAN_FLY);
    assert!(host.has_reply(&format!("{:?}", CrtpReply::Supervision(state))), "{:?}", host.replies);
}
