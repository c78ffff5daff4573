//! The chains between cameras and vehicle that are measured.

use std::fs;
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use oqtal_bus::time::{Span, Time};
use oqtal_config::{ClockKind, Config, RecordedFlights};
use oqtal_control::trajectory::TrajectoryKind;
use oqtal_runtime::files;
use oqtal_runtime::process::{Exit, Failure};
use oqtal_runtime::stop::StopFlag;

use super::capture::{Answers, Capture, PacketKind, StampedPacket};
use crate::child::{Child, program};
use crate::latency::bare::directory;
use crate::latency::rig::failed;

/// A law in Python, from QTM to MAVLink.
const SCRIPT: &str = include_str!("peer.py");
/// Interpreter with the packages of the script.
const PYTHON: &str = "python3";
/// Time after the first command that is not counted \[s\]: starting, and the take-off.
const SETTLING_S: i64 = 5;
/// Time for a chain to start, and for a flight to land.
const TIMEOUT: Span = Span::from_millis(60_000);
/// Longest wait after which the stop flag is checked.
const POLL_PERIOD: Span = Span::from_millis(100);

/// A chain from the cameras' datagram to the command's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chain {
    /// Receiver, daemon and bridge.
    Oqtal,
    /// Receiver and daemon in one process, `oqtal chain`, and the bridge.
    OneProcess,
    /// A script with qtm-rt and pymavlink.
    Python,
}

impl Chain {
    /// The chains that can be measured here.
    pub fn installed() -> Vec<Self> {
        let has = Command::new(PYTHON)
            .args(["-c", "import qtm_rt, pymavlink"])
            .current_dir("/")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        let is_installed = has.is_ok_and(|status| status.success());
        let all = [Self::Oqtal, Self::OneProcess, Self::Python];
        all[..if is_installed { 3 } else { 2 }].to_vec()
    }

    /// Name in figures.
    pub fn name(self) -> &'static str {
        match self {
            Self::Oqtal => "oqtal",
            Self::OneProcess => "oqtal chain",
            Self::Python => "qtm-rt and pymavlink",
        }
    }

    /// Runs the chain and measures it for `seconds` \[s\].
    ///
    /// # Errors
    /// See [`super::measure`].
    pub fn fly(self, config: &Config, seconds: u32, stop: &StopFlag) -> Result<Answers, Failure> {
        let capture = Capture::start()?;
        let directory = private_directory()?;
        let ended = self.run(config, seconds, &directory, stop);
        let packets = capture.finish();
        // A directory that cannot be removed occupies only a few kilobytes.
        let _ = fs::remove_dir_all(&directory);
        ended?;
        let packets = packets?;
        let is_command = |packet: &&StampedPacket| matches!(packet.1, PacketKind::Command(_));
        let Some((first_ns, _)) = packets.iter().find(is_command) else {
            return Err(Failure::new(Exit::Peer, format!("{} sent no command", self.name())));
        };
        let from_ns = first_ns + SETTLING_S * 1_000_000_000;
        Answers::of(&packets, from_ns, from_ns + i64::from(seconds) * 1_000_000_000)
    }

    /// Runs the processes until the last one ends, or until interrupted.
    fn run(
        self,
        config: &Config,
        seconds: u32,
        directory: &Path,
        stop: &StopFlag,
    ) -> Result<(), Failure> {
        let mut processes = self.start(config, i64::from(seconds) + SETTLING_S, directory)?;
        let give_up = Time::now() + TIMEOUT + Span::from_millis(1000 * i64::from(seconds));
        let last = processes.len() - 1;
        while !stop.is_set() && !processes[last].ends_within(POLL_PERIOD) {
            if let Some(failure) = processes.iter_mut().find_map(Child::error) {
                return Err(failure);
            }
            if Time::now() >= give_up {
                let reason = format!("{} did not end when its time was over", self.name());
                return Err(Failure::new(Exit::System, reason));
            }
        }
        processes[last].error().map_or(Ok(()), Err)
    }

    fn start(
        self,
        config: &Config,
        flight_s: i64,
        directory: &Path,
    ) -> Result<Vec<Child>, Failure> {
        match self {
            Self::Oqtal => start_oqtal(config, flight_s, directory, &[]),
            Self::OneProcess => start_oqtal(config, flight_s, directory, &["--chain"]),
            Self::Python => start_python(config, flight_s, directory),
        }
    }
}

/// A flight in an instance of its own: a running one may control a real vehicle.
fn start_oqtal(
    config: &Config,
    flight_s: i64,
    directory: &Path,
    flags: &[&str],
) -> Result<Vec<Child>, Failure> {
    let mut config = config.clone();
    config.instance.name = format!("wire-{}", std::process::id());
    config.clock.kind = ClockKind::Real;
    config.record.flights = RecordedFlights::None;
    config.trajectory.kind = TrajectoryKind::Hover;
    config.trajectory.duration_s = Some(flight_s as f64);
    let file = directory.join("config.toml");
    files::write(&file, config.to_toml()).map_err(|e| failed(&file, &e))?;
    let mut command = program(&["fly", "--mocap", "qtm", "--vehicle", "bridge:mavlink"])?;
    command.args(flags).arg("--config").arg(&file).arg("--out").arg(directory.join("flight"));
    Ok(vec![Child::start("fly", command, directory)?])
}

/// The server of the cameras, and the script, which sends its commands to a port that nobody reads.
fn start_python(config: &Config, flight_s: i64, directory: &Path) -> Result<Vec<Child>, Failure> {
    let any = (Ipv4Addr::LOCALHOST, 0);
    let port = TcpListener::bind(any).and_then(|it| it.local_addr()).map(|it| it.port());
    let vehicle = UdpSocket::bind(any).and_then(|it| it.local_addr()).map(|it| it.port());
    let [port, vehicle] = [port, vehicle].map(|it| it.map_err(|e| failed(directory, &e)));
    let (port, vehicle) = (port?, vehicle?);
    let rate = config.mocap.rate_hz.to_string();
    let protocol = format!("qtm:{port}");
    let words =
        ["mocap-emu", "serve", "--scene", "hover", "--protocol", &protocol, "--rate", &rate];
    let server = Child::start("server", program(&words)?, directory)?;
    let mut script = Command::new(PYTHON);
    // Not the present directory: Python would import from it.
    script.current_dir("/").args(["-c", SCRIPT]).args([
        port.to_string(),
        vehicle.to_string(),
        flight_s.to_string(),
    ]);
    Ok(vec![server, Child::start("script", script, directory)?])
}

/// A directory of this process for logs and results.
fn private_directory() -> Result<PathBuf, Failure> {
    let path = directory(&format!("wire-{}", std::process::id()));
    files::create_private_directory(&path).map_err(|e| failed(&path, &e))?;
    Ok(path)
}
