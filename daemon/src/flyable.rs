//! Demand of a trajectory on the vehicle, checked before the start: thrust, tilt, body rates, speed, and the way to stop inside the fence.

use oqtal_config::{Config, Interface};
use oqtal_control::options::OptionError;
use oqtal_control::predictive::{MotionDemand, VehicleModel};
use oqtal_control::trajectory::{FlightPlan, Phase, Reference, Trajectory, TrajectoryKind};

use crate::command_model::CommandModel;

/// Shortest time between two points that are looked at \[s\], and most points \[-\].
const STEP_S: f64 = 0.02;
const MOST_POINTS: f64 = 20_000.0;
/// Distance of the points that are looked at before and after a jump of the acceleration \[s\].
const BESIDE_JUMP_S: f64 = 1e-6;

/// Shares of the vehicle's thrust, of its body rates, and of the limits of speed and tilt that a trajectory may demand \[-\]; the rest is
/// for corrections.
const THRUST_SHARE: f64 = 0.9;
/// The share of the body rates \[-\].
pub(crate) const RATE_SHARE: f64 = 0.8;
const LIMIT_SHARE: f64 = 0.97;
const TILT_SHARE: f64 = 0.9;
/// Share of the speed limit that take-off and landing may use \[-\]: the limit also holds for the estimated speed, and the vehicle is
/// faster than its reference while it leaves the floor.
const FLOOR_SPEED_SHARE: f64 = 0.8;

/// Least value of `trajectory.descent-m-s` \[m/s\].
const LEAST_DESCENT_M_S: f64 = 0.05;

/// Greatest factor of time that is tried \[-\].
const SLOWEST: f64 = 1e3;
/// Most points at which factors of time are tried \[-\].
const MOST_TRIED: usize = 8000;
/// Number of raises by a hundredth after which a factor that does not suffice at all points is given up \[-\].
const MOST_RAISES: usize = 8;

/// The points of a path that are looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) enum SampledPoints {
    /// At most [`MOST_TRIED`], evenly spread: for a search, which looks at them many times.
    Few,
    /// Every one.
    All,
}

impl SampledPoints {
    /// Number of steps from one of `count` points to the next one that is looked at \[-\].
    pub(crate) fn step(self, count: usize) -> usize {
        match self {
            Self::Few => count.div_ceil(MOST_TRIED).max(1),
            Self::All => 1,
        }
    }
}

/// A limit with its key and value, and the demand on it.
struct Demand {
    key: &'static str,
    limit: f64,
    /// The value with which the trajectory could be flown: above the demand by the share that is kept.
    needed: f64,
    unit: &'static str,
}

impl Demand {
    fn excess(&self) -> f64 {
        self.needed / self.limit
    }

    /// The error for this demand, `t_s` \[s\] after the beginning of `phase`, which would be accepted `factor` times as slowly.
    fn refusal(self, phase: Phase, t_s: f64, factor: Option<f64>, config: &Config) -> OptionError {
        let Self { key, limit, needed, unit } = self;
        let options = &config.trajectory;
        let (part, remedy) = match (phase, factor) {
            (Phase::TakeOff, Some(factor)) => {
                let longer_s = (10.0 * factor * options.take_off_s).ceil() / 10.0;
                let descent = lower_descent(config).map(|descent| format!(" and {descent}"));
                let descent = descent.unwrap_or_default();
                ("take-off", format!("; trajectory.take-off-s = {longer_s:.1}{descent} would do"))
            }
            (Phase::TakeOff, None) => ("take-off", String::new()),
            (_, Some(factor)) => {
                ("trajectory", format!("; {} would do", slower(options.kind, factor)))
            }
            (_, None) => ("trajectory", String::new()),
        };
        let needed = (needed * 100.0).ceil() / 100.0;
        let allowed = format!("at least {needed:.2}{unit} for the {part} at {t_s:.2} s{remedy}");
        OptionError::new(key, limit, allowed)
    }
}

/// References of one phase of a flight, with their times from its beginning \[s\].
struct PhaseDemand<'a> {
    config: &'a Config,
    phase: Phase,
    model: VehicleModel,
    references: Vec<(f64, Reference)>,
}

impl<'a> PhaseDemand<'a> {
    /// The `phase` of the flight of `trajectory`.
    fn of(config: &'a Config, trajectory: &Trajectory, phase: Phase) -> Result<Self, OptionError> {
        let model = CommandModel::new(config)?.model;
        let plan = FlightPlan::from_origin(&config.trajectory, trajectory);
        let (from_s, duration_s) = match phase {
            Phase::TakeOff => (0.0, config.trajectory.take_off_s),
            _ => (config.trajectory.start_s(), trajectory.duration_s()),
        };
        let step_s = STEP_S.max(duration_s / MOST_POINTS);
        let even = (0..=(duration_s / step_s) as u32).map(|index| f64::from(index) * step_s);
        // Between waypoints a cubic demands the most at an end or in the middle, which even steps of a slower flight meet elsewhere.
        let corners = trajectory.corners_s().filter(|_| phase == Phase::Trajectory);
        let corners: Vec<_> = corners.collect();
        let middles = corners.windows(2).map(|ends| 0.5 * (ends[0] + ends[1]));
        let beside = corners.iter().flat_map(|t_s| [t_s - BESIDE_JUMP_S, t_s + BESIDE_JUMP_S]);
        let references =
            even.chain(beside).chain(middles).map(|t_s| (t_s, plan.sample(from_s + t_s)));
        let references = references.filter(|(_, reference)| reference.phase == phase).collect();
        Ok(Self { config, phase, model, references })
    }

    /// The greatest excess of the phase flown `slower` times as slowly \[-\], with its time \[s\]; `None` without one.
    fn worst(&self, slower: f64, points: SampledPoints) -> Option<(f64, Demand)> {
        let references = self.references.iter().step_by(points.step(self.references.len()));
        let demands = references.flat_map(|(t_s, reference)| {
            let demand = MotionDemand::of(reference, slower, &self.model);
            demands(self.config, (&demand, self.phase)).map(|demand| (*t_s, demand))
        });
        let excessive = demands.filter(|(_, demand)| demand.excess() > 1.0);
        excessive.max_by(|a, b| a.1.excess().total_cmp(&b.1.excess()))
    }

    /// Refuses the phase if it exceeds a limit. The factor of time in the error is the least one with which the flight also has room, or else
    /// the least one with which it exceeds no limit.
    fn check(&self, lacks_room: impl Fn(f64, SampledPoints) -> bool) -> Result<(), OptionError> {
        let Some((t_s, demand)) = self.worst(1.0, SampledPoints::All) else { return Ok(()) };
        let exceeds = |slower, points| self.worst(slower, points).is_some();
        let factor = least_sufficient(|slower, points| {
            exceeds(slower, points) || lacks_room(slower, points)
        });
        let factor = factor.or_else(|| least_sufficient(exceeds));
        Err(demand.refusal(self.phase, t_s, factor, self.config))
    }
}

/// Whether the vehicle can fly `trajectory`: with 0.9 of its thrust, 0.8 of its rates, and inside the limits of speed and tilt.
/// `lacks_room` returns whether it leaves the fence if it is flown this many times as slowly \[-\].
///
/// # Errors
/// The key of the limit, the first point at which the trajectory exceeds it most, and the factor of time with which it would not.
pub(crate) fn check_demand(
    config: &Config,
    trajectory: &Trajectory,
    lacks_room: impl Fn(f64, SampledPoints) -> bool,
) -> Result<(), OptionError> {
    PhaseDemand::of(config, trajectory, Phase::TakeOff)?.check(|_, _| false)?;
    check_descent(config)?;
    PhaseDemand::of(config, trajectory, Phase::Trajectory)?.check(lacks_room)
}

/// Whether the trajectory exceeds a limit of the vehicle or of the flight when it is flown this many times as slowly \[-\].
pub(crate) fn exceeding(
    config: &Config,
    trajectory: &Trajectory,
) -> impl Fn(f64, SampledPoints) -> bool {
    let demand = PhaseDemand::of(config, trajectory, Phase::Trajectory).ok();
    move |slower, points| {
        demand.as_ref().is_some_and(|demand| demand.worst(slower, points).is_some())
    }
}

/// Refuses a descent that is too fast for the speed limit.
fn check_descent(config: &Config) -> Result<(), OptionError> {
    let (limit, descent) = (config.safety.speed_limit_m_s, config.trajectory.descent_m_s);
    if descent <= FLOOR_SPEED_SHARE * limit {
        return Ok(());
    }
    let remedy = lower_descent(config).map(|it| format!("; {it} would do")).unwrap_or_default();
    let needed = (descent / FLOOR_SPEED_SHARE * 100.0).ceil() / 100.0;
    let allowed = format!("at least {needed:.2} m/s for the landing{remedy}");
    Err(OptionError::new("safety.speed-limit-m-s", limit, allowed))
}

/// Slower descent that the speed limit allows, as key and value; `None` if the configured one is allowed, or if none is.
fn lower_descent(config: &Config) -> Option<String> {
    let allowed_m_s = FLOOR_SPEED_SHARE * config.safety.speed_limit_m_s;
    let lower_m_s = (1e3 * allowed_m_s).floor() / 1e3;
    let is_needed = config.trajectory.descent_m_s > allowed_m_s;
    (is_needed && lower_m_s >= LEAST_DESCENT_M_S)
        .then(|| format!("trajectory.descent-m-s = {lower_m_s}"))
}

/// The demands on the limits of the vehicle and of the flight.
fn demands(config: &Config, (demand, phase): (&MotionDemand, Phase)) -> [Demand; 6] {
    let (vehicle, safety) = (&config.vehicle, &config.safety);
    let of = |key, limit, needed, unit| Demand { key, limit, needed, unit };
    let speed_share = if phase == Phase::TakeOff { FLOOR_SPEED_SHARE } else { LIMIT_SHARE };
    let tilt_deg = demand.tilt_rad.to_degrees() / TILT_SHARE;
    let [roll, pitch, yaw] = [0, 1, 2].map(|axis| {
        // Of a vehicle commanded by torque the rates have no limit of their own.
        let is_limited = vehicle.interface != Interface::Torque;
        let needed = if is_limited { demand.rate[axis].abs() / RATE_SHARE } else { 0.0 };
        let unit = [" rad/s in roll", " rad/s in pitch", " rad/s in yaw"][axis];
        of("vehicle.rate-authority-rad-s", vehicle.rate_authority_rad_s[axis], needed, unit)
    });
    [
        of("vehicle.max-thrust-n", vehicle.max_thrust_n, demand.thrust_n / THRUST_SHARE, " N"),
        of("safety.tilt-limit-deg", safety.tilt_limit_deg.min(60.0), tilt_deg, " deg"),
        of(
            "safety.speed-limit-m-s",
            safety.speed_limit_m_s,
            demand.speed_m_s / speed_share,
            " m/s",
        ),
        roll,
        pitch,
        yaw,
    ]
}

/// The least factor of time from which on nothing `exceeds` at few points, raised until nothing does at any point; `None` without one.
pub(crate) fn least_sufficient(exceeds: impl Fn(f64, SampledPoints) -> bool) -> Option<f64> {
    let least = least_factor(|slower| exceeds(slower, SampledPoints::Few))?;
    let raised = std::iter::successors(Some(least), |factor| Some((factor * 101.0).ceil() / 100.0));
    raised.take(1 + MOST_RAISES).find(|factor| !exceeds(*factor, SampledPoints::All))
}

/// The least factor of time from which on nothing `exceeds`, at most 2 % too great; `None` if there is none. A slower flight may exceed a
/// limit that a faster one does not, since a trajectory that leaves the vehicle weightless turns the thrust fast; far below the speed of an
/// excess this does not happen.
fn least_factor(exceeds: impl Fn(f64) -> bool) -> Option<f64> {
    if exceeds(SLOWEST) {
        return None;
    }
    let doublings = SLOWEST.log2() as i32;
    let last = (0..=doublings).rev().map(|power| 2f64.powi(power)).find(|slower| exceeds(*slower));
    let mut hundredths = (4.0 * last.unwrap_or(1.0)).min(SLOWEST) * 100.0;
    while hundredths > 100.0 {
        let next = (hundredths * 0.99).ceil().min(hundredths - 1.0);
        if exceeds(next / 100.0) {
            break;
        }
        hundredths = next;
    }
    // One more: a trajectory that is slower is looked at in other points.
    Some((hundredths + 1.0) / 100.0)
}

/// The change with which a trajectory is flown `factor` times as slowly \[-\]: the keys of its times, where it has such keys.
pub(crate) fn slower(kind: TrajectoryKind, factor: f64) -> String {
    let times = match kind {
        TrajectoryKind::Circle => "trajectory.circle.period-s and ramp-s",
        TrajectoryKind::Lemniscate => "trajectory.lemniscate.period-s and ramp-s",
        TrajectoryKind::Waypoints => "the times of all waypoints",
        _ => return format!("the trajectory flown {factor:.2} times as slowly"),
    };
    format!("{times} multiplied by {factor:.2}")
}

/// Time to settle in which the vehicle can turn to the heading of the first waypoint \[s\]; `None` if the configured one suffices.
pub(crate) fn least_settle_s(config: &Config, trajectory: &Trajectory) -> Option<f64> {
    let plan = FlightPlan::from_origin(&config.trajectory, trajectory);
    let limit_rad_s = RATE_SHARE * config.vehicle.rate_authority_rad_s[2];
    let least_s = plan.first_turn_s(limit_rad_s);
    (least_s > config.trajectory.settle_s).then_some((10.0 * least_s).ceil() / 10.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use oqtal_config::Setting;
    use oqtal_control::trajectory::Waypoints;

    #[test]
    fn waypoints_slower_by_the_factor_of_the_refusal_are_accepted() {
        let settings = [
            "trajectory.kind=waypoints",
            "vehicle.mass-kg=0.74",
            "vehicle.max-thrust-n=17.5",
            "vehicle.rate-authority-rad-s=[3.5, 3.5, 2.0]",
        ];
        let settings = settings.map(|text| Setting::parse("test", text).unwrap());
        let config = Config::from_settings(&settings).unwrap();
        let checked = |slower: f64| {
            let [second, third] = [1.0, 2.0].map(|t_s| t_s * slower);
            let table = format!("t,x,y,z\n0,0,0,1\n{second},3,0,1\n{third},0,0,1.5\n");
            let points = Waypoints::parse(&table).unwrap();
            check_demand(&config, &config.trajectory.trajectory(Some(points)).unwrap(), |_, _| {
                false
            })
        };
        let refusal = checked(1.0).unwrap_err().to_string();
        let factor = refusal.split("multiplied by ").nth(1).unwrap().split(' ').next().unwrap();
        assert!(checked(factor.parse().unwrap()).is_ok(), "{refusal}");
    }

    #[test]
    fn every_flight_slower_than_by_the_least_factor_is_accepted() {
        let gap = |slower: f64| slower < 1.075 || (1.085..1.115).contains(&slower);
        let far = |slower: f64| slower < 1.3 || (2.6..2.7).contains(&slower);
        for (exceeds, least) in [(&gap as &dyn Fn(f64) -> bool, 1.115), (&far, 2.7)] {
            let factor = least_factor(exceeds).unwrap();
            assert!((least..1.02 * least + 0.01).contains(&factor), "{factor}");
            assert!((0..1000).all(|step| !exceeds(factor + 0.01 * f64::from(step))), "{factor}");
        }
        assert_eq!(least_factor(|_| true), None);
    }
}
