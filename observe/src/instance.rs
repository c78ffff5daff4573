//! Model of a running instance: processes, vehicle, newest tick, latencies, counters and events. Shown by `oqtal ctl status`,
//! `oqtal monitor` and `oqtal view`.

use std::collections::VecDeque;

use oqtal_bus::message::{HealthV1, TelemetryV1, VehicleV1};
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{ObservedTopic, Role, Sample};

use crate::event::{self, DaemonCondition};
use crate::flight_sample::FlightSample;
use crate::loop_monitor::LoopMonitor;
use crate::observed_process::ObservedProcess;
use crate::sink::{Reception, Sink};
use crate::status::{InstanceStatus, ProcessHealth, VehicleStatus, reported_motors};

/// Maximum number of stored events \[-\]: more than the height of a terminal.
const MAX_EVENTS: usize = 200;

/// The newest sample of a topic.
#[derive(Clone, Copy, Debug)]
pub struct Newest<M> {
    /// Instant of reception.
    pub received_at: Time,
    /// The sample.
    pub body: M,
}

/// Model of one instance.
#[derive(Debug)]
pub struct InstanceModel {
    /// Latest instant of the observation.
    pub now: Time,
    /// Newest tick of the daemon.
    pub tick: Option<Newest<TelemetryV1>>,
    /// Newest message of the vehicle.
    pub vehicle: Option<Newest<VehicleV1>>,
    /// Latencies and counters since the last of: start of the observation, replacement of the daemon, [`Self::restart_figures`].
    pub figures: LoopMonitor,
    /// Greatest [`tracking_error_m`] since the same instant \[m\].
    pub max_error_m: f64,
    /// Law and trajectory that fly, as reported by the daemon; `None` before its first report.
    pub law_and_trajectory: Option<String>,
    /// Events with the time since the observation began, oldest first.
    pub events: VecDeque<(Span, String)>,
    began: Time,
    /// Age of a health message above which its process counts as silent.
    timeout: Span,
    processes: [Option<ObservedProcess>; Role::PROCESSES.len()],
    /// Writer of the newest tick.
    daemon: Option<u64>,
    condition: Option<DaemonCondition>,
}

impl InstanceModel {
    /// Empty model of an observation that begins at `now`; a process counts as silent `timeout` after its last health message.
    pub fn new(now: Time, timeout: Span) -> Self {
        Self {
            now,
            tick: None,
            vehicle: None,
            figures: LoopMonitor::default(),
            max_error_m: 0.0,
            law_and_trajectory: None,
            events: VecDeque::new(),
            began: now,
            timeout,
            processes: [None; _],
            daemon: None,
            condition: None,
        }
    }

    /// Stores law and trajectory, if the daemon reported them.
    pub fn note_law(&mut self, reported: Option<String>) {
        if reported.is_some() {
            self.law_and_trajectory = reported;
        }
    }

    /// Topics required for [`Self::status`].
    pub fn status_topics() -> Vec<ObservedTopic> {
        let topics = [ObservedTopic::Telemetry, ObservedTopic::Vehicle];
        topics.into_iter().chain(Role::PROCESSES.map(ObservedTopic::Health)).collect()
    }

    /// Topics required for the whole model.
    pub fn topics() -> Vec<ObservedTopic> {
        [
            Self::status_topics(),
            vec![ObservedTopic::Command, ObservedTopic::Input, ObservedTopic::Event],
        ]
        .concat()
    }

    /// Sets the instant of the following samples, and adds events for processes that have become silent.
    pub fn advance(&mut self, now: Time) {
        self.now = now;
        let (timeout, was_alive) = (self.timeout, self.is_alive());
        let known = self.processes.iter_mut().flatten();
        let silent = known.filter(|p| !p.is_silent && now.since(p.health.time) > timeout);
        let mut texts = Vec::new();
        for process in silent {
            process.is_silent = true;
            texts.push(format!("{} is silent", process.role.name()));
        }
        texts.into_iter().for_each(|text| self.add_event(text));
        if was_alive && !self.is_alive() {
            self.add_event("the instance has ended");
        }
    }

    /// Time since the observation began.
    pub fn age(&self) -> Span {
        self.now.since(self.began)
    }

    /// Time since the newest tick was received; `None` before the first.
    pub fn tick_age(&self) -> Option<Span> {
        self.tick.map(|tick| self.now.since(tick.received_at))
    }

    /// The processes that have published their health.
    pub fn processes(&self) -> impl Iterator<Item = &ObservedProcess> {
        self.processes.iter().flatten()
    }

    /// Whether a process publishes its health.
    pub fn is_alive(&self) -> bool {
        self.processes().any(|process| !process.is_silent)
    }

    /// Whether no daemon has published its health in an observation that is long enough to have received it.
    pub fn lacks_daemon(&self) -> bool {
        self.age() > self.timeout && !self.has(Role::Daemon)
    }

    /// Whether messages of all the processes `running`, and of their vehicle, have been received.
    pub fn is_complete(&self, running: &[Role]) -> bool {
        let has_vehicle = running.iter().any(|role| matches!(role, Role::Plant | Role::Bridge));
        (self.vehicle.is_some() || !has_vehicle) && running.iter().all(|role| self.has(*role))
    }

    /// Whether processes that are not silent run with different configurations.
    pub fn configs_differ(&self) -> bool {
        let running = self.processes().filter(|process| !process.is_silent);
        let mut hashes = running.filter_map(|process| process.health.compared_config());
        let first = hashes.next();
        hashes.any(|hash| Some(hash) != first)
    }

    /// Status at `now`.
    pub fn status(&self, now: Time) -> InstanceStatus {
        let processes = Role::PROCESSES
            .into_iter()
            .zip(&self.processes)
            .map(|(role, process)| ProcessHealth::new(role, process.as_ref(), now));
        let tick = self.tick.filter(|tick| tick.body.pose_age_s.is_finite());
        InstanceStatus {
            processes: processes.collect(),
            vehicle: self.vehicle.map(|vehicle| VehicleStatus::new(&vehicle.body)),
            position: tick.map(|tick| {
                let age_s = tick.body.pose_age_s + now.since(tick.received_at).seconds();
                (tick.body.position, age_s)
            }),
            ..InstanceStatus::default()
        }
    }

    /// Resets latencies and counters.
    pub fn restart_figures(&mut self) {
        self.figures.restart(Time::UNSET);
        self.max_error_m = 0.0;
    }

    fn has(&self, role: Role) -> bool {
        self.processes().any(|process| process.role == role)
    }

    /// Adds an event, unless it repeats the last one, such as a refusal of a request that is repeated until it is accepted.
    fn add_event(&mut self, text: impl Into<String>) {
        let text = text.into();
        if self.events.back().is_some_and(|(_, last)| *last == text) {
            return;
        }
        if self.events.len() == MAX_EVENTS {
            self.events.pop_front();
        }
        self.events.push_back((self.age(), text));
    }

    fn telemetry(&mut self, reception: &Reception, telemetry: &TelemetryV1) {
        let source = reception.header.source;
        if self.daemon.replace(source).is_some_and(|before| before != source) {
            self.restart_figures();
            self.condition = None;
            // The next session may need fewer processes.
            for process in &mut self.processes {
                process.take_if(|process| process.is_silent);
            }
        }
        self.tick = Some(Newest { received_at: reception.received_at, body: *telemetry });
        self.max_error_m = self.max_error_m.max(tracking_error_m(telemetry).unwrap_or(0.0));
        let condition = DaemonCondition::of(telemetry);
        if self.condition.replace(condition) != Some(condition) {
            self.add_event(condition.to_string());
        }
    }

    fn vehicle(&mut self, reception: &Reception, vehicle: &VehicleV1) {
        let newest = Newest { received_at: reception.received_at, body: *vehicle };
        let Some(Newest { body: before, .. }) = self.vehicle.replace(newest) else { return };
        let is_known = reported_motors(vehicle).is_some();
        let off = if is_known { "motors off" } else { "motors unknown" };
        let [was_linked, is_linked] = [&before, vehicle].map(|it| u8::from(it.answers()));
        let changes = [
            (before.armed, vehicle.armed, [off, "motors run"]),
            (was_linked, is_linked, ["vehicle silent", "vehicle answers"]),
            (before.stopped, vehicle.stopped, ["stop lifted", "vehicle stopped by an operator"]),
        ];
        for (_, now, texts) in changes.into_iter().filter(|(before, now, _)| before != now) {
            self.add_event(texts[usize::from(now == 1)]);
        }
    }

    /// Adds a health message; a message older than the time-out is ignored.
    fn health(&mut self, reception: &Reception, role: Role, health: &HealthV1) {
        let entry = Role::PROCESSES.iter().position(|other| *other == role);
        let is_old = reception.received_at.since(health.time) > self.timeout;
        let Some(entry) = entry.filter(|_| !is_old) else { return };
        let header = reception.header;
        let process = ObservedProcess { role, header, health: *health, is_silent: false };
        let before = self.processes[entry].replace(process);
        if before.is_none_or(|before| before.is_silent || before.pid() != process.pid()) {
            self.add_event(format!("{} came, pid {}", role.name(), process.pid()));
        }
    }
}

/// Distance of the estimated position from the reference, both at the capture of the newest pose \[m\]; `None` when not flying.
pub fn tracking_error_m(tick: &TelemetryV1) -> Option<f64> {
    let distance = FlightSample { telemetry: *tick, truth: None }.position_error().norm();
    (distance.is_finite() && tick.mission_s.is_finite()).then_some(distance)
}

impl Sink for InstanceModel {
    fn sample(&mut self, reception: &Reception, sample: Sample<'_>) {
        match sample {
            Sample::Telemetry(telemetry) => self.telemetry(reception, telemetry),
            Sample::Vehicle(vehicle) => self.vehicle(reception, vehicle),
            Sample::Input(input) => {
                event::of_input(input).into_iter().for_each(|text| self.add_event(text));
            }
            Sample::Event(event) => self.add_event(event::of_operator(event)),
            Sample::Health(role, health) => self.health(reception, role, health),
            _ => {}
        }
        self.figures.sample(reception, sample);
    }

    fn lost(&mut self, topic: ObservedTopic, count: u64) {
        self.figures.lost(topic, count);
        self.add_event(format!("{count} samples of `{topic}` were not observed"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_bus::code::Cause;

    /// Model at 1 s that received a health message of each of `roles`, with this age.
    fn model(roles: &[Role], age: Span) -> InstanceModel {
        let mut model = InstanceModel::new(Time::VIRTUAL_START, Span::from_millis(100));
        for role in roles {
            let time = Time::VIRTUAL_START - age;
            receive(&mut model, *role, HealthV1 { time, ..HealthV1::default() });
        }
        model
    }

    fn receive(model: &mut InstanceModel, role: Role, health: HealthV1) {
        let reception = Reception { received_at: Time::VIRTUAL_START, ..Reception::default() };
        model.sample(&reception, Sample::Health(role, &health));
    }

    #[test]
    fn messages_of_all_running_processes_are_awaited_and_old_ones_do_not_count() {
        let roles = [Role::Mocap, Role::Daemon, Role::Bridge];
        let mut fresh = model(&roles, Span::from_millis(20));
        assert!(!fresh.is_complete(&roles));
        fresh.sample(&Reception::default(), Sample::Vehicle(&VehicleV1::default()));
        assert!(fresh.is_complete(&roles));
        assert!(!fresh.is_complete(&Role::PROCESSES));
        let lines = fresh.status(Time::VIRTUAL_START).lines();
        assert_eq!(lines[0], "plant-sim  not started, or ended");
        assert!(lines[1].contains("20 ms ago"), "{lines:?}");
        let late = HealthV1 { time: Time::VIRTUAL_START, runs_late: 1, ..HealthV1::default() };
        receive(&mut fresh, Role::Mocap, late);
        assert!(fresh.status(Time::VIRTUAL_START).lines()[1].ends_with("runs late"));
        let lost = HealthV1 { cause: Cause::NoPose.code(), ..late };
        receive(&mut fresh, Role::Receiver, lost);
        let lines = fresh.status(Time::VIRTUAL_START).lines();
        assert!(lines[4].starts_with("receiver   cameras silent "), "{lines:?}");
        receive(&mut fresh, Role::Receiver, HealthV1 { cause: Cause::NoBody.code(), ..late });
        let lines = fresh.status(Time::VIRTUAL_START).lines();
        assert!(lines[4].starts_with("receiver   the server has no such body "), "{lines:?}");
        let stale = model(&roles, Span::from_millis(101));
        let mut status = stale.status(Time::VIRTUAL_START);
        assert_eq!(status.lines()[1], "mocap-emu  not started, or ended");
        status.processes[1].note_holder(Some("`oqtal mocap-emu` (7)".to_owned()));
        let hangs = "`oqtal mocap-emu` (7) runs, but hangs, or virtual time stands still";
        assert_eq!(status.lines()[1], format!("mocap-emu  silent: {hangs}"));
    }

    #[test]
    fn processes_with_different_configurations_are_reported() {
        let mut model = model(&[Role::Mocap, Role::Daemon], Span::ZERO);
        let runs_with = |config_hash| HealthV1 {
            time: Time::VIRTUAL_START,
            config_hash,
            ..HealthV1::default()
        };
        receive(&mut model, Role::Daemon, runs_with(5));
        receive(&mut model, Role::Mocap, runs_with(5));
        assert_eq!(model.status(Time::VIRTUAL_START).config_agrees(), Some(true));
        receive(&mut model, Role::Mocap, runs_with(HealthV1::OWN_CONFIG));
        assert_eq!(model.status(Time::VIRTUAL_START).config_agrees(), Some(true));
        receive(&mut model, Role::Mocap, runs_with(7));
        let status = model.status(Time::VIRTUAL_START);
        assert_eq!(status.config_agrees(), Some(false));
        let told = status.lines().pop().unwrap();
        assert!(told.contains("configurations differ") && !told.contains("--link"), "{told}");
        assert!(model.configs_differ());
        receive(&mut model, Role::Bridge, runs_with(5));
        let told = model.status(Time::VIRTUAL_START).lines().pop().unwrap();
        assert!(
            told.contains("with one --config, bridge and receiver with their --link"),
            "{told}"
        );
    }

    #[test]
    fn the_number_of_events_is_bounded() {
        let mut model = model(&[], Span::ZERO);
        for number in 0..MAX_EVENTS + 5 {
            model.now = Time::VIRTUAL_START + Span::from_millis(number as i64);
            model.add_event(format!("event {number}"));
        }
        assert_eq!(model.events.len(), MAX_EVENTS);
        let (at, text) = model.events.back().unwrap();
        assert_eq!((*at, &**text), (Span::from_millis(204), "event 204"));
    }
}
