//! Parameters of an autopilot of MAVLink.

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::{AutopilotKind, LinkSpec, MavlinkLink};
use oqtal_wire::mavlink::{
    AutopilotFirmware, MavlinkAddress, MavlinkContent, MavlinkDecoder, MavlinkEncoder,
    MavlinkHeartbeat, ParameterName, ParameterValue, SignatureCheck,
};

use super::exchange::{
    ANSWER_WITHIN, ParameterReport, READ_BUFFER, SetupPort, TRIES, refuse_in_flight, table,
};
use crate::mavlink::{
    OWN_HEARTBEAT, earlier_name, encoder_and_check, is_accepted, wanted_parameters,
};
use crate::protocol::PeriodicTimer;
use crate::setup::unix_us;
use crate::wanted::WantedParameter;

/// Time within which a heartbeat must come.
const HEARTBEAT_WITHIN: Span = Span::from_millis(6000);
/// Note below the table if parameters were set.
const RESTART: &str = "restart the autopilot now: some parameters take effect at its start\n";
/// Period of own heartbeats, which some autopilots need before they answer.
const HEARTBEAT_PERIOD: Span = Span::from_millis(500);

/// Reads, checks and sets the parameters of the vehicle at `spec`; see `set_up` of the module above.
pub(super) fn set_up(
    config: &Config,
    (spec, link): (&LinkSpec, &MavlinkLink),
    apply: bool,
) -> Result<(String, bool), Failure> {
    let mut session = ParameterSession::open(config, spec, link)?;
    refuse_in_flight(apply && session.is_armed)?;
    let mut reports = Vec::new();
    for wanted in wanted_parameters(session.kind) {
        let mut report = session.check(wanted, apply)?;
        if let (None, Some(name)) = (report.found, earlier_name(wanted.name)) {
            let earlier = session.check(&WantedParameter { name, ..*wanted }, apply)?;
            report = if earlier.found.is_some() { earlier } else { report };
        }
        reports.push(report);
    }
    let all_right = reports.iter().all(ParameterReport::is_right);
    let firmware = AutopilotFirmware::Known(session.kind);
    let title = format!("{firmware} of system {}", session.vehicle.system);
    let rows = table(&title, reports.iter().map(ParameterReport::line));
    let has_set = reports.iter().any(|report| report.set.is_some());
    let restart = if has_set { RESTART } else { "" };
    Ok((format!("{rows}{restart}"), all_right))
}

/// Exchange of parameters with one vehicle.
struct ParameterSession {
    port: SetupPort,
    encoder: MavlinkEncoder,
    decoder: MavlinkDecoder,
    check: Option<SignatureCheck>,
    vehicle: MavlinkAddress,
    kind: AutopilotKind,
    is_armed: bool,
    heartbeat_timer: PeriodicTimer,
}

impl ParameterSession {
    fn open(config: &Config, spec: &LinkSpec, link: &MavlinkLink) -> Result<Self, Failure> {
        let located = |error| config.locate(&error);
        let (encoder, check) = encoder_and_check(config, unix_us()).map_err(located)?;
        let signed = if check.is_some() { ", that it signs with the same key" } else { "" };
        let mut session = Self {
            port: SetupPort::open(config, spec)?,
            encoder,
            decoder: MavlinkDecoder::new(),
            check,
            vehicle: MavlinkAddress::ALL,
            kind: AutopilotKind::ArduPilot,
            is_armed: false,
            heartbeat_timer: PeriodicTimer::new(HEARTBEAT_PERIOD),
        };
        let is_wanted = |heartbeat: &MavlinkHeartbeat, from: MavlinkAddress| {
            let AutopilotFirmware::Known(kind) = heartbeat.autopilot else { return None };
            let fits = link.autopilot.is_none_or(|wanted| wanted == kind)
                && link.system.is_none_or(|wanted| wanted == from.system);
            fits.then_some((from, kind, heartbeat.is_armed))
        };
        let found = session.wait_for(HEARTBEAT_WITHIN, |from, content| match content {
            MavlinkContent::Heartbeat(heartbeat) => is_wanted(heartbeat, from),
            _ => None,
        })?;
        let (vehicle, kind, is_armed) = found.ok_or_else(|| {
            let message = format!(
                "no heartbeat of such a vehicle at {spec} within {} s; check that it is switched on, that port, speed, autopilot and system are its own{signed}",
                HEARTBEAT_WITHIN.seconds()
            );
            Failure::new(Exit::Peer, message)
        })?;
        (session.vehicle, session.kind, session.is_armed) = (vehicle, kind, is_armed);
        Ok(session)
    }

    /// Reads a parameter, and sets it if it is wrong and is to `apply`.
    fn check(&mut self, wanted: &WantedParameter, apply: bool) -> Result<ParameterReport, Failure> {
        let Some(name) = ParameterName::new(wanted.name) else {
            return Err(Failure::new(Exit::Internal, format!("{} is not a name", wanted.name)));
        };
        let as_bits = self.kind.sends_integers_as_bits();
        let target = self.vehicle;
        let request = MavlinkContent::ParameterRequest { target, name };
        let value = self.exchange(&request, name)?;
        let found = value.map(|value| value.number(as_bits));
        let mut report = ParameterReport { wanted: *wanted, found, set: None };
        if let (true, false, Some(value), Some(number)) = (apply, report.is_right(), value, found) {
            let value = value.with(wanted.value.in_place_of(number), as_bits);
            self.exchange(&MavlinkContent::ParameterSet { target, name, value }, name)?;
            // An unsolicited value may repeat the value that was set: the parameter is requested again.
            let read = self.exchange(&request, name)?;
            report.set = read.map(|value| value.number(as_bits));
        }
        Ok(report)
    }

    /// Sends `request` until the parameter `name` comes; `None` if it never does.
    fn exchange(
        &mut self,
        request: &MavlinkContent,
        name: ParameterName,
    ) -> Result<Option<ParameterValue>, Failure> {
        for _ in 0..TRIES {
            self.send(request)?;
            let vehicle = self.vehicle;
            let value = self.wait_for(ANSWER_WITHIN, |from, content| match content {
                MavlinkContent::Parameter { name: reported, value }
                    if from == vehicle && *reported == name =>
                {
                    Some(*value)
                }
                _ => None,
            })?;
            if value.is_some() {
                return Ok(value);
            }
        }
        Ok(None)
    }

    /// Waits until `pick` finds something in a message; `None` after the time `within`.
    fn wait_for<T>(
        &mut self,
        within: Span,
        mut pick: impl FnMut(MavlinkAddress, &MavlinkContent) -> Option<T>,
    ) -> Result<Option<T>, Failure> {
        let deadline = Time::now() + within;
        let mut buffer = [0; READ_BUFFER];
        while Time::now() < deadline {
            if self.heartbeat_timer.is_due(Time::now(), false) {
                self.send(&MavlinkContent::Heartbeat(OWN_HEARTBEAT))?;
            }
            let Self { port, encoder, decoder, check, .. } = self;
            let bytes = port.read(&mut buffer)?;
            let mut packets =
                decoder.push(bytes).filter(|packet| is_accepted(check, encoder, packet));
            let found = packets.find_map(|packet| pick(packet.from, &packet.content));
            packets.for_each(drop);
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    fn send(&mut self, content: &MavlinkContent) -> Result<(), Failure> {
        let Some(wire) = self.encoder.encode(content) else { return Ok(()) };
        self.port.write(wire.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use std::net::{SocketAddr, UdpSocket};
    use std::thread::JoinHandle;

    use super::*;

    const OWN: MavlinkAddress = MavlinkAddress { system: 1, component: MavlinkAddress::AUTOPILOT };

    type SetupThread = JoinHandle<Result<(String, bool), Failure>>;

    /// A set-up that has received the vehicle's heartbeat; the vehicle's socket and the address of the set-up.
    fn setup_of(is_armed: bool, apply: bool) -> (SetupThread, UdpSocket, SocketAddr) {
        let vehicle = UdpSocket::bind("127.0.0.1:0").unwrap();
        let spec: LinkSpec =
            format!("mavlink:udpout:{}", vehicle.local_addr().unwrap()).parse().unwrap();
        let LinkSpec::Mavlink(link) = &spec else { panic!("{spec}") };
        let link = link.clone();
        let setup = std::thread::spawn(move || set_up(&Config::default(), (&spec, &link), apply));
        let (_, host) = vehicle.recv_from(&mut [0; READ_BUFFER]).unwrap();
        let heartbeat = MavlinkContent::Heartbeat(MavlinkHeartbeat {
            autopilot: AutopilotFirmware::Known(AutopilotKind::ArduPilot),
            custom_mode: 20,
            is_armed,
            is_simulated: false,
        });
        let wire = MavlinkEncoder::new(OWN).encode(&heartbeat).unwrap();
        vehicle.send_to(wire.as_bytes(), host).unwrap();
        (setup, vehicle, host)
    }

    #[test]
    fn a_parameter_of_earlier_firmware_is_found_under_its_earlier_name() {
        let (setup, vehicle, host) = setup_of(false, false);
        let (mut encoder, mut decoder) = (MavlinkEncoder::new(OWN), MavlinkDecoder::new());
        vehicle.set_read_timeout(Some(std::time::Duration::from_millis(50))).unwrap();
        let value = ParameterValue { raw: 0.0, is_real: true, code: ParameterValue::REAL32 };
        while !setup.is_finished() {
            let mut buffer = [0; READ_BUFFER];
            let Ok(count) = vehicle.recv(&mut buffer) else { continue };
            for packet in decoder.push(&buffer[..count]) {
                let MavlinkContent::ParameterRequest { name, .. } = packet.content else {
                    continue;
                };
                // ArduCopter 4.5 does not answer requests for a name that it does not have.
                if name.as_str() != "GPS1_TYPE" {
                    let wire = encoder.encode(&MavlinkContent::Parameter { name, value }).unwrap();
                    vehicle.send_to(wire.as_bytes(), host).unwrap();
                }
            }
        }
        let (table, _) = setup.join().unwrap().unwrap();
        assert!(table.contains("\nGPS_TYPE ") && !table.contains("GPS1_TYPE"), "{table}");
    }

    #[test]
    fn the_parameters_of_a_vehicle_whose_motors_run_are_not_changed() {
        let (setup, ..) = setup_of(true, true);
        let failure = setup.join().unwrap().unwrap_err();
        assert!(failure.message.contains("the motors of the vehicle run"), "{}", failure.message);
    }
}
