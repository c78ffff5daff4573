//! The path of a flight's commands to the vehicle.

use std::fmt;

use oqtal_config::Config;

/// The path of commands to the vehicle.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CommandPath {
    /// Over the bus to the simulated vehicle.
    #[default]
    Bus,
    /// By a bridge over a link of this kind to the simulated vehicle; `KIND[,OPTION=VALUE]…`, without the path of the link.
    Bridged(String),
    /// By a bridge to the vehicle at this link, `KIND:PATH[,OPTION=VALUE]…`.
    Linked(String),
}

impl CommandPath {
    /// Whether the link is a serial line or a serial radio, whose bytes leave one after another.
    pub fn is_line(&self) -> bool {
        match self {
            Self::Bus => false,
            Self::Bridged(link) => link.starts_with("asctec"),
            Self::Linked(link) => {
                link.split_once(':').is_some_and(|(_, port)| port.starts_with('/'))
            }
        }
    }

    /// Path of the commands of a bridge in a flight of `config`, of which the vehicle may be emulated.
    pub fn of_bridge(config: &Config) -> Self {
        let link = &config.bridge.link;
        if config.plant.wire.link.is_empty() {
            return Self::Linked(link.clone());
        }
        let (kind, port) = link.split_once(':').unwrap_or((link, ""));
        let options = port.split_once(',').map_or_else(String::new, |(_, it)| format!(",{it}"));
        Self::Bridged(format!("{kind}{options}"))
    }

    /// Parses the text form of [`CommandPath`].
    pub fn parse(text: &str) -> Self {
        match text.split_once(':') {
            Some(("bridge", link)) => Self::Bridged(link.to_owned()),
            Some(("link", link)) => Self::Linked(link.to_owned()),
            _ => Self::Bus,
        }
    }
}

impl fmt::Display for CommandPath {
    /// Writes the path in the form of `oqtal fly --vehicle`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus => f.write_str("sim"),
            Self::Bridged(link) => write!(f, "bridge:{link}"),
            Self::Linked(link) => write!(f, "link:{link}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_emulated_vehicle_behind_a_bridge_is_named_without_its_port() {
        let named = |link: &str, emulated: &str| {
            let mut config = Config::default();
            config.bridge.link = link.to_owned();
            config.plant.wire.link = emulated.to_owned();
            CommandPath::of_bridge(&config).to_string()
        };
        let crazyflie = "crtp:udp:127.64.7.1:14550";
        assert_eq!(named(crazyflie, crazyflie), "bridge:crtp");
        let radio = "asctec:/tmp/wire,xbee=api1";
        assert_eq!(named(radio, radio), "bridge:asctec,xbee=api1");
        assert_eq!(named("asctec:/dev/ttyUSB0", ""), "link:asctec:/dev/ttyUSB0");
    }
}
