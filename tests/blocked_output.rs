//! Processes whose standard error is a full pipe that nobody reads: operators, loops and signals must not wait for the log.

mod common;

use std::io::{ErrorKind, PipeReader, PipeWriter, Write, pipe};
use std::process::{Command, Stdio};

use common::{Running, Testbed, wait_for};
use oqtal_bus::code::Mode;
use oqtal_bus::topic::{TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::Signal;

/// A pipe that takes not one byte more.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (reader, mut writer) = pipe().unwrap();
    let flags = fcntl_getfl(&writer).unwrap();
    fcntl_setfl(&writer, flags | OFlags::NONBLOCK).unwrap();
    // Large pieces first; single bytes fill what is left.
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

/// Starts `command` with its standard error connected to `pipe`.
fn start_into(pipe: &PipeWriter, command: &mut Command) -> Running {
    Running::start_with_stderr(command, Stdio::from(pipe.try_clone().unwrap()))
}

#[test]
fn f34_an_operator_is_obeyed_and_processes_end_although_nobody_reads_their_log() {
    let testbed = Testbed::new("blocked");
    let (_reader, pipe) = full_pipe();
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let mut vehicle = bus.observer(&VEHICLE).unwrap();
    let processes = ["plant-sim", "mocap-emu", "daemon"].map(|process| {
        let arguments = [process, "run", "--set", "log.level=trace"];
        start_into(&pipe, &mut testbed.oqtal(&arguments))
    });
    let operator = |command| testbed.oqtal(&["ctl", command]).output().unwrap();
    wait_for("arming", || operator("arm").status.success().then_some(()));
    wait_for("flight", || {
        let (_, tick) = telemetry.latest().unwrap()?;
        (tick.mode == Mode::Flying.code() && tick.position[2] > 0.3).then_some(())
    });
    let output = operator("stop");
    assert!(output.status.success(), "{}", common::stderr(&output));
    wait_for("motors off", || {
        let (_, vehicle) = vehicle.latest().unwrap()?;
        (vehicle.armed == 0).then_some(())
    });
    for process in processes {
        process.signal(Signal::TERM);
        assert_eq!(process.wait().status.code(), Some(0));
    }
}
