//! The server over real sockets: updates, slow readers, slow requests, commands and pages among too many connections.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use oqtal_bus::time::Time;
use oqtal_config::Config;
use oqtal_view::access::Access;
use oqtal_view::collect::{Collected, EventMood, ViewedEvent};
use oqtal_view::hub::Hub;
use oqtal_view::scene::SceneDescription;
use oqtal_view::server::serve;
use oqtal_view::site::{Operator, OperatorReply, Site, Subject};

/// Header with the token of the tests.
const TOKEN: &str = "Authorization: Bearer secret\r\n";

/// Operator that accepts every command.
#[derive(Debug)]
struct Echo;

impl Operator for Echo {
    fn execute(&self, command: &str, _: &[String], _: Time) -> OperatorReply {
        OperatorReply { is_accepted: true, text: command.to_owned() }
    }
}

/// Starts a server of an instance that is fed by `hub` and accepts every command.
fn start(hub: &Arc<Hub>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let access = Access::new(address, true, false, Some("secret".to_owned())).unwrap();
    let scene = SceneDescription::of_instance(&Config::default(), true);
    let subject = Subject::Live(Arc::clone(hub), Some(Box::new(Echo)));
    let site = Arc::new(Site::new(access, &scene, subject));
    std::thread::spawn(move || serve(&listener, &site));
    address
}

fn send(address: SocketAddr, request: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    stream
}

fn answer(mut stream: TcpStream) -> String {
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    text
}

/// Opens the stream of updates and reads up to the past.
fn follow(address: SocketAddr) -> BufReader<TcpStream> {
    follow_with(address, "")
}

/// The same with a further header.
fn follow_with(address: SocketAddr, header: &str) -> BufReader<TcpStream> {
    let request = format!("GET /live HTTP/1.1\r\nHost: localhost\r\n{header}\r\n");
    let mut page = BufReader::new(send(address, &request));
    let mut line = String::new();
    while !line.starts_with('{') {
        line.clear();
        assert!(page.read_line(&mut line).unwrap() > 0, "the stream ended");
    }
    page
}

/// An update of about 20 kB.
fn large() -> Collected {
    let text = "a".repeat(20_000);
    let event = ViewedEvent { t_s: 0.0, mood: EventMood::Neutral, text };
    Collected { events: vec![event], ..Collected::default() }
}

#[test]
fn a_page_that_does_not_read_is_cut_off_while_another_reads_on() {
    let hub = Arc::new(Hub::default());
    let address = start(&hub);
    let asleep = follow(address);
    let mut awake = follow(address);
    let mut line = String::new();
    // Until the kernel's buffers and the queue of the sleeping page are full.
    while hub.pages() == 2 {
        hub.publish(Time::UNSET, &large(), None);
        line.clear();
        awake.read_line(&mut line).unwrap();
        assert!(line.contains("aaaa"), "{line}");
    }
    assert_eq!(hub.pages(), 1);
    hub.publish(Time::UNSET, &large(), None);
    assert!(awake.read_line(&mut line).unwrap() > 20_000);
    drop(asleep);
}

#[test]
fn a_request_that_is_never_complete_is_refused() {
    let address = start(&Arc::default());
    let text = answer(send(address, "GET / HTTP/1.1\r\nHost: local"));
    assert!(text.starts_with("HTTP/1.1 408 "), "{text}");
}

#[test]
fn a_head_without_end_is_refused_when_it_is_too_long() {
    let address = start(&Arc::default());
    let head = format!("GET / HTTP/1.1\r\nx: {}", "a".repeat(9_000));
    let text = answer(send(address, &head));
    assert!(text.starts_with("HTTP/1.1 431 "), "{text}");
}

/// Sends 20 stops with the token, one after another; all must be accepted.
#[track_caller]
fn stops_20_of_20(address: SocketAddr) {
    let body = r#"{"command": "stop"}"#;
    let length = body.len();
    let request = format!(
        "POST /control HTTP/1.1\r\nHost: localhost\r\n{TOKEN}Content-Length: {length}\r\n\r\n{body}"
    );
    for trial in 1..=20 {
        let text = answer(send(address, &request));
        assert!(text.starts_with("HTTP/1.1 200 "), "stop {trial}: {text}");
    }
}

#[test]
fn a_stop_is_served_among_60_connections_without_a_request() {
    let address = start(&Arc::default());
    let _idle: Vec<_> = (0..60).map(|_| send(address, "")).collect();
    stops_20_of_20(address);
}

#[test]
fn a_stop_is_served_among_60_connections_that_send_byte_by_byte() {
    let address = start(&Arc::default());
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let open = || send(address, "GET / HTTP/1.1\r\nx: ");
            let mut slow: Vec<_> = (0..60).map(|_| open()).collect();
            while !is_over.load(Ordering::Relaxed) {
                for stream in &mut slow {
                    if stream.write_all(b"a").is_err() {
                        *stream = open();
                    }
                }
                std::thread::sleep(Duration::from_millis(1));
            }
        });
        let stops = std::panic::catch_unwind(|| stops_20_of_20(address));
        is_over.store(true, Ordering::Relaxed);
        stops.unwrap();
    });
}

#[test]
fn a_stop_is_served_among_48_open_pages_and_60_connections_without_a_request() {
    let hub = Arc::default();
    let address = start(&hub);
    let _pages: Vec<_> = (0..48).map(|_| follow(address)).collect();
    stops_20_of_20(address);
    let _idle: Vec<_> = (0..60).map(|_| send(address, "")).collect();
    stops_20_of_20(address);
}

#[test]
fn the_oldest_page_without_the_token_makes_room_and_one_with_the_token_stays() {
    let hub = Arc::new(Hub::default());
    let address = start(&hub);
    let mut holder = follow_with(address, TOKEN);
    let mut pages: Vec<_> = (0..48).map(|_| follow(address)).collect();
    hub.publish(Time::UNSET, &large(), None);
    let read = |page: &mut BufReader<TcpStream>| {
        let mut line = String::new();
        let _ = page.read_line(&mut line);
        line.len()
    };
    assert_eq!(read(&mut pages[0]), 0, "the oldest page is closed");
    assert!(read(&mut pages[47]) > 20_000, "the newest page is open");
    assert!(read(&mut holder) > 20_000, "the page with the token is open");
}
