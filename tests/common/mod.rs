//! Testbeds: each test has a separate instance, root directory and output directory, so that tests run in parallel.
pub mod network;
pub mod obedience;
pub mod peers;
pub mod random;
pub mod sources;

use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use oqtal_bus::bus::Bus;
use oqtal_bus::code::Mode;
use oqtal_bus::paths::InstancePaths;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};
use serde_json::Value;
use tempfile::TempDir;

/// Time-out of every wait: a test that waits longer has failed.
pub const WAIT_TIMEOUT: Duration = Duration::from_secs(60);

/// The square with its first two corners: what compares a flight in real time with the same in virtual time.
pub const TWO_CORNERS: [&str; 6] = ["--trajectory", "square", "--duration", "6", "--seed", "7"];

/// Processes of a simulated flight.
pub const SERVICES: [&str; 3] = ["plant-sim", "mocap-emu", "daemon"];

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
        // The lengths of studies are not settings of the configuration.
        for (name, _) in std::env::vars_os() {
            if name.as_encoded_bytes().starts_with(b"OQTAL_TEST_") {
                command.env_remove(name);
            }
        }
        command
    }

    /// The command `oqtal` with the given arguments in the directory of this testbed, without its instance.
    pub fn study(&self, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_oqtal"));
        command.args(words).current_dir(self.directory.path()).stdin(Stdio::null());
        command
    }

    /// Runs [`Self::study`], which must succeed; returns its standard output.
    #[track_caller]
    pub fn succeeds(&self, words: &[&str]) -> String {
        let output = self.study(words).output().unwrap();
        assert!(output.status.success(), "{words:?}: {}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs `oqtal` on this testbed; it must fail with this exit code and a message that contains `parts`.
    #[track_caller]
    pub fn refuses(&self, words: &[&str], code: i32, parts: &[&str]) {
        assert_refused(&self.oqtal(words).output().unwrap(), code, parts);
    }

    /// Runs `oqtal fly` with the given arguments to its end.
    pub fn fly(&self, words: &[&str]) -> Output {
        self.oqtal(&[&["fly"], words].concat()).output().unwrap()
    }

    /// Runs `oqtal fly --json` with the given arguments; it must succeed. Returns its summary.
    #[track_caller]
    pub fn summary(&self, words: &[&str]) -> Value {
        let output = self.fly(&[words, &["--json"]].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        json(&output)
    }

    /// Runs a flight like [`Self::summary`]; it must land.
    #[track_caller]
    pub fn lands(&self, words: &[&str]) -> Value {
        let summary = self.summary(words);
        assert_eq!(summary["outcome"], "landed", "{words:?}: {summary:#}");
        summary
    }

    pub fn start(&self, words: &[&str]) -> Running {
        Running::start(&mut self.oqtal(words))
    }

    /// Starts simulator, cameras and daemon.
    pub fn services(&self) -> [Running; 3] {
        SERVICES.map(|process| self.start(&[process, "run"]))
    }

    /// Waits until a daemon answers `oqtal ctl status`.
    pub fn wait_for_daemon(&self) {
        wait_for("a daemon that answers", || {
            self.oqtal(&["ctl", "status"]).output().unwrap().status.success().then_some(())
        });
    }

    /// Arms until the vehicle is in the air. While poses are late the daemon refuses or withdraws a flight, and the operator arms
    /// again.
    pub fn take_off(&self, bus: &Bus) {
        let mut telemetry = bus.observer(&TELEMETRY).unwrap();
        wait_for("flight", || {
            let (_, tick) = telemetry.latest().unwrap()?;
            if tick.mode == Mode::Disarmed.code() {
                self.oqtal(&["ctl", "arm"]).output().unwrap();
            }
            (tick.mode == Mode::Flying.code() && tick.position[2] > 0.3).then_some(())
        });
    }

    /// Names of this instance in shared memory.
    pub fn remains(&self) -> Vec<String> {
        let prefix = format!("oqtal_{}_", self.instance);
        std::fs::read_dir("/dev/shm")
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            // A directory that is not yet in use begins with a dot.
            .filter(|name| name.trim_start_matches('.').starts_with(&prefix))
            .collect()
    }
}

impl Drop for Testbed {
    fn drop(&mut self) {
        // Joins as the only process and thereby removes files of killed processes.
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

    /// Whether the process is still running. One that has ended is not reaped: it can still be signalled.
    pub fn runs(&self) -> bool {
        is_alive(self.id())
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

/// State of a process as in /proc/PID/stat; `None` if the process does not exist.
pub fn state_of(pid: u32) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit(')').next()?.trim().chars().next()
}

/// Whether a process exists and is not a zombie.
pub fn is_alive(pid: u32) -> bool {
    state_of(pid).is_some_and(|state| state != 'Z' && state != 'X')
}

/// Process ids of the children of a process.
pub fn children(pid: u32) -> Vec<u32> {
    let list = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"));
    list.unwrap_or_default().split_whitespace().map(|child| child.parse().unwrap()).collect()
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

/// Reports that this test cannot run here, and the reason. The message bypasses the capture of the test's output, so that a
/// skipped test is distinguishable from a passed one.
pub fn skipped(reason: &str) {
    use std::io::Write as _;
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let _ = writeln!(std::io::stderr(), "test {test}: skipped: {reason}");
}

/// Whether this test runs as root; reports that it is skipped otherwise.
pub fn is_root() -> bool {
    let is_root = rustix::process::getuid().is_root();
    if !is_root {
        skipped("only root can become another user");
    }
    is_root
}

/// Whether this user may mount file systems in a new namespace; reports that the test is skipped otherwise.
pub fn has_namespaces() -> bool {
    let mut unshare = Command::new("unshare");
    unshare.args(["--map-root-user", "--mount", "--pid", "--fork", "true"]).stderr(Stdio::null());
    let is_allowed = unshare.status().is_ok_and(|status| status.success());
    if !is_allowed {
        skipped("this user may not create namespaces (unshare, package util-linux)");
    }
    is_allowed
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// JSON document printed by a process.
#[track_caller]
pub fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(output)))
}

/// Checks that a process failed with this exit code and a message that contains `parts`.
#[track_caller]
pub fn assert_refused(output: &Output, code: i32, parts: &[&str]) {
    let message = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{message}");
    for part in parts {
        assert!(message.contains(part), "no `{part}` in: {message}");
    }
}

/// Checks that the mean errors of a flight over a wire equal those of the direct simulation within 15 %.
#[track_caller]
pub fn assert_as_good_as(wired: &Value, direct: &Value) {
    for error in ["position_error_m", "velocity_error_m_s", "attitude_error_deg"] {
        let path = format!("/{error}/mean");
        let ratio = number(wired, &path) / number(direct, &path);
        assert!((0.85..1.15).contains(&ratio), "{error}: {ratio} of the direct simulation");
    }
}

#[track_caller]
pub fn number(summary: &Value, path: &str) -> f64 {
    summary.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("no number at {path}"))
}
