//! Links to vehicles: written, read back and refused.

use proptest::prelude::*;

use super::port::BAUD;
use super::*;
use crate::xbee::Framing;

fn refused(text: &str) -> String {
    text.parse::<LinkSpec>().unwrap_err().to_string()
}

fn asctec(text: &str) -> AsctecLink {
    match text.parse() {
        Ok(LinkSpec::Asctec(link)) => link,
        other => panic!("{other:?}"),
    }
}

fn mavlink(text: &str) -> MavlinkLink {
    match text.parse() {
        Ok(LinkSpec::Mavlink(link)) => link,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_port_alone_is_57600_baud_and_transparent() {
    let link = asctec("asctec:/dev/ttyUSB0");
    assert_eq!((&*link.serial.path, link.serial.baud), ("/dev/ttyUSB0", 57_600));
    assert_eq!(link.xbee, Framing::Transparent);
}

#[test]
fn a_colon_in_the_path_belongs_to_the_path() {
    let path = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0";
    let link = asctec(&format!("asctec:{path},xbee=api2"));
    assert_eq!((&*link.serial.path, link.xbee), (path, Framing::Api2));
    let PortSpec::Serial(serial) = mavlink(&format!("mavlink:serial:{path}")).port else {
        panic!("a serial port")
    };
    assert_eq!((&*serial.path, serial.baud), (path, 921_600));
}

#[test]
fn every_port_of_mavlink_is_read() {
    let address = |host: &str, port| HostPort { host: host.to_owned(), port };
    for (text, port) in [
        ("mavlink:udpin:0.0.0.0:14540", PortSpec::UdpIn(address("0.0.0.0", 14_540))),
        ("mavlink:udpout:drone.lab:14550", PortSpec::UdpOut(address("drone.lab", 14_550))),
        ("mavlink:tcp:[::1]:5760", PortSpec::Tcp(address("[::1]", 5760))),
    ] {
        let link = mavlink(text);
        assert_eq!((link.port, link.autopilot, link.system), (port, None, None));
        let link = mavlink(&format!("{text},autopilot=ardupilot,system=7"));
        assert_eq!((link.autopilot, link.system), (Some(AutopilotKind::ArduPilot), Some(7)));
    }
}

#[test]
fn errors_name_the_problem_and_the_form() {
    for (text, problem) in [
        ("asctec:", "no path"),
        ("asctec:,baud=57600", "no path"),
        ("asctec:/dev/ttyS0,baud", "`baud` has no `=`"),
        ("asctec:/dev/ttyS0,baud=1199", "not between 1200 and 3000000"),
        ("asctec:/dev/ttyS0,baud=3000001", "not between 1200 and 3000000"),
        ("asctec:/dev/ttyS0,baud=fast", "baud `fast`"),
        ("asctec:/dev/ttyS0,xbee=api3", "`api3`"),
        ("asctec:/dev/ttyS0,parity=even", "unknown option `parity`"),
        ("asctec:/dev/ttyS0,baud=9600,baud=9600", "`baud` twice"),
    ] {
        let message = refused(text);
        assert!(message.contains(problem), "{text}: {message}");
        assert!(message.contains(AsctecLink::FORM) && message.contains(text), "{message}");
    }
    for (text, problem) in [
        ("mavlink:/dev/ttyUSB0", "no port in"),
        ("mavlink:serial:", "no path"),
        ("mavlink:usb:/dev/ttyACM0", "unknown kind of port `usb`"),
        ("mavlink:udpin:14550", "no port in `14550`"),
        ("mavlink:udpin::14550", "no host"),
        ("mavlink:udpin:::1:14550", "brackets"),
        ("mavlink:udpout:host:0", "port `0` is not between 1 and 65535"),
        ("mavlink:tcp:host:http", "port `http`"),
        ("mavlink:tcp:host:5760,baud=9600", "unknown option `baud`"),
        ("mavlink:tcp:host:5760,autopilot=inav", "`inav` is neither px4 nor ardupilot"),
        ("mavlink:tcp:host:5760,system=256", "system `256`"),
        ("mavlink:tcp:host:5760,system=0", "system `0`"),
    ] {
        let message = refused(text);
        assert!(message.contains(problem), "{text}: {message}");
        assert!(message.contains(MavlinkLink::FORM) && message.contains(text), "{message}");
    }
    for (text, problem) in
        [("/dev/ttyUSB0", "no kind before a colon"), ("sbus:/dev/ttyUSB0", "unknown kind `sbus`")]
    {
        let message = refused(text);
        assert!(message.contains(problem), "{text}: {message}");
        assert!(LinkSpec::forms().iter().all(|form| message.contains(form)), "{message}");
    }
}

proptest! {
    #[test]
    fn written_links_are_read_back(path in "[^,]+", baud in BAUD, xbee in 0..3_usize) {
        let xbee = [Framing::Transparent, Framing::Api1, Framing::Api2][xbee];
        let link = LinkSpec::Asctec(AsctecLink { serial: SerialSpec { path, baud }, xbee });
        prop_assert_eq!(link.to_string().parse::<LinkSpec>(), Ok(link));
    }

    #[test]
    fn written_mavlink_links_are_read_back(
        name in r"[^,:\[\]]+", number in 1..=u16::MAX, kind in 0..4_usize, system in 0..=u8::MAX,
    ) {
        let address = HostPort { host: name.clone(), port: number };
        let serial = SerialSpec { path: name, baud: 1200 + u32::from(number) };
        let ports = [
            PortSpec::Serial(serial),
            PortSpec::UdpIn(address.clone()),
            PortSpec::UdpOut(address.clone()),
            PortSpec::Tcp(address),
        ];
        let autopilot = [None, Some(AutopilotKind::Px4), Some(AutopilotKind::ArduPilot)]
            [usize::from(system) % 3];
        let system = Some(system).filter(|system| *system != 0);
        let port = ports[kind].clone();
        let link = LinkSpec::Mavlink(MavlinkLink { port, autopilot, system });
        prop_assert_eq!(link.to_string().parse::<LinkSpec>(), Ok(link));
    }

    #[test]
    fn any_text_is_a_link_or_refused(text: String) {
        if let Ok(link) = text.parse::<LinkSpec>() {
            prop_assert_eq!(link.to_string().parse::<LinkSpec>(), Ok(link));
        }
    }
}

#[test]
fn crazyflie_ports_are_read_and_wrong_ones_refused() {
    for text in
        ["crtp:radio:80/2M/E7E7E7E701", "crtp:radio:0/250K/0000000001", "crtp:udp:[::1]:19850"]
    {
        let link: LinkSpec = text.parse().unwrap();
        assert_eq!((link.to_string().as_str(), link.kind().as_str()), (text, "crtp"));
    }
    let Ok(LinkSpec::Crtp(CrtpLink::Radio(radio))) = "crtp:radio:80/1M/E7E7E7E701".parse() else {
        panic!("a radio")
    };
    assert_eq!((radio.channel, radio.rate, radio.vehicle_id()), (80, RadioRate::M1, 1));
    for (text, problem) in [
        ("crtp:", "no port"),
        ("crtp:radio:80", "is not CHANNEL/RATE/ADDRESS"),
        ("crtp:radio:126/2M/E7E7E7E7E7", "not between 0 and 125"),
        ("crtp:radio:80/3M/E7E7E7E7E7", "not 250K, 1M or 2M"),
        ("crtp:radio:80/2M/E7E7", "not 10 hexadecimal digits"),
        ("crtp:radio:80/2M/+7E7E7E7E7", "not 10 hexadecimal digits"),
        ("crtp:udp:localhost", "no port"),
        ("crtp:udp:127.0.0.1:19850,baud=1", "unknown option `baud`"),
        ("crtp:serial:/dev/ttyS0", "unknown kind of port `serial`"),
    ] {
        let message = refused(text);
        assert!(message.contains(problem), "{text}: {message}");
        assert!(message.contains("crtp:udp:HOST:PORT"), "{message}");
    }
}

#[test]
fn ports_of_msp_are_read_and_wrong_ones_refused() {
    for text in
        ["msp:tcp:127.0.0.1:5761", "msp:serial:/dev/ttyACM0", "msp:serial:/dev/ttyS1,baud=57600"]
    {
        assert_eq!(text.parse::<LinkSpec>().unwrap().to_string(), text);
    }
    assert_eq!("msp:serial:/dev/ttyACM0".parse::<LinkSpec>().unwrap().port().baud(), Some(115_200));
    for (text, problem) in [
        ("msp:/dev/ttyACM0", "no port"),
        ("msp:tcp:host", "no port"),
        ("msp:tcp:host:1,baud=1", "`baud`"),
    ] {
        let message = refused(text);
        assert!(message.contains(problem) && message.contains(MspLink::FORM), "{message}");
    }
}
