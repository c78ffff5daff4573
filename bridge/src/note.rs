//! Events of the bridge that are logged.

use oqtal_bus::code::VehicleRefusal;
use oqtal_wire::link::LinkSpec;

use crate::motors::MotorEvent;
use crate::protocol::VehicleText;

/// Event for the log, passed from the real-time thread to the background thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// The vehicle answers.
    Answering,
    /// The vehicle has stopped answering.
    Silent {
        /// Number of damaged frames received so far \[-\].
        damaged: u64,
    },
    /// Another vehicle answers in place of one that stopped answering.
    Replaced,
    /// Event of the motors.
    Motors(MotorEvent),
    /// The motors did not stop: the emergency stop is sent.
    EmergencyStop,
    /// A command was rejected: past its timeout, or stamped in the future.
    CommandRejected,
    /// The port did not send what it was given, and that was discarded.
    Stuck,
    /// The tenant hung while it wrote a frame, and was killed.
    TenantKilled,
    /// The vehicle refuses the request.
    Refused(VehicleRefusal),
    /// Line of text sent by the vehicle.
    Text(VehicleText),
}

impl Note {
    /// Writes the event of the vehicle at `link` to the log.
    pub fn log(self, link: &LinkSpec) {
        match self {
            Self::Answering => tracing::info!("the vehicle answers"),
            Self::Silent { damaged } => tracing::warn!(
                damaged,
                "the vehicle is silent: is it switched on?{}",
                silence_hint(link)
            ),
            Self::Replaced => tracing::warn!(
                "another vehicle answers in place of the silent one: name the right one in `bridge.link`, as with `,system=N`"
            ),
            Self::Motors(event) => log_motors(event, link),
            Self::EmergencyStop => tracing::warn!(
                "motors did not stop: the emergency stop is sent{}",
                emergency_stop_hint(link)
            ),
            Self::CommandRejected => tracing::warn!(
                "a command was older than `bridge.command-timeout-periods` and was not sent; nor are others like it"
            ),
            Self::Stuck => tracing::warn!(
                "the port did not send what it was given, which was discarded: check `bridge.hardware-flow-control` against the radio"
            ),
            Self::TenantKilled => tracing::error!(
                "the chain hung while it wrote to the port, and was killed: otherwise it could send an old command later"
            ),
            Self::Refused(refusal) => tracing::warn!("{refusal}"),
            Self::Text(VehicleText { is_trouble: true, text }) => {
                tracing::warn!("the vehicle says: {text}");
            }
            Self::Text(VehicleText { text, .. }) => tracing::info!("the vehicle says: {text}"),
        }
    }
}

/// Further cause of silence of the vehicle at `link`; empty without one.
fn silence_hint(link: &LinkSpec) -> &'static str {
    match link {
        LinkSpec::Asctec(_) => " It also needs its serial interface enabled on the remote control",
        LinkSpec::Mavlink(_) | LinkSpec::Crtp(_) | LinkSpec::Msp(_) => "",
    }
}

/// Remedy for motors of the vehicle at `link` that did not start; empty without one.
fn start_hint(link: &LinkSpec) -> &'static str {
    match link {
        LinkSpec::Asctec(_) => ". Check `bridge.asctec.motor-yaw-counts` and the remote control",
        LinkSpec::Mavlink(_) => {
            ". An autopilot needs 6000 ms, as the presets ardupilot-quad and px4-quad give it"
        }
        LinkSpec::Crtp(_) | LinkSpec::Msp(_) => "",
    }
}

/// Consequence of the emergency stop for the vehicle at `link`; empty if none is known.
fn emergency_stop_hint(link: &LinkSpec) -> &'static str {
    match link {
        LinkSpec::Crtp(_) => "; the vehicle stays locked until it is restarted",
        LinkSpec::Asctec(_) | LinkSpec::Mavlink(_) | LinkSpec::Msp(_) => "",
    }
}

/// Remedy for motors of the vehicle at `link` that did not stop.
fn stop_hint(link: &LinkSpec) -> &'static str {
    match link {
        LinkSpec::Crtp(_) => "switch the vehicle off",
        LinkSpec::Asctec(_) | LinkSpec::Mavlink(_) | LinkSpec::Msp(_) => {
            "stop them by the remote control"
        }
    }
}

fn log_motors(event: MotorEvent, link: &LinkSpec) {
    match event {
        MotorEvent::Starting => tracing::info!("motors are being started"),
        MotorEvent::Running => tracing::info!("motors run"),
        MotorEvent::Stopping => tracing::info!("motors are being stopped"),
        MotorEvent::Stopped => tracing::info!("motors have stopped"),
        MotorEvent::StartFailed => tracing::warn!(
            "motors did not start within `bridge.motor-sequence-ms`: zero set-point until disarmed; see what the vehicle says{}",
            start_hint(link)
        ),
        MotorEvent::StopFailed => {
            tracing::warn!("motors did not stop: zero set-point; {}", stop_hint(link));
        }
        MotorEvent::StoppedInFlight => {
            tracing::warn!("motors stopped in flight: zero set-point until disarmed");
        }
        MotorEvent::DaemonSilent(lasted) => tracing::warn!(
            "no flight command for {:.2} s: the set-point has been zero for nearly as long, and stays zero until the daemon is back and disarmed",
            lasted.seconds()
        ),
        MotorEvent::ControlTaken => tracing::warn!(
            "a pilot or the vehicle itself has control: no set-points and no stop are sent until the motors are off or control is given back"
        ),
        MotorEvent::StopWithheld => tracing::warn!(
            "a pilot or the vehicle itself has control: the operator's stop is not sent; only the remote control stops the motors. It is sent if control is given back"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hints_are_those_of_the_protocol_of_the_link() {
        let hints = |link: &str| {
            let link: LinkSpec = link.parse().unwrap();
            [silence_hint(&link), start_hint(&link)].map(|hint| !hint.is_empty())
        };
        assert_eq!(hints("asctec:/dev/ttyUSB0"), [true, true]);
        assert_eq!(hints("mavlink:udpin:127.0.0.1:14550"), [false, true]);
        assert_eq!(hints("crtp:udp:127.0.0.1:19850"), [false, false]);
        assert_eq!(hints("msp:tcp:127.0.0.1:5761"), [false, false]);
    }
}
