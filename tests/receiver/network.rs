//! Emulated camera systems, and networks of their own for them.
#![allow(dead_code, reason = "each test uses its part")]

use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::process::{Child, Command, Stdio};

/// An emulated camera system of one protocol; killed when dropped.
pub struct Server {
    child: Child,
    pub port: u16,
    kind: &'static str,
}

impl Server {
    pub fn start(kind: &'static str, port: u16, words: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        command.args(["mocap-emu", "serve", "--protocol", &format!("{kind}:{port}")]).args(words);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        // The first line is printed when the ports are open.
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert!(line.contains(&port.to_string()), "{line}");
        Self { child, port, kind }
    }

    /// The link to the server; `rest` is what follows the address.
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

/// A port that is free with the three after it.
pub fn free_port() -> u16 {
    for _ in 0..100 {
        let port =
            TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap().local_addr().unwrap().port();
        let is_free = |port| {
            TcpListener::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
                && UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).is_ok()
        };
        if port < 65_000 && (port..port + 4).all(is_free) {
            return port;
        }
    }
    panic!("no free ports");
}

/// A network of its own for a server, behind a cable of two virtual ends; removed when dropped.
pub struct Network {
    name: String,
    pub cable: String,
}

impl Network {
    const HERE: &str = "10.213.77.1/24";
    pub const THERE: &str = "10.213.77.2";

    /// `None` where networks cannot be made, which is said.
    pub fn new() -> Option<Self> {
        if !Self::can_be_made() {
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

    /// Whether this user may make networks. Where he may, a test that cannot make one fails.
    fn can_be_made() -> bool {
        const NET_ADMIN: u64 = 1 << 12;
        const SYS_ADMIN: u64 = 1 << 21;
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let held = status.lines().find_map(|line| line.strip_prefix("CapEff:")).unwrap().trim();
        let held = u64::from_str_radix(held, 16).unwrap();
        if held & (NET_ADMIN | SYS_ADMIN) != NET_ADMIN | SYS_ADMIN {
            super::common::skipped("only root may make a network namespace");
            return false;
        }
        true
    }

    /// A network without a cable: whatever is started there hears itself alone. `None` where networks cannot be made, which is said.
    pub fn alone() -> Option<Self> {
        if !Self::can_be_made() {
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
        command.args([
            "netns",
            "exec",
            &self.name,
            env!("CARGO_BIN_EXE_oqtal"),
            "mocap-emu",
            "serve",
        ]);
        command.args(["--listen", Self::THERE, "--protocol", &format!("qtm:{port}")]);
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert!(line.contains(Self::THERE), "{line}");
        Server { child, port, kind: "qtm" }
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        // The cable goes with one of its ends.
        ip(&["link", "delete", &self.cable]);
        ip(&["netns", "delete", &self.name]);
    }
}

pub fn ip(words: &[&str]) -> bool {
    let done = Command::new("ip").args(words).stdin(Stdio::null()).stderr(Stdio::null()).status();
    done.is_ok_and(|status| status.success())
}
