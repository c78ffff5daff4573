//! Files of a running instance that are removed or shortened, and observers that take places: real processes.

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::process::Command;

use crate::common::network::{Server, free_port};
use crate::common::{Running, SERVICES, Testbed, assert_refused, stderr, wait_for};
use oqtal_bus::bus::Bus;
use oqtal_bus::code::{Cause, Mode, SafetyState};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, POSE, Role, Sample, TELEMETRY};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_observe::recording::{RecordingFile, play};
use oqtal_observe::sink::{Reception, Sink};
use rustix::process::Signal;

/// Objects of the testbed in shared memory.
pub fn objects(testbed: &Testbed) -> Vec<PathBuf> {
    testbed.remains().into_iter().map(|name| PathBuf::from("/dev/shm").join(name)).collect()
}

/// Removes a file, link or directory that may have been removed already.
pub fn remove(path: &PathBuf) {
    let _ = fs::remove_file(path).or_else(|_| fs::remove_dir_all(path));
}

/// Starts the processes that do not run, as a service manager does, until the daemon among them is in the state Nominal, or keeps an
/// operator's stop. A process that ended by itself had lost a file of the instance, exit code 71.
pub fn work_again(testbed: &Testbed, running: &mut [Option<Running>; 3]) {
    wait_for("accepted poses", || {
        for (slot, process) in running.iter_mut().zip(SERVICES) {
            if let Some(ended) = slot.take_if(|process| !process.runs()) {
                let output = ended.wait();
                assert_eq!(output.status.code(), Some(71), "{process}: {}", stderr(&output));
            }
            slot.get_or_insert_with(|| testbed.start(&[process, "run"]));
        }
        let daemon = running[2].as_ref().map(Running::id)?;
        // The processes may just be leaving one run of the instance for the next one.
        let bus = testbed.bus();
        let mut telemetry = bus.observer(&TELEMETRY).unwrap();
        let give_up = Time::now() + Span::from_millis(500);
        while Time::now() < give_up {
            if let Some((header, tick)) = telemetry.latest().unwrap()
                && header.origin().process() == daemon
                && (tick.state == SafetyState::Nominal.code()
                    || tick.cause == Cause::Operator.code())
            {
                return Some(());
            }
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        None
    });
}

/// Removes the root. A process may make a file in a directory that is being removed.
fn remove_root(testbed: &Testbed) {
    wait_for("the removal", || fs::remove_dir_all(testbed.path("run")).ok());
}

type Loss = (&'static str, fn(&Testbed));

const LOSSES: [Loss; 4] = [
    ("root", remove_root),
    ("stop words", |testbed| {
        fs::remove_file(testbed.paths().directory().join("shared/stop")).unwrap();
    }),
    ("shared memory", |testbed| objects(testbed).iter().for_each(remove)),
    ("one service", |testbed| {
        let is_service = |path: &PathBuf| path.extension().is_some_and(|end| end == "dynamic");
        remove(objects(testbed).iter().find(|path| is_service(path)).unwrap());
    }),
];

#[test]
fn f68_a_flight_lands_after_a_loss_and_the_processes_work_when_started_again() {
    for (name, lose) in LOSSES {
        let testbed = Testbed::new("lost-lands");
        let bus = testbed.bus();
        let mut telemetry = bus.observer(&TELEMETRY).unwrap();
        let processes = testbed.services();
        testbed.take_off(&bus);
        while telemetry.receive().unwrap().is_some() {}
        lose(&testbed);
        let mut modes = Vec::new();
        wait_for(&format!("the end of the flight after the loss of the {name}"), || {
            let (_, tick) = telemetry.receive().unwrap()?;
            if modes.last() != Some(&tick.mode) {
                modes.push(tick.mode);
            }
            (tick.mode == Mode::Disarmed.code()).then_some(())
        });
        let expected = [Mode::Flying, Mode::Landing, Mode::Disarmed].map(Mode::code);
        assert!(modes.ends_with(&expected[1..]), "{name}: {modes:?}");
        drop((telemetry, bus));
        work_again(&testbed, &mut processes.map(Some));
    }
}

#[test]
fn f68_a_receiver_ends_after_the_loss_of_its_instance_and_continues_for_another_one_in_use() {
    let server = Server::start("qtm", free_port(), &["--body", "quad", "--body", "six"]);
    let testbed = Testbed::new("lost-receiver");
    let receiver = testbed.start(&["receiver", "run", "--link", &server.link(",body=quad")]);
    receive_poses(&testbed.bus(), Time::now());
    remove(&testbed.paths().directory());
    assert_eq!(receiver.wait().status.code(), Some(71));

    let testbed = Testbed::new("lost-of-two");
    let link = server.link(",body=quad,body=six@used");
    let receiver = testbed.start(&["receiver", "run", "--link", &link]);
    let root = testbed.path("run").display().to_string();
    let daemon = ["daemon", "run", "--instance", "used", "--root", &root];
    let _daemon = Running::start(&mut testbed.study(&daemon));
    let used = testbed.bus_of("used");
    wait_for("the daemon", || used.holder(&Role::Daemon.health()).unwrap());
    receive_poses(&used, Time::now());
    remove(&testbed.paths().directory());
    receive_poses(&used, Time::now() + Span::from_millis(2000));
    assert!(receiver.runs());
}

/// Receives poses until one was published at `until`.
fn receive_poses(bus: &Bus, until: Time) {
    let mut poses = bus.observer(&POSE).unwrap();
    wait_for("a pose", || {
        let (header, _) = poses.receive().unwrap()?;
        (header.stamps.pose_published_at >= until).then_some(())
    });
}

#[test]
fn f68_requests_after_a_loss_tell_that_the_daemon_runs() {
    let testbed = Testbed::new("lost-told");
    let [_plant, _cameras, daemon] = testbed.services();
    testbed.wait_for_daemon();
    // It stays until it is continued.
    daemon.signal(Signal::STOP);
    remove_root(&testbed);
    for words in [&["status"][..], &["goto", "0", "0", "1"], &["arm"], &["status", "--json"]] {
        let output = testbed.oqtal(&[&["ctl"], words].concat()).output().unwrap();
        assert_refused(&output, 75, &[" runs, but cannot be reached"]);
        let told = stderr(&output);
        assert!(!told.contains("not started") && !told.contains("start one"), "{told}");
    }
    daemon.signal(Signal::CONT);
}

#[test]
fn f68_a_daemon_killed_after_a_loss_starts_again() {
    for (_, lose) in LOSSES {
        let testbed = Testbed::new("lost-killed");
        let mut running = [None, None, None];
        work_again(&testbed, &mut running);
        lose(&testbed);
        let daemon = running[2].take().unwrap();
        daemon.signal(Signal::KILL);
        drop(daemon.wait());
        work_again(&testbed, &mut running);
        let stop = testbed.oqtal(&["ctl", "stop"]).output().unwrap();
        assert_eq!(stop.status.code(), Some(0), "{}", stderr(&stop));
    }
}

/// Processes of the daemons whose ticks were received.
#[derive(Default)]
struct Daemons(Vec<u32>);

impl Sink for Daemons {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        if matches!(sample, Sample::Telemetry(_)) {
            self.0.push(reception.header.origin().process());
        }
    }

    fn lost(&mut self, _: ObservedTopic, _: u64) {}
}

/// Waits until `observer` takes part in the present run of the instance, and ticks have followed.
fn is_observed(testbed: &Testbed, observer: &Running) {
    wait_for("the observer", || {
        let run = fs::read_link(testbed.paths().directory().join("shared")).ok()?;
        let maps = fs::read_to_string(format!("/proc/{}/maps", observer.id())).ok()?;
        maps.contains(&run.display().to_string()).then_some(())
    });
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let mut ticks = 0;
    wait_for("ticks", || {
        ticks += u32::from(telemetry.receive().unwrap().is_some());
        (ticks > 30).then_some(())
    });
}

/// Moves the directory of the instance, and returns its new path.
fn move_directory(testbed: &Testbed) -> PathBuf {
    let directory = testbed.paths().directory();
    let moved = directory.with_extension(format!("moved-{}", Time::now().nanos()));
    fs::rename(directory, &moved).unwrap();
    moved
}

/// Removals of all files, and moves of them, after which another directory may have the name of the instance's.
const MOVES: [fn(&Testbed); 7] = [
    remove_root,
    |testbed| objects(testbed).iter().for_each(remove),
    |testbed| drop(move_directory(testbed)),
    |testbed| fs::rename(testbed.path("run"), testbed.path("moved")).unwrap(),
    |testbed| {
        move_directory(testbed);
        fs::create_dir(testbed.paths().directory()).unwrap();
    },
    |testbed| {
        let moved = move_directory(testbed);
        let copy = Command::new("cp").arg("-a").args([moved, testbed.paths().directory()]).status();
        assert!(copy.unwrap().success());
    },
    |testbed| {
        let (root, other) = (testbed.path("run"), testbed.path("other"));
        fs::create_dir(&other).unwrap();
        fs::rename(&root, testbed.path("moved-last")).unwrap();
        symlink(other, root).unwrap();
    },
];

/// Waits for the end of the processes after a loss.
fn have_ended(running: &[Option<Running>; 3]) {
    wait_for("the end of the processes", || {
        running.iter().flatten().all(|process| !process.runs()).then_some(())
    });
}

/// The observers are processes of their own: processes started by one that observes would have its files open.
#[test]
fn f68_observers_continue_with_the_next_start_of_the_processes_and_leave_it_whole() {
    let testbed = Testbed::new("observed");
    let page = testbed.start(&["view", "--wait", "--listen", "127.0.0.1:0"]);
    let mut running = [None, None, None];
    for (number, loss) in MOVES.into_iter().enumerate() {
        let file = testbed.path(&format!("{number}.mcap"));
        let recorder = testbed.start(&["record", "--out", &file.display().to_string()]);
        let mut daemons = Vec::new();
        for lose in [Some(loss), None] {
            work_again(&testbed, &mut running);
            daemons.extend(running[2].as_ref().map(Running::id));
            [&recorder, &page].iter().for_each(|observer| is_observed(&testbed, observer));
            if let Some(lose) = lose {
                lose(&testbed);
                have_ended(&running);
            }
        }
        recorder.signal(Signal::INT);
        let output = recorder.wait();
        assert!(output.status.success(), "{number}: {}", stderr(&output));
        // Longer than two checks of the files.
        (0..3).for_each(|_| is_observed(&testbed, &page));
        assert!(running.iter().flatten().all(Running::runs), "{number}: the recorder left");
        let mut recorded = Daemons::default();
        play(&RecordingFile::read(&file).unwrap(), &mut recorded).unwrap();
        recorded.0.dedup();
        assert_eq!(recorded.0, daemons, "{number}");
    }
    page.signal(Signal::INT);
    assert!(page.wait().status.success());
    let stop = testbed.oqtal(&["ctl", "stop"]).output().unwrap();
    assert_eq!(stop.status.code(), Some(0), "{}", stderr(&stop));
}

#[test]
fn f68_a_recorder_suspended_during_a_move_tells_that_it_recorded_nothing_since() {
    let testbed = Testbed::new("suspended");
    let out = testbed.path("all.mcap").display().to_string();
    let recorder = testbed.start(&["record", "--out", &out]);
    let mut running = [None, None, None];
    work_again(&testbed, &mut running);
    is_observed(&testbed, &recorder);
    recorder.signal(Signal::STOP);
    move_directory(&testbed);
    have_ended(&running);
    work_again(&testbed, &mut running);
    recorder.signal(Signal::INT);
    recorder.signal(Signal::CONT);
    assert_refused(&recorder.wait(), 71, &["removed or moved", "record again"]);
    assert!(running.iter().flatten().all(Running::runs), "the recorder left an earlier run");
}

#[test]
fn f69_a_flight_continues_and_stops_after_all_shared_words_were_shortened() {
    let testbed = Testbed::new("shortened");
    let bus = testbed.bus();
    let mut telemetry = bus.observer(&TELEMETRY).unwrap();
    let processes = testbed.services();
    testbed.take_off(&bus);
    while telemetry.receive().unwrap().is_some() {}
    let run = fs::read_dir(testbed.paths().directory().join("shared")).unwrap();
    let words = run.map(Result::unwrap).filter(|entry| entry.file_type().unwrap().is_file());
    let words: Vec<_> = words.collect();
    assert!(words.len() > 5);
    for size in [0, 1, 64] {
        for file in &words {
            let file = File::options().write(true).open(file.path());
            file.unwrap().set_len(size).unwrap();
        }
        let mut ticks = 0;
        wait_for("ticks of a flight", || {
            let (_, tick) = telemetry.receive().unwrap()?;
            assert_eq!(tick.mode, Mode::Flying.code());
            ticks += 1;
            (ticks > 60).then_some(())
        });
    }
    assert!(processes.iter().all(Running::runs));
    let stop = testbed.oqtal(&["ctl", "stop"]).output().unwrap();
    assert_eq!(stop.status.code(), Some(0), "{}", stderr(&stop));
}

#[test]
fn f71_eight_recorders_started_first_leave_the_places_of_a_flight() {
    let testbed = Testbed::new("recorders");
    let record = |number: i32| {
        let out = testbed.path(&format!("{number}.mcap")).display().to_string();
        testbed.start(&["record", "--out", &out])
    };
    let recorders: Vec<_> = (0..8).map(record).collect();
    wait_for("four refusals", || {
        let running = recorders.iter().filter_map(|recorder| recorder.runs().then_some(()));
        (running.count() == 4).then_some(())
    });
    let (running, refused): (Vec<_>, Vec<_>) = recorders
        .into_iter()
        .map(|recorder| (recorder.runs(), recorder))
        .partition(|(runs, _)| *runs);
    for (_, recorder) in refused {
        let output = recorder.wait();
        assert_eq!(output.status.code(), Some(75), "{}", stderr(&output));
        let message = stderr(&output);
        assert!(
            message.contains("4 observers") && message.contains("`oqtal record` ("),
            "{message}"
        );
    }
    // A recorder has its places once its file exists.
    wait_for("four recordings", || {
        let exists = |number: &i32| testbed.path(&format!("{number}.mcap")).exists();
        ((0..8).filter(exists).count() == 4).then_some(())
    });
    // Two are suspended: their places stay theirs.
    running[..2].iter().for_each(|(_, recorder)| recorder.signal(Signal::STOP));
    testbed.lands(&["--trajectory", "hover", "--duration", "1"]);
    running.iter().for_each(|(_, recorder)| recorder.signal(Signal::KILL));
}
