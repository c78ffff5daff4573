//! A share of the environments: the lanes that one thread steps.

use std::sync::mpsc::{Receiver, RecvError, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard};

use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_lab::environment::{ACTION, Environment, OBSERVATION, StepResult, Task};
use oqtal_runtime::process::{Exit, Failure};

use crate::error;

/// Time for which a thread polls before it sleeps: waking it takes as long as some twenty lanes.
const POLL: Span = Span::from_nanos(200_000);

/// Request to a lane.
#[derive(Clone, Copy, Debug)]
pub enum LaneRequest {
    /// Fly for one tick with a command: sticks and thrust.
    Step([f64; ACTION]),
    /// Begin the episode of a seed.
    Reset(u64),
    /// Stay.
    None,
}

/// Observation and result of a lane after a request.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Observation, of 32 bits as the environments give it.
    pub observation: [f32; OBSERVATION],
    /// Reward and end of the episode.
    pub result: StepResult,
}

/// Lanes that one thread steps.
pub struct Share {
    /// The lanes.
    pub lanes: Vec<Environment>,
    /// Outcomes of their last requests.
    pub outcomes: Vec<Outcome>,
}

// SAFETY: a lane is not `Send` because its ports hold `Rc`s of its bus. `Environment::new` makes the bus and all its ports, and hands
// out none of them; no two lanes have a bus in common, and nothing of a lane belongs to a thread. So a share moves with everything that
// refers into it, and one thread at a time uses it: it is borrowed mutably, or locked.
unsafe impl Send for Share {}

impl Share {
    /// Lanes in the episodes of `seeds`.
    pub fn new(
        config: &Config,
        task: Task,
        duration_s: f64,
        seeds: impl Iterator<Item = u64>,
    ) -> Result<Self, Failure> {
        let lane = |seed| {
            let mut config = config.clone();
            config.clock.seed = seed;
            Environment::new(config, task, duration_s)
        };
        let lanes = seeds.map(lane).collect::<Result<Vec<_>, Failure>>()?;
        let outcomes = lanes.iter().map(|lane| outcome(lane, StepResult::default())).collect();
        Ok(Self { lanes, outcomes })
    }

    /// Carries out one request for each lane.
    pub fn carry_out(&mut self, requests: &[LaneRequest]) -> Result<(), Failure> {
        for ((lane, request), slot) in self.lanes.iter_mut().zip(requests).zip(&mut self.outcomes) {
            let result = match *request {
                LaneRequest::Step(command) => lane.step(command)?,
                LaneRequest::Reset(seed) => lane.reset(seed).map(|()| StepResult::default())?,
                LaneRequest::None => continue,
            };
            *slot = outcome(lane, result);
        }
        Ok(())
    }
}

fn outcome(lane: &Environment, result: StepResult) -> Outcome {
    Outcome { observation: lane.observation().map(|number| number as f32), result }
}

/// A thread that steps a share, which its owner may use between requests.
pub struct Worker {
    share: Arc<Mutex<Share>>,
    requests: Sender<Vec<LaneRequest>>,
    replies: Receiver<Result<(), Failure>>,
}

impl Worker {
    /// Starts a thread, which ends with its owner.
    pub fn start(share: Share) -> Result<Self, Failure> {
        let (requests, incoming) = channel::<Vec<_>>();
        let (outgoing, replies) = channel();
        let share = Arc::new(Mutex::new(share));
        let stepped = Arc::clone(&share);
        let work = move || {
            error::catch_panics_of_thread(true);
            while let Ok(requests) = receive(&incoming) {
                let done = lock(&stepped).and_then(|mut share| share.carry_out(&requests));
                if outgoing.send(done).is_err() {
                    break;
                }
            }
        };
        std::thread::Builder::new().spawn(work).map_err(|error| {
            let reason =
                format!("no further thread for the environments: {error}; give fewer `threads`");
            Failure::new(Exit::System, reason)
        })?;
        Ok(Self { share, requests, replies })
    }

    /// The share, once the thread has replied.
    pub fn share(&self) -> Result<MutexGuard<'_, Share>, Failure> {
        lock(&self.share)
    }

    /// Asks the thread to carry out one request for each of its lanes.
    pub fn send(&self, requests: &[LaneRequest]) -> Result<(), Failure> {
        self.requests.send(requests.to_vec()).map_err(|_| ended())
    }

    /// Waits for the thread.
    pub fn reply(&self) -> Result<(), Failure> {
        receive(&self.replies).map_err(|_| ended())?
    }
}

/// Locks `mutex`; fails if a holder panicked, since its lanes may be half stepped.
pub fn lock<T>(mutex: &Mutex<T>) -> Result<MutexGuard<'_, T>, Failure> {
    mutex.lock().map_err(|_| ended())
}

/// Failure of lanes after a panic.
fn ended() -> Failure {
    let reason = format!("environments that failed must be made again: {}", error::last_panic());
    Failure::new(Exit::Internal, reason)
}

/// The next message; an error if the other end is gone.
fn receive<T>(messages: &Receiver<T>) -> Result<T, RecvError> {
    let sleep_at = Time::now() + POLL;
    while Time::now() < sleep_at {
        match messages.try_recv() {
            Ok(message) => return Ok(message),
            // Another thread may need this processor.
            Err(TryRecvError::Empty) => std::thread::yield_now(),
            Err(TryRecvError::Disconnected) => return Err(RecvError),
        }
    }
    messages.recv()
}
