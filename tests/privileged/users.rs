//! Instance of one user, started or queried by another.

use std::os::unix::process::CommandExt;
use std::process::Command;

use crate::common::{Running, Testbed, assert_refused, is_root, stderr, wait_for};
use rustix::process::Signal;

#[test]
fn f28_another_user_is_refused_with_the_directory() {
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("other-user");
    let _daemon = testbed.start(&["daemon", "run"]);
    let root = testbed.path("run");
    wait_for("the daemon's root", || root.exists().then_some(()));
    let mut other = testbed.oqtal(&["ctl", "status"]);
    other.uid(65534);
    let output = other.output().unwrap();
    assert_refused(&output, 77, &[&root.display().to_string()]);
}

#[test]
fn f28_names_that_another_user_planted_in_shared_memory_do_no_harm() {
    use std::os::unix::fs::PermissionsExt;
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("planted");
    let (owner, root) = (65_533, testbed.path("run"));
    std::fs::set_permissions(testbed.path(""), PermissionsExt::from_mode(0o755)).unwrap();
    std::fs::create_dir(&root).unwrap();
    std::os::unix::fs::chown(&root, Some(owner), Some(owner)).unwrap();
    // Directories of a third user, which the owner of the instance cannot remove.
    let names = ["stop", "pose.count", "truth.count", "vehicle.count", "shared"];
    let planted = names.map(|name| format!("/dev/shm/{}{name}", testbed.paths().prefix()));
    let mut mkdir = Command::new("mkdir");
    assert!(mkdir.args(&planted).uid(65_534).gid(65_534).status().unwrap().success());
    let as_owner = |words: &[&str]| {
        let mut command = testbed.oqtal(words);
        command.uid(owner).gid(owner);
        command
    };
    let plant = Running::start(&mut as_owner(&["plant-sim", "run"]));
    wait_for("a stop that takes effect", || {
        as_owner(&["ctl", "stop"]).output().unwrap().status.success().then_some(())
    });
    plant.signal(Signal::TERM);
    assert!(plant.wait().status.success());
    let mut left = testbed.remains();
    left.retain(|name| !planted.contains(&format!("/dev/shm/{name}")));
    assert!(left.is_empty() && !root.join(testbed.instance()).exists(), "{left:?}");
    planted.iter().for_each(|path| std::fs::remove_dir(path).unwrap());
    std::os::unix::fs::chown(&root, Some(0), Some(0)).unwrap();
}

/// `oqtal` with these arguments as another user, without a directory of that user's session.
fn as_user(user: u32, program: &str, words: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.args(words).env_remove("XDG_RUNTIME_DIR").current_dir("/").uid(user).gid(user);
    command
}

#[test]
fn every_process_of_another_user_s_instance_is_named() {
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("theirs");
    let (owner, oqtal) = (65_532, env!("CARGO_BIN_EXE_oqtal"));
    let words = |command: &[&str]| {
        let place = ["--instance", testbed.instance()];
        let words = command.iter().chain(&place);
        words.map(|word| (*word).to_owned()).collect::<Vec<_>>()
    };
    let run = |user, command: &[&str]| {
        let words = words(command);
        as_user(user, oqtal, &words.iter().map(String::as_str).collect::<Vec<_>>())
    };
    let [plant, daemon] =
        ["plant-sim", "daemon"].map(|process| Running::start(&mut run(owner, &[process, "run"])));
    let names =
        [format!("the vehicle's process {}", plant.id()), format!("the daemon, {}", daemon.id())];
    wait_for("both names", || {
        let said = stderr(&run(65_534, &["ctl", "stop"]).output().unwrap());
        names.iter().all(|name| said.contains(name)).then_some(())
    });
    for process in [daemon, plant] {
        process.signal(Signal::TERM);
        drop(process.wait());
    }
    std::fs::remove_dir_all(format!("/tmp/oqtal-{owner}")).unwrap();
}

#[test]
fn f28_a_stop_names_the_owner_s_directory_acts_as_root_and_needs_no_thread() {
    if !is_root() {
        return;
    }
    let testbed = Testbed::new("owner");
    let (owner, oqtal) = (65_533, env!("CARGO_BIN_EXE_oqtal"));
    let root = format!("/tmp/oqtal-{owner}");
    let place = ["--instance", testbed.instance()];
    // The root by default of a user without a session.
    let words = [&["plant-sim", "run"], &place[..]].concat();
    let plant = Running::start(&mut as_user(owner, oqtal, &words));
    let stop = [&["ctl", "stop"], &place[..]].concat();
    wait_for("a stop by the owner", || {
        as_user(owner, oqtal, &stop).output().unwrap().status.success().then_some(())
    });
    let other = as_user(65_534, oqtal, &stop).output().unwrap();
    assert_refused(&other, 77, &[&root, "sudo oqtal ctl stop", testbed.instance()]);
    for named in [root.as_str(), "/tmp/oqtal-65534-elsewhere"] {
        for command in ["stop", "land"] {
            let words = [&["ctl", command, "--root", named], &place[..]].concat();
            let other = as_user(65_534, oqtal, &words).output().unwrap();
            assert_refused(&other, 77, &[&format!("sudo oqtal ctl {command}"), testbed.instance()]);
        }
    }
    let by_root = as_user(0, oqtal, &stop).output().unwrap();
    assert!(by_root.status.success(), "{}", stderr(&by_root));
    // A process that may start no thread.
    let limited = [&["--nproc=1:1", oqtal], &stop[..]].concat();
    let limited = as_user(owner, "prlimit", &limited).output().unwrap();
    assert!(limited.status.success(), "{}", stderr(&limited));
    std::fs::remove_dir_all(&root).unwrap();
    for user in [owner, 0] {
        let stopped = as_user(user, oqtal, &stop).output().unwrap();
        assert!(stopped.status.success(), "user {user}, no root: {}", stderr(&stopped));
    }
    assert!(!std::path::Path::new(&root).exists(), "made by another user");
    plant.signal(Signal::TERM);
    drop(plant.wait());
    testbed.remains().iter().for_each(|name| {
        let path = std::path::Path::new("/dev/shm").join(name);
        let _ = std::fs::remove_file(&path).or_else(|_| std::fs::remove_dir_all(path));
    });
}
