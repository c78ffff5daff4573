//! In-process flight that passes each turn of the daemon to a callback.

use oqtal_bus::code::{Mode, OperatorCommand};
use oqtal_bus::memory::{MemoryBus, MemoryReader};
use oqtal_bus::message::TelemetryV1;
use oqtal_bus::time::{Span, Time};
use oqtal_bus::topic::{Role, TELEMETRY};
use oqtal_bus::transport::{Subscribe, Transport};
use oqtal_config::{Config, Setting};
use oqtal_daemon::{
    CacheWarmup, Cycle, DaemonPorts, DaemonTurn, LawPort, OperatorRequests, loop_handoff,
    trajectory,
};
use oqtal_mocap_emu::{Cameras, EmulatedCameras};
use oqtal_plant_sim::{Plant, PlantTurn, Stepping};
use oqtal_runtime::pose_source::PoseTurn;
use oqtal_runtime::turn::step;
use oqtal_runtime::virtual_clock::{TurnResult, VirtualClock};

/// Longer than take-off, square and landing together.
const LENGTH_S: f64 = 40.0;

/// Flies the square under `law` and passes each turn of the daemon, including its telemetry, to `count`; returns the number of
/// armed ticks.
pub fn fly(law: &str, resolve: &str, mut count: impl FnMut(&mut dyn FnMut())) -> u64 {
    let mut settings = vec![Setting::flag("test", "control.controller", law)];
    // The other laws lack this key.
    if ["lqr", "oqtal"].contains(&law) {
        settings.push(Setting::flag("test", &format!("control.{law}.resolve"), resolve));
    }
    let start = Time::VIRTUAL_START;
    let mut flight = Flight::new(&Config::from_settings(&settings).unwrap(), start);
    let mut virtual_clock = VirtualClock::new(start, &Role::ALL[..3]);
    while let Some((role, now)) = virtual_clock.turn() {
        if now > start + Span::from_seconds(LENGTH_S) {
            break;
        }
        let result = match role {
            Role::Plant => step(&mut flight.plant, now).unwrap(),
            Role::Mocap => step(&mut flight.cameras, now).unwrap(),
            Role::Daemon => flight.daemon_turn(now, &mut count),
            Role::Recorder | Role::Bridge | Role::Receiver => TurnResult::default(),
        };
        virtual_clock.done(role, result);
    }
    flight.armed_ticks
}

struct Flight {
    plant: PlantTurn<MemoryBus>,
    cameras: PoseTurn<MemoryBus, EmulatedCameras<MemoryBus>>,
    daemon: DaemonTurn<'static, MemoryBus>,
    /// Kept open: a closed hand-off does not accept a status.
    _requests: OperatorRequests,
    telemetry: MemoryReader<TelemetryV1>,
    armed_ticks: u64,
}

impl Flight {
    fn new(config: &Config, start: Time) -> Self {
        let bus = MemoryBus::new();
        let mut cycle = Cycle::new(config, trajectory(config).unwrap(), start).unwrap();
        cycle.request(start, OperatorCommand::Fly);
        let cameras = Cameras::new(&config.mocap, config.clock.seed);
        let cameras = EmulatedCameras::open(&bus, cameras).unwrap();
        let (handle, requests) = loop_handoff();
        let ports = DaemonPorts::open(&bus).unwrap();
        let plant = Plant::new(config, start);
        Self {
            plant: PlantTurn::open(&bus, plant, Stepping::Exact, config).unwrap(),
            cameras: PoseTurn::open(&bus, cameras).unwrap(),
            daemon: DaemonTurn {
                ports,
                cycle,
                warmup: CacheWarmup::never(),
                handle,
                law: LawPort::default(),
            },
            _requests: requests,
            telemetry: bus.reader(&TELEMETRY).unwrap(),
            armed_ticks: 0,
        }
    }

    fn daemon_turn(&mut self, now: Time, count: &mut impl FnMut(&mut dyn FnMut())) -> TurnResult {
        let mut result = None;
        count(&mut || result = Some(step(&mut self.daemon, now).unwrap()));
        let telemetry = self.telemetry.latest().unwrap();
        let is_armed = telemetry.is_some_and(|(_, tick)| tick.mode != Mode::Disarmed.code());
        self.armed_ticks += u64::from(is_armed);
        result.expect("the turn was executed")
    }
}
