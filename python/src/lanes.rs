//! Environments stepped together: each lane by one of a few threads, which it never leaves.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvError, Sender, TryRecvError, channel};

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use oqtal_bus::time::{Span, Time};
use oqtal_config::{ClockKind, Config};
use oqtal_lab::environment::{ACTION, Environment, OBSERVATION, StepResult, Task};
use oqtal_runtime::process::{Exit, Failure};
use pyo3::prelude::*;

use crate::error;
use crate::settings::Sources;
use crate::task;

/// Length of the truth of a lane: position, velocity, attitude, body rate, time.
const TRUTH: usize = 14;
/// Length of a reference: position, velocity.
const REFERENCE: usize = 6;
/// Length of a pose.
const POSE: usize = 7;

/// Time for which a thread polls for its next request before it sleeps: waking it takes as long as some twenty lanes.
const POLL: Span = Span::from_nanos(200_000);

/// State of one lane after a step.
#[derive(Clone, Copy, Debug, Default)]
struct LaneState {
    observation: Observation,
    truth: [f64; TRUTH],
    pose: [f64; POSE],
    reference: [f64; REFERENCE],
    result: StepResult,
}

/// Newtype for the length, which has no default; of 32 bits, as the environments give it.
#[derive(Clone, Copy, Debug)]
struct Observation([f32; OBSERVATION]);

impl Default for Observation {
    fn default() -> Self {
        Self([0.0; OBSERVATION])
    }
}

/// Request to a lane.
#[derive(Clone, Copy, Debug)]
enum LaneRequest {
    /// Fly for one tick with an action.
    Step([f64; ACTION]),
    /// Begin the episode of a seed.
    Reset(u64),
    /// Stay.
    None,
}

/// Requests to the lanes of a thread, in their order.
type Request = Vec<LaneRequest>;

/// Answer of a thread.
type Reply = Result<Vec<LaneState>, Failure>;

/// A thread with its lanes.
struct Worker {
    lanes: Range<usize>,
    requests: Mutex<Sender<Request>>,
    replies: Mutex<Receiver<Reply>>,
}

impl Worker {
    /// Starts a thread for `lanes` of `config`, lane `i` with the seed `first + i`.
    fn start(
        config: &Config,
        task: Task,
        duration_s: f64,
        (lanes, first): (Range<usize>, u64),
    ) -> Self {
        let (requests, incoming) = channel();
        let (outgoing, replies) = channel();
        let (config, seeds) = (config.clone(), lanes.clone());
        std::thread::spawn(move || {
            error::catch_panics_of_thread(true);
            let lane = |index: usize| {
                let mut config = config.clone();
                config.clock.seed = first + index as u64;
                Environment::new(config, task, duration_s)
            };
            let mut lanes = match seeds.map(lane).collect::<Result<Vec<_>, Failure>>() {
                Ok(lanes) => lanes,
                Err(failure) => return drop(outgoing.send(Err(failure))),
            };
            // The first reply: the lanes at the start of their episodes.
            let mut reply =
                Ok(lanes.iter_mut().map(|lane| state(lane, StepResult::default())).collect());
            // The thread ends with its owner.
            while outgoing.send(reply).is_ok()
                && let Ok(request) = next(&incoming)
            {
                reply = answer(&mut lanes, request);
            }
        });
        Self { lanes, requests: Mutex::new(requests), replies: Mutex::new(replies) }
    }

    fn send(&self, request: Request) -> Result<(), Failure> {
        let sent = self.requests.lock().map_err(|_| ended()).map(|requests| requests.send(request));
        sent?.map_err(|_| ended())
    }

    fn reply(&self) -> Reply {
        let reply = self.replies.lock().map_err(|_| ended()).map(|replies| replies.recv());
        reply?.map_err(|_| ended())?
    }
}

/// Failure of a thread that has ended.
fn ended() -> Failure {
    Failure::new(Exit::Internal, "a thread of the environments has ended; make them again")
}

fn answer(lanes: &mut [Environment], request: Request) -> Reply {
    let answered = |(lane, request): (&mut Environment, LaneRequest)| {
        let result = match request {
            LaneRequest::Step(action) => lane.step(action)?,
            LaneRequest::Reset(seed) => lane.reset(seed).map(|()| StepResult::default())?,
            LaneRequest::None => StepResult::default(),
        };
        Ok(state(lane, result))
    };
    lanes.iter_mut().zip(request).map(answered).collect()
}

/// The next request; an error if the owner was dropped.
fn next(requests: &Receiver<Request>) -> Result<Request, RecvError> {
    let sleep_at = Time::now() + POLL;
    while Time::now() < sleep_at {
        match requests.try_recv() {
            Ok(request) => return Ok(request),
            // The caller may need this processor.
            Err(TryRecvError::Empty) => std::thread::yield_now(),
            Err(TryRecvError::Disconnected) => return Err(RecvError),
        }
    }
    requests.recv()
}

fn state(lane: &mut Environment, result: StepResult) -> LaneState {
    let truth = lane.truth();
    let t_s = truth.time.since(Time::VIRTUAL_START).seconds();
    let numbers =
        truth.position.into_iter().chain(truth.velocity).chain(truth.attitude).chain(truth.rate);
    let mut numbers = numbers.chain([t_s]);
    LaneState {
        observation: Observation(lane.observation().map(|number| number as f32)),
        truth: std::array::from_fn(|_| numbers.next().unwrap_or(f64::NAN)),
        pose: lane.pose(),
        reference: lane.reference(),
        result,
    }
}

/// Environments of one configuration, stepped together on all processors.
#[pyclass(frozen, module = "oqtal._native")]
struct Lanes {
    workers: Vec<Worker>,
    /// States of the lanes of each worker.
    states: Mutex<Vec<Vec<LaneState>>>,
    process: u32,
}

#[pymethods]
impl Lanes {
    /// `count` lanes of a task; lane `i` begins with the episode of the seed `seed + i`.
    #[new]
    fn new(
        py: Python<'_>,
        sources: Sources,
        task: &str,
        count: usize,
        seed: u64,
        limits: (f64, usize),
    ) -> PyResult<Self> {
        let (duration_s, threads) = limits;
        let known = Task::parse(task);
        let task = known.ok_or_else(|| {
            error::usage(format!("`{task}` is not a task; expected hover, track, recover or floor"))
        })?;
        if count == 0 || duration_s.is_nan() || duration_s <= 0.0 {
            return Err(error::usage(
                "the number of lanes and the duration of an episode are above 0",
            ));
        }
        task::detached(py, || {
            let mut config = sources.config()?;
            config.clock.kind = ClockKind::InProcess;
            let processors = std::thread::available_parallelism().map_or(1, usize::from);
            let threads = if threads == 0 { processors } else { threads }.min(count);
            let share = |index: usize| index * count / threads;
            let workers: Vec<Worker> = (0..threads)
                .map(|index| {
                    let lanes = (share(index)..share(index + 1), seed);
                    Worker::start(&config, task, duration_s, lanes)
                })
                .collect();
            let lanes = Self { workers, states: Mutex::default(), process: std::process::id() };
            lanes.gather()?;
            Ok(lanes)
        })
    }

    /// Commands one action for each lane, `(count, 4)`: sticks from -1 to 1 and thrust from 0 to 1; NaN switches the motors off. A
    /// lane with a seed begins the episode of this seed instead.
    fn step(
        &self,
        py: Python<'_>,
        actions: PyReadonlyArray2<'_, f64>,
        seeds: HashMap<usize, u64>,
    ) -> PyResult<()> {
        let count = self.count()?;
        if actions.shape() != [count, ACTION] {
            let found = actions.shape();
            return Err(error::usage(format!(
                "actions have the shape {found:?}; expected [{count}, {ACTION}]"
            )));
        }
        let actions = actions.as_array();
        self.request(py, |lane| match seeds.get(&lane) {
            Some(seed) => LaneRequest::Reset(*seed),
            None => LaneRequest::Step(std::array::from_fn(|index| actions[[lane, index]])),
        })
    }

    /// Begins the episodes of `seeds`, one for each lane; `None` leaves a lane as it is.
    fn reset(&self, py: Python<'_>, seeds: Vec<Option<u64>>) -> PyResult<()> {
        let count = self.count()?;
        if seeds.len() != count {
            return Err(error::usage(format!("{} seeds for {count} lanes", seeds.len())));
        }
        self.request(py, |lane| seeds[lane].map_or(LaneRequest::None, LaneRequest::Reset))
    }

    /// Observations, `(count, 25)`.
    fn observations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.rows(py, |state| state.observation.0)
    }

    /// True position, velocity, attitude, body rate, and the time, `(count, 14)`.
    fn truths<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, |state| state.truth)
    }

    /// Newest poses as measured, `(count, 7)`.
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, |state| state.pose)
    }

    /// Position and velocity of the references, `(count, 6)`.
    fn references<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, |state| state.reference)
    }

    /// Rewards of the last step, whether episodes have terminated, and whether their time is over.
    #[allow(clippy::type_complexity)]
    fn results<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>, Bound<'py, PyArray1<bool>>)>
    {
        let states = self.states.lock().map_err(|_| error::raised(ended()))?;
        let results = || states.iter().flatten().map(|state| state.result);
        Ok((
            PyArray1::from_iter(py, results().map(|result| result.reward)),
            PyArray1::from_iter(py, results().map(|result| result.terminated)),
            PyArray1::from_iter(py, results().map(|result| result.truncated)),
        ))
    }
}

impl Lanes {
    /// Number of lanes, in the process that made them.
    fn count(&self) -> PyResult<usize> {
        if std::process::id() != self.process {
            return Err(error::usage(
                "environments do not survive a fork: make them in the new process",
            ));
        }
        Ok(self.workers.last().map_or(0, |worker| worker.lanes.end))
    }

    /// Sends each thread the requests `of` its lanes, and gathers the replies.
    fn request(&self, py: Python<'_>, of: impl Fn(usize) -> LaneRequest) -> PyResult<()> {
        let requests: Vec<Request> =
            self.workers.iter().map(|worker| worker.lanes.clone().map(&of).collect()).collect();
        let send = || {
            let mut pairs = self.workers.iter().zip(requests);
            pairs.try_for_each(|(worker, request)| worker.send(request))?;
            self.gather()
        };
        py.detach(send).map_err(error::raised)
    }

    /// Waits for a reply of every thread.
    fn gather(&self) -> Result<(), Failure> {
        // Every reply is taken, lest that of a request be read as that of the next one.
        let replies: Vec<Reply> = self.workers.iter().map(Worker::reply).collect();
        *self.states.lock().map_err(|_| ended())? =
            replies.into_iter().collect::<Result<_, _>>()?;
        Ok(())
    }

    /// Rows of an array, one for each lane.
    fn rows<'py, T: numpy::Element + Copy, const N: usize>(
        &self,
        py: Python<'py>,
        row: impl Fn(&LaneState) -> [T; N],
    ) -> PyResult<Bound<'py, PyArray2<T>>> {
        let states = self.states.lock().map_err(|_| error::raised(ended()))?;
        let mut numbers = Vec::with_capacity(N * self.count()?);
        states.iter().flatten().for_each(|state| numbers.extend(row(state)));
        let rows = numbers.len() / N;
        PyArray1::from_vec(py, numbers).reshape([rows, N])
    }
}

/// Registers the class.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Lanes>()?;
    module.add("OBSERVATION", OBSERVATION)
}
