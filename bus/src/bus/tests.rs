//! Tests of joining, leaving and versions.

mod control;

use iceoryx2::node::Node;
use iceoryx2::prelude::{AttributeSpecifier, NodeBuilder, ServiceName, ipc};

use super::*;
use crate::message::Header;
use crate::topic::{COMMAND, CONTROL, POSE, Role, TRUTH};
use crate::transport::{Publish, Subscribe};

fn place(root: &std::path::Path) -> InstancePaths {
    InstancePaths::new("test", Some(root)).unwrap()
}

/// A new root directory, removed when it is dropped, and an instance in it.
fn temporary() -> (tempfile::TempDir, InstancePaths) {
    let root = tempfile::tempdir().unwrap();
    let place = place(root.path());
    (root, place)
}

fn counters(place: &InstancePaths) -> usize {
    let prefix = place.prefix();
    let entries = std::fs::read_dir("/dev/shm").unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with(&prefix) && name.ends_with(".global_mgmt")).count()
}

#[test]
fn the_last_to_leave_removes_the_counter_of_its_own_root_only() {
    let (one, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (one, other) = (place(one.path()), place(other.path()));
    let (first, second) = (Bus::open(&one).unwrap(), Bus::open(&other).unwrap());
    drop(first);
    assert_eq!((counters(&one), counters(&other)), (0, 1));
    drop(second);
    assert_eq!(counters(&other), 0);
}

#[test]
fn a_root_is_the_same_by_every_path_to_it() {
    let root = tempfile::tempdir().unwrap();
    let link = root.path().join("link");
    std::os::unix::fs::symlink(root.path(), &link).unwrap();
    let prefix = |root: &std::path::Path| place(root).prefix();
    assert_eq!(prefix(root.path()), prefix(&link));
}

/// The longest path is that of a connection between two ports.
#[test]
fn the_longest_name_of_an_instance_connects_its_ports() {
    let root = tempfile::tempdir().unwrap();
    let place = InstancePaths::new(&"i".repeat(32), Some(root.path())).unwrap();
    let bus = Bus::open(&place).unwrap();
    let (mut writer, mut reader) = (bus.writer(&POSE).unwrap(), bus.reader(&POSE).unwrap());
    writer.send(1, Default::default(), Default::default()).unwrap();
    assert!(reader.latest().unwrap().is_some());
    let longest = std::fs::read_dir(bus.membership.words_file("")).unwrap();
    let longest = longest.map(|entry| entry.unwrap().path().as_os_str().len()).max().unwrap();
    // The counters in the names of the ports have up to five digits more after 100 000 ports.
    assert!(longest + 2 * 5 <= 255, "{longest}");
}

/// Files of the instance in shared memory and in its root.
fn files(place: &InstancePaths) -> Vec<std::path::PathBuf> {
    let shared = std::fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path());
    let named = |path: &std::path::PathBuf| {
        path.file_name().unwrap().to_string_lossy().starts_with(&place.prefix())
    };
    let own =
        std::fs::read_dir(&place.root).into_iter().flatten().map(|entry| entry.unwrap().path());
    shared.filter(named).chain(own).collect()
}

#[test]
fn nothing_is_left_after_the_last_port_is_dropped() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let (writer, reader) = (bus.writer(&POSE).unwrap(), bus.reader(&POSE).unwrap());
    let listener = bus.listener(&TRUTH).unwrap();
    drop(bus);
    assert!(!files(&place).is_empty());
    drop((writer, reader));
    assert!(!files(&place).is_empty());
    drop(listener);
    assert_eq!(files(&place), Vec::<std::path::PathBuf>::new());
}

/// The description of the service `name` in the instance's directory.
fn description(place: &InstancePaths, name: &str) -> Option<std::path::PathBuf> {
    let entries = std::fs::read_dir(place.words_file("services")).unwrap();
    let mut files = entries.map(|entry| entry.unwrap().path());
    let line = format!("service_name = \"{name}\"");
    files.find(|file| std::fs::read_to_string(file).unwrap().contains(&line))
}

#[test]
fn f29_half_made_services_are_replaced_and_complete_ones_kept() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let _pose = bus.writer(&POSE).unwrap();
    let command = bus.writer(&COMMAND).unwrap();
    let path = description(&place, "command").unwrap();
    drop(command);
    assert_eq!(description(&place, "command"), None);
    // Simulates a creator that died: a partial description, then a description without dynamic part.
    std::fs::write(&path, "service_ha").unwrap();
    drop(Bus::open(&place).unwrap().writer(&COMMAND).unwrap());
    let truth = bus.reader(&TRUTH).unwrap();
    let before = files(&place);
    let _more = bus.reader(&COMMAND).unwrap();
    for file in files(&place).iter().filter(|file| !before.contains(file)) {
        std::fs::remove_file(file).unwrap();
    }
    let other = Bus::open(&place).unwrap();
    drop(other.writer(&COMMAND).unwrap());
    assert!(description(&place, "pose").is_some() && description(&place, "truth").is_some());
    assert!(matches!(other.writer(&POSE), Err(BusError::Held { .. })));
    drop(truth);
}

#[test]
fn f27_all_memory_of_a_port_is_allocated_when_it_is_opened() {
    use std::os::unix::fs::MetadataExt;
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let _ports = (bus.writer(&POSE).unwrap(), bus.observer(&POSE).unwrap());
    let shared = files(&place).into_iter().filter(|file| file.starts_with("/dev/shm"));
    let shared: Vec<_> = shared.map(|file| (std::fs::metadata(&file).unwrap(), file)).collect();
    assert!(shared.iter().any(|(metadata, _)| metadata.len() > 1_000_000));
    for (metadata, file) in shared.iter().filter(|(metadata, _)| metadata.is_file()) {
        assert!(metadata.blocks() * 512 >= metadata.len(), "{}", file.display());
    }
}

#[test]
fn files_of_an_instance_are_private() {
    use std::os::unix::fs::MetadataExt;
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let _ports = (bus.writer(&POSE).unwrap(), bus.reader(&POSE).unwrap());
    for file in files(&place) {
        let mode = std::fs::metadata(&file).unwrap().mode();
        assert_eq!(mode & 0o077, 0, "{} has mode {mode:o}", file.display());
    }
}

/// Names of an instance in shared memory, without the random number of the run.
fn guessable(place: &InstancePaths) -> Vec<String> {
    let names = files(place).into_iter().filter(|file| file.starts_with("/dev/shm"));
    names.map(|file| file.file_name().unwrap().to_string_lossy().into_owned()).collect()
}

#[test]
fn f28_names_in_shared_memory_cannot_be_guessed_and_planted_files_do_no_harm() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let ports = (bus.writer(&POSE).unwrap(), bus.listener(&POSE).unwrap());
    let words = bus.stop_switch().unwrap();
    let last = guessable(&place);
    assert!(last.len() > 3, "{last:?}");
    drop((bus, ports, words));
    assert_eq!(files(&place), Vec::<std::path::PathBuf>::new());
    // Files that another user could create: the names of the last run, and the names without the random number.
    let mut planted: Vec<_> =
        last.iter().map(|name| std::path::Path::new("/dev/shm").join(name)).collect();
    planted.extend(
        ["stop", "pose.count"].map(|name| crate::remains::shared(&(place.prefix() + name))),
    );
    for path in &planted {
        std::fs::create_dir_all(path.join("full")).unwrap();
    }
    let foreign = |path: &std::path::PathBuf| path.join("full").exists();
    let bus = Bus::open(&place).unwrap();
    let now = guessable(&place);
    drop((bus.listener(&POSE).unwrap(), bus.stop_switch().unwrap(), bus));
    assert!(now.iter().all(|name| !last.contains(name)), "{now:?}");
    assert!(!planted.iter().any(foreign), "the instance's own remains are removed");
}

#[test]
fn f26_a_service_of_other_definitions_is_another_version_not_a_fault_of_the_system() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let config = bus.membership.config().unwrap();
    let node: Node<ipc::Service> = NodeBuilder::new().config(&config).create().unwrap();
    let named = |name: &str| node.service_builder(&ServiceName::new(name).unwrap());
    let _control = named(CONTROL).request_response::<u64, u64>().create().unwrap();
    let _typed = named("health/daemon").publish_subscribe::<u64>().create().unwrap();
    let other_schema = AttributeSpecifier::new()
        .define(&"schema".try_into().unwrap(), &"0123456789abcdef".try_into().unwrap())
        .unwrap();
    let pose = named("pose").publish_subscribe::<[u8]>().user_header::<Header>();
    let quality = POSE.quality;
    let _pose = pose
        .history_size(quality.history)
        .subscriber_max_buffer_size(quality.buffer)
        .max_publishers(1)
        .max_subscribers(quality.readers)
        .max_nodes(24)
        .create_with_attributes(&other_schema)
        .unwrap();
    let event = crate::wake::path(&bus.membership, COMMAND.name);
    std::fs::write(event, "an event of another size").unwrap();
    let version = |error: BusError| matches!(error, BusError::Version { .. });
    assert!(version(bus.listener(&COMMAND).unwrap_err()));
    assert!(version(bus.control_client().unwrap_err()));
    assert!(version(bus.reader(&Role::Daemon.health()).unwrap_err()));
    assert!(version(bus.reader(&POSE).unwrap_err()));
}

#[test]
fn a_root_that_cannot_be_made_is_a_fault_of_the_system() {
    let error = Bus::open(&place(std::path::Path::new("/dev/null/oqtal"))).unwrap_err();
    assert!(matches!(error, BusError::System { .. }), "{error}");
}

/// Checks of a watch until a loss of a file in use counts.
fn check_twice(watch: &mut InstanceWatch) -> Vec<crate::watch::LostFile> {
    [watch.check(), watch.check()].concat()
}

#[test]
fn f68_members_and_link_of_a_living_instance_are_restored_and_no_object_is_removed() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let (_pose, _stop) = (bus.writer(&POSE).unwrap(), bus.stop_switch().unwrap());
    let mut watch = bus.watch().unwrap();
    let objects = guessable(&place);
    for names in [&["members"][..], &["shared"], &["members", "shared"]] {
        assert_eq!(check_twice(&mut watch), []);
        names.iter().for_each(|name| std::fs::remove_file(place.directory().join(name)).unwrap());
        // A process that joins, and leaves, before the loss was noticed.
        drop(Bus::open_running(&place).unwrap().expect("the instance lives"));
        assert_eq!(guessable(&place), objects, "{names:?}");
        names.iter().for_each(|name| drop(std::fs::remove_file(place.directory().join(name))));
        let restored = watch.check();
        assert!(restored.iter().all(|file| file.is_restored), "{restored:?}");
        assert_eq!(restored.len(), names.len(), "{restored:?}");
        let other = Bus::open(&place).unwrap();
        assert!(matches!(other.writer(&POSE), Err(BusError::Held { .. })), "{names:?}");
    }
}

#[test]
fn f68_a_loss_is_told_to_processes_that_do_not_use_the_file_and_nobody_joins_that_run() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let mut watch = bus.watch().unwrap();
    let (run, path) = (bus.membership.words_file(""), std::path::PathBuf::from("/lost.dynamic"));
    crate::private::record_loss(&run, &path);
    assert_eq!(watch.check(), [crate::watch::LostFile { path, is_restored: false }]);
    let next = Bus::open(&place).unwrap();
    assert_ne!(next.membership.words_file(""), run);
}

/// Moves the directory of the instance.
fn moved(place: &InstancePaths) -> std::path::PathBuf {
    let path = place.root.join("moved");
    std::fs::rename(place.directory(), &path).unwrap();
    path
}

#[test]
fn f68_after_another_loss_a_new_run_begins_beside_the_lost_one() {
    type Lose = fn(&InstancePaths, &Bus);
    let losses: [Lose; 6] = [
        |place, _| drop(moved(place)),
        |place, _| {
            let copy = [moved(place), place.directory()];
            assert!(
                std::process::Command::new("cp").arg("-a").args(copy).status().unwrap().success()
            );
        },
        |place, _| std::fs::remove_dir_all(&place.root).unwrap(),
        |_, bus| std::fs::remove_dir_all(bus.membership.words_file("")).unwrap(),
        |_, bus| std::fs::remove_file(bus.membership.words_file("stop")).unwrap(),
        |place, _| {
            let objects = guessable(place).into_iter().map(|name| crate::remains::shared(&name));
            objects
                .filter(|path| path.is_file())
                .for_each(|path| std::fs::remove_file(path).unwrap());
        },
    ];
    for (number, lose) in losses.into_iter().enumerate() {
        let parent = tempfile::tempdir().unwrap();
        let place = place(&parent.path().join("run"));
        let bus = Bus::open(&place).unwrap();
        let (pose, _stop) = (bus.writer(&POSE).unwrap(), bus.stop_switch().unwrap());
        let mut watch = bus.watch().unwrap();
        lose(&place, &bus);
        let lost = check_twice(&mut watch);
        assert!(lost.iter().any(|file| !file.is_restored), "{number}: {lost:?}");
        let objects = guessable(&place);
        let next = Bus::open(&place).unwrap();
        assert!(objects.iter().all(|name| guessable(&place).contains(name)), "{number}");
        let readers = (next.reader(&TRUTH).unwrap(), next.stop_switch().unwrap());
        drop((pose, _stop, bus, watch));
        assert!(Bus::open(&place).unwrap().reader(&TRUTH).is_ok(), "{number}");
        drop((readers, next));
        assert_eq!(guessable(&place), [""; 0], "{number}");
    }
}

#[test]
fn f29_objects_of_a_dead_run_are_removed_by_the_next_process_that_joins() {
    let (_root, place) = temporary();
    let _bus = Bus::open(&place).unwrap();
    let dead = crate::remains::shared(&format!("{}0123456789abcdef", place.prefix()));
    std::fs::create_dir(&dead).unwrap();
    std::fs::write(dead.join("stop"), "").unwrap();
    let object = std::path::PathBuf::from(format!("{}_1_2.data", dead.display()));
    std::fs::write(&object, "").unwrap();
    let unnamed = crate::remains::shared(&format!(".{}0123456789abcdef", place.prefix()));
    std::fs::create_dir(&unnamed).unwrap();
    assert!(Bus::open_running(&place).unwrap().is_some());
    assert!(!dead.exists() && !object.exists() && !unnamed.exists());
}

/// The clean-up of iceoryx2 would wait without end for an object whose maker was killed before it gave it a size.
#[test]
fn f29_objects_without_a_size_are_removed() {
    let (_root, place) = temporary();
    let bus = Bus::open(&place).unwrap();
    let run = bus.membership.words_file("stop").parent().unwrap().to_path_buf();
    let run = run.file_name().unwrap().to_string_lossy().into_owned();
    let object = crate::remains::shared(&format!("{run}_1_2.connection"));
    std::fs::write(&object, "").unwrap();
    let before = files(&place).len();
    drop(Bus::open_running(&place).unwrap().unwrap());
    assert!(!object.exists());
    assert_eq!(files(&place).len(), before - 1);
}

#[test]
fn the_configuration_of_a_killed_daemon_outlives_a_visitor() {
    let (_root, place) = temporary();
    for is_kept in [true, false] {
        let bus = Bus::open(&place).unwrap();
        std::fs::write(place.config(), "").unwrap();
        let visitor = Bus::open_running(&place).unwrap().unwrap();
        if is_kept {
            drop((bus, visitor))
        } else {
            drop((visitor, bus))
        }
        assert_eq!(place.config().exists(), is_kept);
    }
}

#[test]
fn an_instance_without_members_is_not_made_by_asking_for_it() {
    let parent = tempfile::tempdir().unwrap();
    let place = place(&parent.path().join("run"));
    assert!(Bus::open_running(&place).unwrap().is_none());
    assert!(!place.root.exists());
    std::fs::create_dir_all(place.directory()).unwrap();
    std::fs::write(place.directory().join("members"), "").unwrap();
    assert!(Bus::open_running(&place).unwrap().is_none());
    assert!(place.directory().join("members").exists());
}

#[test]
fn f71_observers_leave_the_places_of_the_loop() {
    let (_root, place) = temporary();
    let most = POSE.quality.observers;
    let bus = Bus::open(&place).unwrap().for_observer();
    let observers: Vec<_> = (0..most).map(|_| bus.observer(&POSE).unwrap()).collect();
    let error = bus.observer(&POSE).unwrap_err().to_string();
    let (count, own) = (format!("has {most} observers"), format!("({})", std::process::id()));
    assert!(error.contains(&count) && error.contains(&own), "{error}");
    let lab = Bus::open(&place).unwrap();
    let reserved: Vec<_> =
        (most..POSE.quality.readers).map(|_| lab.reader(&POSE).unwrap()).collect();
    drop(reserved);
    drop(observers);
    assert!(bus.observer(&POSE).is_ok());
}
