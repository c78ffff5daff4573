//! Emulated vehicle at the far end of a pseudo-terminal: reads frames, answers status requests, and has motors with a switch.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use oqtal_wire::asctec::{
    ControlInput, Descriptor, HostCommand, LlStatus, Scales, Status, VehicleDecoder,
    acknowledgement_frame, write_telemetry,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};

use crate::common::random::Random;

/// Number of consecutive motor-switch frames after which the motors start or stop \[-\].
const SWITCH_FRAMES: u32 = 10;

/// Behaviour of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Manner {
    /// Answers every frame.
    Answering,
    /// Reads frames without answering.
    Silent,
    /// Sends noise instead of answers.
    Noise,
}

/// Log of the frames received by the vehicle.
#[derive(Clone, Debug, Default)]
pub struct VehicleLog {
    /// Every set-point.
    pub setpoints: Vec<ControlInput>,
    /// Every byte, in order.
    pub bytes: Vec<u8>,
    pub polls: usize,
    pub emergency_stops: usize,
    pub damaged: u64,
    pub skipped: u64,
    pub motors_run: bool,
}

/// The vehicle and its thread.
pub struct PtyVehicle {
    log: Arc<Mutex<VehicleLog>>,
    manner: Arc<AtomicU8>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    link: PathBuf,
    /// The bridge's end of the port.
    slave: File,
}

impl PtyVehicle {
    /// Starts a vehicle with its port at `link`.
    pub fn new(link: &Path, manner: Manner) -> Self {
        let master =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        // Kept open, so that the terminal outlives a bridge that closes the port.
        let slave = File::options().read(true).write(true).open(&name).unwrap();
        raw(&slave);
        let _ = std::fs::remove_file(link);
        std::os::unix::fs::symlink(&name, link).unwrap();
        let (log, stop) =
            (Arc::new(Mutex::new(VehicleLog::default())), Arc::new(AtomicBool::new(false)));
        let manner = Arc::new(AtomicU8::new(manner as u8));
        let body = VehicleThread {
            log: log.clone(),
            manner: manner.clone(),
            decoder: VehicleDecoder::new(),
            scales: Scales::default(),
            switched: 0,
            noise: Random(1),
        };
        let (ended, own) = (stop.clone(), slave.try_clone().unwrap());
        let thread = std::thread::spawn(move || body.run(master, slave, &ended));
        Self { log, manner, stop, thread: Some(thread), link: link.to_owned(), slave: own }
    }

    pub fn log(&self) -> VehicleLog {
        self.log.lock().unwrap().clone()
    }

    pub fn clear_log(&self) {
        let mut log = self.log.lock().unwrap();
        *log = VehicleLog { motors_run: log.motors_run, ..VehicleLog::default() };
    }

    pub fn set_manner(&self, manner: Manner) {
        self.manner.store(manner as u8, Ordering::Release);
    }

    /// Ends the exclusive use of the port by a bridge that was killed, as the last close of a real port does.
    pub fn release_port(&self) {
        rustix::termios::ioctl_tiocnxcl(&self.slave).unwrap();
    }

    pub fn link(&self) -> String {
        format!("asctec:{}", self.link.display())
    }

    /// Closes the port, as if it were unplugged; returns the log.
    pub fn unplug(mut self) -> VehicleLog {
        self.end();
        self.log()
    }

    fn end(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

impl Drop for PtyVehicle {
    fn drop(&mut self) {
        self.end();
    }
}

fn raw(slave: &File) {
    let mut settings = rustix::termios::tcgetattr(slave).unwrap();
    settings.make_raw();
    rustix::termios::tcsetattr(slave, rustix::termios::OptionalActions::Now, &settings).unwrap();
}

struct VehicleThread {
    log: Arc<Mutex<VehicleLog>>,
    manner: Arc<AtomicU8>,
    decoder: VehicleDecoder,
    scales: Scales,
    switched: u32,
    noise: Random,
}

impl VehicleThread {
    fn run(mut self, master: OwnedFd, slave: File, stop: &AtomicBool) {
        let mut master = File::from(master);
        let mut buffer = [0; 4096];
        while !stop.load(Ordering::Acquire) {
            let wait = Timespec { tv_sec: 0, tv_nsec: 2_000_000 };
            let mut ready = [PollFd::new(&master, PollFlags::IN)];
            if poll(&mut ready, Some(&wait)).unwrap_or(0) == 0 {
                continue;
            }
            match master.read(&mut buffer) {
                Ok(count) => {
                    let answer = self.receive(&buffer[..count]);
                    master.write_all(&answer).unwrap();
                }
                Err(error) => assert_eq!(error.kind(), ErrorKind::Interrupted, "{error}"),
            }
        }
        drop((master, slave));
    }

    fn receive(&mut self, bytes: &[u8]) -> Vec<u8> {
        let commands: Vec<HostCommand> = self.decoder.push(bytes).collect();
        let mut log = self.log.lock().unwrap();
        log.bytes.extend_from_slice(bytes);
        let mut answer = Vec::new();
        for command in commands {
            match command {
                HostCommand::Control(input) => {
                    let switches = self.scales.is_motor_switch(&input);
                    self.switched = if switches { self.switched + 1 } else { 0 };
                    if self.switched == SWITCH_FRAMES {
                        log.motors_run = !log.motors_run;
                    }
                    log.setpoints.push(input);
                    answer.extend(acknowledgement_frame(Descriptor::ControlInput));
                }
                HostCommand::Poll(_) => {
                    log.polls += 1;
                    let status =
                        Status { battery_v: 11.1, motors_on: log.motors_run, flying: false };
                    answer.extend(status_frame(status));
                }
                HostCommand::EmergencyStop => {
                    log.emergency_stops += 1;
                    log.motors_run = false;
                }
            }
        }
        (log.damaged, log.skipped) =
            (self.decoder.counters().damaged, self.decoder.counters().skipped);
        drop(log);
        match self.manner.load(Ordering::Acquire) {
            manner if manner == Manner::Answering as u8 => answer,
            manner if manner == Manner::Silent as u8 => Vec::new(),
            _ => (0..64).map(|_| self.noise()).collect(),
        }
    }

    /// Pseudo-random bytes, many of which begin a frame.
    fn noise(&mut self) -> u8 {
        let byte = self.noise.below(256) as u8;
        if byte < 64 { b">*>a<"[usize::from(byte) % 5] } else { byte }
    }
}

fn status_frame(status: Status) -> Vec<u8> {
    let mut frame = [0; 64];
    let payload = LlStatus::from(status).payload();
    let length = write_telemetry(Descriptor::LlStatus, &payload, &mut frame).unwrap();
    frame[..length].to_vec()
}
