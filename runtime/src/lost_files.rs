//! Watch over the files of the instance during the life of a process, on a separate thread.
//!
//! A file that can be restored is reported. After any other loss a flight is landed, and the process ends once it can do so safely:
//! the next start, by the service manager or by hand, then finds a whole instance.

use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use oqtal_bus::obeying::ObeyingProcess;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::watch::LostFile;

use crate::context::ProcessContext;
use crate::exit::{Exit, Failure};
use crate::health::MotorActivity;
use crate::watches::WatchedInstance;

/// Time between two checks; a loss is confirmed by the second one.
const CHECK_PERIOD: Duration = Duration::from_millis(300);
/// Time for which the motors are off before the process ends: an operator receives an answer within it.
const MOTORS_OFF: Span = Span::from_millis(1000);
/// Time after which a process without motors ends although others may still fly: longer than any landing.
const LONGEST_LANDING: Span = Span::from_millis(60_000);

/// Executes `job` beside the watch.
///
/// # Errors
/// The error of `job`; a file of the instance was removed that cannot be restored (exit code 71).
pub(crate) fn watched(
    context: &ProcessContext,
    job: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    std::thread::scope(|threads| {
        // Closed when the job ends, also after a panic.
        let (job_runs, over) = channel::<()>();
        let watch = move || watch_until(context, &over);
        let watching = match std::thread::Builder::new().spawn_scoped(threads, watch) {
            Ok(watching) => Some(watching),
            Err(error) => {
                tracing::warn!("the files of the instance are not watched: {error}");
                None
            }
        };
        let result = job();
        drop(job_runs);
        let lost = watching.and_then(|watching| watching.join().ok().flatten());
        match lost {
            // The job's failure is most likely a consequence of the loss: it is logged, and the loss is reported.
            Some((failure, ends_process)) if ends_process || result.is_err() => {
                if let Err(own) = result {
                    tracing::error!("{}", own.message);
                }
                Err(failure)
            }
            _ => result,
        }
    })
}

/// Checks the files until the job is over; returns a loss, and whether it ended the process.
fn watch_until(context: &ProcessContext, over: &Receiver<()>) -> Option<(Failure, bool)> {
    let mut departure: Option<Departure> = None;
    // Instants of the last two checks without a loss; one found at the second check may have been there at the first.
    let mut whole = [Time::now(); 2];
    while over.recv_timeout(CHECK_PERIOD) == Err(RecvTimeoutError::Timeout) {
        let lost = context.watches.check();
        for (instance, file) in &lost {
            let path = file.path.display();
            if file.is_restored {
                tracing::warn!(
                    "{path} was removed or shortened while the instance runs, and is restored"
                );
            } else if departure.is_none() {
                departure = Some(Departure::begin(context, (instance, file), whole[0]));
            }
        }
        if lost.iter().all(|(_, file)| file.is_restored) {
            whole = [whole[1], Time::now()];
        }
        if let Some(departure) = &mut departure
            && departure.is_safe(context.health.motors(), Time::now())
        {
            context.stop.set();
            return Some((departure.failure(), true));
        }
    }
    departure.map(|departure| (departure.failure(), false))
}

/// End of a process after a loss.
#[derive(Debug)]
struct Departure {
    reason: String,
    begun_at: Time,
    motors_off_since: Option<Time>,
    /// Other processes of vehicles and daemons of the lost instance.
    flying: Vec<ObeyingProcess>,
    /// Other instances in which this process takes part: it serves their flights.
    kept: Vec<WatchedInstance>,
}

impl Departure {
    /// Reports the loss of `file`, and requests a landing from the loop of a daemon. `whole_at` is the last instant at which all files
    /// existed.
    fn begin(
        context: &ProcessContext,
        (instance, file): (&WatchedInstance, &LostFile),
        whole_at: Time,
    ) -> Self {
        let reason = format!(
            "{} was removed or moved while the instance runs: no process can join it any more; start its processes again",
            file.path.display()
        );
        tracing::error!("{reason}; a flight is landed first");
        context.signals.files_lost.store(true, Ordering::Release);
        let flying = others(std::slice::from_ref(instance), whole_at);
        let kept = context.watches.others(instance);
        Self { reason, begun_at: Time::now(), motors_off_since: None, flying, kept }
    }

    fn failure(&self) -> Failure {
        Failure::new(Exit::System, self.reason.clone())
    }

    /// Whether the process can end: its motors have been off for a second; a process without motors waits for those that have.
    fn is_safe(&mut self, motors: MotorActivity, now: Time) -> bool {
        match motors {
            MotorActivity::Off => {
                now.since(*self.motors_off_since.get_or_insert(now)) >= MOTORS_OFF
            }
            MotorActivity::MayRun => {
                self.motors_off_since = None;
                false
            }
            MotorActivity::Unreported => {
                let have_ended = self.flying.iter().all(|process| !process.is_running());
                let is_over = have_ended || now.since(self.begun_at) >= LONGEST_LANDING;
                is_over && others(&self.kept, now).is_empty()
            }
        }
    }
}

/// Processes of vehicles and daemons on `instances` that were started before `whole_at`, without this one. Later ones belong to the next
/// run of their instance.
fn others(instances: &[WatchedInstance], whole_at: Time) -> Vec<ObeyingProcess> {
    let is_here = |process: &ObeyingProcess| {
        let is_of = |instance: &WatchedInstance| {
            process.is_of_instance(&instance.name) && process.is_under_hash(instance.root_hash)
        };
        process.pid != std::process::id()
            && process.started_at().is_some_and(|at| at < whole_at)
            && instances.iter().any(is_of)
    };
    ObeyingProcess::all().into_iter().filter(is_here).collect()
}
