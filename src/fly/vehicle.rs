//! The flag `--vehicle`: the vehicle of a flight, and the path of its commands.

use std::path::Path;

use oqtal_bus::time::Span;
use oqtal_bus::topic::Role;
use oqtal_config::{ClockKind, Config, Setting};
use oqtal_control::options::OptionError;
use oqtal_observe::command_path::CommandPath;
use oqtal_runtime::process::{Exit, Failure, instance_paths, roles};
use oqtal_wire::link::{
    AsctecLink, CrtpLink, HostPort, InvalidLink, LinkSpec, LinkText, MavlinkLink, MspLink,
    PortSpec, SerialSpec,
};

/// Forms of the flag, for messages.
const FORMS: &str = "expected one of
  sim[:hummingbird|:spacecraft|:crazyflie-2.1|:ardupilot-quad|:px4-quad|:betaflight-quad][,fidelity=eq61|rotors]
  bridge:asctec[,baud=57600][,xbee=transparent|api1|api2]
  bridge:mavlink[,autopilot=px4|ardupilot][,system=N]
  bridge:crtp
  bridge:msp
  link:LINK, where LINK is one of";
/// Time within which enough reports of the vehicle arrive to confirm that its motors have stopped.
const REPORTED_WITHIN: Span = Span::from_millis(1500);
/// Default time within which a vehicle at a link must answer \[s\].
const ANSWER_TIMEOUT_S: f64 = 20.0;
/// Least time within which it must answer \[s\].
const LEAST_ANSWER_TIMEOUT_S: f64 = 10.0;

/// The value of the flag.
#[derive(Clone, Debug)]
pub enum VehicleChoice {
    /// The simulated vehicle, commanded over the bus.
    Simulated {
        /// Name of the preset, `vehicle.preset`.
        preset: Option<String>,
        /// Value of `plant.fidelity`.
        fidelity: Option<String>,
    },
    /// The simulated vehicle, commanded by a bridge over a wire; the port of the link is provisional.
    Bridged(LinkSpec),
    /// The vehicle at a link, commanded by a bridge.
    Linked(LinkSpec),
}

/// Parses the flag.
///
/// # Errors
/// The text has none of the forms; the message lists them.
pub fn parse(text: &str) -> Result<VehicleChoice, String> {
    match text.split_once(':') {
        Some(("bridge", kind)) => {
            LinkSpec::without_port(kind).map(VehicleChoice::Bridged).map_err(|_| forms())
        }
        Some(("link", link)) => {
            let link = link.parse().map_err(|error: InvalidLink| error.to_string());
            link.map(VehicleChoice::Linked)
        }
        _ => parse_simulated(text).ok_or_else(forms),
    }
}

/// Forms of the flag, and of links.
fn forms() -> String {
    let links = LinkSpec::forms().into_iter().map(|form| format!("\n    {form}"));
    std::iter::once(FORMS.to_owned()).chain(links).collect()
}

fn parse_simulated(text: &str) -> Option<VehicleChoice> {
    let mut text = LinkText::split(text);
    let (kind, preset) = (text.kind, text.address.map(str::to_owned));
    let fidelity = text.take("fidelity").ok()?.map(str::to_owned);
    text.finish().ok()?;
    (kind == "sim").then_some(VehicleChoice::Simulated { preset, fidelity })
}

impl VehicleChoice {
    /// Appends the settings of the configuration that the flag implies.
    pub fn settings(&self, settings: &mut Vec<Setting>) {
        let mut set = |key: &str, value: toml::Value| {
            settings.push(Setting::flag("--vehicle", key, value));
        };
        // Only these vehicles have the protocol.
        match self {
            Self::Bridged(LinkSpec::Crtp(_)) => set("vehicle.preset", "crazyflie-2.1".into()),
            Self::Bridged(LinkSpec::Msp(_)) => set("vehicle.preset", "betaflight-quad".into()),
            _ => {}
        }
        let Self::Simulated { preset, fidelity } = self else { return };
        set("plant.wire.link", "".into());
        set("plant.truth", "".into());
        set("plant.shadow", false.into());
        for (key, value) in [("vehicle.preset", preset), ("plant.fidelity", fidelity)] {
            value.iter().for_each(|value| set(key, value.as_str().into()));
        }
    }
}

/// Path of a flight's commands, with the link.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CommandLink {
    /// Over the bus to the simulated vehicle.
    #[default]
    Bus,
    /// By a bridge over a wire to the simulated vehicle.
    Bridged {
        /// Link at the bridge's end.
        bridge: LinkSpec,
        /// Link at the vehicle's end.
        vehicle: LinkSpec,
    },
    /// By a bridge to the vehicle at this link.
    Linked(LinkSpec),
}

impl CommandLink {
    /// Path requested by `choice`, or else by the configuration. Completes the configuration accordingly.
    ///
    /// # Errors
    /// The clock is virtual, or a recording is played (exit code 64); a link is invalid (78).
    pub fn open(choice: Option<&VehicleChoice>, config: &mut Config) -> Result<Self, Failure> {
        let path = match choice {
            Some(VehicleChoice::Simulated { .. }) => Self::Bus,
            Some(VehicleChoice::Bridged(link)) => Self::bridged(link, config)?,
            Some(VehicleChoice::Linked(link)) => Self::Linked(link.clone()),
            None => Self::configured(config)?,
        };
        if !config.plant.truth.is_empty() && !matches!(path, Self::Linked(_)) {
            let message = format!(
                "--truth {} is for a vehicle at a link: give --vehicle link:LINK, or leave out --truth",
                config.plant.truth
            );
            return Err(Failure::new(Exit::Usage, message));
        }
        if path == Self::Bus {
            return Ok(path);
        }
        if config.clock.kind != ClockKind::Real || config.is_replay() {
            let message = format!(
                "--vehicle {} needs the real clock and emulated cameras: leave out --clock and --mocap",
                path.command_path()
            );
            return Err(Failure::new(Exit::Usage, message));
        }
        path.complete(config);
        config.check()?;
        Ok(path)
    }

    /// Path given by a configuration, for example that of an earlier flight.
    fn configured(config: &Config) -> Result<Self, Failure> {
        let located = |error: OptionError| Failure::from(config.locate(&error));
        if let Some(link) = oqtal_plant_sim::wire::link(config).map_err(located)? {
            return Self::bridged(&link, config);
        }
        let link = oqtal_bridge::link(config).map_err(located)?;
        Ok(link
            .filter(|_| config.plant.shadow || !config.plant.truth.is_empty())
            .map_or(Self::Bus, Self::Linked))
    }

    /// Path over `link`, at ports that belong to this instance.
    fn bridged(link: &LinkSpec, config: &Config) -> Result<Self, Failure> {
        Ok(match link {
            LinkSpec::Asctec(link) => {
                let bridge = checked_path(link, &instance_paths(config)?.wire())?;
                Self::Bridged { vehicle: bridge.clone(), bridge }
            }
            LinkSpec::Mavlink(link) => {
                let at = |port| LinkSpec::Mavlink(MavlinkLink { port, ..link.clone() });
                let address = own_address();
                let bridge = at(PortSpec::UdpIn(address.clone()));
                Self::Bridged { bridge, vehicle: at(PortSpec::UdpOut(address)) }
            }
            LinkSpec::Msp(_) => {
                let at = |port| LinkSpec::Msp(MspLink { port });
                let address = own_address();
                let bridge = at(PortSpec::UdpOut(address.clone()));
                Self::Bridged { bridge, vehicle: at(PortSpec::UdpIn(address)) }
            }
            LinkSpec::Crtp(_) => {
                let vehicle = LinkSpec::Crtp(CrtpLink::Udp(own_address()));
                Self::Bridged { bridge: vehicle.clone(), vehicle }
            }
        })
    }

    fn complete(&self, config: &mut Config) {
        match self {
            Self::Bus => {}
            Self::Bridged { bridge, vehicle } => {
                config.bridge.link = bridge.to_string();
                config.plant.wire.link = vehicle.to_string();
                config.plant.shadow = false;
                config.safety.allow_emulated_poses = true;
                config.bridge.vehicle_time_out_ms = config.plant.wire.time_out_ms;
            }
            Self::Linked(link) => {
                config.bridge.link = link.to_string();
                config.plant.wire.link.clear();
                // Only a firmware executed as a program has a truth of its own; a shadow supplies that of any other vehicle.
                config.plant.shadow = config.plant.truth.is_empty();
                config.safety.allow_emulated_poses |= !config.plant.shadow;
            }
        }
    }

    /// The path as named in the flight's record, without the path of a temporary link.
    pub fn command_path(&self) -> CommandPath {
        match self {
            Self::Bus => CommandPath::Bus,
            Self::Bridged { bridge, .. } => CommandPath::Bridged(bridge.kind()),
            Self::Linked(link) => CommandPath::Linked(link.to_string()),
        }
    }

    /// Processes of the flight, in start order.
    pub fn roles(&self, config: &Config) -> &'static [Role] {
        match self {
            Self::Bus => roles(config),
            Self::Linked(_) if !config.plant.shadow && config.plant.truth.is_empty() => {
                &[Role::Mocap, Role::Bridge, Role::Daemon]
            }
            Self::Bridged { .. } | Self::Linked(_) => {
                &[Role::Plant, Role::Mocap, Role::Bridge, Role::Daemon]
            }
        }
    }

    /// Path that the plant creates and the bridge then opens; `None` if the plant creates none.
    pub fn awaited(&self) -> Option<&Path> {
        match self {
            Self::Bridged { vehicle: LinkSpec::Asctec(link), .. } => {
                Some(Path::new(&link.serial.path))
            }
            Self::Bridged { .. } | Self::Bus | Self::Linked(_) => None,
        }
    }

    /// Time within which the vehicle must give its first answer; `None` without a bridge.
    pub fn answer_timeout(&self, config: &Config) -> Option<Span> {
        let seconds = config.trajectory.duration_s.unwrap_or(ANSWER_TIMEOUT_S);
        // However short the trajectory: the processes have to start, too.
        let seconds = seconds.max(LEAST_ANSWER_TIMEOUT_S);
        (*self != Self::Bus).then(|| Span::from_seconds(seconds))
    }

    /// Time within which a bridge has stopped the motors after a flight; zero without a bridge.
    pub fn rest_timeout(&self, config: &Config) -> Span {
        if *self == Self::Bus {
            return Span::ZERO;
        }
        let millis = config.bridge.rest_ms + config.bridge.motor_sequence_ms;
        Span::from_seconds(millis * 1e-3) + REPORTED_WITHIN
    }

    /// Failure for a vehicle that did not answer; `truth` is the source of its true motion.
    pub fn never_answered(&self, truth: &str) -> Failure {
        let path = self.command_path().to_string();
        let (check, logs) = if !truth.is_empty() {
            (
                "that the firmware has the addresses of the link and of --truth, and start it again",
                "plant-sim.log and bridge.log",
            )
        } else if path.contains(":asctec") {
            (
                "that vehicle and remote control are switched on, channel 5 at \"serial\", and that baud rate and XBee mode are those \
                 of the link",
                "bridge.log",
            )
        } else {
            (
                "that the vehicle is switched on, and that the link has its address, or port and baud rate",
                "bridge.log",
            )
        };
        let message = format!(
            "the vehicle at {path} does not answer; check {check}; see {logs} beside the report"
        );
        Failure::new(Exit::Peer, message)
    }
}

/// Port of emulated vehicles on a separate address.
const VEHICLE_PORT: u16 = 14_550;

/// Loopback address that no other flight uses: derived from the process id.
fn own_address() -> HostPort {
    let [_, high, middle, low] = std::process::id().to_be_bytes();
    HostPort { host: format!("127.{}.{middle}.{low}", 64 + high), port: VEHICLE_PORT }
}

/// `path` as the path of a serial link.
fn checked_path(link: &AsctecLink, path: &Path) -> Result<LinkSpec, Failure> {
    let serial = SerialSpec { path: path.display().to_string(), ..link.serial.clone() };
    let link = LinkSpec::Asctec(AsctecLink { serial, ..link.clone() });
    link.to_string().parse().map_err(|error| {
        Failure::new(Exit::Usage, format!("{error}; give a --root whose name has no comma"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_read_and_any_other_text_is_refused_with_the_forms() {
        let config = Config::default();
        for kind in
            ["asctec,baud=115200,xbee=api2", "mavlink,autopilot=px4,system=3", "crtp", "msp"]
        {
            let bridged = parse(&format!("bridge:{kind}")).unwrap();
            let VehicleChoice::Bridged(link) = bridged else { panic!("{bridged:?}") };
            let path = CommandLink::bridged(&link, &config).unwrap().command_path();
            assert_eq!(path.to_string(), format!("bridge:{kind}"));
        }
        let linked = parse("link:asctec:/dev/ttyUSB0").unwrap();
        let VehicleChoice::Linked(link) = linked else { panic!("{linked:?}") };
        assert_eq!(
            CommandLink::Linked(link).command_path().to_string(),
            "link:asctec:/dev/ttyUSB0"
        );
        assert!(matches!(
            parse("sim:hummingbird,fidelity=rotors"),
            Ok(VehicleChoice::Simulated { preset: Some(_), fidelity: Some(_) })
        ));
        for wrong in ["bridge", "bridge:sbus", "bridge:asctec,parity=1", "simulated", "sim,x=1"] {
            let message = parse(wrong).unwrap_err();
            let forms = ["link:LINK", "asctec:PATH", "mavlink:udpin:", "crtp:radio:", "msp:tcp:"];
            assert!(forms.iter().all(|form| message.contains(form)), "{wrong}: {message}");
        }
        assert!(parse("link:/dev/ttyUSB0").unwrap_err().contains("asctec:PATH"));
    }

    #[test]
    fn at_a_link_only_a_firmware_executed_as_a_program_is_flown_by_emulated_poses_unasked() {
        let path = CommandLink::Linked("asctec:/dev/ttyUSB0".parse().unwrap());
        let keys = |truth: &str| {
            let mut config = Config::default();
            config.plant.truth = truth.to_owned();
            path.complete(&mut config);
            let Config { plant, safety, bridge, .. } = config;
            (plant.shadow, safety.allow_emulated_poses, bridge.vehicle_time_out_ms)
        };
        assert_eq!(keys(""), (true, false, 0.0));
        assert_eq!(keys("mavlink:udpin:127.0.0.1:14551"), (false, true, 0.0));
    }
}
