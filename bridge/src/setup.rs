//! Set-up of the bridge from the configuration: link, protocol and transport.

use oqtal_bus::time::{Span, Time};
use oqtal_config::{ClockKind, Config, Interface};
use oqtal_control::options::OptionError;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_wire::link::{AsctecLink, CrtpLink, LinkSpec, PortSpec, SerialSpec};
use oqtal_wire::xbee::{Address, Framing};

use crate::asctec::Asctec;
use crate::crtp::{Crtp, TableKeeper, TableStore};
use crate::line::LineOccupancy;
use crate::link::PortOptions;
use crate::mavlink::Mavlink;
use crate::msp::Msp;
use crate::options;
use crate::protocol::VehicleProtocol;
use crate::radio::RadioPortOptions;
use crate::serial::SerialPortOptions;
use crate::tcp::TcpPortOptions;
use crate::timing::periodic_spacing;
use crate::transport::{BareTransport, VehicleTransport};
use crate::udp::UdpPortOptions;
use crate::xbee::XbeeTransport;

/// Greatest share of the line's time that set-points may take \[-\].
const MAX_OCCUPANCY: f64 = 0.8;

/// Greatest time from the request to the first thrust of a MAVLink autopilot \[ms\]: 1.5 s of set-points, mode and arming, each
/// refused once, and 1 to 2 s of spooling up.
const AUTOPILOT_START_MS: f64 = 5000.0;

/// Path to the vehicle.
#[derive(Debug)]
pub struct VehicleSetup {
    /// The configured link.
    pub spec: LinkSpec,
    /// The vehicle's wire format.
    pub protocol: Box<dyn VehicleProtocol>,
    /// Transport of its frames.
    pub transport: Box<dyn VehicleTransport>,
    /// Port of the bytes.
    pub port: Box<dyn PortOptions>,
    /// Keeper of the tables of a Crazyflie, for the background thread.
    pub table_keeper: Option<TableKeeper>,
}

/// Unix time \[us\], by which packets are signed.
pub(crate) fn unix_us() -> u64 {
    (Time::now() + Time::wall_offset()).nanos() / 1000
}

impl VehicleSetup {
    /// Path to the vehicle that `config` describes.
    ///
    /// # Errors
    /// There is no link, or it is malformed or too slow (exit code 78), or the clock is virtual (64).
    pub fn of(config: &Config) -> Result<Self, Failure> {
        if config.clock.kind != ClockKind::Real {
            let reason = "a bridge runs in real time only; set `clock.kind = \"real\"`";
            return Err(Failure::new(Exit::Usage, reason));
        }
        if config.vehicle.interface == Interface::Torque {
            let reason = "a bridge forwards sticks or an attitude, not torque; set `vehicle.interface` to \"rate\" or \"attitude\"";
            return Err(Failure::new(Exit::Config, reason));
        }
        let located = |error: OptionError| Failure::from(config.locate(&error));
        let spec = options::link(config).map_err(located)?.ok_or_else(|| {
            let reason =
                "`bridge.link` is empty; give --link asctec:PATH, as in --link asctec:/dev/ttyUSB0";
            Failure::new(Exit::Config, reason)
        })?;
        let peer = options::address(config).map_err(located)?;
        let mut table_keeper = None;
        let protocol: Box<dyn VehicleProtocol> = match &spec {
            LinkSpec::Asctec(_) => Box::new(Asctec::new(config).map_err(located)?),
            LinkSpec::Mavlink(link) => {
                Box::new(Mavlink::new(config, link, unix_us()).map_err(located)?)
            }
            LinkSpec::Msp(_) => Box::new(Msp::new(config).map_err(located)?),
            LinkSpec::Crtp(link) => {
                let radio_id = match link {
                    CrtpLink::Radio(radio) => Some(radio.vehicle_id()),
                    CrtpLink::Udp(_) => None,
                };
                let (tables, keeper) = TableStore::open(&config.bridge.crtp.table_cache);
                table_keeper = keeper;
                Box::new(Crtp::new(config, tables, radio_id).map_err(located)?)
            }
        };
        let port = port(&spec, config);
        let setup = Self { protocol, transport: transport(&spec, peer), port, spec, table_keeper };
        setup.check_room(config).map_err(located)?;
        Ok(setup)
    }

    /// Warns if commands reach every radio in range.
    pub fn warn_of_broadcast(&self, config: &Config) {
        let is_broadcast = options::address(config).is_ok_and(Address::is_broadcast);
        let LinkSpec::Asctec(link) = &self.spec else { return };
        if is_broadcast && link.xbee != Framing::Transparent {
            tracing::warn!(
                "commands go to every radio in reach, and a reply of any radio counts as the vehicle's; set `bridge.xbee-address` to the address of its radio"
            );
        }
    }

    /// Warns if an autopilot is given less time for its start than it takes.
    pub fn warn_of_short_start(&self, config: &Config) {
        let given = config.bridge.motor_sequence_ms;
        if matches!(self.spec, LinkSpec::Mavlink(_)) && given < AUTOPILOT_START_MS {
            tracing::warn!(
                "`bridge.motor-sequence-ms` is {given}: an autopilot takes up to {AUTOPILOT_START_MS} for its mode, arming and the first thrust that it obeys; set `vehicle.preset` to \"ardupilot-quad\" or \"px4-quad\", or this key to 6000 and `safety.motor-start-ms` to 6500"
            );
        }
    }

    /// Checks that every frame fits into a packet, and that set-points, periodic frames and answers fit on the line.
    fn check_room(&self, config: &Config) -> Result<(), OptionError> {
        let wrong = |rule: String| {
            let link = format!("`{}`", self.spec);
            Err(OptionError::new("bridge.link", link, format!("another link: it {rule}")))
        };
        let (bare, longest) = (self.protocol.sizes(), self.transport.max_frame());
        if bare.longest_sent() > longest {
            let bytes = bare.longest_sent();
            return wrong(format!(
                "cannot transport frames of {bytes} bytes: a packet holds {longest}; use another transport"
            ));
        }
        let sizes = bare.with_overhead(self.transport.overhead());
        let line = LineOccupancy::new(self.transport.byte_rate());
        let (rate, baud) = (config.control.rate_hz, self.spec.port().baud().unwrap_or_default());
        let period = Span::period_of(rate);
        if line.time_for(sizes.setpoint) > period.scaled(MAX_OCCUPANCY) {
            return wrong(format!(
                "is too slow: {rate} set-points of {} bytes a second take more than {} % of {baud} baud; lower `control.rate-hz`, or use a faster line",
                sizes.setpoint,
                MAX_OCCUPANCY * 100.0
            ));
        }
        match periodic_spacing(&line, period, sizes, self.protocol.periodic_count()) {
            Some(_) => Ok(()),
            None => wrong(format!(
                "is too slow: between two of {rate} set-points a second, {baud} baud leave no room to request the vehicle's status; lower `control.rate-hz`, or use a faster line"
            )),
        }
    }
}

/// The transport over the link `spec`, to the radio `peer` if the link is a radio in API mode.
pub fn transport(spec: &LinkSpec, peer: Address) -> Box<dyn VehicleTransport> {
    if let LinkSpec::Asctec(AsctecLink { serial, xbee }) = spec
        && *xbee != Framing::Transparent
    {
        return Box::new(XbeeTransport::new(*xbee, peer, serial.baud));
    }
    let bare = spec.port().baud().map_or_else(BareTransport::immediate, BareTransport::serial);
    Box::new(bare)
}

/// The port of the link `spec`.
pub(crate) fn port(spec: &LinkSpec, config: &Config) -> Box<dyn PortOptions> {
    // Behind one address, a router may serve several vehicles that are told apart by their number.
    let is_exclusive = !matches!(spec, LinkSpec::Mavlink(link) if link.system.is_some());
    match spec.port() {
        PortSpec::Serial(SerialSpec { path, baud }) => Box::new(SerialPortOptions {
            path: path.into(),
            baud,
            hardware_flow_control: config.bridge.hardware_flow_control,
        }),
        PortSpec::UdpIn(host) => Box::new(UdpPortOptions::In(host)),
        PortSpec::UdpOut(host) => Box::new(UdpPortOptions::Out { host, is_exclusive }),
        PortSpec::Tcp(server) => Box::new(TcpPortOptions { server, is_exclusive }),
        PortSpec::Radio(vehicle) => Box::new(RadioPortOptions {
            vehicle,
            packets_per_s: config.bridge.crtp.radio_packets_per_s,
        }),
    }
}
