//! The command `serve`: frames of well-behaved clients beside misbehaving ones, and error messages.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::time::Duration;

use oqtal_wire::ByteOrder;
use oqtal_wire::qtm::{
    DiscoveryReply, DiscoveryRequest, QtmClient, QtmClientEvent, QtmClientOptions, QtmEvent,
    QtmWriter,
};
use oqtal_wire::vrpn::{VrpnClient, VrpnEvent, VrpnVersion};
use rustix::process::{Pid, Signal, kill_process};

use crate::served::{Served, command};

/// Time-out of every wait: a test that waits longer has failed.
const WAIT_TIMEOUT: Duration = Duration::from_secs(60);
/// Number of consecutive frames that a client must receive.
const FRAMES: usize = 150;

fn connect(address: &str) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(WAIT_TIMEOUT)).unwrap();
    stream
}

/// A QTM client with its connection.
struct Qtm {
    stream: TcpStream,
    client: QtmClient,
}

impl Qtm {
    fn connect(address: &str) -> Self {
        Self { stream: connect(address), client: QtmClient::new(QtmClientOptions::default()) }
    }

    /// Receives until `matches` returns a value for an event.
    fn wait<T>(&mut self, mut matches: impl FnMut(&QtmClientEvent<'_>) -> Option<T>) -> T {
        let mut buffer = [0; 65536];
        loop {
            while let Some(event) = self.client.poll().unwrap() {
                if let Some(found) = matches(&event) {
                    return found;
                }
            }
            self.stream.write_all(&self.client.take_output()).unwrap();
            let length = self.stream.read(&mut buffer).unwrap();
            assert!(length > 0, "the server has closed the connection");
            self.client.receive(&buffer[..length]);
        }
    }

    fn next_frame(&mut self) -> u32 {
        self.wait(|event| match event {
            QtmClientEvent::Frame(frame) => Some(frame.frame()),
            _ => None,
        })
    }

    fn send(&mut self, text: &str) {
        let mut bytes = Vec::new();
        QtmWriter::new(&mut bytes, ByteOrder::Little).command(text);
        self.stream.write_all(&bytes).unwrap();
    }
}

/// Times of the poses that a VRPN client gets of the tracker `name` \[us\].
fn vrpn_times(address: &str, name: &str) -> Vec<u64> {
    let (mut stream, mut client) = (connect(address), VrpnClient::new());
    let (mut times, mut buffer, mut tracker) = (Vec::new(), [0; 65536], None);
    while times.len() < FRAMES {
        while let Some(event) = client.poll().unwrap() {
            match event {
                VrpnEvent::Sender { number, name: sent } if sent == name => tracker = Some(number),
                VrpnEvent::Pose { sender, time_us, .. } if Some(sender) == tracker => {
                    times.push(time_us);
                }
                _ => {}
            }
        }
        stream.write_all(&client.take_output()).unwrap();
        let length = stream.read(&mut buffer).unwrap();
        assert!(length > 0, "the server has closed the connection");
        client.receive(&buffer[..length]);
    }
    times
}

/// Clients that hang, send garbage, flood the server, or request frames without reading them.
fn bad_clients(qtm: &str, vrpn: &str) -> Vec<TcpStream> {
    let mut stream_request = Vec::new();
    let mut writer = QtmWriter::new(&mut stream_request, ByteOrder::Little);
    writer.command("StreamFrames AllFrames 3D 3DRes 3DNoLabels 6D 6DRes 6DEuler 6DEulerRes");
    let mut flood = Vec::new();
    (0..500)
        .for_each(|_| QtmWriter::new(&mut flood, ByteOrder::Little).command("GetParameters All"));
    let cookie = VrpnVersion::OURS.to_cookie();
    let garbage = [0xA5; 5000];
    let sent: [(&str, &[u8]); 7] = [
        (qtm, &[]),
        (qtm, &garbage),
        (qtm, &stream_request),
        (qtm, &flood),
        (vrpn, &[]),
        (vrpn, &garbage),
        (vrpn, &cookie),
    ];
    let open = |(address, bytes)| {
        let mut stream = connect(address);
        // The server may close it meanwhile.
        let _ = stream.write_all(bytes);
        stream
    };
    sent.into_iter().map(open).collect()
}

#[test]
fn clients_that_hang_send_garbage_or_never_read_cost_no_other_client_a_frame() {
    let names: Vec<String> = (0..32).flat_map(|n| ["--body".to_owned(), format!("b{n}")]).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let mut server = Served::start(&[&["--protocol", "qtm:0,vrpn:0"], &names[..]].concat());
    let (qtm, vrpn) = (server.address("qtm", "little endian"), server.address("vrpn", "direct"));
    let bad = bad_clients(&qtm, &vrpn);
    let mut client = Qtm::connect(&qtm);
    let frames: Vec<u32> = (0..FRAMES).map(|_| client.next_frame()).collect();
    assert!(frames.windows(2).all(|pair| pair[0] + 1 == pair[1]), "{frames:?}");
    let times = vrpn_times(&vrpn, "b31");
    assert!(times.windows(2).all(|pair| pair[1].abs_diff(pair[0] + 10_000) <= 1), "{times:?}");
    assert!(server.is_running());
    drop(bad);
}

#[test]
fn an_eleventh_client_is_refused_until_one_leaves() {
    let server = Served::start(&["--protocol", "qtm:0"]);
    let address = server.address("qtm", "little endian");
    let mut clients: Vec<Qtm> = (0..10).map(|_| Qtm::connect(&address)).collect();
    clients.iter_mut().for_each(|client| assert!(client.next_frame() > 0));
    let mut refusal = Vec::new();
    connect(&address).read_to_end(&mut refusal).unwrap();
    assert!(String::from_utf8_lossy(&refusal).contains("Max number of clients reached"));
    drop(clients.pop());
    // The server reads requests in order: after this answer it has noticed the free place.
    clients[0].send("GetState");
    let connected = QtmClientEvent::Event(QtmEvent::Connected);
    clients[0].wait(|event| (*event == connected).then_some(()));
    assert!(Qtm::connect(&address).next_frame() > 0);
}

#[test]
fn every_client_receives_the_events_of_the_one_in_control() {
    let server = Served::start(&["--protocol", "qtm:0"]);
    let address = server.address("qtm", "little endian");
    let (mut master, mut other) = (Qtm::connect(&address), Qtm::connect(&address));
    assert!(master.next_frame() > 0 && other.next_frame() > 0);
    master.send("TakeControl");
    for (order, event) in [
        ("Start", QtmEvent::CaptureStarted),
        ("Stop", QtmEvent::CaptureStopped),
        ("Close", QtmEvent::ConnectionClosed),
        ("New", QtmEvent::Connected),
    ] {
        master.send(order);
        let matches =
            |seen: &QtmClientEvent<'_>| (*seen == QtmClientEvent::Event(event)).then_some(());
        other.wait(matches);
        master.wait(matches);
    }
    // The client has requested the stream again.
    assert!(other.next_frame() > 0);
}

#[test]
fn a_server_is_discovered() {
    let server = Served::start(&["--protocol", "qtm:0"]);
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(WAIT_TIMEOUT)).unwrap();
    let request = DiscoveryRequest { reply_port: socket.local_addr().unwrap().port() };
    socket.send_to(&request.to_datagram(), server.address("qtm", "discovery")).unwrap();
    let mut buffer = [0; 1000];
    let length = socket.recv(&mut buffer).unwrap();
    let reply = DiscoveryReply::parse(&buffer[..length]).unwrap();
    assert_eq!(reply.base_port + 1, server.port("qtm", "little endian"));
    assert!(reply.description.ends_with(", QTM 2.17 (build 4000), 6 cameras"), "{reply:?}");
}

#[test]
fn a_signal_ends_the_server_with_exit_code_0() {
    let mut child =
        command(&["--protocol", "vrpn:0"]).stdout(std::process::Stdio::piped()).spawn().unwrap();
    let mut first = [0; 1];
    child.stdout.as_mut().unwrap().read_exact(&mut first).unwrap();
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

/// Exit code and message of a server that fails to start.
fn failure(arguments: &[&str]) -> (Option<i32>, String) {
    let output = command(arguments).stderr(std::process::Stdio::piped()).output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn a_server_that_cannot_start_names_the_remedy() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let taken = format!("vrpn:{port}");
    let cases: [(&[&str], i32, &str); 9] = [
        (&["--protocol", &taken], 71, "is in use; stop the server there"),
        (&["--scene", "looping"], 64, "possible values: hover, circle, lemniscate"),
        (&["--protocol", "vicon"], 64, "write qtm[:PORT], vrpn[:PORT] and natnet[:PORT]"),
        (&["--replay", "nowhere.csv"], 65, "nowhere.csv"),
        (&["--listen", "lab"], 78, "write 127.0.0.1 or 0.0.0.0"),
        (
            &["--protocol", "qtm:0", "--listen", "192.0.2.1"],
            71,
            "is not an address of this machine",
        ),
        (&["--body", "a", "--body", "a"], 78, "two bodies are named `a`"),
        (&["--rate", "0"], 64, "from 1 to 1000"),
        (&["--protocol", "natnet:0", "--natnet-version", "2.9"], 78, "write 3.1 or 4.1"),
    ];
    for (arguments, code, words) in cases {
        let (exit, message) = failure(arguments);
        assert_eq!(exit, Some(code), "{arguments:?}: {message}");
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
}
