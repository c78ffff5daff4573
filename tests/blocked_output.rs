//! Processes whose log cannot be written: operator requests, loops and signals do not wait for it.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, PipeReader, PipeWriter, Read, Write, pipe};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixDatagram;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::common::obedience::{LandingWatch, MotorWatch};
use crate::common::{Running, SERVICES, Testbed, has_namespaces, stderr};
use oqtal_bus::transport::Transport;
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::Signal;

/// A completely full pipe.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (reader, mut writer) = pipe().unwrap();
    let flags = fcntl_getfl(&writer).unwrap();
    fcntl_setfl(&writer, flags | OFlags::NONBLOCK).unwrap();
    // Large pieces first, then single bytes.
    for piece in [&[0_u8; 4096][..], &[0_u8; 1][..]] {
        let error = loop {
            if let Err(error) = writer.write_all(piece) {
                break error;
            }
        };
        assert_eq!(error.kind(), ErrorKind::WouldBlock);
    }
    fcntl_setfl(&writer, flags).unwrap();
    (reader, writer)
}

/// Flies with processes started by `start`. An operator's landing and stop take effect within three periods at the vehicle; a
/// signal to the daemon in flight stops the motors equally fast and ends each process with exit code 0.
fn all_obey(name: &str, start: impl Fn(&mut Command) -> Running) {
    let testbed = Testbed::new(name);
    let bus = testbed.bus();
    let processes = SERVICES.map(|process| {
        let arguments = [process, "run", "--set", "log.level=trace"];
        start(&mut testbed.oqtal(&arguments))
    });
    let operator = |command| testbed.oqtal(&["ctl", command]).output().unwrap();
    testbed.take_off(&bus);
    let mut landing = LandingWatch::open(&bus);
    let output = operator("land");
    assert!(output.status.success(), "{}", stderr(&output));
    landing.lands();
    let mut motors = MotorWatch::open(&bus);
    let switch = bus.stop_switch().unwrap();
    // The first step of `oqtal ctl stop`.
    motors.obeys(|| {
        switch.raise();
    });
    let output = operator("stop");
    assert!(output.status.success(), "{}", stderr(&output));
    testbed.take_off(&bus);
    motors.obeys(|| processes[2].signal(Signal::TERM));
    for process in processes {
        process.signal(Signal::TERM);
        assert_eq!(process.wait().status.code(), Some(0));
    }
}

#[test]
fn f34_an_operator_is_obeyed_and_processes_end_although_their_log_is_not_read() {
    let (_reader, pipe) = full_pipe();
    all_obey("blocked", |command| {
        Running::start_with_stderr(command, Stdio::from(pipe.try_clone().unwrap()))
    });
}

/// Another process floods the output, which is read slowly, so that the processes can rarely write.
#[test]
fn f34_an_operator_is_obeyed_and_processes_end_although_their_log_is_flooded() {
    let (mut reader, mut flood) = pipe().unwrap();
    let pipe = flood.try_clone().unwrap();
    let flooding = std::thread::spawn(move || while flood.write_all(&[b'x'; 4096]).is_ok() {});
    let is_over = Arc::new(AtomicBool::new(false));
    let until = is_over.clone();
    let reading = std::thread::spawn(move || {
        while !until.load(Ordering::Relaxed) && reader.read(&mut [0; 1024]).is_ok() {
            std::thread::sleep(Duration::from_millis(2));
        }
    });
    all_obey("flooded", |command| {
        Running::start_with_stderr(command, Stdio::from(pipe.try_clone().unwrap()))
    });
    is_over.store(true, Ordering::Relaxed);
    reading.join().unwrap();
    flooding.join().unwrap();
}

#[test]
fn f34_an_operator_is_obeyed_and_processes_end_although_the_disk_is_full() {
    all_obey("full-disk", |command| {
        let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
        Running::start_with_stderr(command, Stdio::from(full))
    });
}

#[test]
fn f34_an_operator_is_obeyed_and_processes_end_although_standard_error_is_closed() {
    all_obey("closed", |command| {
        let mut shell = Command::new("sh");
        shell.args(["-c", "exec \"$0\" \"$@\" 2>&-"]).arg(command.get_program());
        Running::start(shell.args(command.get_args()))
    });
}

#[test]
fn f34_an_operator_is_obeyed_and_processes_end_although_the_journal_hangs() {
    if !has_namespaces() {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let socket = directory.path().join("socket");
    let _hung = UnixDatagram::bind(&socket).unwrap();
    let sender = UnixDatagram::unbound().unwrap();
    sender.set_nonblocking(true).unwrap();
    while sender.send_to(b"filled", &socket).is_ok() {}
    let log = File::create(directory.path().join("stderr")).unwrap();
    let metadata = log.metadata().unwrap();
    let stream = format!("{}:{}", metadata.dev(), metadata.ino());
    // A private mount for one process; a user namespace makes it possible without privileges.
    let script = "mkdir -p /run/systemd && mount -t tmpfs tmpfs /run/systemd && \
        mkdir /run/systemd/journal && ln -s \"$SOCKET\" /run/systemd/journal/socket && \
        exec \"$0\" \"$@\"";
    all_obey("hung-journal", |command| {
        let mut private = Command::new("unshare");
        private.args(["--map-root-user", "--mount", "sh", "-c", script]).arg(command.get_program());
        private.args(command.get_args()).env("SOCKET", &socket).env("JOURNAL_STREAM", &stream);
        Running::start_with_stderr(&mut private, Stdio::from(log.try_clone().unwrap()))
    });
    assert_eq!(std::fs::read_to_string(directory.path().join("stderr")).unwrap(), "");
}

#[test]
fn a_flight_whose_figures_cannot_be_printed_keeps_its_files() {
    let testbed = Testbed::new("unprinted");
    let mut flight = testbed.oqtal(&["fly", "--clock", "in-process", "--out", "flown"]);
    let full = OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = flight.stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(71), "{}", stderr(&output));
    for name in ["summary.json", "telemetry.csv", "report.html"] {
        assert!(testbed.path("flown").join(name).metadata().unwrap().len() > 0, "{name}");
    }
}
