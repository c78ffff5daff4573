//! Testbeds: each test has an instance, a root directory and an output directory of its own, so that tests run in parallel.
#![allow(dead_code)]

pub mod obedience;
pub mod random;

use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use oqtal_bus::bus::Bus;
use oqtal_bus::paths::InstancePaths;
use serde_json::Value;
use tempfile::TempDir;

/// Time-out of every wait: a test that waits longer has failed.
pub const WAIT_TIMEOUT: Duration = Duration::from_secs(60);

/// An instance in a temporary directory; removed from shared memory when dropped.
pub struct Testbed {
    directory: TempDir,
    instance: String,
}

impl Testbed {
    pub fn new(name: &str) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let directory = tempfile::tempdir().unwrap();
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let instance = format!("{name}-{}-{number}", std::process::id());
        Self { directory, instance }
    }

    pub fn instance(&self) -> &str {
        &self.instance
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    pub fn paths(&self) -> InstancePaths {
        InstancePaths::new(&self.instance, Some(&self.path("run"))).unwrap()
    }

    /// The bus of another instance in the same directory.
    pub fn bus_of(&self, instance: &str) -> Bus {
        Bus::open(&InstancePaths::new(instance, Some(&self.path("run"))).unwrap()).unwrap()
    }

    pub fn bus(&self) -> Bus {
        Bus::open(&self.paths()).unwrap()
    }

    /// The command `oqtal` with the given arguments, on this testbed.
    pub fn oqtal<S: AsRef<str>>(&self, words: &[S]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        command.args(words.iter().map(AsRef::as_ref));
        command.arg("--instance").arg(&self.instance).arg("--root").arg(self.path("run"));
        command.current_dir(self.directory.path()).stdin(Stdio::null());
        // The lengths of studies are no settings of the configuration.
        for (name, _) in std::env::vars_os() {
            if name.as_encoded_bytes().starts_with(b"OQTAL_TEST_") {
                command.env_remove(name);
            }
        }
        command
    }

    /// Runs `oqtal fly` with the given arguments to its end.
    pub fn fly(&self, words: &[&str]) -> Output {
        self.oqtal(&[&["fly"], words].concat()).output().unwrap()
    }

    /// Runs `oqtal fly --json` with the given arguments, which must succeed; returns its summary.
    pub fn summary(&self, words: &[&str]) -> Value {
        let output = self.fly(&[words, &["--json"]].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    pub fn start(&self, words: &[&str]) -> Running {
        Running::start(&mut self.oqtal(words))
    }

    /// Objects of this instance in shared memory.
    pub fn remains(&self) -> Vec<String> {
        let prefix = format!("oqtal_{}_", self.instance);
        std::fs::read_dir("/dev/shm")
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .filter(|name| name.starts_with(&prefix))
            .collect()
    }
}

impl Drop for Testbed {
    fn drop(&mut self) {
        // Joins alone and removes what killed processes left.
        drop(self.bus());
    }
}

/// A running process; killed when dropped.
pub struct Running {
    child: Option<Child>,
}

impl Running {
    pub fn start(command: &mut Command) -> Self {
        Self::start_with_stderr(command, Stdio::piped())
    }

    pub fn start_with_stderr(command: &mut Command, stderr: Stdio) -> Self {
        let child = command.stdout(Stdio::piped()).stderr(stderr).spawn().unwrap();
        Self { child: Some(child) }
    }

    pub fn id(&self) -> u32 {
        self.child.as_ref().unwrap().id()
    }

    pub fn signal(&self, signal: rustix::process::Signal) {
        self::signal(self.id(), signal);
    }

    /// Whether the process has not ended.
    pub fn runs(&mut self) -> bool {
        matches!(self.child.as_mut().unwrap().try_wait(), Ok(None))
    }

    pub fn wait(mut self) -> Output {
        self.child.take().unwrap().wait_with_output().unwrap()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.child {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

pub fn signal(pid: u32, signal: rustix::process::Signal) {
    let pid = rustix::process::Pid::from_raw(pid.cast_signed()).unwrap();
    rustix::process::kill_process(pid, signal).unwrap();
}

/// The state of a process as in /proc/PID/stat; `None` if the process does not exist.
pub fn state_of(pid: u32) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit(')').next()?.trim().chars().next()
}

/// Whether a process exists and is not a zombie.
pub fn is_alive(pid: u32) -> bool {
    state_of(pid).is_some_and(|state| state != 'Z' && state != 'X')
}

/// Polls until `look` returns a value; fails after [`WAIT_TIMEOUT`].
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < WAIT_TIMEOUT, "timed out: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Says that this test cannot run here, and why. Written past the capture of the test's output: a test that did not run must not
/// look like one that passed.
pub fn skipped(reason: &str) {
    use std::io::Write as _;
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let _ = writeln!(std::io::stderr(), "test {test}: skipped: {reason}");
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub fn number(summary: &Value, path: &str) -> f64 {
    summary.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("no number at {path}"))
}
