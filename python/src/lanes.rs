//! Environments stepped together: a share of the lanes by the caller, the others by threads of their own.

mod share;

use std::sync::Mutex;

use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use oqtal_bus::time::Time;
use oqtal_config::ClockKind;
use oqtal_lab::environment::{ACTION, Environment, OBSERVATION, StepResult, Task};
use oqtal_runtime::process::Failure;
use pyo3::prelude::*;

use crate::error;
use crate::settings::Sources;
use crate::task;
use share::{LaneRequest, Outcome, Share, Worker, lock};

/// Length of the truth of a lane: position, velocity, attitude, body rate, time.
const TRUTH: usize = 14;

/// Environments of one configuration, stepped together on all processors.
#[pyclass(frozen, module = "oqtal._native")]
struct Lanes {
    shares: Mutex<Shares>,
    /// Number of lanes, and the process that made them.
    count: usize,
    process: u32,
}

/// All lanes.
struct Shares {
    /// Stepped by the caller: with as many threads as processors, none waits for a processor.
    own: Share,
    workers: Vec<Worker>,
    /// Seed of the next episode of a lane whose episode ends.
    next_seed: u64,
}

/// Results of all lanes.
struct Results {
    observations: Vec<f32>,
    steps: Vec<StepResult>,
}

/// Observations, rewards, whether episodes have terminated, and whether their time is over.
type ResultArrays<'py> = (
    Bound<'py, PyArray2<f32>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
);

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
            return Err(error::usage(format!(
                "duration is {duration_s} s, number of vehicles {count}; both must be above 0"
            )));
        }
        let shares = task::detached(py, || {
            let mut config = sources.config()?;
            config.clock.kind = ClockKind::InProcess;
            let processors = std::thread::available_parallelism().map_or(1, usize::from);
            let threads = if threads == 0 { processors } else { threads }.min(count);
            let end = |index: usize| seed + (index * count / threads) as u64;
            let share = |index| Share::new(&config, task, duration_s, end(index)..end(index + 1));
            let workers = (1..threads).map(|index| share(index).and_then(Worker::start));
            let (own, workers) = (share(0)?, workers.collect::<Result<_, _>>()?);
            Ok(Shares { own, workers, next_seed: seed + count as u64 })
        })?;
        Ok(Self { shares: Mutex::new(shares), count, process: std::process::id() })
    }

    /// Takes one action for each lane, four numbers from -1 to 1: body rates, and thrust. A lane whose episode has ended begins the next
    /// one instead if `is_endless`.
    fn act<'py>(
        &self,
        py: Python<'py>,
        actions: PyReadonlyArrayDyn<'py, f64>,
        is_endless: bool,
    ) -> PyResult<ResultArrays<'py>> {
        self.check_process()?;
        if actions.shape().last() != Some(&ACTION) || actions.len() != self.count * ACTION {
            return Err(self.misshaped(actions.shape()));
        }
        let numbers: Vec<f64> = actions.as_array().iter().copied().collect();
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(error::usage("actions are not finite; expected numbers from -1 to 1"));
        }
        let results = self.request(py, |shares| {
            let mut requests: Vec<_> = numbers.as_chunks().0.iter().map(stepped).collect();
            if is_endless {
                let mut next_seed = shares.next_seed;
                let mut requests = requests.iter_mut();
                shares.each_outcome(|Outcome { result, .. }| {
                    let request = requests.next();
                    if result.terminated || result.truncated {
                        request.into_iter().for_each(|it| *it = LaneRequest::Reset(next_seed));
                        next_seed += 1;
                    }
                })?;
                shares.next_seed = next_seed;
            }
            Ok(requests)
        })?;
        results.arrays(py)
    }

    /// Commands each lane, `(count, 4)`: sticks from -1 to 1 and thrust from 0 to 1; NaN switches the motors off.
    fn command(&self, py: Python<'_>, commands: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        self.check_process()?;
        if commands.shape() != [self.count, ACTION] {
            return Err(self.misshaped(commands.shape()));
        }
        let numbers: Vec<f64> = commands.as_array().iter().copied().collect();
        let commands = numbers.as_chunks().0.iter().copied();
        let requests = commands.map(LaneRequest::Step).collect();
        self.request(py, |_| Ok(requests)).map(drop)
    }

    /// Begins the episodes of `seeds`, one for each lane; `None` leaves a lane as it is. The seeds of later episodes count from
    /// `next_seed`, by default from the one after the greatest of `seeds`. Returns the observations, `(count, 25)`.
    #[pyo3(signature = (seeds, next_seed=None))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Vec<Option<u64>>,
        next_seed: Option<u64>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.check_process()?;
        if seeds.len() != self.count {
            return Err(error::usage(format!(
                "{} seeds for {} vehicles; give one for each vehicle, or one integer",
                seeds.len(),
                self.count
            )));
        }
        let results = self.request(py, |shares| {
            let after = seeds.iter().flatten().max().map(|it| it + 1);
            shares.next_seed = next_seed.or(after).unwrap_or(shares.next_seed);
            let requests = seeds.iter().map(|it| it.map_or(LaneRequest::None, LaneRequest::Reset));
            Ok(requests.collect())
        })?;
        Ok(results.arrays(py)?.0)
    }

    /// Seed of the next episode of a lane whose episode ends.
    fn next_seed(&self, py: Python<'_>) -> PyResult<u64> {
        self.check_process()?;
        task::detached(py, || Ok(lock(&self.shares)?.next_seed))
    }

    /// True position, velocity, attitude, body rate, and the time, `(count, 14)`.
    fn truths<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, |lane| {
            let truth = lane.truth();
            let t_s = truth.time.since(Time::VIRTUAL_START).seconds();
            let parts = truth.position.into_iter().chain(truth.velocity).chain(truth.attitude);
            let mut numbers = parts.chain(truth.rate).chain([t_s]);
            std::array::from_fn::<_, TRUTH, _>(|_| numbers.next().unwrap_or(f64::NAN))
        })
    }

    /// Newest poses as measured, `(count, 7)`.
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, |lane| lane.pose())
    }

    /// Position and velocity of the references, `(count, 6)`.
    fn references<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.rows(py, |lane| lane.reference())
    }
}

impl Lanes {
    /// The threads live in the process that made them.
    fn check_process(&self) -> PyResult<()> {
        if std::process::id() == self.process {
            return Ok(());
        }
        Err(error::usage("an environment cannot be used in a forked process; make a new one there"))
    }

    fn misshaped(&self, shape: &[usize]) -> PyErr {
        error::usage(format!(
            "actions have the shape {shape:?}; expected [{}, {ACTION}]",
            self.count
        ))
    }

    /// Carries out one request `of` each lane, and returns the results.
    fn request(
        &self,
        py: Python<'_>,
        of: impl FnOnce(&mut Shares) -> Result<Vec<LaneRequest>, Failure> + Send,
    ) -> PyResult<Results> {
        task::detached(py, || {
            let mut shares = lock(&self.shares)?;
            let requests = of(&mut shares)?;
            shares.carry_out(&requests)?;
            shares.results()
        })
    }

    /// Rows of an array, one for each lane.
    fn rows<'py, const N: usize>(
        &self,
        py: Python<'py>,
        row: impl Fn(&mut Environment) -> [f64; N] + Sync,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.check_process()?;
        let numbers = task::detached(py, || {
            let mut numbers = Vec::with_capacity(N * self.count);
            lock(&self.shares)?.each_lane(|lane| numbers.extend(row(lane)))?;
            Ok(numbers)
        })?;
        PyArray1::from_vec(py, numbers).reshape([self.count, N])
    }
}

impl Shares {
    /// Carries out one request for each lane, on all threads.
    fn carry_out(&mut self, requests: &[LaneRequest]) -> Result<(), Failure> {
        let (own, mut rest) = requests.split_at(self.own.lanes.len());
        for worker in &self.workers {
            let (of_worker, others) = rest.split_at(worker.share()?.lanes.len());
            worker.send(of_worker)?;
            rest = others;
        }
        let done = self.own.carry_out(own);
        // Every reply is taken even after a failure; otherwise the next request would read it.
        let replies: Vec<_> = self.workers.iter().map(Worker::reply).collect();
        replies.into_iter().chain([done]).collect()
    }

    fn results(&self) -> Result<Results, Failure> {
        let mut results = Results { observations: Vec::new(), steps: Vec::new() };
        self.each_outcome(|outcome| {
            results.observations.extend_from_slice(&outcome.observation);
            results.steps.push(outcome.result);
        })?;
        Ok(results)
    }

    fn each_outcome(&self, mut take: impl FnMut(&Outcome)) -> Result<(), Failure> {
        self.own.outcomes.iter().for_each(&mut take);
        self.workers.iter().try_for_each(|worker| {
            worker.share()?.outcomes.iter().for_each(&mut take);
            Ok(())
        })
    }

    fn each_lane(&mut self, mut take: impl FnMut(&mut Environment)) -> Result<(), Failure> {
        self.own.lanes.iter_mut().for_each(&mut take);
        self.workers.iter().try_for_each(|worker| {
            worker.share()?.lanes.iter_mut().for_each(&mut take);
            Ok(())
        })
    }
}

impl Results {
    fn arrays<'py>(self, py: Python<'py>) -> PyResult<ResultArrays<'py>> {
        let rows = [self.steps.len(), OBSERVATION];
        Ok((
            PyArray1::from_vec(py, self.observations).reshape(rows)?,
            PyArray1::from_iter(py, self.steps.iter().map(|step| step.reward)),
            PyArray1::from_iter(py, self.steps.iter().map(|step| step.terminated)),
            PyArray1::from_iter(py, self.steps.iter().map(|step| step.truncated)),
        ))
    }
}

/// Request of an action: its numbers are limited, and the thrust is from 0 to 1.
fn stepped(action: &[f64; ACTION]) -> LaneRequest {
    let [roll, pitch, yaw, thrust] = action.map(|number| number.clamp(-1.0, 1.0));
    LaneRequest::Step([roll, pitch, yaw, (thrust + 1.0) / 2.0])
}

/// Registers the class.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Lanes>()?;
    module.add("OBSERVATION", OBSERVATION)
}
