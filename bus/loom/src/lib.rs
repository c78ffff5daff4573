//! Every interleaving of the event count, of the stop words and of the lease of a port, with the files of `oqtal-bus` that contain
//! their protocols.
//!
//! `cargo test --release`, in this directory. Memory is that of one process instead of a mapped file; the futex is a mutex and a
//! condition variable.
#![cfg(test)]

use atomic::{AtomicU32, Ordering};
use loom::sync::{Arc, Condvar, Mutex};
use loom::thread;

mod atomic {
    pub(crate) use loom::sync::atomic::{AtomicU32, Ordering};
}
#[path = "../../src/wake/event_count.rs"]
mod event_count;
#[path = "../../src/lease/words.rs"]
mod lease;
#[path = "../../src/stop/words.rs"]
#[allow(dead_code)]
mod words;

/// Futex of one word: the comparison and the beginning of the sleep are one step for every waker.
#[derive(Default)]
struct Futex {
    lock: Mutex<()>,
    sleepers: Condvar,
}

impl Futex {
    fn sleep(&self, word: &AtomicU32, seen: u32) -> Result<(), ()> {
        let lock = self.lock.lock().unwrap();
        if word.load(Ordering::Relaxed) == seen {
            drop(self.sleepers.wait(lock).unwrap());
        }
        Ok(())
    }

    fn wake(&self) -> Result<(), ()> {
        let _lock = self.lock.lock().unwrap();
        self.sleepers.notify_all();
        Ok(())
    }
}

/// A lost notification would leave the listener asleep: loom reports the deadlock.
#[test]
fn no_notification_is_lost_and_what_was_written_before_it_is_seen() {
    loom::model(|| {
        let count = Arc::new(AtomicU32::new(0));
        let message = Arc::new(AtomicU32::new(0));
        let futex = Arc::new(Futex::default());
        let notifier = {
            let (count, message, futex) = (count.clone(), message.clone(), futex.clone());
            thread::spawn(move || {
                for number in 1..=2 {
                    message.store(number, Ordering::Relaxed);
                    event_count::notify(&count, |_| futex.wake()).unwrap();
                }
            })
        };
        let seen = std::cell::Cell::new(0);
        while message.load(Ordering::Relaxed) < 2 {
            event_count::wait(&count, &seen, |word, seen| futex.sleep(word, seen)).unwrap();
            assert!(message.load(Ordering::Relaxed) >= seen.get());
        }
        notifier.join().unwrap();
    });
}

/// The words, the motors of the vehicle, and whether the daemon commands "disarmed".
struct Laboratory {
    words: [AtomicU32; words::WORDS],
    motors: AtomicU32,
    disarmed: AtomicU32,
}

impl Laboratory {
    fn new() -> Arc<Self> {
        let words = std::array::from_fn(|_| AtomicU32::new(0));
        let (motors, disarmed) = (AtomicU32::new(1), AtomicU32::new(0));
        Arc::new(Self { words, motors, disarmed })
    }

    /// A turn of the vehicle's process: the motors follow the daemon's command unless a stop is in force.
    fn turn_vehicle(&self, view: &mut words::VehicleView) {
        match view.in_force(&self.words) {
            Some(number) => {
                self.motors.store(0, Ordering::Relaxed);
                words::confirm(&self.words, number, true);
                if self.disarmed.load(Ordering::Acquire) >= number {
                    words::lift(&self.words, number);
                }
            }
            None => {
                let runs = self.disarmed.load(Ordering::Acquire) == 0;
                self.motors.store(u32::from(runs), Ordering::Relaxed);
            }
        }
    }

    /// A turn of the daemon: it commands "disarmed" from a stop on.
    fn turn_daemon(&self, view: &mut words::DaemonView) {
        if view.is_newly_raised(&self.words) {
            self.disarmed.fetch_add(1, Ordering::Release);
            view.confirm(&self.words);
        }
    }
}

fn model(check: impl Fn() + Send + Sync + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(3);
    builder.check(check);
}

#[test]
fn a_stop_is_reported_only_when_it_acts_and_ends_only_after_the_daemon_obeys() {
    model(|| {
        let lab = Laboratory::new();
        let (vehicle, daemon) = (lab.clone(), lab.clone());
        let vehicle = thread::spawn(move || {
            let mut view = words::VehicleView::new(&vehicle.words);
            (0..2).for_each(|_| vehicle.turn_vehicle(&mut view));
            view
        });
        let daemon = thread::spawn(move || {
            let mut view = words::DaemonView::new(&daemon.words);
            daemon.turn_daemon(&mut view);
            view
        });
        let number = words::raise(&lab.words);
        let report = words::report(&lab.words, number);
        assert!(!report.motors_off || lab.motors.load(Ordering::Relaxed) == 0);
        assert!(!report.daemon_obeys || lab.disarmed.load(Ordering::Relaxed) == 1);
        let (mut vehicle, mut daemon) = (vehicle.join().unwrap(), daemon.join().unwrap());
        // Whatever the order was, one further turn of each obeys.
        lab.turn_vehicle(&mut vehicle);
        assert_eq!(lab.motors.load(Ordering::Relaxed), 0);
        lab.turn_daemon(&mut daemon);
        lab.turn_vehicle(&mut vehicle);
        let report = words::report(&lab.words, number);
        assert!(report.vehicle_obeys && report.motors_off && report.daemon_obeys);
        assert_eq!(vehicle.in_force(&lab.words), None);
    });
}

#[test]
fn of_two_stops_raised_at_once_none_is_lost() {
    model(|| {
        let lab = Laboratory::new();
        let (vehicle, operator) = (lab.clone(), lab.clone());
        let vehicle = thread::spawn(move || {
            let mut view = words::VehicleView::new(&vehicle.words);
            (0..2).for_each(|_| vehicle.turn_vehicle(&mut view));
            view
        });
        let operator = thread::spawn(move || words::raise(&operator.words));
        let ours = words::raise(&lab.words);
        let theirs = operator.join().unwrap();
        assert_eq!(ours.max(theirs), 2);
        let mut vehicle = vehicle.join().unwrap();
        lab.turn_vehicle(&mut vehicle);
        assert_eq!(lab.motors.load(Ordering::Relaxed), 0);
        assert!([ours, theirs].iter().all(|number| words::report(&lab.words, *number).motors_off));
        assert_eq!(vehicle.in_force(&lab.words), Some(2));
    });
}

#[test]
fn a_stop_that_is_withheld_is_reported_as_obeyed_only_once_control_is_given_back() {
    model(|| {
        let lab = Laboratory::new();
        let vehicle = lab.clone();
        let vehicle = thread::spawn(move || {
            let mut view = words::VehicleView::new(&vehicle.words);
            if let Some(number) = view.in_force(&vehicle.words) {
                words::withhold(&vehicle.words, number);
            }
            // Control is given back.
            vehicle.turn_vehicle(&mut view);
            view
        });
        let number = words::raise(&lab.words);
        let report = words::report(&lab.words, number);
        assert!(!report.vehicle_obeys || lab.motors.load(Ordering::Relaxed) == 0);
        assert!(!(report.vehicle_obeys && report.another_has_control));
        let mut vehicle = vehicle.join().unwrap();
        lab.turn_vehicle(&mut vehicle);
        let report = words::report(&lab.words, number);
        assert!(report.vehicle_obeys && report.motors_off && !report.another_has_control);
    });
}

/// A frame, not atomically: frames of two writers at once would be lost.
fn write(frames: &AtomicU32) {
    let before = frames.load(Ordering::Relaxed);
    frames.store(before + 1, Ordering::Relaxed);
}

#[test]
fn a_lent_port_has_one_writer_at_a_time() {
    loom::model(|| {
        let port = Arc::new((AtomicU32::new(0), AtomicU32::new(0)));
        let tenant = {
            let port = port.clone();
            thread::spawn(move || {
                let mut written = 0;
                for _ in 0..2 {
                    if lease::take(&port.0) {
                        write(&port.1);
                        lease::release(&port.0, true);
                        written += 1;
                    }
                }
                written
            })
        };
        let mut written = 0;
        for _ in 0..2 {
            if lease::close(&port.0).is_some() {
                write(&port.1);
                lease::offer(&port.0);
                written += 1;
            }
        }
        written += tenant.join().unwrap();
        assert!(lease::close(&port.0).is_some());
        assert_eq!(port.1.load(Ordering::Relaxed), written);
    });
}
