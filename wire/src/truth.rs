//! Text form of a source of the truth, where the vehicle is a firmware that runs as a program:
//! `crazyflie-sitl:udp:HOST:PORT[,crtp=HOST:PORT]` or `mavlink:udpin:HOST:PORT`.

use std::fmt;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::str::FromStr;

/// Text form, for error messages.
const FORM: &str = "crazyflie-sitl:udp:HOST:PORT[,crtp=HOST:PORT] or mavlink:udpin:HOST:PORT";
/// Default address at which clients reach the firmware over CRTP, that of Crazyflie's own tools.
const DEFAULT_CRTP: SocketAddr = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 19850));

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
    /// The simulator within an autopilot, which sends `SIM_STATE` or `HIL_STATE_QUATERNION` to this address.
    Mavlink(SocketAddr),
}

/// Error in the text of a source of the truth.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("truth `{text}`: {problem}; write {FORM}")]
pub struct InvalidTruthSource {
    /// Text that is no source.
    pub text: String,
    /// Part of it that is wrong.
    pub problem: String,
}

impl TruthSource {
    /// Parses a configuration value; `None` if it is empty.
    ///
    /// # Errors
    /// The text is no source of the truth.
    pub fn from_setting(text: &str) -> Result<Option<Self>, InvalidTruthSource> {
        if text.is_empty() { Ok(None) } else { text.parse().map(Some) }
    }
}

impl FromStr for TruthSource {
    type Err = InvalidTruthSource;

    fn from_str(text: &str) -> Result<Self, InvalidTruthSource> {
        parse(text).map_err(|problem| InvalidTruthSource { text: text.to_owned(), problem })
    }
}

fn parse(text: &str) -> Result<TruthSource, String> {
    let (kind, rest) = text.split_once(':').ok_or("no kind before a colon")?;
    match kind {
        "crazyflie-sitl" => parse_crazyflie(rest),
        "mavlink" => {
            let port = rest.strip_prefix("udpin:").ok_or("no `udpin:` after the kind")?;
            address(port).map(TruthSource::Mavlink)
        }
        _ => Err(format!("unknown kind `{kind}`")),
    }
}

fn parse_crazyflie(rest: &str) -> Result<TruthSource, String> {
    let mut parts = rest.split(',');
    let body = parts.next().and_then(|port| port.strip_prefix("udp:"));
    let body = address(body.ok_or("no `udp:` after the kind")?)?;
    let mut crtp = None;
    for part in parts {
        let value = part.strip_prefix("crtp=").ok_or(format!("unknown option `{part}`"))?;
        if crtp.replace(address(value)?).is_some() {
            return Err("`crtp` twice".to_owned());
        }
    }
    let crtp = crtp.unwrap_or(DEFAULT_CRTP);
    if body == crtp {
        return Err(format!("{body} twice: the firmware and its clients need an address each"));
    }
    Ok(TruthSource::CrazyflieSitl { body, crtp })
}

/// Address of a socket: a number and a port. Names of hosts are not looked up: the programs run on this machine.
fn address(text: &str) -> Result<SocketAddr, String> {
    let text = text.replacen("localhost:", "127.0.0.1:", 1);
    let address: Option<SocketAddr> = text.parse().ok();
    address
        .filter(|address| address.port() != 0)
        .ok_or_else(|| format!("`{text}` is no address such as 127.0.0.1:19950"))
}

impl fmt::Display for TruthSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mavlink(address) => write!(f, "mavlink:udpin:{address}"),
            Self::CrazyflieSitl { body, crtp } if *crtp == DEFAULT_CRTP => {
                write!(f, "crazyflie-sitl:udp:{body}")
            }
            Self::CrazyflieSitl { body, crtp } => {
                write!(f, "crazyflie-sitl:udp:{body},crtp={crtp}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_address_of_clients_is_that_of_crazyflie_s_tools_unless_given() {
        let source: TruthSource = "crazyflie-sitl:udp:localhost:19950".parse().unwrap();
        let TruthSource::CrazyflieSitl { body, crtp } = source else { panic!("{source}") };
        assert_eq!((body.to_string(), crtp), ("127.0.0.1:19950".to_owned(), DEFAULT_CRTP));
        assert_eq!(source.to_string(), "crazyflie-sitl:udp:127.0.0.1:19950");
    }

    #[test]
    fn a_refusal_says_what_is_wrong_and_shows_the_form() {
        for (text, problem) in [
            ("sitl", "no kind before a colon"),
            ("gazebo:udp:127.0.0.1:1", "unknown kind `gazebo`"),
            ("crazyflie-sitl:127.0.0.1:19950", "no `udp:` after the kind"),
            ("crazyflie-sitl:udp:127.0.0.1", "`127.0.0.1` is no address"),
            ("crazyflie-sitl:udp:127.0.0.1:0", "is no address"),
            ("crazyflie-sitl:udp:127.0.0.1:1,crtp=x", "`x` is no address"),
            ("crazyflie-sitl:udp:127.0.0.1:1,baud=9600", "unknown option `baud=9600`"),
            ("crazyflie-sitl:udp:127.0.0.1:1,crtp=127.0.0.1:2,crtp=127.0.0.1:2", "`crtp` twice"),
            ("crazyflie-sitl:udp:127.0.0.1:19850", "need an address each"),
            ("mavlink:udpout:127.0.0.1:14550", "no `udpin:` after the kind"),
            ("mavlink:udpin:/dev/ttyS0", "`/dev/ttyS0` is no address"),
        ] {
            let message = text.parse::<TruthSource>().unwrap_err().to_string();
            assert!(message.contains(problem), "{text}: {message}");
            assert!(message.contains(FORM) && message.contains(text), "{message}");
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(body in 1..30000_u16, crtp in 30000_u16..) {
            let at = |port| SocketAddr::from((Ipv4Addr::LOCALHOST, port));
            let source = TruthSource::CrazyflieSitl { body: at(body), crtp: at(crtp) };
            prop_assert_eq!(source.to_string().parse(), Ok(source));
            let source = TruthSource::Mavlink(at(body));
            prop_assert_eq!(source.to_string().parse(), Ok(source));
        }
    }
}
