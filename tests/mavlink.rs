//! Bridge and emulated autopilot over a network, in virtual time: start, refusals, loss of control to a pilot, silence.

mod air;

use air::{Air, disarmed, flight};
use oqtal_bridge::{MotorEvent, Note};
use oqtal_bus::code::{ControlHolder, EstimatorState, VehicleRefusal};
use oqtal_bus::time::Span;
use oqtal_wire::link::AutopilotKind;
use oqtal_wire::mavlink::{
    AutopilotFirmware, CommandKind, MavlinkAddress, MavlinkContent, MavlinkEncoder,
    MavlinkHeartbeat, SigningKey,
};

const BOTH: [AutopilotKind; 2] = [AutopilotKind::ArduPilot, AutopilotKind::Px4];

#[test]
fn a_vehicle_is_found_gets_poses_and_estimates_its_position() {
    for kind in BOTH {
        let mut air = Air::new(kind, &[]);
        assert_eq!((air.report.link, air.report.estimator), (0, EstimatorState::Unknown.code()));
        air.fly_for(4000, disarmed());
        assert_eq!(air.report.link, 1, "{kind:?}");
        assert_eq!(air.report.estimator, EstimatorState::Ready.code(), "{kind:?}");
        assert!(air.report.estimate_position.iter().all(|number| number.abs() < 0.05), "{kind:?}");
        assert!(air.report.battery_v > 11.0 && air.report.link_quality > 0.9, "{:?}", air.report);
        let poses = air.sent.iter().filter(|content| match kind {
            AutopilotKind::Px4 => matches!(content, MavlinkContent::Odometry(_)),
            AutopilotKind::ArduPilot => matches!(content, MavlinkContent::VisionPosition(_)),
        });
        let poses_per_second = poses.count() as f64 / 4.0;
        assert!((28.0..52.0).contains(&poses_per_second), "{kind:?}: {poses_per_second}");
    }
}

#[test]
fn f72_the_time_out_of_the_vehicle_is_read_also_after_another_changed_it() {
    for kind in BOTH {
        let mut air = Air::new(kind, &["plant.wire.time-out-ms=3000"]);
        assert_eq!(air.report.time_out_s, 0.0, "{kind:?}");
        air.fly_for(2000, disarmed());
        assert_eq!(air.report.time_out_s, 3.0, "{kind:?}");
        air.vehicle.autopilot().set_time_out(0.1);
        air.fly_for(700, disarmed());
        assert!((air.report.time_out_s - 0.1).abs() < 1e-6, "{kind:?}: {:?}", air.report);
        air.fly_for(4500, flight(0.3));
        let report = air.report;
        air.cut_for(150);
        assert!(air.height() > 0.2 && report.armed == 1, "{kind:?}");
        air.fly_for(100, flight(0.3));
        // ArduCopter keeps its mode.
        let is_px4 = kind == AutopilotKind::Px4;
        assert_eq!(air.report.control == ControlHolder::Another.code(), is_px4, "{kind:?}");
        air.vehicle.autopilot().set_time_out(-1.0);
        air.fly_for(700, disarmed());
        assert_eq!(air.report.time_out_s, 0.0, "{kind:?}: no time-out");
    }
}

#[test]
fn motors_start_fly_and_stop_by_mode_arming_and_disarming() {
    for kind in BOTH {
        let mut air = Air::new(kind, &[]);
        air.fly_for(1000, disarmed());
        air.fly_for(3500, flight(0.3));
        assert_eq!(air.report.armed, 1, "{kind:?}");
        assert_eq!(air.report.control, ControlHolder::Bridge.code());
        air.fly_for(800, flight(0.3));
        assert!(air.height() > 0.2, "{kind:?}: {}", air.height());
        air.fly_for(2500, disarmed());
        assert!(air.report.armed == 0 && !air.motors_run(), "{kind:?}");
        let noted = |event| air.notes.contains(&Note::Motors(event));
        assert!(noted(MotorEvent::Running) && noted(MotorEvent::Stopped), "{:?}", air.notes);
    }
}

#[test]
fn a_refusal_to_arm_is_reported_in_words_until_the_motors_run() {
    for kind in BOTH {
        let mut air = Air::new(kind, &["plant.wire.mavlink.refuses-arming-ms=7000"]);
        air.fly_for(3000, disarmed());
        air.fly_for(3500, flight(0.0));
        assert_eq!(air.report.refusal, VehicleRefusal::Arming.code(), "{kind:?}");
        assert_eq!(air.report.text.as_str(), "Arm: Gyros inconsistent");
        assert!(air.notes.contains(&Note::Refused(VehicleRefusal::Arming)));
        assert!(air.notes.contains(&Note::Motors(MotorEvent::StartFailed)));
        air.fly_for(1000, disarmed());
        air.fly_for(2500, flight(0.0));
        assert_eq!((air.report.armed, air.report.refusal), (1, VehicleRefusal::None.code()));
        assert!(air.report.text.is_empty());
    }
}

#[test]
fn f57_a_take_over_by_a_pilot_is_detected_within_a_fifth_of_a_second_and_ends_the_set_points() {
    for kind in BOTH {
        let mut air = Air::new(kind, &[]);
        air.fly_for(1000, disarmed());
        air.fly_for(4500, flight(0.3));
        assert!(air.height() > 0.2, "{kind:?}");
        air.vehicle.autopilot().pilot_takes_over();
        let since = air.now;
        while air.report.control != ControlHolder::Another.code() {
            air.fly_for(1, flight(0.3));
            assert!(air.now.since(since) <= Span::from_millis(200), "{kind:?}");
        }
        air.sent.clear();
        air.fly_for(1000, flight(0.3));
        air.fly_for(4000, disarmed());
        let is_quiet = |content: &MavlinkContent| match content {
            MavlinkContent::AttitudeTarget(_) => false,
            MavlinkContent::Command(command) => {
                !matches!(command.kind, CommandKind::Arm { .. } | CommandKind::SetMode { .. })
            }
            _ => true,
        };
        assert!(air.sent.iter().all(is_quiet), "{kind:?}");
        assert!(air.sent.len() > 50, "poses and heartbeats continue");
        assert!(air.motors_run(), "{kind:?}: the motors are the pilot's");
        assert!(!air.bridge.begin_final_emergency_stop(air.now));
        // An operator's stop is withheld, and said to be.
        air.sent.clear();
        air.bridge.keep_stopped(Some(air.now));
        air.fly_for(1000, disarmed());
        assert!(air.sent.iter().all(is_quiet) && air.motors_run(), "{kind:?}");
        assert!(air.bridge.is_released() && air.report.stopped == 0, "{:?}", air.report);
        let motors = |event| air.notes.iter().filter(|note| **note == Note::Motors(event)).count();
        let [taken, withheld] = [MotorEvent::ControlTaken, MotorEvent::StopWithheld].map(motors);
        assert_eq!((taken, withheld), (1, 1), "{:?}", air.notes);
    }
}

#[test]
fn f14_a_daemon_that_falls_silent_leaves_zero_set_points_within_four_periods() {
    for kind in BOTH {
        let mut air = Air::new(kind, &[]);
        air.fly_for(1000, disarmed());
        air.fly_for(4500, flight(0.3));
        air.sent.clear();
        air.wait(1000);
        let thrusts = air.sent.iter().filter_map(|content| match content {
            MavlinkContent::AttitudeTarget(target) => Some(target.thrust),
            _ => None,
        });
        let thrusts: Vec<f64> = thrusts.collect();
        assert!(thrusts.len() > 50 && thrusts.iter().skip(4).all(|thrust| *thrust == 0.0));
    }
}

/// A heartbeat of another autopilot.
fn other_vehicle(kind: AutopilotKind, is_armed: bool) -> Vec<u8> {
    let own = MavlinkAddress { system: 42, component: MavlinkAddress::AUTOPILOT };
    let heartbeat = MavlinkContent::Heartbeat(MavlinkHeartbeat {
        autopilot: AutopilotFirmware::Known(kind),
        custom_mode: kind.setpoint_mode(),
        is_armed,
        is_simulated: false,
    });
    MavlinkEncoder::new(own).encode(&heartbeat).unwrap().as_bytes().to_vec()
}

#[test]
fn another_autopilot_that_answered_first_does_not_keep_the_vehicle_out() {
    for kind in BOTH {
        let mut air = Air::new(kind, &[]);
        air.receive(&other_vehicle(kind, true));
        air.fly_for(2900, disarmed());
        assert_eq!(air.report.link, 0, "{kind:?}: the other autopilot may return");
        air.fly_for(2000, disarmed());
        assert!(air.notes.contains(&Note::Replaced), "{:?}", air.notes);
        air.fly_for(4500, flight(0.3));
        assert_eq!((air.report.link, air.report.armed), (1, 1), "{kind:?}");
        assert!(air.height() > 0.2, "{kind:?}: {}", air.height());
    }
}

#[test]
fn another_autopilot_does_not_replace_a_vehicle_that_answers_nor_with_running_motors() {
    for kind in BOTH {
        let mut air = Air::new(kind, &[]);
        air.fly_for(1000, disarmed());
        air.fly_for(4500, flight(0.3));
        air.receive(&other_vehicle(kind, false));
        air.fly_for(100, flight(0.3));
        assert_eq!((air.report.link, air.report.armed), (1, 1), "{kind:?}");
        air.fall_silent();
        for _ in 0..50 {
            air.receive(&other_vehicle(kind, true));
            air.fly_for(100, disarmed());
        }
        assert!(!air.notes.contains(&Note::Replaced) && air.report.link == 0, "{kind:?}");
        air.receive(&other_vehicle(kind, false));
        air.fly_for(100, flight(0.3));
        assert!(air.notes.contains(&Note::Replaced), "{kind:?}");
        assert_eq!((air.report.link, air.report.armed, air.report.starting), (1, 0, 0), "{kind:?}");
    }
}

#[test]
fn f57_px4_leaves_offboard_without_set_points_and_the_bridge_does_not_change_the_mode_back() {
    let mut air = Air::new(AutopilotKind::Px4, &[]);
    air.fly_for(1000, disarmed());
    air.fly_for(4500, flight(0.3));
    air.cut_for(1500);
    air.fly_for(300, flight(0.3));
    assert_eq!(air.report.control, ControlHolder::Another.code());
    assert_eq!(air.report.text.as_str(), "Failsafe: offboard signal lost");
}

/// 1 % of the datagrams are lost, and each is delayed by up to 5 ms, some out of order.
#[test]
fn losses_and_jitter_are_flown_through_and_nothing_old_is_sent() {
    let noise = ["plant.wire.loss-probability=0.01", "plant.wire.jitter-ms=5"];
    for kind in BOTH {
        let mut air = Air::new(kind, &noise);
        air.fly_for(1000, disarmed());
        air.fly_for(4500, flight(0.2));
        for step in 0..100_u32 {
            air.fly_for(200, flight(0.4 + 0.001 * f64::from(step % 2)));
            assert_eq!((air.report.armed, air.report.link), (1, 1), "{kind:?}");
            let newest = air.sent.iter().rev().find_map(|content| match content {
                MavlinkContent::AttitudeTarget(target) => Some(target.thrust),
                _ => None,
            });
            assert!((newest.unwrap() - 0.4 - 0.001 * f64::from(step % 2)).abs() < 1e-6);
        }
    }
}

#[test]
fn a_vehicle_that_does_not_sign_with_the_configured_key_is_ignored() {
    let digits = "0f".repeat(32);
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), &digits).unwrap();
    let setting = format!("bridge.mavlink.signing-key-file={}", file.path().display());
    for kind in BOTH {
        // The emulated autopilot does not sign.
        let mut air = Air::new(kind, &[&setting]);
        air.fly_for(3000, disarmed());
        assert_eq!(air.report.link, 0, "{kind:?}");
        let refused = Note::Refused(VehicleRefusal::Unsigned);
        assert_eq!(air.notes.iter().filter(|note| **note == refused).count(), 1, "{kind:?}");
        assert_eq!(air.report.refusal, VehicleRefusal::Unsigned.code());
        let autopilot = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };
        let mut signer = MavlinkEncoder::new(autopilot);
        signer.sign(SigningKey::from_hex(&digits).unwrap(), 0);
        let heartbeat = MavlinkHeartbeat {
            autopilot: AutopilotFirmware::Known(kind),
            custom_mode: 0,
            is_armed: false,
            is_simulated: false,
        };
        let wire = signer.encode(&MavlinkContent::Heartbeat(heartbeat)).unwrap();
        air.receive(wire.as_bytes());
        air.fly_for(50, disarmed());
        assert_eq!(air.report.link, 1, "{kind:?}: signed with the key");
        air.fly_for(1100, disarmed());
        air.receive(wire.as_bytes());
        air.fly_for(50, disarmed());
        assert_eq!(air.report.link, 0, "{kind:?}: the same packet again");
    }
}
