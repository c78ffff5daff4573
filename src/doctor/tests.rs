//! Tests of the checks on machines made of files.

use std::path::Path;

use oqtal_bus::paths::InstancePaths;
use tempfile::TempDir;

use super::*;

/// A machine without findings, whose files are changed by tests.
struct Machine {
    root: TempDir,
    system: System,
}

impl Machine {
    fn fit() -> Self {
        let root = tempfile::tempdir().unwrap();
        let system = System {
            root: root.path().to_path_buf(),
            shared_memory: Some((1 << 30, 1 << 29)),
            instances: Path::new("/run/oqtal").to_path_buf(),
            instances_writable: true,
            instances_free: Some(1 << 30),
            instances_owner: None,
        };
        let machine = Self { root, system };
        for (path, text) in [
            ("proc/self/status", "Name:\toqtal\nCapEff:\t0000000000000000\n"),
            ("proc/self/limits", LIMITS),
            ("proc/sys/kernel/sched_rt_runtime_us", "950000\n"),
            ("proc/version", "Linux version 6.12.1 (cc) #1 SMP PREEMPT_RT\n"),
            ("proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu tsc sse2\n"),
            ("proc/swaps", "Filename\tType\tSize\tUsed\tPriority\n"),
            ("sys/kernel/realtime", "1\n"),
            ("sys/devices/system/cpu/online", "0-3\n"),
            ("sys/devices/system/cpu/isolated", "2-3\n"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n"),
            ("sys/devices/system/cpu/cpu0/cpuidle/state1/name", "C1\n"),
            ("sys/devices/system/cpu/cpu0/cpuidle/state1/latency", "2\n"),
            ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
        ] {
            machine.write(path, text);
        }
        machine
    }

    fn write(&self, path: &str, text: &str) {
        let path = self.root.path().join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn finding(&self, name: &str) -> Finding {
        let findings = examine(&self.system);
        findings.into_iter().find(|finding| finding.name == name).unwrap()
    }

    /// Level and remedy of the finding `name` on a machine whose file `path` contains `text`.
    fn with(path: &str, text: &str, name: &str) -> (Level, String) {
        let machine = Self::fit();
        machine.write(path, text);
        let finding = machine.finding(name);
        (finding.level, finding.remedy.unwrap_or_default())
    }
}

const LIMITS: &str = "\
Limit                     Soft Limit           Hard Limit           Units
Max locked memory         unlimited            unlimited            bytes
Max realtime priority     80                   80
";

#[test]
fn a_fit_machine_gets_no_advice() {
    let findings = examine(&Machine::fit().system);
    let not_ok: Vec<&Finding> = findings.iter().filter(|f| f.level != Level::Ok).collect();
    assert!(not_ok.is_empty(), "{not_ok:?}");
    assert!(text(&findings).ends_with("fit to fly"));
    // Without a serial port, its check has no finding.
    assert_eq!(findings.len(), CHECKS.len() - 1);
}

#[test]
fn every_advice_has_its_command() {
    let cases = [
        (
            "proc/self/limits",
            "Max realtime priority     0  0\nMax locked memory unlimited\n",
            "real-time priority",
            "rtprio",
        ),
        (
            "proc/self/limits",
            "Max realtime priority     99 99\nMax locked memory 8388608 8388608 bytes\n",
            "locked memory",
            "memlock",
        ),
        ("proc/sys/kernel/sched_rt_runtime_us", "100000", "real-time throttling", "sysctl"),
        (
            "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
            "powersave",
            "frequency governor",
            "scaling_governor",
        ),
        ("sys/devices/system/cpu/cpu0/cpuidle/state3/latency", "890", "idle states", "idle-set"),
    ];
    for (path, text, name, word) in cases {
        let (level, remedy) = Machine::with(path, text, name);
        assert_eq!(level, Level::Advice, "{name}");
        assert!(remedy.contains(word), "{name}: {remedy}");
    }
}

#[test]
fn a_capability_is_as_good_as_a_limit() {
    let machine = Machine::fit();
    machine.write("proc/self/limits", "Max realtime priority 0 0\nMax locked memory 65536 65536\n");
    machine.write("proc/self/status", "CapEff:\t0000000000804000\n");
    assert_eq!(machine.finding("real-time priority").level, Level::Ok);
    assert_eq!(machine.finding("locked memory").level, Level::Ok);
}

#[test]
fn preemption_is_found_in_every_form_of_the_kernel() {
    let level = |realtime: &str, version: &str, mode: Option<&str>| {
        let machine = Machine::fit();
        machine.write("sys/kernel/realtime", realtime);
        machine.write("proc/version", version);
        if let Some(mode) = mode {
            machine.write("sys/kernel/debug/sched/preempt", mode);
        }
        machine.finding("preemption").level
    };
    assert_eq!(level("1", "SMP PREEMPT_RT", None), Level::Ok);
    assert_eq!(level("0", "SMP PREEMPT", None), Level::Ok);
    assert_eq!(level("0", "SMP PREEMPT_DYNAMIC", Some("none voluntary (full) lazy")), Level::Ok);
    assert_eq!(level("0", "SMP PREEMPT_DYNAMIC", Some("none (voluntary) full")), Level::Advice);
    assert_eq!(level("0", "SMP PREEMPT_DYNAMIC", None), Level::Advice);
    assert_eq!(level("0", "SMP", None), Level::Advice);
}

#[test]
fn a_package_of_debian_is_advised_on_debian_only() {
    let remedy = |release: &str| {
        let machine = Machine::fit();
        machine.write("sys/kernel/realtime", "0");
        machine.write("proc/version", "SMP");
        machine.write("etc/os-release", release);
        machine.finding("preemption").remedy
    };
    assert_eq!(remedy("NAME=\"Fedora Linux\"\nID=fedora\n"), None);
    let has_package = cfg!(any(target_arch = "x86_64", target_arch = "aarch64"));
    assert_eq!(remedy("ID=debian\n").is_some(), has_package);
}

#[test]
fn a_sticky_directory_stays_as_it_is() {
    use std::fs::{Permissions, set_permissions};
    use std::os::unix::fs::PermissionsExt;
    let with_mode = |mode: u32| {
        let machine = Machine::fit();
        let directory = machine.root.path().join("run/oqtal");
        std::fs::create_dir_all(&directory).unwrap();
        set_permissions(&directory, Permissions::from_mode(mode)).unwrap();
        machine.finding("sharing")
    };
    assert_eq!(with_mode(0o755).level, Level::Ok);
    assert_eq!(with_mode(0o1777).level, Level::Ok);
    assert_eq!(with_mode(0o777).remedy.unwrap(), "chmod go-w /run/oqtal");
}

#[test]
fn swap_matters_only_to_memory_that_cannot_be_locked() {
    let machine = Machine::fit();
    machine.write("proc/swaps", "Filename\tType\n/dev/sda2 partition\n");
    assert_eq!(machine.finding("swap").level, Level::Ok);
    machine.write("proc/self/limits", "Max locked memory 65536 65536 bytes\n");
    assert_eq!(machine.finding("swap").level, Level::Advice);
}

#[test]
fn a_slow_clock_is_advised_against_where_a_fast_one_is_there() {
    let clocks = "sys/devices/system/clocksource/clocksource0";
    let machine = Machine::fit();
    machine.write(&format!("{clocks}/current_clocksource"), "hpet\n");
    machine.write(&format!("{clocks}/available_clocksource"), "hpet acpi_pm\n");
    assert_eq!(machine.finding("clock source").remedy, None);
    machine.write(&format!("{clocks}/available_clocksource"), "tsc hpet acpi_pm\n");
    let finding = machine.finding("clock source");
    assert_eq!(finding.level, Level::Advice);
    assert!(finding.remedy.unwrap().starts_with("echo tsc"));
}

#[test]
fn too_little_shared_memory_forbids_a_flight() {
    let mut machine = Machine::fit();
    for (space, level) in [
        (None, Level::Problem),
        (Some((64 << 20, 1 << 20)), Level::Problem),
        (Some((64 << 20, 64 << 20)), Level::Advice),
    ] {
        machine.system.shared_memory = space;
        let finding = machine.finding("shared memory");
        assert_eq!(finding.level, level, "{space:?}");
        assert!(finding.remedy.is_some());
    }
}

#[test]
fn a_folder_that_cannot_be_written_forbids_a_flight() {
    let mut machine = Machine::fit();
    machine.system.instances_writable = false;
    let finding = machine.finding("instances");
    assert_eq!((finding.level, finding.exit), (Level::Problem, Exit::Permission));
    assert!(finding.remedy.unwrap().contains("/run/oqtal"));
    assert!(text(&examine(&machine.system)).ends_with("not fit to fly: 1 to mend first"));
}

#[test]
fn a_relative_root_and_a_full_one_forbid_a_flight() {
    let mut machine = Machine::fit();
    machine.system.instances_free = Some(8192);
    let finding = machine.finding("instances");
    assert_eq!((finding.level, finding.exit), (Level::Problem, Exit::System));
    assert_eq!(finding.found, "/run/oqtal has only 8 KiB free");
    machine.system.instances = Path::new("tf").to_path_buf();
    let finding = machine.finding("instances");
    assert_eq!((finding.level, finding.exit), (Level::Problem, Exit::Usage));
}

#[test]
fn a_folder_of_another_user_is_not_offered_for_a_change() {
    let mut machine = Machine::fit();
    machine.write("etc/passwd", "root:x:0:0::/root:/bin/sh\noqtal:x:990:990::/:/bin/false\n");
    for (writable, owner, name) in [(false, 990, "oqtal"), (true, 990, "oqtal"), (true, 7, "7")] {
        machine.system.instances_writable = writable;
        machine.system.instances_owner = Some(owner);
        let finding = machine.finding("instances");
        assert_eq!((finding.level, finding.exit), (Level::Problem, Exit::Permission));
        assert!(finding.found.ends_with(&format!("belongs to user {name}")), "{}", finding.found);
        let remedy = finding.remedy.unwrap();
        assert!(remedy.starts_with(&format!("sudo -u {name} oqtal doctor")), "{remedy}");
        assert!(!examine(&machine.system).iter().any(|finding| finding.name == "sharing"));
    }
}

#[test]
fn a_run_is_dead_when_no_process_has_its_memory_and_its_objects_are_removed_on_request() {
    let machine = Machine::fit();
    let run = |instance: &str| {
        let root = Some(Path::new("/run/oqtal"));
        let prefix = InstancePaths::new(instance, root).unwrap().prefix();
        format!("dev/shm/{prefix}0123456789")
    };
    let (alive, dead) = (run("alive"), run("dead-one"));
    for object in [format!("{alive}_1.data"), format!("{dead}_1.data"), format!("{dead}/stop")] {
        machine.write(&object, "");
    }
    machine.write("dev/shm/of_another_program", "");
    machine.write("proc/17/maps", &format!("7f00-7f01 rw-s 00000000 00:19 5  /{alive}_1.data\n"));
    let finding = machine.finding("remains of dead instances");
    assert_eq!((finding.level, finding.found.as_str()), (Level::Advice, "dead-one (2 objects)"));
    assert_eq!(place::remove_strays(&machine.system), ["dead-one (2 objects)"]);
    assert_eq!(machine.finding("remains of dead instances").level, Level::Ok);
    assert_eq!(machine.system.list("dev/shm").len(), 2);
    // Locked by a member, although no map can be read.
    machine.write(&format!("{dead}/stop"), "");
    let lock = std::fs::File::open(machine.root.path().join(&dead)).unwrap();
    rustix::fs::flock(&lock, rustix::fs::FlockOperation::LockShared).unwrap();
    assert_eq!(machine.finding("remains of dead instances").level, Level::Ok);
}

#[test]
fn a_log_out_that_removes_shared_memory_and_a_shared_root_are_told() {
    let machine = Machine::fit();
    machine.write("proc/self/status", "Name:\toqtal\nUid:\t1000\t1000\t1000\t1000\n");
    assert_eq!(machine.finding("log-out").level, Level::Ok);
    machine.write("run/systemd/system/nothing", "");
    assert_eq!(machine.finding("log-out").level, Level::Advice);
    machine.write("etc/systemd/logind.conf", "[Login]\n#RemoveIPC=yes\nRemoveIPC=no\n");
    assert_eq!(machine.finding("log-out").level, Level::Ok);
    machine.write("etc/systemd/logind.conf.d/other.conf", "[Login]\nRemoveIPC=yes\n");
    assert_eq!(machine.finding("log-out").level, Level::Advice);
    let root = machine.root.path().join("run/oqtal");
    std::fs::create_dir_all(&root).unwrap();
    for (mode, level) in [(0o700, Level::Ok), (0o755, Level::Ok), (0o777, Level::Advice)] {
        std::fs::set_permissions(&root, std::os::unix::fs::PermissionsExt::from_mode(mode))
            .unwrap();
        assert_eq!(machine.finding("sharing").level, level, "{mode:o}");
    }
}

#[test]
fn a_virtual_machine_and_a_single_processor_are_noted() {
    let flags = "processor\t: 0\nflags\t\t: fpu hypervisor\n";
    assert_eq!(Machine::with("proc/cpuinfo", flags, "hypervisor").0, Level::Advice);
    assert_eq!(Machine::with("sys/devices/system/cpu/online", "0", "processors").0, Level::Advice);
}

#[test]
fn the_document_has_the_worst_level_and_every_check() {
    let mut machine = Machine::fit();
    machine.system.shared_memory = None;
    let findings = examine(&machine.system);
    let document: serde_json::Value = serde_json::from_str(&json(&findings)).unwrap();
    assert_eq!(document["level"], "problem");
    let checks = document["checks"].as_array().unwrap();
    assert_eq!(checks.len(), findings.len());
    for key in ["name", "level", "found", "why", "remedy"] {
        assert!(checks.iter().all(|check| check.get(key).is_some()), "{key}");
    }
}
