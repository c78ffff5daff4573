//! How commands reached the vehicle in a flight.

use std::fmt;

/// How commands reach the vehicle.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CommandPath {
    /// Over the bus to the simulated vehicle.
    #[default]
    Bus,
    /// Through a bridge and this link to the simulated vehicle; `KIND[,OPTION=VALUE]…`, without the link's path.
    Bridged(String),
    /// Through a bridge to whatever is at this link, `KIND:PATH[,OPTION=VALUE]…`.
    Linked(String),
}

impl fmt::Display for CommandPath {
    /// As `oqtal fly --vehicle` takes it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Bus => f.write_str("sim"),
            Self::Bridged(link) => write!(f, "bridge:{link}"),
            Self::Linked(link) => write!(f, "link:{link}"),
        }
    }
}
