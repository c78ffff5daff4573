//! The path of a flight's commands to the vehicle.

use std::fmt;

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
