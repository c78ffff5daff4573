//! Another user of the machine beside a running instance: files, requests, links and names are protected.

use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{Running, Testbed, assert_refused, is_root, stderr, wait_for};
use oqtal_bus::topic::{TELEMETRY, VEHICLE};
use oqtal_bus::transport::{Subscribe, Transport};

/// The user `nobody`.
const NOBODY: u32 = 65_534;

/// Runs `script` as nobody, with `paths` as its arguments.
fn as_nobody(script: &str, paths: &[PathBuf]) -> std::process::Output {
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(script).arg("sh").args(paths);
    shell.uid(NOBODY).gid(NOBODY).current_dir("/").output().unwrap()
}

fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut found = vec![directory.to_path_buf()];
    for entry in std::fs::read_dir(directory).unwrap().flatten() {
        match entry.file_type().unwrap().is_dir() {
            true => found.extend(files_below(&entry.path())),
            false => found.push(entry.path()),
        }
    }
    found
}

#[test]
fn another_user_cannot_write_read_or_remove_a_file_of_a_running_instance() {
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("neighbour");
    let bus = testbed.bus();
    let mut vehicles = bus.observer(&VEHICLE).unwrap();
    let _processes = testbed.services();
    wait_for("the vehicle", || vehicles.latest().unwrap());
    let shared = wait_for("objects of all processes", || {
        Some(testbed.remains()).filter(|names| names.len() > 10)
    });
    let shared = shared.into_iter().map(|name| Path::new("/dev/shm").join(name));
    let files: Vec<PathBuf> = shared.chain(files_below(&testbed.paths().directory())).collect();
    // The permissions of the instance's directory protect all its content.
    let directory = testbed.paths().directory();
    for file in files.iter().filter(|file| **file == directory || !file.starts_with(&directory)) {
        let mode = std::fs::symlink_metadata(file).unwrap().mode();
        assert_eq!(mode & 0o077, 0, "{} has mode {mode:o}", file.display());
    }
    let script = "for f; do \
        (: >> \"$f\") 2>/dev/null && echo written: $f; \
        head -c 1 \"$f\" >/dev/null 2>&1 && echo read: $f; \
        rm -rf \"$f\" 2>/dev/null && [ ! -e \"$f\" ] && [ -x \"${f%/*}\" ] && echo removed: $f; \
        mv \"$f\" \"$f.moved\" 2>/dev/null && echo moved: $f; done; true";
    let output = as_nobody(script, &files);
    let reached = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(reached.is_empty(), "{reached}{}", stderr(&output));
    wait_for("the vehicle", || vehicles.latest().unwrap());
}

#[test]
fn another_user_can_neither_stop_nor_query_an_instance() {
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("neighbour-ctl");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let _daemon = testbed.start(&["daemon", "run"]);
    wait_for("ticks", || telemetry.latest().unwrap());
    for command in ["stop", "status", "arm"] {
        let mut ctl = testbed.oqtal(&["ctl", command]);
        let output = ctl.uid(NOBODY).gid(NOBODY).current_dir("/").output().unwrap();
        assert_refused(&output, 77, &[]);
    }
    let (_, tick) = wait_for("a tick", || telemetry.latest().unwrap());
    assert_ne!(tick.state, oqtal_bus::code::SafetyState::Stop.code());
}

#[test]
fn links_of_another_user_are_not_followed() {
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("links");
    let place = tempfile::tempdir().unwrap();
    rustix::fs::chmod(place.path(), 0o1777.into()).unwrap();
    let kept = testbed.write("kept", "kept");
    let path = |name: &str| place.path().join(name);
    // Links in world-writable directories to files and directories of root.
    let links = [(path("root"), testbed.path("")), (path("flights"), testbed.path(""))];
    for (link, target) in &links {
        let made = as_nobody("ln -s \"$1\" \"$2\"", &[target.clone(), link.clone()]);
        assert!(made.status.success(), "{}", stderr(&made));
    }
    let root = path("root").display().to_string();
    let daemon = Command::new(env!("CARGO_BIN_EXE_oqtal"))
        .args(["daemon", "run", "--root", &root, "--instance", testbed.instance()])
        .output()
        .unwrap();
    assert_refused(&daemon, 77, &[]);
    let mut fly = testbed.oqtal(&["fly", "--clock", "in-process", "--trajectory", "hover"]);
    let fly = fly.current_dir(place.path()).output().unwrap();
    assert_refused(&fly, 71, &["flights"]);
    // In shared memory: a link with the name prefix of the instance.
    let words = Path::new("/dev/shm").join(format!("{}command.count", testbed.paths().prefix()));
    std::os::unix::fs::symlink(&kept, &words).unwrap();
    let mut daemon = testbed.oqtal(&["plant-sim", "run"]);
    let plant = Running::start(&mut daemon);
    // The first process to join removes the link without writing through it.
    wait_for("the start or the refusal", || {
        (std::fs::symlink_metadata(&words).is_err() || !plant.runs()).then_some(())
    });
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), "kept");
    drop(plant);
    let _ = std::fs::remove_file(words);
}

#[test]
fn results_of_root_are_written_neither_through_links_nor_into_directories_of_another_user() {
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("results");
    let place = tempfile::tempdir().unwrap();
    rustix::fs::chmod(place.path(), 0o1777.into()).unwrap();
    let (kept, theirs) = (testbed.write("kept", "kept"), place.path().join("theirs"));
    let script =
        "mkdir \"$2\" && ln -s \"$1\" \"$2/campaign.csv\" && ln -s \"$1\" \"$2/tuned.toml\"";
    let made = as_nobody(script, &[kept.clone(), theirs.clone()]);
    assert!(made.status.success(), "{}", stderr(&made));
    let campaign = "campaign --force --controllers pid --runs 1 --best 1 --clock in-process";
    let campaign: Vec<_> = campaign.split(' ').collect();
    let tune = ["tune", "pid", "--budget", "1", "--seeds", "1", "--force"];
    let fly = ["fly", "--clock", "in-process", "--trajectory", "hover", "--duration", "0.2"];
    for (words, out, says) in [
        (&campaign[..], theirs.clone(), "a link, which is not followed"),
        (&tune[..], theirs.join("tuned.toml"), "a link, which is not followed"),
        (&fly[..], theirs.clone(), "belongs to another user"),
    ] {
        let output = testbed.study(words).arg("--out").arg(&out).output().unwrap();
        assert_refused(&output, 71, &[says]);
    }
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), "kept");
    assert!(!theirs.join("config.toml").exists());
}
