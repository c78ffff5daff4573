//! The course of a flight: its mission, and the reference that is flown in a tick.

use nalgebra::Vector3;
use oqtal_bus::code::SafetyState;
use oqtal_bus::time::{Span, Time};
use oqtal_config::Config;
use oqtal_control::estimator::Estimate;
use oqtal_control::euler::EulerAngles;
use oqtal_control::trajectory::{
    FlightPlan, Phase, Reference, StartPoint, Trajectory, TrajectoryOptions,
};

use crate::fence::Fence;
use crate::floor;
use crate::mission::ActiveMission;
use crate::setpoint::{CheckedSetpoint, SetpointGuard};

/// Speed below which a vehicle is at rest \[m/s\].
const REST_M_S: f64 = 0.1;
/// Time for which a vehicle that landed must be at rest.
const REST: Span = Span::from_millis(500);

/// Course of a flight.
#[derive(Clone, Debug)]
pub(super) struct FlightCourse {
    observe_only: bool,
    weight_n: f64,
    trajectory: Trajectory,
    options: TrajectoryOptions,
    check: SetpointGuard,
    mission: Option<ActiveMission>,
    /// The reference of this tick: it is flown, and the limits of the flight are relative to it.
    setpoint: CheckedSetpoint,
    /// The last position inside the soft border of the fence \[m, world\].
    inside: Option<Vector3<f64>>,
    /// The instant since which the vehicle, which lands, is at rest.
    at_rest_since: Option<Time>,
    /// Whether the vehicle descends without poses.
    is_descent: bool,
}

impl FlightCourse {
    /// The course of flights of `trajectory` inside `fence`.
    pub(super) fn new(config: &Config, trajectory: Trajectory, fence: Fence) -> Self {
        Self {
            observe_only: config.safety.observe_only,
            weight_n: config.vehicle.mass_kg * config.vehicle.gravity_m_s2,
            options: config.trajectory.clone(),
            check: SetpointGuard::new(fence),
            mission: None,
            setpoint: CheckedSetpoint::default(),
            inside: None,
            at_rest_since: None,
            is_descent: false,
            trajectory,
        }
    }

    /// The mission; `None` on the ground.
    pub(super) fn mission(&self) -> Option<&ActiveMission> {
        self.mission.as_ref()
    }

    /// The reference of this tick.
    pub(super) fn setpoint(&self) -> &CheckedSetpoint {
        &self.setpoint
    }

    /// The reference of the plan at `at`; `None` without one, and while the reference is refused.
    pub(super) fn reference_at(&self, at: Time) -> Option<Reference> {
        let mission = self.mission.as_ref().filter(|_| !self.setpoint.is_refused)?;
        Some(mission.reference(at))
    }

    /// Records a position inside the soft border of the fence \[m, world\].
    pub(super) fn record_inside(&mut self, position: Vector3<f64>) {
        self.inside = Some(position);
    }

    /// Begins a flight of a vehicle at `estimate`.
    pub(super) fn begin_flight(&mut self, now: Time, estimate: &Estimate) {
        let start = StartPoint {
            position: estimate.position,
            yaw_rad: EulerAngles::from_attitude(&estimate.attitude).yaw,
        };
        let plan = FlightPlan::new(&self.options, self.trajectory.clone(), start);
        self.check.reset();
        (self.inside, self.at_rest_since, self.is_descent) = (None, None, false);
        self.mission = Some(ActiveMission::fly(plan, estimate.position.z, now));
        self.update_setpoint(now);
    }

    /// Begins the observation of a vehicle at `position` \[m, world\].
    pub(super) fn begin_observation(&mut self, now: Time, position: Vector3<f64>) {
        self.mission = Some(ActiveMission::observe(position, now));
        self.update_setpoint(now);
    }

    /// Ends the flight.
    pub(super) fn end(&mut self) {
        self.mission = None;
        self.setpoint = CheckedSetpoint::default();
    }

    /// Checks the reference at `now`: once in a tick, and again where the plan has changed in it.
    pub(super) fn update_setpoint(&mut self, now: Time) {
        let Some(mission) = &self.mission else { return };
        let reference = mission.reference(now);
        self.setpoint = match self.observe_only {
            true => CheckedSetpoint { reference: Some(reference), is_refused: false },
            false => self.check.pass(mission.changes(), &reference),
        };
    }

    /// Holds the vehicle, which is at `position` \[m, world\], lands or waits for the end of a descent if the safety state demands it,
    /// and resumes the mission if it no longer does. `is_landing` if the vehicle lands already; returns whether it does now.
    pub(super) fn follow(
        &mut self,
        now: Time,
        state: SafetyState,
        position: Vector3<f64>,
        is_landing: bool,
    ) -> bool {
        let Some(mission) = self.mission.as_mut().filter(|_| !self.observe_only) else {
            return is_landing;
        };
        let changes = mission.changes();
        let mut lands = is_landing;
        match state {
            // Poses have come back.
            SafetyState::Land if self.is_descent => {
                mission.land_from(now, self.setpoint.at(position).into());
                self.is_descent = false;
            }
            SafetyState::Land if !is_landing => {
                self.land(now, position);
                lands = true;
            }
            SafetyState::Hold if !is_landing => {
                mission.hold(now, self.setpoint.at(self.inside.unwrap_or(position)));
            }
            SafetyState::Descend => {
                mission.hold(now, self.setpoint.at(position));
                (self.is_descent, lands) = (true, true);
            }
            // Blindness interrupts neither.
            SafetyState::Nominal | SafetyState::Degraded => mission.resume(now),
            _ => {}
        }
        if self.mission.as_ref().map(ActiveMission::changes) != Some(changes) {
            self.update_setpoint(now);
        }
        lands
    }

    /// Lands above `position` \[m, world\], from the height and at the heading of the reference that was flown last.
    pub(super) fn land(&mut self, now: Time, position: Vector3<f64>) {
        let height = self.setpoint.reference.map_or(position.z, |last| last.position.z);
        if let Some(mission) = &mut self.mission {
            let point = self.setpoint.at(position.xy().push(height));
            mission.land_from(now, point.into());
        }
    }

    /// Keeps the mission at its beginning.
    pub(super) fn restart(&mut self, now: Time) {
        if let Some(mission) = &mut self.mission {
            mission.restart(now);
        }
        self.update_setpoint(now);
    }

    /// Whether the reference is in its landing.
    pub(super) fn is_landing(&self) -> bool {
        self.setpoint.reference.is_some_and(|reference| reference.phase == Phase::Landing)
    }

    /// Whether a vehicle at `estimate` under the thrust `thrust_n` \[N\] has landed: at the floor from which it took off, or at rest for a
    /// while, wherever it is, under a thrust that cannot hold it in the air.
    pub(super) fn has_landed(&mut self, now: Time, estimate: &Estimate, thrust_n: f64) -> bool {
        let (Some(mission), Some(reference)) = (&self.mission, &self.setpoint.reference) else {
            return false;
        };
        mission.has_landed(reference, estimate)
            || self.is_at_rest_on_ground(now, estimate, thrust_n)
    }

    fn is_at_rest_on_ground(&mut self, now: Time, estimate: &Estimate, thrust_n: f64) -> bool {
        let is_at_rest = self.is_landing()
            && thrust_n < floor::STANDING * self.weight_n
            && estimate.velocity.norm() < REST_M_S;
        if !is_at_rest {
            self.at_rest_since = None;
            return false;
        }
        now.since(*self.at_rest_since.get_or_insert(now)) >= REST
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn f41_a_vehicle_has_landed_once_it_rests_for_half_a_second_without_a_break() {
        let config = Config::default();
        let trajectory = crate::trajectory(&config).unwrap();
        let mut course = FlightCourse::new(&config, trajectory, Fence::new(&config.fence));
        let start = Time::VIRTUAL_START;
        let (raised, rising) = (Vector3::z(), Vector3::z() * 0.2);
        let at_rest = Estimate { position: raised, ..Estimate::default() };
        let moving = Estimate { velocity: rising, ..at_rest };
        course.begin_flight(start, &Estimate::default());
        course.land(start, raised);
        course.update_setpoint(start + Span::from_millis(100));
        let weight_n = config.vehicle.mass_kg * config.vehicle.gravity_m_s2;
        let mut has_landed = |millis, estimate, share: f64| {
            course.has_landed(start + Span::from_millis(millis), estimate, share * weight_n)
        };
        assert!(!has_landed(0, &at_rest, 0.4) && !has_landed(490, &at_rest, 0.4));
        assert!(!has_landed(495, &moving, 0.4), "moved");
        assert!(!has_landed(500, &at_rest, 0.4) && !has_landed(990, &at_rest, 0.4));
        assert!(!has_landed(995, &at_rest, 0.6), "held by its thrust");
        assert!(!has_landed(1000, &at_rest, 0.4) && !has_landed(1490, &at_rest, 0.4));
        assert!(has_landed(1500, &at_rest, 0.4));
    }
}
