//! Instance of one user, started or queried by another.

use std::os::unix::process::CommandExt;
use std::process::Command;

use crate::common::{Running, Testbed, assert_refused, is_root, wait_for};
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
