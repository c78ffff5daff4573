//! Tests of the schedule of a radio, in virtual time.

use super::*;

const EXCHANGE: Span = Span::from_nanos(1_200_000);

fn at(millis: i64) -> Time {
    Time::VIRTUAL_START + Span::from_millis(millis)
}

fn setpoint(thrust: u16) -> CrtpPacket {
    CrtpRequest::Setpoint(LegacySetpoint { thrust, ..LegacySetpoint::ZERO }).packet()
}

fn thrust(packet: &CrtpPacket) -> Option<u16> {
    match CrtpRequest::read(packet) {
        Some(CrtpRequest::Setpoint(setpoint)) => Some(setpoint.thrust),
        _ => None,
    }
}

#[test]
fn the_newest_set_point_is_sent_first_and_no_old_packet_is_sent() {
    let mut schedule = RadioSchedule::new(1, 250.0);
    schedule.push(at(0), 0, CrtpRequest::Source.packet());
    schedule.push(at(1), 0, setpoint(1));
    schedule.push(at(2), 0, setpoint(2));
    let (_, packet) = schedule.next(at(3)).unwrap();
    assert_eq!(thrust(&packet), Some(2));
    schedule.sent(at(4), 0, None, 3);
    assert!(schedule.next(at(4)).is_none(), "its share: 4 ms between packets");
    schedule.push(at(40), 0, setpoint(3));
    let (_, packet) = schedule.next(at(91)).unwrap();
    assert!(packet.is_null(), "set-point and request are old");
    assert_eq!(schedule.counts(0).dropped, 3);
}

#[test]
fn a_request_is_repeated_a_few_times_and_a_set_point_never() {
    let mut schedule = RadioSchedule::new(1, 1000.0);
    schedule.push(at(0), 0, CrtpRequest::Source.packet());
    schedule.push(at(0), 0, setpoint(1));
    let mut sent = Vec::new();
    for millis in 0..30 {
        if let Some((_, packet)) = schedule.next(at(millis)) {
            schedule.sent(at(millis), 0, None, 0);
            sent.push(packet);
        }
    }
    let source = CrtpRequest::Source.packet();
    assert_eq!(sent.iter().filter(|packet| **packet == source).count(), 3);
    assert_eq!(sent.iter().filter_map(thrust).count(), 1);
}

/// Vehicles that each get set-points and poses at 60 Hz and echoes at 10 Hz, and report with every third packet.
fn busy(vehicles: usize) -> (RadioSchedule, Span) {
    let mut schedule = RadioSchedule::new(vehicles, 250.0);
    let (mut now, mut worst) = (at(0), Span::ZERO);
    let (mut ticks, mut sent) = (0, 0);
    while now < at(10_000) {
        while at(0) + Span::from_nanos(16_666_667).scaled(f64::from(ticks)) <= now {
            for vehicle in 0..vehicles {
                schedule.push(now, vehicle, setpoint(1));
                schedule.push(now, vehicle, CrtpRequest::Echo(0).packet());
            }
            ticks += 1;
        }
        let waits = schedule.vehicles.iter().filter_map(|v| v.setpoint.map(|w| w.since));
        worst = waits.map(|since| now.since(since)).fold(worst, Span::max);
        match schedule.next(now) {
            Some((vehicle, _)) => {
                sent += 1;
                now = now + EXCHANGE;
                schedule.sent(now, vehicle, Some(sent % 3 == 0), 0);
            }
            None => now = now + Span::from_nanos(100_000),
        }
    }
    (schedule, worst + EXCHANGE)
}

#[test]
fn two_vehicles_at_sixty_hertz_are_within_the_budget_of_one_radio() {
    let (schedule, worst) = busy(2);
    for vehicle in 0..2 {
        let counts = schedule.counts(vehicle);
        assert!(counts.setpoints >= 599 && counts.dropped == 0, "{counts:?}");
        // The share of the vehicle, and set-points.
        assert!(counts.sent <= 2500 + counts.setpoints, "{counts:?}");
    }
    // Behind the exchange that runs, and the other vehicle's set-point.
    assert!(worst <= EXCHANGE.scaled(3.0) + Span::from_nanos(200_000), "{worst:?}");
}

#[test]
fn more_vehicles_than_a_radio_carries_share_it_evenly_and_get_nothing_old() {
    let (schedule, worst) = busy(16);
    let counts: Vec<u64> = (0..16).map(|i| schedule.counts(i).setpoints).collect();
    let (least, most) = (counts.iter().min().unwrap(), counts.iter().max().unwrap());
    assert!(most - least <= 2, "{counts:?}");
    assert!(worst <= MAX_AGE + EXCHANGE);
}

/// Packets that are sent from `since` to `until` \[ms\], and when; each is acknowledged if `ack`.
fn send(
    schedule: &mut RadioSchedule,
    (since, until): (i64, i64),
    ack: bool,
) -> Vec<(i64, CrtpPacket)> {
    let mut sent = Vec::new();
    for millis in since..until {
        while let Some((_, packet)) = schedule.next(at(millis)) {
            schedule.sent(at(millis), 0, ack.then_some(false), 0);
            sent.push((millis, packet));
        }
    }
    sent
}

#[test]
fn a_stop_goes_first_and_is_repeated_until_it_is_acknowledged() {
    for command in [SupervisorCommand::EmergencyStop, SupervisorCommand::Arm(false)] {
        for request in [CrtpRequest::Supervisor(command), CrtpRequest::LegacySupervisor(command)] {
            let stop = request.packet();
            let mut schedule = RadioSchedule::new(1, 250.0);
            schedule.push(at(0), 0, stop);
            (0..20).for_each(|stamp| schedule.push(at(0), 0, CrtpRequest::Echo(stamp).packet()));
            schedule.push(at(0), 0, setpoint(1));
            let count = |sent: &[(i64, CrtpPacket)]| sent.iter().filter(|s| s.1 == stop).count();
            let missed = send(&mut schedule, (0, 100), false);
            assert_eq!((missed[0].1, count(&missed)), (stop, 10), "every 10 ms, at any age");
            assert_eq!(count(&send(&mut schedule, (100, 200), true)), 1);
            // A vehicle that was restarted long after is not locked again.
            schedule.push(at(200), 0, stop);
            assert_eq!(count(&send(&mut schedule, (2201, 2300), false)), 0);
        }
    }
}

#[test]
fn the_newest_of_arming_and_disarming_is_sent_and_neither_replaces_the_emergency_stop() {
    use SupervisorCommand::{Arm, EmergencyStop};
    for (pushed, wanted) in [
        (&[Arm(true), Arm(false)][..], &[Arm(false)][..]),
        (&[Arm(false), Arm(true)], &[Arm(true)]),
        (&[EmergencyStop, Arm(false)], &[EmergencyStop]),
        (&[EmergencyStop, Arm(true)], &[EmergencyStop, Arm(true)]),
    ] {
        let mut schedule = RadioSchedule::new(1, 250.0);
        pushed.iter().for_each(|c| schedule.push(at(0), 0, CrtpRequest::Supervisor(*c).packet()));
        let sent = send(&mut schedule, (0, 40), true);
        let commands = sent.iter().filter_map(|(_, packet)| supervisor_command(packet));
        assert_eq!(commands.collect::<Vec<_>>(), wanted);
    }
}
