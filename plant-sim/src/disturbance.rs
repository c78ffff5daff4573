//! Disturbances in time, `plant.disturb`: loads on the vehicle at an instant of the flight.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use oqtal_bus::error::BusError;
use oqtal_bus::time::Time;
use oqtal_bus::transport::Transport;
use oqtal_config::{Config, DisturbanceKind, PlantOptions, TimedDisturbance};
use oqtal_runtime::faults::{ArmingWatch, RadioDisturbance, RadioFaults, interval, is_within};

/// Disturbance of vehicle and radio at an instant, by the faults and disturbances of a configuration.
#[derive(Clone, Copy, Debug, Default)]
pub struct SceneDisturbance {
    /// The radio.
    pub radio: RadioDisturbance,
    /// Instant of the first command that arms, from which the times of `plant.disturb` count; `None` before it.
    pub armed_at: Option<Time>,
}

/// Source of the disturbances of vehicle and radio.
#[derive(Debug)]
pub struct DisturbanceClock<T: Transport> {
    radio: RadioFaults<T>,
    arming: ArmingWatch<T>,
}

impl<T: Transport> DisturbanceClock<T> {
    /// The source for `config`.
    ///
    /// # Errors
    /// The transport failed.
    pub fn open(bus: &T, config: &Config) -> Result<Self, BusError> {
        let radio = RadioFaults::open(bus, config)?;
        Ok(Self { radio, arming: ArmingWatch::open(bus, !config.plant.disturb.is_empty())? })
    }

    /// The disturbance at `now`.
    ///
    /// # Errors
    /// The transport failed.
    pub fn at(&mut self, now: Time) -> Result<SceneDisturbance, BusError> {
        Ok(SceneDisturbance { radio: self.radio.at(now)?, armed_at: self.arming.armed_at()? })
    }
}

/// Sum of the disturbances at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AppliedLoad {
    /// Force \[N, world\].
    pub force: Vector3<f64>,
    /// Torque \[N m, body\].
    pub torque: Vector3<f64>,
    /// Velocity of the air \[m/s, world\].
    pub wind: Vector3<f64>,
    /// Addition to the mass \[kg\].
    pub mass_kg: f64,
}

/// The disturbances of one flight.
#[derive(Clone, Debug)]
pub struct LoadSchedule {
    loads: Vec<TimedDisturbance>,
    /// Instant of the first command that arms, from which the times count.
    armed_at: Option<Time>,
}

impl LoadSchedule {
    /// The disturbances of `plant`.
    pub fn new(plant: &PlantOptions) -> Self {
        Self { loads: plant.disturb.clone(), armed_at: None }
    }

    /// Sets the instant from which the times count to `armed_at`, unless it is set; `None` changes nothing.
    pub fn begin(&mut self, armed_at: Option<Time>) {
        self.armed_at = self.armed_at.or(armed_at);
    }

    /// The load at `now`; `None` without disturbances.
    pub fn at(&self, now: Time) -> Option<AppliedLoad> {
        let armed_at = self.armed_at.filter(|_| !self.loads.is_empty())?;
        let mut sum = AppliedLoad::default();
        for load in &self.loads {
            let (from, until) = interval(load.at_s, load.duration_s, armed_at);
            if !is_within((from, until), now) {
                continue;
            }
            match load.kind {
                DisturbanceKind::Force(force) => sum.force += Vector3::from(force),
                DisturbanceKind::Torque(torque) => sum.torque += Vector3::from(torque),
                DisturbanceKind::Gust(wind) => {
                    let share = until.map_or(1.0, |until| part(from, now, until));
                    sum.wind += Vector3::from(wind) * (0.5 - 0.5 * (TAU * share).cos());
                }
                DisturbanceKind::Mass(mass_kg) => sum.mass_kg += mass_kg,
            }
        }
        Some(sum)
    }

    /// The first instant after `now` at which a disturbance begins or ends.
    pub fn next_change(&self, now: Time) -> Option<Time> {
        let armed_at = self.armed_at?;
        let instants = self.loads.iter().flat_map(|load| {
            let (from, until) = interval(load.at_s, load.duration_s, armed_at);
            [Some(from), until]
        });
        instants.flatten().filter(|instant| *instant > now).min()
    }
}

/// Elapsed fraction of the time from `from` to `until` at `now` \[0..1\].
fn part(from: Time, now: Time, until: Time) -> f64 {
    now.since(from).seconds() / until.since(from).seconds()
}

#[cfg(test)]
mod tests {
    use oqtal_bus::time::Span;

    use super::*;

    fn schedule(disturb: &[&str]) -> LoadSchedule {
        let mut plant = Config::default().plant;
        plant.disturb = disturb.iter().map(|text| text.parse().unwrap()).collect();
        let mut schedule = LoadSchedule::new(&plant);
        assert_eq!(schedule.at(Time::VIRTUAL_START), None, "not armed");
        schedule.begin(None);
        schedule.begin(Some(Time::VIRTUAL_START));
        schedule.begin(Some(Time::VIRTUAL_START + Span::from_millis(7)));
        schedule
    }

    fn after(millis: i64) -> Time {
        Time::VIRTUAL_START + Span::from_millis(millis)
    }

    #[test]
    fn disturbances_add_up_within_their_times() {
        let schedule = schedule(&["force@1+2=1,0,0", "force@2=0,2,0", "mass@1=-0.1"]);
        let force = |millis| schedule.at(after(millis)).unwrap().force;
        assert_eq!(force(999), Vector3::zeros());
        assert_eq!(force(1000), Vector3::x());
        assert_eq!(force(2500), Vector3::new(1.0, 2.0, 0.0));
        assert_eq!(force(3000), Vector3::y() * 2.0);
        assert_eq!(schedule.at(after(9000)).unwrap().mass_kg, -0.1);
        let changes = [(0, 1000), (1000, 2000), (2000, 3000)];
        for (now, next) in changes {
            assert_eq!(schedule.next_change(after(now)), Some(after(next)));
        }
        assert_eq!(schedule.next_change(after(3000)), None);
    }

    #[test]
    fn a_gust_swells_and_dies_down() {
        let schedule = schedule(&["gust@1+2=0,0,4"]);
        let wind = |millis| schedule.at(after(millis)).unwrap().wind.z;
        assert_eq!((wind(1000), wind(3000)), (0.0, 0.0));
        assert!((wind(2000) - 4.0).abs() < 1e-12 && (wind(1500) - 2.0).abs() < 1e-12);
    }
}
