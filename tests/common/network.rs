//! Emulated camera systems, their ports, and network namespaces for them.

use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU16, Ordering};

/// Emulated camera system of one protocol; killed on drop.
pub struct Server {
    child: Child,
    pub port: u16,
    kind: &'static str,
}

impl Server {
    pub fn start(kind: &'static str, port: u16, words: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        command.args(["mocap-emu", "serve", "--protocol", &format!("{kind}:{port}")]).args(words);
        Self::spawn(&mut command, port, kind)
    }

    /// Starts `command`, which prints its first line once its ports are open.
    fn spawn(command: &mut Command, port: u16, kind: &'static str) -> Self {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert!(line.contains(&port.to_string()), "{line}");
        Self { child, port, kind }
    }

    /// Link to the server; `rest` follows the address.
    pub fn link(&self, rest: &str) -> String {
        format!("{}:127.0.0.1:{}{rest}", self.kind, self.port)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// First of four consecutive free ports. No two test programs get the same one, and none is in the range of the kernel's
/// ephemeral ports.
pub fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    const FIRST: u16 = 12_000;
    const BLOCKS: u16 = 4_000;
    let offset = (std::process::id() % u32::from(BLOCKS)) as u16;
    let is_free = |port| {
        TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
            && UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
    };
    let blocks = || NEXT.fetch_add(1, Ordering::Relaxed);
    let mut ports = std::iter::repeat_with(blocks)
        .take(usize::from(BLOCKS))
        .map(|block| FIRST + 4 * ((offset.wrapping_mul(97).wrapping_add(block)) % BLOCKS));
    ports.find(|&port| (port..port + 4).all(is_free)).expect("free ports")
}

/// Network namespace for a server, behind a virtual cable; removed on drop.
pub struct Network {
    name: String,
    pub cable: String,
}

impl Network {
    const HERE: &str = "10.213.77.1/24";
    pub const THERE: &str = "10.213.77.2";

    /// `None`, with a message, if network namespaces cannot be created.
    pub fn new() -> Option<Self> {
        if !Self::is_allowed() {
            return None;
        }
        let id = std::process::id();
        let network = Self { name: format!("oqtal-{id}"), cable: format!("oq{id}") };
        let (name, cable, there) = (&network.name, &network.cable, format!("oq{id}b"));
        let address = format!("{}/24", Self::THERE);
        let steps: [&[&str]; 6] = [
            &["netns", "add", name],
            &["link", "add", cable, "type", "veth", "peer", "name", &there, "netns", name],
            &["addr", "add", Self::HERE, "dev", cable],
            &["-n", name, "addr", "add", &address, "dev", &there],
            &["-n", name, "link", "set", &there, "up"],
            &["link", "set", cable, "up"],
        ];
        steps.iter().for_each(|words| assert!(ip(words), "ip {words:?} (package iproute2)"));
        Some(network)
    }

    /// Whether this user may create network namespaces; a test fails if it is permitted but impossible.
    fn is_allowed() -> bool {
        const NET_ADMIN: u64 = 1 << 12;
        const SYS_ADMIN: u64 = 1 << 21;
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let held = status.lines().find_map(|line| line.strip_prefix("CapEff:")).unwrap().trim();
        let held = u64::from_str_radix(held, 16).unwrap();
        if held & (NET_ADMIN | SYS_ADMIN) != NET_ADMIN | SYS_ADMIN {
            super::skipped("only root may create a network namespace");
            return false;
        }
        true
    }

    /// Network namespace without a cable: its processes reach only each other. `None`, with a message, if it cannot be created.
    pub fn alone() -> Option<Self> {
        if !Self::is_allowed() {
            return None;
        }
        let name = format!("oqtal-alone-{}", std::process::id());
        let network = Self { name, cable: String::new() };
        let name = &network.name;
        let steps: [&[&str]; 2] =
            [&["netns", "add", name], &["-n", name, "link", "set", "lo", "up"]];
        steps.iter().for_each(|words| assert!(ip(words), "ip {words:?} (package iproute2)"));
        Some(network)
    }

    /// Name of the namespace.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn server(&self, port: u16) -> Server {
        let mut command = Command::new("ip");
        let oqtal = env!("CARGO_BIN_EXE_oqtal");
        command.args(["netns", "exec", &self.name, oqtal, "mocap-emu", "serve"]);
        command.args(["--listen", Self::THERE, "--protocol", &format!("qtm:{port}")]);
        Server::spawn(&mut command, port, "qtm")
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        // Removing one end removes the cable.
        ip(&["link", "delete", &self.cable]);
        ip(&["netns", "delete", &self.name]);
    }
}

pub fn ip(words: &[&str]) -> bool {
    let done = Command::new("ip").args(words).stdin(Stdio::null()).stderr(Stdio::null()).status();
    done.is_ok_and(|status| status.success())
}
