//! Servers from their options.

use std::net::Ipv4Addr;

use oqtal_config::ServeOptions;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::natnet::NatNetVersion;

use super::address::local_address;
use super::feed::{FrameFeed, frame_queue};
use super::model::{BodyModels, MAX_BODIES};
use super::network::NetworkThread;
use super::spec::ServeSpec;
use super::trouble::NetworkTrouble;

/// Opens the servers of `options` for these bodies, at this frame rate \[Hz\]; `seed` seeds the emulated network faults.
///
/// # Errors
/// The options are invalid, or a port cannot be opened.
pub fn open(
    options: &ServeOptions,
    bodies: &[String],
    (rate_hz, seed): (f64, u64),
) -> Result<(FrameFeed, NetworkThread), Failure> {
    let spec: ServeSpec = options.protocols.parse()?;
    let ip = local_address(&options.listen)?;
    let (version, multicast) =
        (natnet_version(&options.natnet_version)?, multicast(&options.multicast)?);
    check_bodies(bodies)?;
    let models = BodyModels::new(bodies, rate_hz);
    let natnet = models.to_natnet(version, multicast);
    let servers = spec.open(ip, natnet, &models)?;
    let (feed, queue) = frame_queue()?;
    let trouble = NetworkTrouble::new(options, seed);
    Ok((feed, NetworkThread::new((servers, trouble), queue, models)))
}

fn natnet_version(text: &str) -> Result<NatNetVersion, Failure> {
    let version = text.parse().ok().filter(|version: &NatNetVersion| version.is_supported());
    version.ok_or_else(|| {
        invalid(&format!("`{text}` is not a version of NatNet that is served; write 3.1 or 4.1"))
    })
}

fn multicast(text: &str) -> Result<Option<Ipv4Addr>, Failure> {
    if text.is_empty() {
        return Ok(None);
    }
    let group = text.parse().ok().filter(Ipv4Addr::is_multicast);
    let reason = || {
        format!("`{text}` is not a multicast group; write 239.255.42.99, or nothing for unicast")
    };
    group.map(Some).ok_or_else(|| invalid(&reason()))
}

fn check_bodies(bodies: &[String]) -> Result<(), Failure> {
    if !(1..=MAX_BODIES).contains(&bodies.len()) {
        return Err(invalid(&format!("{} bodies; name 1 to {MAX_BODIES}", bodies.len())));
    }
    for (index, name) in bodies.iter().enumerate() {
        let is_valid = (1..=64).contains(&name.len()) && !name.chars().any(char::is_control);
        if !is_valid {
            let reason = format!(
                "`{name}` is not a name of a body; write 1 to 64 bytes without control characters"
            );
            return Err(invalid(&reason));
        }
        if bodies[..index].contains(name) {
            return Err(invalid(&format!(
                "two bodies are named `{name}`; give each a name of its own"
            )));
        }
    }
    Ok(())
}

fn invalid(reason: &str) -> Failure {
    Failure::new(Exit::Config, format!("serving poses: {reason}"))
}
