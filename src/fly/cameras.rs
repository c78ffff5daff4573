//! The flag `--mocap`: source of the poses of a flight, and the processes that publish them.

use std::net::{Ipv4Addr, TcpListener, UdpSocket};

use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config, Setting};
use oqtal_observe::recording::recording_path;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::CameraLink;

use super::vehicle::CommandLink;

/// Forms of the flag, for messages.
const FORMS: &str = "expected one of
  emulated
  replay:FILE
  qtm, vrpn or natnet
  link:qtm:HOST[:PORT],body=NAME, link:vrpn:HOST[:PORT],body=NAME or link:natnet:HOST,body=NAME";
/// Number of ports tried until free ones are found \[-\].
const PORT_TRIES: u32 = 100;
/// Distances between the ports of one server \[-\]: for QTM little endian, big endian and discovery; for NatNet requests and
/// frames.
const PORT_DISTANCES: [u16; 3] = [0, 1, 3];

/// The value of the flag.
#[derive(Clone, Debug)]
pub enum MocapSource {
    /// Emulated cameras, over the bus.
    Emulated,
    /// Poses of a recording.
    Replay(String),
    /// Emulated cameras, over the network with this protocol, and a receiver.
    Served(&'static str),
    /// Real cameras at this link, and a receiver.
    Linked(CameraLink),
}

/// Parses the flag.
///
/// # Errors
/// The text has none of the forms; the message lists them.
pub fn parse(text: &str) -> Result<MocapSource, String> {
    if let Some(protocol) = ["qtm", "vrpn", "natnet"].into_iter().find(|name| *name == text) {
        return Ok(MocapSource::Served(protocol));
    }
    match text.split_once(':') {
        None if text == "emulated" => Ok(MocapSource::Emulated),
        Some(("replay", file)) if !file.is_empty() => {
            let file = recording_path(file)?.display().to_string();
            if file.ends_with(".mcap") {
                return Err(format!(
                    "{file} has the messages of a flight, not only poses: `oqtal replay {file}` executes the daemon on them, \
                     `oqtal export {file} --format tum` writes its poses as files for replay:FILE"
                ));
            }
            Ok(MocapSource::Replay(file))
        }
        Some(("link", link)) => match link.parse::<CameraLink>() {
            Ok(link) if link.bodies.len() == 1 && link.bodies[0].instance.is_none() => {
                Ok(MocapSource::Linked(link))
            }
            Ok(_) => Err("a flight needs one body=NAME, without an instance".to_owned()),
            Err(error) => Err(error.to_string()),
        },
        _ => Err(FORMS.to_owned()),
    }
}

impl MocapSource {
    /// Appends the settings of the configuration that the flag implies.
    pub fn settings(&self, settings: &mut Vec<Setting>) {
        let mut set = |key: &str, value: toml::Value| {
            settings.push(Setting::flag("--mocap", key, value));
        };
        set("mocap.replay", if let Self::Replay(file) = self { file.as_str() } else { "" }.into());
        if let Self::Linked(link) = self {
            set("receiver.link", link.to_string().into());
        }
    }
}

/// Path of a flight's poses.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum PosePath {
    /// Published by emulated cameras, or from a recording.
    #[default]
    Bus,
    /// Served by emulated cameras and received at this link.
    Served(CameraLink),
    /// Received from real cameras.
    Linked,
}

impl PosePath {
    /// Path requested by the flag. Completes the configuration accordingly.
    ///
    /// # Errors
    /// The clock is virtual, or real cameras would observe a simulated vehicle (exit code 64); or no ports are free.
    pub fn open(
        source: Option<&MocapSource>,
        commands: &CommandLink,
        config: &mut Config,
    ) -> Result<Self, Failure> {
        let usage = |message: &str| Err(Failure::new(Exit::Usage, message));
        let path = match source {
            None | Some(MocapSource::Emulated | MocapSource::Replay(_)) => return Ok(Self::Bus),
            Some(MocapSource::Served(_)) if matches!(commands, CommandLink::Linked(_)) => {
                // The receiver cannot detect that these poses are emulated, so the daemon would fly a real vehicle with them.
                return usage(
                    "--mocap over a network shows a simulated vehicle: leave it out for a vehicle at a link, or name its cameras by --mocap link:LINK",
                );
            }
            Some(MocapSource::Served(protocol)) => Self::serve(protocol, config)?,
            Some(MocapSource::Linked(_)) if !matches!(commands, CommandLink::Linked(_)) => {
                return usage(
                    "--mocap link: real cameras do not see a simulated vehicle: add --vehicle link:LINK, or leave --mocap out",
                );
            }
            Some(MocapSource::Linked(_)) => {
                // The cameras see the real vehicle; nothing is simulated.
                config.plant.shadow = false;
                Self::Linked
            }
        };
        if config.clock.kind != ClockKind::Real {
            return usage("--mocap over a network needs the real clock: leave out --clock");
        }
        config.check()?;
        Ok(path)
    }

    /// Emulated cameras that serve their poses on free ports of this machine, and a receiver for them.
    fn serve(protocol: &str, config: &mut Config) -> Result<Self, Failure> {
        let port = free_port().ok_or_else(|| {
            let message = "no free ports on 127.0.0.1 for the emulated cameras; leave --mocap out";
            Failure::new(Exit::System, message)
        })?;
        let serve = &mut config.mocap.serve;
        serve.protocols = format!("{protocol}:{port}");
        serve.listen = Ipv4Addr::LOCALHOST.to_string();
        serve.publish = false;
        let text = format!("{protocol}:{}:{port},body={}", serve.listen, serve.body);
        let link: CameraLink =
            text.parse().map_err(|error| Failure::new(Exit::Config, format!("{error}")))?;
        config.receiver.link = link.to_string();
        // The latency of the emulated cameras is known only here.
        config.receiver.camera_latency_ms = config.mocap.latency_ms;
        Ok(Self::Served(link))
    }

    /// Processes of a flight whose commands are sent by these processes.
    pub fn roles(&self, commands: &[Role]) -> Vec<Role> {
        let mut roles = Vec::new();
        for role in commands {
            match (self, role) {
                (Self::Served(_), Role::Mocap) => roles.extend([Role::Mocap, Role::Receiver]),
                (Self::Linked, Role::Mocap) => roles.push(Role::Receiver),
                (_, role) => roles.push(*role),
            }
        }
        roles
    }

    /// Link at which emulated cameras must answer before a receiver can connect; `None` without emulated cameras.
    pub fn awaited(&self) -> Option<&CameraLink> {
        match self {
            Self::Served(link) => Some(link),
            Self::Bus | Self::Linked => None,
        }
    }
}

/// Free port of this machine after which the further ports of every protocol are also free.
fn free_port() -> Option<u16> {
    (0..PORT_TRIES).find_map(|_| {
        let first = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).ok()?.local_addr().ok()?.port();
        let is_free = |distance: u16| {
            let port = first.checked_add(distance)?;
            let free = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
                && UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).is_ok();
            free.then_some(())
        };
        PORT_DISTANCES.into_iter().all(|distance| is_free(distance).is_some()).then_some(first)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_read_and_any_other_text_is_refused_with_the_forms() {
        assert!(matches!(parse("emulated"), Ok(MocapSource::Emulated)));
        assert!(matches!(parse("vrpn"), Ok(MocapSource::Served("vrpn"))));
        assert!(matches!(parse("replay:a.csv"), Ok(MocapSource::Replay(_))));
        assert!(parse("replay:d/flight.mcap").unwrap_err().contains("oqtal replay d/flight.mcap"));
        let Ok(MocapSource::Linked(link)) = parse("link:qtm:10.0.0.2,body=quad") else { panic!() };
        assert_eq!(link.to_string(), "qtm:10.0.0.2,body=quad");
        for wrong in ["", "optitrack", "replay:", "qtm:10.0.0.2"] {
            assert!(parse(wrong).unwrap_err().contains("link:vrpn:HOST"), "{wrong}");
        }
        assert!(parse("link:qtm:10.0.0.2").unwrap_err().contains("one body=NAME"));
        assert!(parse("link:qtm:h,body=a@b").unwrap_err().contains("without an instance"));
        assert!(parse("link:vicon:h,body=a").unwrap_err().contains("unknown kind"));
    }

    #[test]
    fn a_receiver_stands_behind_or_in_place_of_the_emulated_cameras() {
        let simulated = [Role::Plant, Role::Mocap, Role::Daemon];
        let served = PosePath::Served("qtm:127.0.0.1,body=quad".parse().unwrap());
        assert_eq!(
            served.roles(&simulated),
            [Role::Plant, Role::Mocap, Role::Receiver, Role::Daemon]
        );
        let real = [Role::Mocap, Role::Bridge, Role::Daemon];
        assert_eq!(PosePath::Linked.roles(&real), [Role::Receiver, Role::Bridge, Role::Daemon]);
        assert_eq!(PosePath::Bus.roles(&simulated), simulated);
    }
}
