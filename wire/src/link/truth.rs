//! Links to the true motion of a firmware that runs as a program: `crazyflie-sitl:udp:HOST:PORT[,crtp=HOST:PORT]`,
//! `betaflight-sitl:udp:HOST:PORT[,state=HOST:PORT]` or `mavlink:udpin:HOST:PORT`.

use std::fmt;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::str::FromStr;

use super::text::{self, InvalidLink, LinkKind, LinkText, option};

/// Default address at which clients reach the firmware over CRTP, that of Crazyflie's own tools.
const DEFAULT_CRTP: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 19850));

/// Default address at which Betaflight takes the state of its body, a constant of its program.
const DEFAULT_STATE: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 9003));

/// Source of a vehicle's true motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TruthSource {
    /// The simulated body of a Crazyflie, flown by the firmware: [`crate::crazyflie_sitl`].
    CrazyflieSitl {
        /// Address at which the simulator waits for the firmware.
        body: SocketAddr,
        /// Address at which the simulator passes on CRTP packets of a client.
        crtp: SocketAddr,
    },
    /// The simulated body of a vehicle with Betaflight, flown by the firmware: [`crate::betaflight_sitl`].
    BetaflightSitl {
        /// Address at which the simulator waits for motor values.
        motors: SocketAddr,
        /// Address to which the simulator sends the state.
        state: SocketAddr,
    },
    /// The simulator within an autopilot, which sends `SIM_STATE` or `HIL_STATE_QUATERNION` to this address.
    Mavlink(SocketAddr),
}

/// Kinds of sources.
const KINDS: [LinkKind<TruthSource>; 3] = [
    LinkKind {
        name: "crazyflie-sitl",
        form: "crazyflie-sitl:udp:HOST:PORT[,crtp=HOST:PORT]",
        parse: parse_crazyflie,
    },
    LinkKind {
        name: "betaflight-sitl",
        form: "betaflight-sitl:udp:HOST:PORT[,state=HOST:PORT]",
        parse: |port, link| {
            let motors = address_behind("udp:", port)?;
            let state = link.take("state")?.map_or(Ok(DEFAULT_STATE), address)?;
            Ok(TruthSource::BetaflightSitl { motors, state })
        },
    },
    LinkKind {
        name: "mavlink",
        form: "mavlink:udpin:HOST:PORT",
        parse: |port, _| address_behind("udpin:", port).map(TruthSource::Mavlink),
    },
];

impl FromStr for TruthSource {
    type Err = InvalidLink;

    fn from_str(text: &str) -> Result<Self, InvalidLink> {
        text::parse("truth", text, &KINDS)
    }
}

fn parse_crazyflie(port: &str, link: &mut LinkText<'_>) -> Result<TruthSource, String> {
    let body = address_behind("udp:", port)?;
    let crtp = link.take("crtp")?.map_or(Ok(DEFAULT_CRTP), address)?;
    if body == crtp {
        return Err(format!("{body} twice: the firmware and its clients need an address each"));
    }
    Ok(TruthSource::CrazyflieSitl { body, crtp })
}

fn address_behind(prefix: &str, port: &str) -> Result<SocketAddr, String> {
    let rest = port.strip_prefix(prefix);
    address(rest.ok_or_else(|| format!("no `{prefix}` after the kind"))?)
}

/// Address of a socket: a number and a port. Names of hosts are not looked up: the programs run on this machine.
fn address(text: &str) -> Result<SocketAddr, String> {
    let text = text.replacen("localhost:", "127.0.0.1:", 1);
    let address: Option<SocketAddr> = text.parse().ok();
    address
        .filter(|address| address.port() != 0)
        .ok_or_else(|| format!("`{text}` is not an address such as 127.0.0.1:19950"))
}

impl fmt::Display for TruthSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mavlink(address) => write!(f, "mavlink:udpin:{address}"),
            Self::BetaflightSitl { motors, state } => {
                let state = option("state", Some(state).filter(|state| **state != DEFAULT_STATE));
                write!(f, "betaflight-sitl:udp:{motors}{state}")
            }
            Self::CrazyflieSitl { body, crtp } => {
                let crtp = option("crtp", Some(crtp).filter(|crtp| **crtp != DEFAULT_CRTP));
                write!(f, "crazyflie-sitl:udp:{body}{crtp}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_default_address_of_clients_is_that_of_crazyflie_tools() {
        let source: TruthSource = "crazyflie-sitl:udp:localhost:19950".parse().unwrap();
        let TruthSource::CrazyflieSitl { body, crtp } = source else { panic!("{source}") };
        assert_eq!((body.to_string(), crtp), ("127.0.0.1:19950".to_owned(), DEFAULT_CRTP));
        assert_eq!(source.to_string(), "crazyflie-sitl:udp:127.0.0.1:19950");
    }

    #[test]
    fn errors_name_the_problem_and_the_form() {
        for (text, problem) in [
            ("sitl", "no kind before a colon"),
            ("gazebo:udp:127.0.0.1:1", "unknown kind `gazebo`"),
            ("crazyflie-sitl:127.0.0.1:19950", "no `udp:` after the kind"),
            ("crazyflie-sitl:udp:127.0.0.1", "`127.0.0.1` is not an address"),
            ("crazyflie-sitl:udp:127.0.0.1:0", "is not an address"),
            ("crazyflie-sitl:udp:127.0.0.1:1,crtp=x", "`x` is not an address"),
            ("crazyflie-sitl:udp:127.0.0.1:1,baud=9600", "unknown option `baud`"),
            ("crazyflie-sitl:udp:127.0.0.1:1,crtp=127.0.0.1:2,crtp=127.0.0.1:2", "`crtp` twice"),
            ("crazyflie-sitl:udp:127.0.0.1:19850", "need an address each"),
            ("mavlink:udpout:127.0.0.1:14550", "no `udpin:` after the kind"),
            ("mavlink:udpin:/dev/ttyS0", "`/dev/ttyS0` is not an address"),
        ] {
            let message = text.parse::<TruthSource>().unwrap_err().to_string();
            assert!(message.contains(problem), "{text}: {message}");
            assert!(message.contains(text), "{message}");
            assert!(KINDS.iter().any(|kind| message.contains(kind.form)), "{message}");
        }
    }

    proptest! {
        #[test]
        fn written_sources_are_read_back(body in 1..30000_u16, crtp in 30000_u16..) {
            let at = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
            let source = TruthSource::CrazyflieSitl { body: at(body), crtp: at(crtp) };
            prop_assert_eq!(source.to_string().parse(), Ok(source));
            let source = TruthSource::BetaflightSitl { motors: at(body), state: at(crtp) };
            prop_assert_eq!(source.to_string().parse(), Ok(source));
            let source = TruthSource::Mavlink(at(body));
            prop_assert_eq!(source.to_string().parse(), Ok(source));
        }
    }
}
