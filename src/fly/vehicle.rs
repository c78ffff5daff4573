//! `--vehicle`: what flies, and how commands get there.

use std::path::Path;

use oqtal_bus::bus::Bus;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{Role, TRUTH};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_config::{ClockKind, Config, Setting};
use oqtal_observe::command_path::CommandPath;
use oqtal_runtime::process::{Exit, Failure, instance_paths, roles};
use oqtal_wire::link::LinkSpec;

/// What the flag can say, for messages.
const FORMS: &str = "sim[:hummingbird|:spacecraft][,fidelity=eq61|rotors], \
                     bridge:asctec[,baud=57600][,xbee=transparent|api1|api2] or link:asctec:PATH[,baud=57600][,xbee=transparent|api1|api2]";
/// Whoever publishes the truth does so every millisecond.
const TRUTH_WITHIN: Span = Span::from_millis(500);
/// A vehicle at a link has so long to answer, unless a duration is given \[s\].
const ANSWER_S: f64 = 20.0;

/// What the flag says.
#[derive(Clone, Debug)]
pub enum VehicleChoice {
    /// The simulated vehicle, with commands off the bus.
    Simulated {
        /// Which.
        kind: Option<String>,
        /// How closely modelled.
        fidelity: Option<String>,
    },
    /// The simulated vehicle at the other end of a wire; the link's path is yet to be found.
    Bridged(LinkSpec),
    /// Whatever is at a link.
    Linked(LinkSpec),
}

/// Reads the flag.
///
/// # Errors
/// Says what can be written.
pub fn parse(text: &str) -> Result<VehicleChoice, String> {
    let link = |text: &str| text.parse::<LinkSpec>().map_err(|error| error.to_string());
    match text.split_once(':') {
        Some(("bridge", rest)) => {
            let (kind, options) =
                rest.split_once(',').map_or((rest, ""), |(kind, _)| (kind, &rest[kind.len()..]));
            let usage = |_| format!("`{text}` is none of {FORMS}");
            link(&format!("{kind}:/{options}")).map(VehicleChoice::Bridged).map_err(usage)
        }
        Some(("link", rest)) => link(rest).map(VehicleChoice::Linked),
        _ => parse_simulated(text).ok_or_else(|| format!("`{text}` is none of {FORMS}")),
    }
}

fn parse_simulated(text: &str) -> Option<VehicleChoice> {
    let (vehicle, option) = match text.split_once(',') {
        Some((vehicle, option)) => (vehicle, Some(option)),
        None => (text, None),
    };
    let kind = match vehicle.split_once(':') {
        None if vehicle == "sim" => None,
        Some(("sim", kind)) => Some(kind.to_owned()),
        _ => return None,
    };
    let fidelity = match option.map(|option| option.split_once('=')) {
        None => None,
        Some(Some(("fidelity", fidelity))) => Some(fidelity.to_owned()),
        Some(_) => return None,
    };
    Some(VehicleChoice::Simulated { kind, fidelity })
}

impl VehicleChoice {
    /// What it sets before the configuration is made.
    pub fn settings(&self, settings: &mut Vec<Setting>) {
        let Self::Simulated { kind, fidelity } = self else { return };
        let mut set = |key: &str, value: toml::Value| {
            settings.push(Setting::flag("--vehicle", key, value));
        };
        set("vehicle.wire.link", "".into());
        set("vehicle.shadow", false.into());
        for (key, value) in [("vehicle.kind", kind), ("vehicle.fidelity", fidelity)] {
            value.iter().for_each(|value| set(key, value.as_str().into()));
        }
    }
}

/// What a flight's commands go through, with the link itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum VehicleLink {
    /// Over the bus to the simulated vehicle.
    #[default]
    Bus,
    /// By a bridge through this link to the simulated vehicle.
    Bridged(LinkSpec),
    /// By a bridge to whatever is at this link.
    Linked(LinkSpec),
}

impl VehicleLink {
    /// The way that `choice`, or else the configuration, asks for; the configuration is completed for it.
    ///
    /// # Errors
    /// The clock is virtual, or a recording is played (exit code 64); a link has no meaning (78); the bus refuses.
    pub fn open(choice: Option<&VehicleChoice>, config: &mut Config) -> Result<Self, Failure> {
        let way = match choice {
            Some(VehicleChoice::Simulated { .. }) => Self::Bus,
            Some(VehicleChoice::Bridged(link)) => Self::Bridged(at_instance(link, config)?),
            Some(VehicleChoice::Linked(link)) => Self::Linked(link.clone()),
            None => Self::configured(config)?,
        };
        if way == Self::Bus {
            return Ok(way);
        }
        if config.clock.kind != ClockKind::Real || config.is_replay() {
            let message = format!(
                "--vehicle {} flies by the machine's clock and emulated cameras alone: leave out --clock and --mocap",
                way.command_path()
            );
            return Err(Failure::new(Exit::Usage, message));
        }
        way.complete(config)?;
        config.check()?;
        Ok(way)
    }

    /// As a flight before was flown, by the configuration that it left.
    fn configured(config: &Config) -> Result<Self, Failure> {
        if let Some(link) = config.vehicle.wire.link()? {
            return Ok(Self::Bridged(at_instance(&link, config)?));
        }
        let link = config.bridge.link()?;
        Ok(link.filter(|_| config.vehicle.shadow).map_or(Self::Bus, Self::Linked))
    }

    fn complete(&self, config: &mut Config) -> Result<(), Failure> {
        match self {
            Self::Bus => {}
            Self::Bridged(link) => {
                config.bridge.link = link.to_string();
                config.vehicle.wire.link = link.to_string();
                config.vehicle.shadow = false;
            }
            Self::Linked(link) => {
                config.bridge.link = link.to_string();
                config.vehicle.wire.link.clear();
                config.vehicle.shadow = !is_truth_told(config)?;
            }
        }
        Ok(())
    }

    /// As a flight records it.
    #[must_use]
    pub fn command_path(&self) -> CommandPath {
        match self {
            Self::Bus => CommandPath::Bus,
            Self::Bridged(link) => {
                let path = format!(":{}", link.path());
                CommandPath::Bridged(link.to_string().replacen(&path, "", 1))
            }
            Self::Linked(link) => CommandPath::Linked(link.to_string()),
        }
    }

    /// The processes of a flight this way, in the order in which they are started.
    #[must_use]
    pub fn roles(&self, config: &Config) -> &'static [Role] {
        match self {
            Self::Bus => roles(config),
            Self::Linked(_) if !config.vehicle.shadow => &[Role::Mocap, Role::Bridge, Role::Daemon],
            Self::Bridged(_) | Self::Linked(_) => {
                &[Role::Plant, Role::Mocap, Role::Bridge, Role::Daemon]
            }
        }
    }

    /// What the plant makes before a bridge can open it.
    #[must_use]
    pub fn awaited(&self) -> Option<&Path> {
        match self {
            Self::Bridged(link) => Some(Path::new(link.path())),
            Self::Bus | Self::Linked(_) => None,
        }
    }

    /// How long a vehicle may stay silent before the flight is given up; for ever where there is none that could.
    #[must_use]
    pub fn silence(&self, config: &Config) -> Option<Span> {
        let seconds = config.trajectory.duration_s.unwrap_or(ANSWER_S);
        (*self != Self::Bus).then(|| Span::from_seconds(seconds))
    }

    /// A vehicle that never answered.
    #[must_use]
    pub fn never_answered(&self) -> Failure {
        let message = format!(
            "the vehicle at {} does not answer; see whether it is switched on and its remote control too, with channel 5 at \"serial\", \
             whether speed and XBee mode are those of the link, and bridge.log beside the report",
            self.command_path()
        );
        Failure::new(Exit::Peer, message)
    }
}

/// `link` at a path of this instance's own.
fn at_instance(link: &LinkSpec, config: &Config) -> Result<LinkSpec, Failure> {
    let place = instance_paths(config)?;
    let path = place.root.join(format!("{}.wire", place.instance));
    let text = link.to_string().replacen(link.path(), &path.display().to_string(), 1);
    text.parse().map_err(|error| {
        Failure::new(Exit::Usage, format!("{error}; give a --root whose name has no comma"))
    })
}

/// Whether somebody on this instance tells the truth to the cameras.
fn is_truth_told(config: &Config) -> Result<bool, Failure> {
    let bus = Bus::open(&instance_paths(config)?)?;
    let mut truths = bus.reader(&TRUTH)?;
    let give_up = Time::now() + TRUTH_WITHIN;
    let told = loop {
        if truths.latest()?.is_some_and(|(_, truth)| truth.time + TRUTH_WITHIN > Time::now()) {
            break true;
        }
        if Time::now() >= give_up {
            break false;
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    drop(truths);
    drop(bus);
    Ok(told)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_read_and_anything_else_is_told_the_forms() {
        let bridged = parse("bridge:asctec,baud=115200,xbee=api2").unwrap();
        let VehicleChoice::Bridged(link) = bridged else { panic!("{bridged:?}") };
        assert_eq!(link.baud(), 115_200);
        assert_eq!(
            VehicleLink::Bridged(link).command_path().to_string(),
            "bridge:asctec,baud=115200,xbee=api2"
        );
        let linked = parse("link:asctec:/dev/ttyUSB0").unwrap();
        let VehicleChoice::Linked(link) = linked else { panic!("{linked:?}") };
        assert_eq!(
            VehicleLink::Linked(link).command_path().to_string(),
            "link:asctec:/dev/ttyUSB0"
        );
        assert!(matches!(
            parse("sim:hummingbird,fidelity=rotors"),
            Ok(VehicleChoice::Simulated { kind: Some(_), fidelity: Some(_) })
        ));
        for wrong in ["bridge", "bridge:mavlink", "bridge:asctec,parity=1", "simulated", "sim,x=1"]
        {
            assert!(parse(wrong).unwrap_err().contains("link:asctec:PATH"), "{wrong}");
        }
        assert!(parse("link:/dev/ttyUSB0").unwrap_err().contains("asctec:PATH"));
    }
}
