//! What a service manager is told: that the process is ready, how it is, that its loop turns, that it ends.
//!
//! A thread of its own says it, never the loop; where no service manager listens there is no such thread.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use sd_notify::NotifyState;

use crate::process::ProcessContext;
use oqtal_bus::topic::Role;

/// How often the loop is looked at, until it turns for the first time and from then on.
const LOOK_EARLY: Duration = Duration::from_millis(20);
const LOOK: Duration = Duration::from_millis(250);
/// A watchdog is fed so many times in its period.
const FEEDS: u32 = 4;
/// A loop that hears nothing in so many looks waits for its peers.
const DEAF_LOOKS: u32 = 4;

/// What a process shows of itself; cheap to write for a real-time loop, but for words.
#[derive(Clone, Debug, Default)]
pub struct Health(Arc<Record>);

#[derive(Debug, Default)]
struct Record {
    turns: AtomicU64,
    inputs: AtomicU64,
    words: Mutex<String>,
}

impl Health {
    /// The loop has turned.
    pub fn turned(&self) {
        self.0.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// The loop was given what it waits for.
    pub fn heard(&self) {
        self.0.inputs.fetch_add(1, Ordering::Relaxed);
    }

    /// How the process is, in words; not for a real-time loop.
    pub fn say(&self, words: impl Into<String>) {
        *self.0.words.lock().unwrap_or_else(PoisonError::into_inner) = words.into();
    }

    fn look(&self, stopping: bool) -> Sight {
        Sight {
            turns: self.0.turns.load(Ordering::Relaxed),
            inputs: self.0.inputs.load(Ordering::Relaxed),
            words: self.0.words.lock().unwrap_or_else(PoisonError::into_inner).clone(),
            stopping,
        }
    }
}

/// Does `job`, and tells the service manager meanwhile how it goes, if there is one.
pub(crate) fn attended<T>(context: &ProcessContext, job: impl FnOnce() -> T) -> T {
    if std::env::var_os("NOTIFY_SOCKET").is_none() {
        return job();
    }
    std::thread::scope(|threads| {
        // Closes when the job ends, be it by a panic.
        let (_job_runs, over) = channel::<()>();
        threads.spawn(move || attend(context, &over));
        job()
    })
}

fn attend(context: &ProcessContext, over: &Receiver<()>) {
    let watchdog = sd_notify::watchdog_enabled();
    let regular = watchdog.map_or(LOOK, |period| (period / FEEDS).min(LOOK));
    let mut notifier = ServiceNotifier::new(context.role);
    let mut wait = LOOK_EARLY;
    while over.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
        tell(&notifier.notices(context.health.look(context.stop.is_set())));
        wait = if notifier.ready { regular } else { LOOK_EARLY };
    }
    tell(&notifier.notices(context.health.look(true)));
}

/// Nobody is left to tell if the service manager does not listen.
fn tell(notices: &[Notice]) {
    for notice in notices {
        let state = match notice {
            Notice::Ready => NotifyState::Ready,
            Notice::Status(words) => NotifyState::Status(words),
            Notice::Alive => NotifyState::Watchdog,
            Notice::Stopping => NotifyState::Stopping,
        };
        let _ = sd_notify::notify(&[state]);
    }
}

/// What was seen of the loop in one look.
#[derive(Clone, Debug, Default)]
struct Sight {
    turns: u64,
    inputs: u64,
    words: String,
    stopping: bool,
}

/// What the service manager is told.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Notice {
    Ready,
    Status(String),
    Alive,
    Stopping,
}

/// Turns what is seen of the loop into what is told. Pure.
#[derive(Debug)]
struct ServiceNotifier {
    role: Role,
    ready: bool,
    stopping: bool,
    status: String,
    turns: u64,
    inputs: u64,
    deaf_looks: u32,
}

impl ServiceNotifier {
    fn new(role: Role) -> Self {
        Self {
            role,
            ready: false,
            stopping: false,
            status: String::new(),
            turns: 0,
            inputs: 0,
            deaf_looks: DEAF_LOOKS,
        }
    }

    fn notices(&mut self, sight: Sight) -> Vec<Notice> {
        let mut notices = Vec::new();
        let turns = std::mem::replace(&mut self.turns, sight.turns) != sight.turns;
        let hears = std::mem::replace(&mut self.inputs, sight.inputs) != sight.inputs;
        self.deaf_looks = if hears { 0 } else { self.deaf_looks.saturating_add(1) };
        // A loop turns only once its ports are open.
        if turns && !self.ready {
            self.ready = true;
            notices.push(Notice::Ready);
        }
        if turns {
            notices.push(Notice::Alive);
        }
        if sight.stopping && !std::mem::replace(&mut self.stopping, true) {
            notices.push(Notice::Stopping);
        }
        let status = self.status(sight.words);
        if self.ready && status != self.status {
            self.status.clone_from(&status);
            notices.push(Notice::Status(status));
        }
        notices
    }

    /// The process's own words, or whether it hears its peers.
    fn status(&self, words: String) -> String {
        if self.stopping {
            return "ending".to_owned();
        }
        if !words.is_empty() {
            return words;
        }
        let waits = self.deaf_looks >= DEAF_LOOKS;
        let status = match (self.role, waits) {
            (Role::Plant, true) => "waiting for commands of a daemon",
            (Role::Plant, false) => "flying as commanded",
            (Role::Mocap, true) => "waiting for a simulated vehicle",
            (Role::Mocap, false) => "seeing the vehicle",
            (Role::Bridge, true) => "waiting for commands of a daemon",
            (Role::Bridge, false) => "passing commands on",
            (Role::Daemon | Role::Recorder, _) => "",
        };
        status.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sight(turns: u64, inputs: u64) -> Sight {
        Sight { turns, inputs, ..Sight::default() }
    }

    fn statuses(notices: Vec<Notice>) -> Vec<String> {
        let words = |notice| if let Notice::Status(words) = notice { Some(words) } else { None };
        notices.into_iter().filter_map(words).collect()
    }

    #[test]
    fn nothing_is_said_before_the_loop_turns_and_readiness_once() {
        let mut notifier = ServiceNotifier::new(Role::Plant);
        assert_eq!(notifier.notices(sight(0, 0)), []);
        assert!(notifier.notices(sight(1, 0)).contains(&Notice::Ready));
        assert!(!notifier.notices(sight(2, 0)).contains(&Notice::Ready));
    }

    #[test]
    fn f15_a_loop_that_stands_still_does_not_feed_its_watchdog() {
        let mut notifier = ServiceNotifier::new(Role::Daemon);
        for turns in [3, 4, 90] {
            assert!(notifier.notices(sight(turns, 0)).contains(&Notice::Alive));
        }
        for _ in 0..10 {
            assert!(!notifier.notices(sight(90, 0)).contains(&Notice::Alive));
        }
        assert!(notifier.notices(sight(91, 0)).contains(&Notice::Alive));
    }

    #[test]
    fn a_status_is_said_when_it_changes() {
        let mut notifier = ServiceNotifier::new(Role::Plant);
        let first = statuses(notifier.notices(sight(1, 0)));
        assert_eq!(first, ["waiting for commands of a daemon"]);
        assert!(statuses(notifier.notices(sight(2, 0))).is_empty());
        assert_eq!(statuses(notifier.notices(sight(3, 1))), ["flying as commanded"]);
        let later: Vec<_> =
            (4..12).flat_map(|turns| statuses(notifier.notices(sight(turns, 1)))).collect();
        assert_eq!(later, ["waiting for commands of a daemon"]);
        let words = Sight { words: "well".to_owned(), ..sight(20, 1) };
        assert_eq!(statuses(notifier.notices(words)), ["well"]);
    }

    #[test]
    fn the_end_is_told_once() {
        let mut notifier = ServiceNotifier::new(Role::Bridge);
        notifier.notices(sight(1, 0));
        let stops = |turns| Sight { stopping: true, ..sight(turns, 0) };
        let notices = notifier.notices(stops(2));
        assert!(notices.contains(&Notice::Stopping));
        assert_eq!(statuses(notices), ["ending"]);
        assert_eq!(notifier.notices(stops(2)), []);
    }
}
