//! Health of a process: a record shared by its threads, and the heartbeat on its health topic. The loop itself sends the
//! heartbeat, so that a hung loop sends none.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use oqtal_bus::bus::Bus;
use oqtal_bus::error::BusError;
use oqtal_bus::message::{HealthV1, Stamps};
use oqtal_bus::port::Writer;
use oqtal_bus::suspend::{ClockReadings, SuspendWatch};
use oqtal_bus::time::Span;
use oqtal_bus::topic::Role;
use oqtal_bus::transport::{Publish, Transport};

use crate::overrun::OverrunMonitor;

/// Health record of a process, shared by its threads. Counting is wait-free.
#[derive(Clone, Debug, Default)]
pub struct Health(Arc<HealthRecord>);

#[derive(Debug, Default)]
struct HealthRecord {
    turns: AtomicU64,
    inputs: AtomicU64,
    outputs: AtomicU64,
    polls: AtomicU64,
    late_turns: AtomicU64,
    runs_late: AtomicBool,
    motors: AtomicU8,
    status: Mutex<String>,
    /// Records of parts of the process that have a background thread of their own.
    parts: Mutex<Vec<Health>>,
}

/// State of the motors that a process controls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum MotorActivity {
    /// The process controls no motors, or does not know their state.
    #[default]
    Unreported = 0,
    /// The motors run, or may run.
    MayRun = 1,
    /// The motors are off.
    Off = 2,
}

/// The health record at one instant.
#[derive(Clone, Debug, Default)]
pub(crate) struct HealthSample {
    /// Turns of the loop so far \[-\].
    pub turns: u64,
    /// Number of inputs received so far \[-\].
    pub inputs: u64,
    /// Outputs published so far \[-\].
    pub outputs: u64,
    /// Polls so far by the background thread, 0 without one, followed by those of the parts' threads \[-\].
    pub polls: Vec<u64>,
    /// State of the motors after the last turn.
    pub motors: MotorActivity,
    /// The status text; empty if the process sets none.
    pub status: String,
}

impl Health {
    /// Counts a turn of the loop.
    pub fn count_turn(&self) {
        self.0.turns.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts an input that the process waits for.
    pub fn count_input(&self) {
        self.0.inputs.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts an output of the process's main function.
    pub fn count_output(&self) {
        self.0.outputs.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a poll of the background thread.
    pub(crate) fn count_poll(&self) {
        self.0.polls.fetch_add(1, Ordering::Relaxed);
    }

    /// Records the state of the motors after a turn.
    pub(crate) fn set_motors(&self, motors: MotorActivity) {
        self.0.motors.store(motors as u8, Ordering::Relaxed);
    }

    /// State of the motors after the last turn.
    pub(crate) fn motors(&self) -> MotorActivity {
        match self.0.motors.load(Ordering::Relaxed) {
            0 => MotorActivity::Unreported,
            1 => MotorActivity::MayRun,
            _ => MotorActivity::Off,
        }
    }

    /// Records the overruns of the loop.
    pub(crate) fn set_overruns(&self, overruns: &OverrunMonitor) {
        self.0.late_turns.store(overruns.late_turns(), Ordering::Relaxed);
        self.0.runs_late.store(overruns.runs_late(), Ordering::Relaxed);
    }

    /// Sets the status text. Takes a lock; not for a real-time loop.
    pub fn set_status(&self, status: impl Into<String>) {
        *self.0.status.lock().unwrap_or_else(PoisonError::into_inner) = status.into();
    }

    /// New record of a part of the process. Takes a lock; not for a real-time loop.
    pub(crate) fn of_part(&self) -> Self {
        let part = Self::default();
        self.0.parts.lock().unwrap_or_else(PoisonError::into_inner).push(part.clone());
        part
    }

    pub(crate) fn sample(&self) -> HealthSample {
        let parts = self.0.parts.lock().unwrap_or_else(PoisonError::into_inner);
        let records = std::iter::once(self).chain(parts.iter());
        HealthSample {
            turns: self.0.turns.load(Ordering::Relaxed),
            inputs: self.0.inputs.load(Ordering::Relaxed),
            outputs: self.0.outputs.load(Ordering::Relaxed),
            polls: records.map(|it| it.0.polls.load(Ordering::Relaxed)).collect(),
            motors: self.motors(),
            status: self.0.status.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }
}

/// Time between two heartbeats without a change.
pub const HEALTH_PERIOD: Span = Span::from_millis(500);

/// Time without a health message after which a process counts as silent: three periods.
pub const SILENCE: Span = Span::from_millis(1500);

/// Publishes the state of a process on its health topic.
#[derive(Debug)]
pub struct Heartbeat {
    writer: Writer<HealthV1>,
    config_hash: u64,
    health: Health,
    suspend: SuspendWatch,
    last: HealthV1,
}

impl Heartbeat {
    /// Heartbeat of `role` with this configuration hash and the overruns recorded in `health`.
    ///
    /// # Errors
    /// The process is already running, or the bus refuses.
    pub fn new(bus: &Bus, role: Role, config_hash: u64, health: Health) -> Result<Self, BusError> {
        let writer = bus.writer(&role.health())?;
        let suspend = SuspendWatch::new(&ClockReadings::now());
        Ok(Self { writer, config_hash, health, suspend, last: HealthV1::default() })
    }

    /// Publishes `health` once per [`HEALTH_PERIOD`] and on every change; adds time, configuration hash and overruns. Reads the
    /// machine's clock also in virtual time, since observers of health wait in real time. Logs a suspension of the machine.
    ///
    /// # Errors
    /// The bus failed.
    pub fn beat(&mut self, health: HealthV1) -> Result<(), BusError> {
        if let Some(length) = self.beat_unlogged(health)? {
            tracing::warn!(
                "the machine was suspended for {:.1} s: poses and commands from before are old",
                length.seconds()
            );
        }
        Ok(())
    }

    /// Like [`Heartbeat::beat`], without the log; returns the length of a suspension of the machine.
    ///
    /// # Errors
    /// The bus failed.
    pub fn beat_unlogged(&mut self, health: HealthV1) -> Result<Option<Span>, BusError> {
        let readings = ClockReadings::now();
        let suspended = self.suspend.observe(&readings);
        let record = &self.health.0;
        let health = HealthV1 {
            time: readings.boot,
            config_hash: self.config_hash,
            late_turns: record.late_turns.load(Ordering::Relaxed),
            runs_late: u8::from(record.runs_late.load(Ordering::Relaxed)),
            ..health
        };
        // Another late turn is not a change that requires a message.
        let HealthV1 { time, late_turns, .. } = self.last;
        let changed = self.last != HealthV1 { time, late_turns, ..health };
        if changed || health.time.since(time) >= HEALTH_PERIOD {
            self.last = health;
            self.writer.send(0, Stamps::default(), self.last)?;
        }
        Ok(suspended)
    }
}
