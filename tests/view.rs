//! The page of `oqtal view`: in a browser, with ten open pages, and with invalid arguments.
//!
//! The browser is Chromium, driven by `tests/peers/view_page.js`: `OQTAL_PEERS_NODE` names a folder with the packages of
//! `tests/peers/package.json`, `OQTAL_PEERS_CHROMIUM` the program if it is not in the search path. `.ci/run` installs both. Without
//! them these tests are skipped with a message. `VIEW_STUDY_S` is the length of the flights with ten pages open.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::{Child, ChildStderr, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::common::{Running, SERVICES, Testbed, number, peers, signal, skipped, stderr, wait_for};
use oqtal_observe::latency::WHOLE;
use rustix::process::Signal;
use serde_json::Value;

const HOVER: [&str; 6] =
    ["--trajectory", "hover", "--duration", "1", "--set", "trajectory.settle-s=0.5"];

/// A running `oqtal view`; ended on drop.
struct View {
    child: Child,
    address: SocketAddr,
    token: String,
    _messages: BufReader<ChildStderr>,
}

impl View {
    /// Starts `oqtal view` at a free port, and waits until it serves the page.
    fn start(testbed: &Testbed, words: &[&str]) -> Self {
        let mut command = testbed.oqtal(&[&["view", "--listen", "127.0.0.1:0"], words].concat());
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let mut messages = BufReader::new(child.stderr.take().unwrap());
        let mut line = || {
            let mut line = String::new();
            messages.read_line(&mut line).unwrap();
            line
        };
        let first = line();
        let address = first.split("http://").nth(1).and_then(|rest| rest.split('/').next());
        let address = address.unwrap_or_else(|| panic!("{words:?}: {first}")).parse().unwrap();
        let token = if words.contains(&"--control") { line() } else { String::new() };
        let token = token.rsplit(": ").next().unwrap().trim().to_owned();
        Self { child, address, token, _messages: messages }
    }

    fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// Sends a request and returns the status of the answer.
    fn status(&self, head: &str, body: &str) -> u16 {
        let mut stream = TcpStream::connect(self.address).unwrap();
        let length = body.len();
        write!(stream, "{head}\r\ncontent-length: {length}\r\n\r\n{body}").unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        std::str::from_utf8(&answer[9..]).unwrap().parse().unwrap()
    }
}

impl Drop for View {
    fn drop(&mut self) {
        signal(self.child.id(), Signal::TERM);
        let _ = self.child.wait();
    }
}

/// Results of `view_page.js` in a browser; `None` without a browser.
fn browser(view: &View, what: &str) -> Option<Value> {
    let mut command = peers::node("view_page.js")?;
    let named = std::env::var_os("OQTAL_PEERS_CHROMIUM");
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&paths).map(|folder| folder.join("chromium"));
    let found = named.map(Into::into).or_else(|| found.into_iter().find(|path| path.exists()));
    let Some(chromium) = found else {
        skipped("no Chromium; install it with: sudo apt-get install chromium");
        return None;
    };
    let output = command.arg(chromium).args([&view.url(), what, &view.token]).output().unwrap();
    assert!(output.status.success(), "{what}: {}", stderr(&output));
    let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("{what}: {seen}");
    assert_eq!(seen["errors"], Value::Array(Vec::new()), "errors on the console");
    assert_eq!(seen["elsewhere"], Value::Array(Vec::new()), "requests elsewhere");
    Some(seen)
}

/// Settings of a hover that poses do not end which a browser on the same machine makes late.
const PATIENT: [&str; 4] = [
    "trajectory.kind=hover",
    "safety.max-pose-age-ms=1000",
    "safety.pose-age-limit-ms=1000",
    "safety.coast-ms=1000",
];

fn processes(testbed: &Testbed) -> [Running; 3] {
    let settings = PATIENT.iter().flat_map(|setting| ["--set", setting]);
    let words: Vec<&str> = std::iter::once("run").chain(settings).collect();
    SERVICES.map(|process| testbed.start(&[&[process], &words[..]].concat()))
}

#[test]
fn a_browser_follows_a_flight_that_it_arms_and_lands() {
    let testbed = Testbed::new("view-control");
    let _processes = processes(&testbed);
    let view = View::start(&testbed, &["--control", "--wait"]);
    let Some(seen) = browser(&view, "control") else { return };
    assert_eq!(seen["refused"]["here"], 401, "a command without the token");
    assert!(
        ["blocked", "403"].contains(&&*seen["refused"]["foreign"].to_string().replace('"', ""))
    );
    assert!(seen["armed"].as_str().unwrap().starts_with("arm"), "{seen}");
    let tuned = seen["tuned"].as_str().unwrap();
    assert!(tuned.starts_with("set: ") && tuned.contains("control.oqtal."), "{seen}");
    assert!(seen["landing"].as_str().unwrap().starts_with("landing"), "{seen}");
    assert!(seen["late"].as_str().unwrap().contains("not up to date"), "{seen}");
    assert_eq!(seen["gotos"], 0, "a goto is sent after the landing");
    assert!(number(&seen, "/pixels") > 100.0, "no path is drawn");
}

#[test]
fn without_control_a_browser_shows_changing_numbers_and_no_commands() {
    let testbed = Testbed::new("view-live");
    let _processes = processes(&testbed);
    let view = View::start(&testbed, &["--wait"]);
    let host = format!("Host: {}", view.address);
    let post = format!("POST /control HTTP/1.1\r\n{host}");
    assert_eq!(view.status(&post, r#"{"command": "arm"}"#), 403);
    assert_eq!(view.status(&format!("{post}\r\nAuthorization: Bearer x"), "{}"), 403);
    let Some(seen) = browser(&view, "live") else { return };
    assert_eq!(seen["control"], false);
}

#[test]
fn a_page_does_not_show_the_state_of_processes_that_have_ended() {
    let testbed = Testbed::new("view-silent");
    let processes = processes(&testbed);
    let view = View::start(&testbed, &["--wait"]);
    testbed.wait_for_daemon();
    let mut updates = BufReader::new(TcpStream::connect(view.address).unwrap());
    write!(updates.get_mut(), "GET /live HTTP/1.1\r\nHost: {}\r\n\r\n", view.address).unwrap();
    let is_vehicle = |line: String| line.contains("\"vehicles\":[[");
    assert!(updates.lines().any(|line| is_vehicle(line.unwrap())), "no message of the vehicle");
    drop(processes);
    let Some(seen) = browser(&view, "silent") else { return };
    assert_eq!((&seen["mode"], &seen["z"]), (&"–".into(), &"–".into()), "{seen}");
    assert!(seen["figures"].as_str().unwrap().contains("Linkunknown"), "{seen}");
}

/// The scene of the page, without the head of the answer.
fn scene(view: &View) -> Value {
    let mut stream = TcpStream::connect(view.address).unwrap();
    write!(stream, "GET /scene HTTP/1.1\r\nHost: {}\r\n\r\n", view.address).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap()
}

#[test]
fn the_page_shows_the_room_of_the_daemon_whatever_its_flags() {
    let testbed = Testbed::new("view-flags");
    let start = |flags: &[&str]| testbed.start(&[&["daemon", "run"], flags].concat());
    let daemon = start(&["--set", "clock.seed=5", "--set", "fence.x-m=[-3,3]"]);
    testbed.wait_for_daemon();
    let view = View::start(&testbed, &[]);
    assert_eq!(scene(&view)["fence"]["corners"][0][0], -3.0);
    let status = testbed.oqtal(&["ctl", "status", "--json"]).output().unwrap();
    let status: Value = serde_json::from_slice(&status.stdout).unwrap();
    let runs = &status["processes"][2]["heard"]["config_hash"];
    assert_eq!(&scene(&view)["config_hash"], runs, "{status:#}");
    daemon.signal(Signal::TERM);
    daemon.wait();
    let _daemon = start(&["--set", "fence.x-m=[-2,2]"]);
    wait_for("the room of the next daemon", || {
        (scene(&view)["fence"]["corners"][0][0] == -2.0).then_some(())
    });
}

#[test]
fn a_stop_from_the_page_is_obeyed_among_connections_of_others() {
    let testbed = Testbed::new("view-crowd");
    let _processes = processes(&testbed);
    testbed.wait_for_daemon();
    let view = View::start(&testbed, &["--control", "--wait"]);
    let counts: Vec<Arc<AtomicU64>> = (0..48).map(|_| Arc::default()).collect();
    counts.iter().for_each(|count| reader(view.address, count));
    let _idle: Vec<_> = (0..60).map(|_| TcpStream::connect(view.address).unwrap()).collect();
    let (host, token) = (view.address, &view.token);
    let head = format!("POST /control HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {token}");
    for trial in 1..=20 {
        assert_eq!(view.status(&head, r#"{"command": "stop"}"#), 200, "stop {trial}");
    }
}

#[test]
fn a_recording_is_shown_and_played_and_turned() {
    let testbed = Testbed::new("view-file");
    testbed.summary(&[&HOVER[..], &["--clock", "lockstep", "--out", "d"]].concat());
    let view = View::start(&testbed, &["d/flight.mcap"]);
    let host = format!("Host: {}", view.address);
    assert_eq!(view.status(&format!("GET /recording HTTP/1.1\r\n{host}"), ""), 200);
    assert_eq!(view.status(&format!("GET /live HTTP/1.1\r\n{host}"), ""), 404);
    let Some(seen) = browser(&view, "recorded") else { return };
    assert!(number(&seen, "/pixels") > 100.0 && number(&seen, "/events") > 1.0, "{seen}");
    assert_eq!(seen["turned"], true);
}

/// Checks that `oqtal view` with `words` fails with this code and a message that contains `parts`.
#[track_caller]
fn fails(testbed: &Testbed, words: &[&str], code: i32, parts: &[&str]) {
    testbed.refuses(&[&["view"], words].concat(), code, parts);
}

#[test]
fn bad_use_has_its_message_and_exit_code() {
    let testbed = Testbed::new("view-bad");
    testbed.write("a.mcap", "no recording");
    fails(&testbed, &["a.mcap"], 65, &["a.mcap is not a recording"]);
    fails(&testbed, &["none.mcap"], 65, &["none.mcap"]);
    fails(&testbed, &["a.mcap", "--control"], 64, &["--control"]);
    fails(&testbed, &["--listen", "0.0.0.0:0"], 64, &["0.0.0.0:0", "--token"]);
    fails(&testbed, &["--listen", "127.0.0.1:0"], 75, &["no daemon answers", "--wait"]);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    fails(&testbed, &["--wait", "--listen", &address], 71, &[&address, "--listen"]);
}

#[test]
fn a_truncated_recording_is_shown_and_one_of_another_version_is_refused() {
    let testbed = Testbed::new("view-cut");
    testbed.summary(&[&HOVER[..], &["--clock", "lockstep", "--out", "d"]].concat());
    let mut bytes = std::fs::read(testbed.path("d/flight.mcap")).unwrap();
    std::fs::write(testbed.path("cut.mcap"), &bytes[..bytes.len() * 2 / 3]).unwrap();
    let mut command = testbed.oqtal(&["view", "--listen", "127.0.0.1:0", "cut.mcap"]);
    let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
    let mut messages = BufReader::new(child.stderr.take().unwrap()).lines();
    let first = messages.next().unwrap().unwrap();
    signal(child.id(), Signal::TERM);
    child.wait().unwrap();
    assert!(first.contains("cut.mcap is cut off"), "{first}");
    // The layout of the recording is part of its metadata: key, length, value.
    let key = b"layout";
    let at = bytes.windows(key.len()).position(|part| part == key).unwrap() + key.len() + 4;
    bytes[at] = b'9';
    std::fs::write(testbed.path("other.mcap"), &bytes).unwrap();
    fails(&testbed, &["other.mcap"], 76, &[env!("CARGO_PKG_VERSION"), "layout"]);
}

/// Page that reads its updates until the server ends, and counts them.
fn reader(address: SocketAddr, updates: &Arc<AtomicU64>) {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET /live HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
    let updates = Arc::clone(updates);
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines() {
            if line.is_ok_and(|line| line.starts_with('{')) {
                updates.fetch_add(1, Ordering::Relaxed);
            }
        }
    });
}

/// Two flights in real time: alone, and with ten open pages.
#[test]
fn ten_pages_do_not_disturb_the_loop() {
    let study_s = std::env::var("VIEW_STUDY_S").ok();
    let duration = study_s.as_deref().unwrap_or("2");
    let flight = |pages: usize| {
        let testbed = Testbed::new("view-ten");
        let view = (pages > 0).then(|| View::start(&testbed, &["--wait"]));
        let counts: Vec<Arc<AtomicU64>> = (0..pages).map(|_| Arc::default()).collect();
        for count in &counts {
            reader(view.as_ref().unwrap().address, count);
        }
        let words = ["--trajectory", "hover", "--duration", duration, "--out", "d"];
        let summary = testbed.summary(&words);
        let read: Vec<u64> = counts.iter().map(|count| count.load(Ordering::Relaxed)).collect();
        (summary, read)
    };
    let (alone, _) = flight(0);
    let (watched, updates) = flight(10);
    let hop = |summary: &Value, name: &str| number(summary, &format!("/hops/{name}/p99_ns")) * 1e-3;
    for name in alone["hops"].as_object().unwrap().keys() {
        let (a, b) = (hop(&alone, name), hop(&watched, name));
        println!("{name}: p99 {a:.1} µs alone, {b:.1} µs with ten pages, ratio {:.3}", b / a);
    }
    let misses = |summary| number(summary, "/deadline_misses");
    println!("deadlines missed: {} alone, {} with ten pages", misses(&alone), misses(&watched));
    let seconds = number(&watched, "/duration_s");
    println!("updates of each page in {seconds:.1} s: {updates:?}");
    assert!(updates.iter().all(|count| *count > 0), "{updates:?}");
    // Only a study runs on an otherwise idle machine.
    if study_s.is_some() {
        assert_eq!(misses(&watched), 0.0);
        assert!(hop(&watched, WHOLE) <= 1.1 * hop(&alone, WHOLE));
        assert!(updates.iter().all(|count| *count as f64 > 30.0 * seconds), "{updates:?}");
    }
}
