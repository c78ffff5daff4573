//! Datagrams of the gateway: one JSON object each, version 1.

use oqtal_bus::code::ReferenceKind;
use oqtal_bus::message::ReferenceV1;
use oqtal_bus::time::{Span, Time};
use serde::{Deserialize, Serialize};

/// Longest datagram \[bytes\].
pub const LONGEST_DATAGRAM: usize = 4096;
/// The version of the protocol.
const VERSION: u32 = 1;
/// Validity of a reference that states none \[ms\].
const DEFAULT_VALIDITY_MS: f64 = 100.0;

/// Content of a datagram.
#[derive(Debug)]
pub enum Content {
    /// A reference.
    Reference(Box<ReferenceV1>),
    /// A request as of `oqtal ctl`.
    Request {
        /// The command.
        command: String,
        /// Arguments of the command.
        arguments: Vec<String>,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Datagram {
    version: u32,
    reference: Option<ReferenceObject>,
    request: Option<String>,
    #[serde(default)]
    arguments: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ReferenceObject {
    position_m: [f64; 3],
    #[serde(default)]
    velocity_m_s: [f64; 3],
    #[serde(default)]
    acceleration_m_s2: [f64; 3],
    #[serde(default)]
    jerk_m_s3: [f64; 3],
    #[serde(default)]
    yaw_rad: f64,
    #[serde(default)]
    yaw_rate_rad_s: f64,
    attitude_xyzw: Option<[f64; 4]>,
    #[serde(default)]
    rate_rad_s: [f64; 3],
    /// Instant of the motion by CLOCK_BOOTTIME \[ns\]; that of the reception by default.
    time_ns: Option<u64>,
    valid_ms: Option<f64>,
}

/// The content of `datagram`, received at `now`.
///
/// # Errors
/// The text names the field at fault.
pub fn parse(datagram: &[u8], now: Time) -> Result<Content, String> {
    if datagram.len() > LONGEST_DATAGRAM {
        return Err(format!("longer than {LONGEST_DATAGRAM} bytes"));
    }
    let object: Datagram = serde_json::from_slice(datagram).map_err(|error| error.to_string())?;
    if object.version != VERSION {
        return Err(format!("version is {}, it must be {VERSION}", object.version));
    }
    match (object.reference, object.request) {
        (Some(reference), None) => Ok(Content::Reference(Box::new(reference.message(now)))),
        (None, Some(command)) => Ok(Content::Request { command, arguments: object.arguments }),
        _ => Err("a datagram has either `reference` or `request`".to_owned()),
    }
}

impl ReferenceObject {
    fn message(self, now: Time) -> ReferenceV1 {
        let time = self.time_ns.map_or(now, Time::from_nanos);
        let validity_ms = self.valid_ms.unwrap_or(DEFAULT_VALIDITY_MS);
        let kind = match self.attitude_xyzw {
            Some(_) => ReferenceKind::Attitude,
            None => ReferenceKind::Position,
        };
        ReferenceV1 {
            time,
            valid_until: time + Span::from_seconds(validity_ms * 1e-3),
            kind: kind.code(),
            position: self.position_m,
            velocity: self.velocity_m_s,
            acceleration: self.acceleration_m_s2,
            jerk: self.jerk_m_s3,
            yaw: self.yaw_rad,
            yaw_rate: self.yaw_rate_rad_s,
            attitude: self.attitude_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0]),
            rate: self.rate_rad_s,
        }
    }
}

/// Reply to a datagram.
#[derive(Debug, Serialize)]
pub struct GatewayReply {
    version: u32,
    answer: &'static str,
    text: String,
    /// Sequence number after which the sender of a datagram of the network continues.
    #[serde(skip_serializing_if = "Option::is_none")]
    continue_after: Option<u64>,
}

impl GatewayReply {
    /// A request was executed.
    pub fn done(text: String) -> Self {
        Self { version: VERSION, answer: "done", text, continue_after: None }
    }

    /// A datagram was refused.
    pub fn refused(text: String) -> Self {
        Self { version: VERSION, answer: "refused", text, continue_after: None }
    }

    /// A datagram was refused for its sequence number, which is `reason`; `last` is the highest one.
    pub fn out_of_sequence(reason: &str, last: u64) -> Self {
        let text = format!("the sequence is more than {reason}: continue after {last}");
        Self { continue_after: Some(last), ..Self::refused(text) }
    }

    /// The reply as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("a reply is plain JSON")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reference_has_defaults_and_its_own_validity() {
        let text = br#"{"version":1,"reference":{"position_m":[1,2,3],"valid_ms":50}}"#;
        let now = Time::from_nanos(1_000_000_000);
        let Ok(Content::Reference(message)) = parse(text, now) else { panic!("{text:?}") };
        assert_eq!((message.position, message.velocity), ([1.0, 2.0, 3.0], [0.0; 3]));
        assert_eq!((message.time, message.valid_until), (now, now + Span::from_millis(50)));
        assert_eq!(message.kind, ReferenceKind::Position.code());
    }

    #[test]
    fn other_datagrams_are_refused_with_the_reason() {
        for (text, part) in [
            (r#"{"version":2,"request":"land"}"#, "version is 2"),
            (r#"{"version":1}"#, "either"),
            (r#"{"version":1,"request":"land","reference":{"position_m":[0,0,1]}}"#, "either"),
            (r#"{"version":1,"reference":{"position":[0,0,1]}}"#, "position"),
            ("\u{0}", "expected"),
        ] {
            let told = parse(text.as_bytes(), Time::UNSET).unwrap_err();
            assert!(told.contains(part), "{text}: {told}");
        }
        let long = [b' '; LONGEST_DATAGRAM + 1];
        assert_eq!(parse(&long, Time::UNSET).unwrap_err(), "longer than 4096 bytes");
    }
}
