//! Notifications to the service manager (sd_notify): ready, status, watchdog, stopping.
//!
//! A separate thread sends them, never the loop. The thread is not started without a service manager.
//!
//! The watchdog is triggered while the process is healthy: its loop turns, its background thread polls (in flight this does not matter),
//! and it has output (the daemon publishes commands, the simulator the truth, the cameras poses while the vehicle is in view; the bridge
//! writes set-points). A late loop does not end a process in flight; it only changes the safety state.

use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use sd_notify::NotifyState;

use oqtal_bus::topic::Role;

use crate::context::ProcessContext;
use crate::health::{HealthSample, MotorActivity};

/// Sampling period before the first turn of the loop.
const STARTUP_SAMPLING: Duration = Duration::from_millis(20);
/// Maximum sampling period after the first turn.
const SAMPLING: Duration = Duration::from_millis(250);
/// Watchdog notifications per watchdog period \[-\].
const WATCHDOG_NOTIFICATIONS: u32 = 4;
/// Number of samples without input after which a loop counts as waiting for its peers \[-\].
const SAMPLES_WITHOUT_INPUT: u32 = 4;

/// Executes `job`; if there is a service manager, notifies it meanwhile.
pub(crate) fn notified<T>(context: &ProcessContext, job: impl FnOnce() -> T) -> T {
    if std::env::var_os("NOTIFY_SOCKET").is_none() {
        return job();
    }
    std::thread::scope(|threads| {
        // Closed when the job ends, also after a panic.
        let (_job_runs, over) = channel::<()>();
        threads.spawn(move || notify_until(context, &over));
        job()
    })
}

fn notify_until(context: &ProcessContext, over: &Receiver<()>) {
    let watchdog = sd_notify::watchdog_enabled();
    let regular =
        watchdog.map_or(SAMPLING, |period| (period / WATCHDOG_NOTIFICATIONS).min(SAMPLING));
    let mut notifier = ServiceNotifier::new(context.role);
    let mut wait = STARTUP_SAMPLING;
    while over.recv_timeout(wait) == Err(RecvTimeoutError::Timeout) {
        send(&notifier.notices(context.health.sample(), context.stop.is_set()));
        wait = if notifier.ready { regular } else { STARTUP_SAMPLING };
    }
    send(&notifier.notices(context.health.sample(), true));
}

/// Sends notices. An error means that the service manager is gone, and is ignored.
fn send(notices: &[Notice]) {
    for notice in notices {
        let state = match notice {
            Notice::Ready => NotifyState::Ready,
            Notice::Status(text) => NotifyState::Status(text),
            Notice::Alive => NotifyState::Watchdog,
            Notice::Stopping => NotifyState::Stopping,
        };
        let _ = sd_notify::notify(&[state]);
    }
}

/// A notification to the service manager.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Notice {
    Ready,
    Status(String),
    Alive,
    Stopping,
}

/// Converts samples of the health record to notices. Pure.
#[derive(Debug)]
struct ServiceNotifier {
    role: Role,
    ready: bool,
    stopping: bool,
    status: String,
    last: HealthSample,
    samples_without_input: u32,
}

impl ServiceNotifier {
    fn new(role: Role) -> Self {
        Self {
            role,
            ready: false,
            stopping: false,
            status: String::new(),
            last: HealthSample::default(),
            samples_without_input: SAMPLES_WITHOUT_INPUT,
        }
    }

    fn notices(&mut self, sample: HealthSample, stopping: bool) -> Vec<Notice> {
        let mut notices = Vec::new();
        let turns = self.last.turns != sample.turns;
        let has_input = self.last.inputs != sample.inputs;
        let is_healthy = self.is_healthy(&sample);
        self.samples_without_input =
            if has_input { 0 } else { self.samples_without_input.saturating_add(1) };
        // The first turn follows the opening of the ports.
        if turns && !self.ready {
            self.ready = true;
            notices.push(Notice::Ready);
        }
        if is_healthy {
            notices.push(Notice::Alive);
        }
        if stopping && !std::mem::replace(&mut self.stopping, true) {
            notices.push(Notice::Stopping);
        }
        let hangs = !self.background_polls(&sample);
        let status = self.status(sample.status.clone(), hangs);
        self.last = sample;
        if self.ready && status != self.status {
            self.status.clone_from(&status);
            notices.push(Notice::Status(status));
        }
        notices
    }

    /// Whether loop, background threads and outputs have progressed since the last sample.
    fn is_healthy(&self, sample: &HealthSample) -> bool {
        let HealthSample { turns, inputs, outputs, .. } = &self.last;
        let loop_turns = sample.turns != *turns;
        // The end of the process would drop a vehicle in flight; the loop, a stop and a landing do not need the background thread.
        let flies = sample.motors == MotorActivity::MayRun;
        // Without a vehicle in view, or during playback of a recording, the cameras may be idle.
        let may_be_idle = match self.role {
            Role::Mocap | Role::Receiver => sample.inputs == *inputs,
            Role::Recorder => true,
            Role::Daemon | Role::Plant | Role::Bridge => false,
        };
        let polls = self.background_polls(sample) || flies;
        loop_turns && polls && (may_be_idle || sample.outputs != *outputs)
    }

    /// Whether every background thread has polled since the last sample.
    fn background_polls(&self, sample: &HealthSample) -> bool {
        let mut pairs = sample.polls.iter().zip(&self.last.polls);
        pairs.all(|(count, before)| *count == 0 || count != before)
    }

    /// Status text of the process, or whether it receives input from its peers.
    fn status(&self, own: String, hangs: bool) -> String {
        if self.stopping {
            return "ending".to_owned();
        }
        if hangs {
            return "the background thread hangs: requests of operators wait, but for a stop and a landing".to_owned();
        }
        if !own.is_empty() {
            return own;
        }
        let waits = self.samples_without_input >= SAMPLES_WITHOUT_INPUT;
        let status = match (self.role, waits) {
            (Role::Plant, true) => "waiting for commands of a daemon",
            (Role::Plant, false) => "flying as commanded",
            (Role::Mocap, true) => "waiting for a simulated vehicle",
            (Role::Mocap, false) => "seeing the vehicle",
            (Role::Bridge, true) => "waiting for commands of a daemon",
            (Role::Bridge, false) => "passing commands on",
            (Role::Receiver, true) => "waiting for frames of the camera system",
            (Role::Receiver, false) => "passing poses on",
            (Role::Daemon | Role::Recorder, _) => "",
        };
        status.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sample of a loop that publishes in every turn.
    fn sample(turns: u64, inputs: u64) -> HealthSample {
        HealthSample { turns, inputs, outputs: turns, ..HealthSample::default() }
    }

    /// Whether a process of `role` triggers its watchdog at the sample `second` after `first`.
    fn triggers(role: Role, first: &HealthSample, second: &HealthSample) -> bool {
        let mut notifier = ServiceNotifier::new(role);
        notifier.notices(first.clone(), false);
        notifier.notices(second.clone(), false).contains(&Notice::Alive)
    }

    #[test]
    fn f15_a_loop_that_turns_without_output_does_not_trigger_its_watchdog() {
        let first = HealthSample { polls: vec![5, 0, 7], ..sample(10, 3) };
        let well = HealthSample { polls: vec![6, 0, 8], ..sample(11, 4) };
        let idle = HealthSample { outputs: first.outputs, ..well.clone() };
        let hung_background = [vec![5, 0, 8], vec![6, 0, 7]];
        for role in [Role::Daemon, Role::Plant, Role::Mocap, Role::Bridge] {
            assert!(triggers(role, &first, &well), "{role:?}");
            assert!(!triggers(role, &first, &idle), "{role:?}");
            for polls in &hung_background {
                let hung = HealthSample { polls: polls.clone(), ..well.clone() };
                assert!(!triggers(role, &first, &hung), "{role:?}");
                let flying = HealthSample { motors: MotorActivity::MayRun, ..hung };
                assert!(
                    triggers(role, &first, &flying),
                    "{role:?}: its end would drop the vehicle"
                );
            }
        }
        let unseen = HealthSample { inputs: first.inputs, ..idle };
        assert!(triggers(Role::Mocap, &first, &unseen), "cameras without a vehicle in view");
        assert!(!triggers(Role::Daemon, &first, &unseen));
    }

    fn statuses(notices: Vec<Notice>) -> Vec<String> {
        let text = |notice| if let Notice::Status(text) = notice { Some(text) } else { None };
        notices.into_iter().filter_map(text).collect()
    }

    #[test]
    fn readiness_is_notified_once_after_the_first_turn() {
        let mut notifier = ServiceNotifier::new(Role::Plant);
        assert_eq!(notifier.notices(sample(0, 0), false), []);
        assert!(notifier.notices(sample(1, 0), false).contains(&Notice::Ready));
        assert!(!notifier.notices(sample(2, 0), false).contains(&Notice::Ready));
    }

    #[test]
    fn f15_a_loop_that_stands_still_does_not_trigger_its_watchdog() {
        let mut notifier = ServiceNotifier::new(Role::Daemon);
        for turns in [3, 4, 90] {
            assert!(notifier.notices(sample(turns, 0), false).contains(&Notice::Alive));
        }
        for _ in 0..10 {
            assert!(!notifier.notices(sample(90, 0), false).contains(&Notice::Alive));
        }
        assert!(notifier.notices(sample(91, 0), false).contains(&Notice::Alive));
    }

    #[test]
    fn a_status_is_notified_when_it_changes() {
        let mut notifier = ServiceNotifier::new(Role::Plant);
        let first = statuses(notifier.notices(sample(1, 0), false));
        assert_eq!(first, ["waiting for commands of a daemon"]);
        assert!(statuses(notifier.notices(sample(2, 0), false)).is_empty());
        assert_eq!(statuses(notifier.notices(sample(3, 1), false)), ["flying as commanded"]);
        let later: Vec<_> =
            (4..12).flat_map(|turns| statuses(notifier.notices(sample(turns, 1), false))).collect();
        assert_eq!(later, ["waiting for commands of a daemon"]);
        let own = HealthSample { status: "well".to_owned(), ..sample(20, 1) };
        assert_eq!(statuses(notifier.notices(own, false)), ["well"]);
    }

    #[test]
    fn the_end_is_notified_once() {
        let mut notifier = ServiceNotifier::new(Role::Bridge);
        notifier.notices(sample(1, 0), false);
        let notices = notifier.notices(sample(2, 0), true);
        assert!(notices.contains(&Notice::Stopping));
        assert_eq!(statuses(notices), ["ending"]);
        assert_eq!(notifier.notices(sample(2, 0), true), []);
    }
}
