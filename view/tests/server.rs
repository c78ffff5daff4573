//! The server over real sockets: updates, slow readers, slow requests, too many connections.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;

use oqtal_config::Config;
use oqtal_view::access::Access;
use oqtal_view::collect::{Collected, EventMood, ViewedEvent};
use oqtal_view::hub::Hub;
use oqtal_view::scene::SceneDescription;
use oqtal_view::server::{MOST_CONNECTIONS, serve};
use oqtal_view::site::{Site, Subject};

/// Starts a server of an instance that is fed by `hub`.
fn start(hub: &Arc<Hub>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let access = Access::new(address, false, false, None).unwrap();
    let scene = SceneDescription::of_instance(&Config::default(), false);
    let site = Arc::new(Site::new(access, &scene, Subject::Live(Arc::clone(hub), None)));
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
    let mut page = BufReader::new(send(address, "GET /live HTTP/1.1\r\nHost: localhost\r\n\r\n"));
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
        hub.publish(&large(), None);
        line.clear();
        awake.read_line(&mut line).unwrap();
        assert!(line.contains("aaaa"), "{line}");
    }
    assert_eq!(hub.pages(), 1);
    hub.publish(&large(), None);
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

#[test]
fn further_pages_than_there_is_room_for_are_told_so_and_closed_ones_make_room() {
    let hub = Arc::new(Hub::default());
    let address = start(&hub);
    let pages: Vec<_> = (0..MOST_CONNECTIONS).map(|_| follow(address)).collect();
    let request = "GET /scene HTTP/1.1\r\nHost: localhost\r\n\r\n";
    let mut text = String::new();
    let mut refused = TcpStream::connect(address).unwrap();
    // The refusal is sent without waiting for a request: a slow client must not occupy a place.
    let _ = refused.read_to_string(&mut text);
    assert!(text.starts_with("HTTP/1.1 503 "), "{text}");
    for page in pages {
        drop(page);
    }
    // The server detects a closed page when it writes to it.
    while !answer(send(address, request)).starts_with("HTTP/1.1 200 ") {
        hub.publish(&large(), None);
    }
}
