//! `oqtal monitor` in a real terminal (tmux): changes are shown, resizing works, the terminal is restored; and `oqtal fly` whose
//! terminal is closed. Skipped without tmux.

use std::process::{Command, Stdio};

use oqtal_bus::code::Mode;
use oqtal_bus::topic::TELEMETRY;
use oqtal_bus::transport::{Subscribe, Transport};

use crate::common::{Running, Testbed, assert_refused, is_alive, skipped, stderr, wait_for};
use rustix::process::{Pid, Signal, kill_process};

/// Terminal of tmux with a separate server; ended on drop.
struct Tmux<'a> {
    testbed: &'a Testbed,
}

impl<'a> Tmux<'a> {
    /// Shell in a terminal of this size; `None`, with a message, without tmux.
    fn start(testbed: &'a Testbed, size: (u16, u16)) -> Option<Self> {
        if Command::new("tmux").arg("-V").output().is_err() {
            skipped("no tmux; install it with: sudo apt-get install tmux");
            return None;
        }
        let tmux = Self { testbed };
        let (width, height) = (size.0.to_string(), size.1.to_string());
        let shell = "env -u NO_COLOR PS1='ready$ ' LC_ALL=C.UTF-8 sh";
        tmux.run(&["-f", "/dev/null", "new-session", "-d", "-x", &width, "-y", &height, shell]);
        tmux.run(&["set-option", "-g", "window-size", "manual"]);
        Some(tmux)
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut tmux = Command::new("tmux");
        tmux.arg("-S").arg(self.testbed.path("tmux")).args(words).stdin(Stdio::null());
        tmux
    }

    fn run(&self, words: &[&str]) -> String {
        let output = self.command(words).output().unwrap();
        assert!(output.status.success(), "tmux {words:?}: {}", stderr(&output));
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Types a line into the shell.
    fn line(&self, text: &str) {
        self.run(&["send-keys", "-l", text]);
        self.run(&["send-keys", "Enter"]);
    }

    /// Waits until the screen contains all of `texts`; returns the screen.
    fn shows(&self, texts: &[&str]) -> String {
        wait_for(&format!("{texts:?} on the screen"), || {
            let screen = self.run(&["capture-pane", "-p"]);
            texts.iter().all(|text| screen.contains(text)).then_some(screen)
        })
    }

    /// Whether the program uses the terminal's alternate screen.
    fn is_on_other_screen(&self) -> bool {
        self.run(&["display-message", "-p", "#{alternate_on}"]).trim() == "1"
    }

    /// Starts `oqtal monitor` on the testbed; the shell then prints its exit code.
    fn monitor(&self, options: &str) {
        let [pid, root] = ["pid", "run"].map(|name| self.testbed.path(name).display().to_string());
        let (oqtal, instance) = (env!("CARGO_BIN_EXE_oqtal"), self.testbed.instance());
        let command = format!("exec {oqtal} monitor --instance {instance} --root {root} {options}");
        self.line(&format!("sh -c 'echo $$ > {pid}; {command}'; echo ended $?"));
    }

    fn terminate_monitor(&self) {
        let pid = std::fs::read_to_string(self.testbed.path("pid")).unwrap();
        let pid = Pid::from_raw(pid.trim().parse().unwrap()).unwrap();
        kill_process(pid, Signal::TERM).unwrap();
    }

    /// Settings of the terminal, written by its shell.
    fn settings(&self, name: &str) -> String {
        let path = self.testbed.path(name);
        self.line(&format!("stty -a > {}; echo told $?", path.display()));
        self.shows(&["told 0"]);
        self.line("clear");
        std::fs::read_to_string(path).unwrap()
    }
}

impl Drop for Tmux<'_> {
    fn drop(&mut self) {
        // A test may have ended the server.
        let _ = self.command(&["kill-server"]).output();
    }
}

fn services(testbed: &Testbed) -> [Running; 3] {
    let running = testbed.services();
    testbed.wait_for_daemon();
    running
}

/// Types an S, a letter in a request, and stops the motors there.
fn stop_in_a_request(tmux: &Tmux<'_>) {
    tmux.run(&["send-keys", ":S"]);
    tmux.shows(&["(Ctrl-S stops): S_", "mode      flying"]);
    tmux.run(&["send-keys", "C-s"]);
    tmux.shows(&["stopped: motors off until `arm`", "mode      disarmed"]);
}

#[test]
fn changes_are_shown_resizing_works_and_the_terminal_is_restored() {
    let testbed = Testbed::new("monitor");
    let Some(tmux) = Tmux::start(&testbed, (80, 24)) else { return };
    let before = tmux.settings("before");
    let running = services(&testbed);
    tmux.monitor("");
    let screen =
        tmux.shows(&["state     Nominal", "mode      disarmed", "hop [ms]", "distance [m]"]);
    assert!(!screen.contains("not shown"), "{screen}");
    assert!(tmux.is_on_other_screen());
    wait_for("a daemon that is ready", || {
        testbed.oqtal(&["ctl", "arm"]).output().unwrap().status.success().then_some(())
    });
    tmux.shows(&["mode      flying", "operator: arm", "motors run"]);
    tmux.line(":get control.controller");
    tmux.shows(&[": \"oqtal\""]);
    tmux.run(&["resize-window", "-x", "50", "-y", "12"]);
    tmux.shows(&["not shown: charts, hops", "state     Nominal"]);
    tmux.run(&["resize-window", "-x", "120", "-y", "40"]);
    tmux.shows(&["q quits, r restarts", "sensor_to_actuator"]);
    stop_in_a_request(&tmux);
    tmux.run(&["send-keys", "r"]);
    drop(running);
    tmux.shows(&["waiting for the instance", "the instance has ended"]);
    let running = services(&testbed);
    tmux.shows(&["state     Nominal"]);
    tmux.run(&["resize-window", "-x", "80", "-y", "24"]);
    for (end, options) in [("q", ""), ("C-c", "--no-color"), ("TERM", "")] {
        if !tmux.is_on_other_screen() {
            tmux.monitor(options);
            tmux.shows(&["state     Nominal"]);
        }
        match end {
            "TERM" => tmux.terminate_monitor(),
            key => drop(tmux.run(&["send-keys", key])),
        }
        tmux.shows(&["ended 0"]);
        assert!(!tmux.is_on_other_screen(), "{end}");
        assert_eq!(tmux.settings("after"), before, "{end}");
    }
    drop(running);
}

#[test]
fn without_an_instance_or_a_terminal_the_remedy_is_reported() {
    let testbed = Testbed::new("monitor-none");
    let output = testbed.oqtal(&["monitor"]).output().unwrap();
    assert_refused(&output, 64, &["not a terminal", "ctl status --json"]);
    let Some(tmux) = Tmux::start(&testbed, (200, 24)) else { return };
    tmux.monitor("");
    tmux.shows(&["no process of instance", "oqtal fly --instance", "ended 75"]);
    assert!(!tmux.is_on_other_screen());
}

/// A closed window does not send a key: the monitor detects it and ends.
#[test]
fn a_monitor_whose_terminal_is_closed_ends() {
    let testbed = Testbed::new("monitor-closed");
    let Some(tmux) = Tmux::start(&testbed, (80, 24)) else { return };
    let _running = services(&testbed);
    tmux.monitor("");
    tmux.shows(&["state     Nominal"]);
    let pid = std::fs::read_to_string(testbed.path("pid")).unwrap().trim().parse().unwrap();
    // The server of tmux outlives its only session.
    tmux.run(&["set-option", "-g", "exit-empty", "off"]);
    tmux.run(&["kill-session"]);
    wait_for("the end of the monitor", || (!is_alive(pid)).then_some(()));
}

/// bash passes the loss of its terminal on to its jobs, so that they are told twice.
#[test]
fn a_flight_whose_terminal_is_closed_lands_and_keeps_its_results() {
    let testbed = Testbed::new("hung-up");
    let Some(tmux) = Tmux::start(&testbed, (80, 24)) else { return };
    let shell = Command::new("bash").args(["--norc", "-c", "true"]).status();
    if !shell.is_ok_and(|status| status.success()) {
        return skipped("no bash");
    }
    let flight = testbed.oqtal(&["fly", "--trajectory", "hover", "--duration", "60"]);
    let words = flight.get_args().map(|word| word.display().to_string());
    let program = flight.get_program().display().to_string();
    let line = [program].into_iter().chain(words).collect::<Vec<_>>().join(" ");
    tmux.line("bash --norc");
    tmux.line(&format!("cd {}; {line} --out flown", testbed.path("").display()));
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    wait_for("the hover", || {
        let (_, tick) = telemetry.latest().unwrap()?;
        (tick.mode == Mode::Flying.code() && tick.position[2] > 0.3).then_some(())
    });
    tmux.run(&["kill-server"]);
    let summary = wait_for("the results", || {
        let text = std::fs::read_to_string(testbed.path("flown/summary.json")).ok()?;
        serde_json::from_str::<serde_json::Value>(&text).ok()
    });
    assert_eq!(summary["outcome"], "landed", "{summary:#}");
}
