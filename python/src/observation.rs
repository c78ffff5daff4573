//! Observation of a running instance: messages of a topic, or events, as rows.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use oqtal_bus::paths::InstancePaths;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Sample};
use oqtal_observe::csv::FieldCell;
use oqtal_observe::instance::InstanceModel;
use oqtal_observe::observer::BusObserver;
use oqtal_observe::recording::cell;
use oqtal_observe::sink::{Reception, Sink};
use oqtal_operator::request::running_bus;
use oqtal_runtime::health::SILENCE;
use oqtal_runtime::process::Failure;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error;
use crate::instance::{Watch, check_process, ended};
use crate::task;

/// Period at which an observation polls the bus.
const POLL_PERIOD: Duration = Duration::from_millis(2);
/// Maximum number of rows that wait to be taken; the oldest are lost \[-\].
const MAX_ROWS: usize = 8192;

/// Observes for `duration`, and not longer than the owner exists; `opened` receives whether the ports could be opened.
fn observe(
    (paths, duration): (&InstancePaths, Span),
    mut rows: Rows,
    shared: &Shared,
    opened: &Sender<Result<(), Failure>>,
) -> Result<(), Failure> {
    let open = || {
        paths.become_owner()?;
        let bus = running_bus(paths)?.for_observer();
        Ok((Watch::of(&bus)?, BusObserver::open(&bus, &rows.topics)?, bus))
    };
    let (mut watch, mut observer, _bus) = match open() {
        Ok(ports) => ports,
        Err(failure) => {
            let _ = opened.send(Err(failure));
            return Ok(());
        }
    };
    let _ = opened.send(Ok(()));
    let (begin, mut now) = (Time::now(), Time::now());
    while !shared.is_closed.load(Ordering::Relaxed) && now.since(begin) < duration {
        now = Time::now();
        watch.check(now)?;
        observer.poll(now, &mut rows)?;
        rows.take(now, &mut shared.lock());
        std::thread::sleep(POLL_PERIOD);
    }
    Ok(())
}

/// Rows that wait to be taken.
#[derive(Default)]
struct Waiting {
    rows: VecDeque<Vec<FieldCell>>,
    /// Rows that were not taken in time, and samples that the bus overwrote.
    lost: u64,
    /// The end of the observation, and its reason.
    end: Option<Result<(), Failure>>,
}

/// State shared with the thread of an observation.
#[derive(Default)]
struct Shared {
    waiting: Mutex<Waiting>,
    is_closed: AtomicBool,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Makes rows of samples.
struct Rows {
    names: Vec<String>,
    topics: Vec<ObservedTopic>,
    new: Vec<Vec<FieldCell>>,
    lost: u64,
    /// Model whose events are the rows; `None` if they are the messages of a topic.
    model: Option<Box<InstanceModel>>,
}

impl Rows {
    /// Rows of the messages of `topic`.
    fn of_topic(topic: ObservedTopic) -> Self {
        Self {
            names: cell::names(topic.fields()),
            topics: vec![topic],
            new: Vec::new(),
            lost: 0,
            model: None,
        }
    }

    /// Rows of events: time since the observation began, and text.
    fn of_events() -> Self {
        let names = vec!["t_s".to_owned(), "event".to_owned()];
        let model = Some(Box::new(InstanceModel::new(Time::now(), SILENCE)));
        Self { names, topics: InstanceModel::topics(), new: Vec::new(), lost: 0, model }
    }

    /// Moves the new rows to those that wait.
    fn take(&mut self, now: Time, waiting: &mut Waiting) {
        if let Some(model) = &mut self.model {
            model.advance(now);
            let row = |(t, text): (Span, String)| {
                vec![FieldCell::Number(t.seconds()), FieldCell::Text(text)]
            };
            self.new.extend(model.events.drain(..).map(row));
        }
        waiting.rows.extend(self.new.drain(..));
        let excess = waiting.rows.len().saturating_sub(MAX_ROWS);
        waiting.rows.drain(..excess);
        waiting.lost += std::mem::take(&mut self.lost) + excess as u64;
    }
}

impl Sink for Rows {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match &mut self.model {
            Some(model) => model.sample(reception, sample),
            None => self.new.push(cell::cells(reception, &sample).collect()),
        }
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        match &mut self.model {
            Some(model) => model.lost(topic, count),
            None => self.lost += count,
        }
    }
}

/// Messages of a topic, or events, since it was opened.
#[pyclass(frozen, module = "oqtal._native")]
pub struct Observation {
    shared: Arc<Shared>,
    names: Vec<String>,
}

impl Observation {
    /// Observes the topic `topic`, or `events`, of the instance at `paths` for `duration`.
    pub fn open(
        py: Python<'_>,
        paths: &InstancePaths,
        topic: &str,
        duration: Span,
    ) -> PyResult<Self> {
        let known = ObservedTopic::all().find(|observed| observed.name() == topic);
        let rows = match (known, topic) {
            (_, "events") => Rows::of_events(),
            (Some(topic), _) => Rows::of_topic(topic),
            (None, _) => {
                let names: Vec<_> = ObservedTopic::all().map(ObservedTopic::name).collect();
                let names = names.join(", ");
                let text = format!("`{topic}` is not a topic; expected events, {names}");
                return Err(error::usage(text));
            }
        };
        let shared = Arc::new(Shared::default());
        let (names, paths, of_thread) = (rows.names.clone(), paths.clone(), Arc::clone(&shared));
        task::interruptible(py, move |_| {
            let (opened, is_open) = channel();
            std::thread::spawn(move || {
                error::catch_panics_of_thread(true);
                let end = observe((&paths, duration), rows, &of_thread, &opened);
                of_thread.lock().end = Some(end);
            });
            is_open.recv().unwrap_or_else(|_| Err(ended()))
        })?;
        Ok(Self { shared, names })
    }
}

#[pymethods]
impl Observation {
    /// The next row as a dictionary; `None` if there is none within `timeout_s`, or the observation was closed.
    fn next<'py>(&self, py: Python<'py>, timeout_s: f64) -> PyResult<Option<Bound<'py, PyDict>>> {
        check_process()?;
        let give_up = Time::now() + Span::from_seconds(timeout_s.clamp(0.0, 1e9));
        loop {
            {
                let mut waiting = self.shared.lock();
                if let Some(row) = waiting.rows.pop_front() {
                    return self.dictionary(py, row).map(Some);
                }
                if let Some(Err(failure)) = &waiting.end {
                    return Err(error::raised(Failure::new(failure.exit, failure.message.clone())));
                }
                if waiting.end.is_some() || Time::now() >= give_up {
                    return Ok(None);
                }
            }
            py.check_signals()?;
            py.detach(|| std::thread::sleep(POLL_PERIOD));
        }
    }

    /// Number of rows lost so far \[-\].
    #[getter]
    fn lost(&self) -> u64 {
        self.shared.lock().lost
    }

    /// Names of the columns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.names.clone()
    }

    /// Leaves the instance.
    fn close(&self) {
        self.shared.is_closed.store(true, Ordering::Relaxed);
    }
}

impl Observation {
    fn dictionary<'py>(
        &self,
        py: Python<'py>,
        row: Vec<FieldCell>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let found = PyDict::new(py);
        for (name, cell) in self.names.iter().zip(row) {
            match cell {
                FieldCell::Count(count) => found.set_item(name, count)?,
                FieldCell::Signed(number) => found.set_item(name, number)?,
                FieldCell::Number(number) => found.set_item(name, number)?,
                FieldCell::Text(text) => found.set_item(name, text)?,
            }
        }
        Ok(found)
    }
}

impl Drop for Observation {
    fn drop(&mut self) {
        self.close();
    }
}

/// Registers the class.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Observation>()
}
