//! Settings of a Betaflight vehicle.

use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::LinkSpec;
use oqtal_wire::msp::{MSP_ARM, MspDecoder, MspKind, MspModeRange, MspPacket, MspStatus, command};

use super::exchange::{
    ANSWER_WITHIN, ParameterReport, READ_BUFFER, SetupPort, TRIES, refuse_in_flight, row, table,
};
use crate::msp::{MspField, MspSettings, full_rates};

/// Range in which the first auxiliary channel arms, if no range arms: 1700 to 2100 us.
const ARM_RANGE: [u8; 4] = [MSP_ARM, 0, 32, 48];

/// Reads, checks and sets the settings of the vehicle at `spec`; see `set_up` of the module above.
pub(super) fn set_up(
    config: &Config,
    spec: &LinkSpec,
    apply: bool,
) -> Result<(String, bool), Failure> {
    let rates = full_rates(config).map_err(|error| config.locate(&error))?;
    let mut session = MspSession::open(config, spec)?;
    let found = session.read()?;
    if !found.is_betaflight() {
        let message = format!("the vehicle at {spec} does not have Betaflight; name its own link");
        return Err(Failure::new(Exit::Peer, message));
    }
    let status = session.exchange(command::STATUS, &[])?;
    let is_armed = MspStatus::read(status.payload()).is_some_and(|status| status.is_armed());
    refuse_in_flight(apply && is_armed)?;
    let mut now = found.clone();
    let is_right = |settings: &MspSettings| {
        let mut rules = settings.rules().into_iter();
        rules.all(|(_, is_met, _)| is_met) && settings.wrong_fields(rates).next().is_none()
    };
    if apply && !is_right(&found) {
        session.apply(&found, rates)?;
        now = session.read()?;
    }
    let lines = rule_lines(&found, &now).chain(field_lines(&found, &now, rates, apply));
    Ok((table("Betaflight", lines), is_right(&now)))
}

/// Lines of the settings, as `found` and as they are `now`.
fn field_lines(found: &MspSettings, now: &MspSettings, rates: [u8; 3], apply: bool) -> Vec<String> {
    let value =
        |settings: &MspSettings, field: &MspField| field.number(settings.payload(field.commands.0));
    let lines = MspField::all(rates).filter_map(move |field| {
        let before = value(found, &field);
        let was_right = field.is_right(found.payload(field.commands.0));
        let set = if apply && !was_right { value(now, &field) } else { None };
        // A setting that this version does not have is right.
        let is_absent = before.is_none() && was_right;
        let report = ParameterReport { wanted: field.parameter, found: before, set };
        (!is_absent).then(|| report.line())
    });
    lines.collect()
}

/// Lines of the rules without a number.
fn rule_lines(found: &MspSettings, now: &MspSettings) -> impl Iterator<Item = String> {
    found.rules().into_iter().zip(now.rules()).map(|((name, before, reason), (_, after, _))| {
        let (is, mark) = match (before, after) {
            (true, _) => ("right", ""),
            (false, true) => ("wrong", "set"),
            (false, false) => ("wrong", "wrong"),
        };
        row([name, is, "right", mark, reason])
    })
}

/// Exchange of settings with one vehicle.
struct MspSession {
    port: SetupPort,
    decoder: MspDecoder,
    /// Name of the link, for messages.
    link: String,
}

impl MspSession {
    fn open(config: &Config, spec: &LinkSpec) -> Result<Self, Failure> {
        let port = SetupPort::open(config, spec)?;
        Ok(Self { port, decoder: MspDecoder::new(), link: spec.to_string() })
    }

    /// Reads all settings.
    fn read(&mut self) -> Result<MspSettings, Failure> {
        let mut settings = MspSettings::default();
        while let Some(request) = settings.unread() {
            let packet = self.exchange(request.command, request.payload())?;
            settings.take(Time::now(), &packet);
        }
        Ok(settings)
    }

    /// Sets what deviates from its rule, and saves it.
    fn apply(&mut self, found: &MspSettings, rates: [u8; 3]) -> Result<(), Failure> {
        let mut packets: Vec<((u8, u8), Vec<u8>)> = Vec::new();
        for field in found.wrong_fields(rates) {
            let payload = found.payload(field.commands.0);
            let Some(number) = field.number(payload) else { continue };
            let known = packets.iter().position(|(commands, _)| *commands == field.commands);
            let index = known.unwrap_or_else(|| {
                packets.push((field.commands, payload.to_vec()));
                packets.len() - 1
            });
            field.set(&mut packets[index].1, field.parameter.value.in_place_of(number));
        }
        for ((_, set), payload) in packets {
            self.exchange(set, &payload)?;
        }
        let mut ranges = MspModeRange::all(found.payload(command::MODE_RANGES));
        if !ranges.clone().any(|range| range.arms())
            && let Some(free) = ranges.position(|range| range.low >= range.high)
        {
            let payload = [&[free as u8][..], &ARM_RANGE].concat();
            self.exchange(command::SET_MODE_RANGE, &payload)?;
        }
        self.exchange(command::SAVE, &[]).map(drop)
    }

    /// Sends a request until it is answered; returns the reply, or the refusal.
    fn exchange(&mut self, number: u8, payload: &[u8]) -> Result<MspPacket, Failure> {
        for _ in 0..TRIES {
            self.port.write(MspPacket::request(number, payload).as_bytes())?;
            let deadline = Time::now() + ANSWER_WITHIN;
            let mut buffer = [0; READ_BUFFER];
            while Time::now() < deadline {
                let bytes = self.port.read(&mut buffer)?;
                let is_reply = |packet: &MspPacket| {
                    packet.kind != MspKind::Request && packet.command == number
                };
                let mut packets = self.decoder.push(bytes);
                let reply = packets.find(is_reply);
                packets.for_each(drop);
                if let Some(reply) = reply {
                    return Ok(reply);
                }
            }
        }
        let message = format!(
            "no vehicle answers MSP at {}; check that it is switched on, that port and speed are its own, that MSP is on for this port, and that no bridge uses the vehicle",
            self.link
        );
        Err(Failure::new(Exit::Peer, message))
    }
}
