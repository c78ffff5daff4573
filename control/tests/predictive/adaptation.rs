//! The model adapted in flight.

use nalgebra::{Vector2, Vector4};
use oqtal_control::predictive::{
    Adaptation, AdaptationOptions, AdaptiveEstimator, ClimbInterval, CommandHistory, FilterOptions,
    MeasuredPose, ModelInput, Motion, RateResponse, ResponseBounds, RotationEstimator,
    ThrustEstimator, TurnInterval,
};
use oqtal_control::quaternion::Attitude;

use super::noise::Noise;
use super::*;

const ONE: Vector3<f64> = Vector3::new(1.0, 1.0, 1.0);

const BOUNDS: ResponseBounds = ResponseBounds {
    nominal: RateResponse { gain: ONE, lag_s: LAG_S, delay_s: 0.0 },
    deviation: RateResponse { gain: Vector3::new(0.4, 0.4, 0.4), lag_s: 0.06, delay_s: 0.04 },
};

/// A vehicle of some response, its commands, and the noise of the cameras.
struct Vehicle {
    response: RateResponse,
    drift: Vector3<f64>,
    rate: Vector3<f64>,
    attitude: Attitude,
    history: CommandHistory,
    noise: Noise,
    tick: u64,
}

impl Vehicle {
    fn new(response: RateResponse, seed: u64) -> Self {
        Self {
            response,
            drift: Vector3::new(0.03, -0.02, 0.01),
            rate: Vector3::zeros(),
            attitude: Attitude::LEVEL,
            history: CommandHistory::new(DELAY_S),
            noise: Noise(seed),
            tick: 0,
        }
    }

    fn now_s(&self) -> f64 {
        self.tick as f64 * PERIOD_S
    }

    /// Sends random rates of this size \[rad/s\], moves on by a period and returns the pose measured then, at the origin.
    fn turn(&mut self, size: f64) -> MeasuredPose {
        let (from_s, leaning) = (self.now_s(), Attitude::LEVEL.rotation_to(&self.attitude));
        let demand = self.noise.vector() * size - leaning * 3.0;
        let input = ModelInput { demand, ..ModelInput::default() };
        self.history.push(self.tick, from_s, input);
        self.tick += 1;
        let RateResponse { gain, lag_s, delay_s } = self.response;
        let steps = 200;
        let h = PERIOD_S / f64::from(steps);
        for step in 0..steps {
            let t_s = from_s + f64::from(step) * h;
            let aim =
                self.history.reported(t_s, delay_s).0.demand.component_mul(&gain) + self.drift;
            let next = aim + (self.rate - aim) * (-h / lag_s).exp();
            self.attitude = self.attitude.turned_by((self.rate + next) * (0.5 * h));
            self.rate = next;
        }
        let sd = FilterOptions::default().attitude_noise_deg.to_radians();
        let attitude = self.attitude.turned_by(self.noise.vector() * sd);
        MeasuredPose { position: Vector3::zeros(), attitude }
    }
}

/// An estimator after `ticks` of a vehicle that turns by random commands.
fn estimated(bounds: ResponseBounds, vehicle: &mut Vehicle, ticks: u32) -> RotationEstimator {
    let mut estimator = RotationEstimator::new(bounds, &FilterOptions::default(), vehicle.attitude);
    for _ in 0..ticks {
        let from_s = vehicle.now_s();
        let measured = vehicle.turn(0.5);
        let interval = (from_s, vehicle.now_s());
        estimator.take(
            &TurnInterval { attitude: measured.attitude, history: &vehicle.history, interval },
            1.0,
        );
    }
    estimator
}

#[test]
fn gain_lag_and_hidden_delay_are_found() {
    let hidden = RateResponse { gain: Vector3::new(0.72, 1.25, 1.0), lag_s: 0.075, delay_s: 0.012 };
    let found = estimated(BOUNDS, &mut Vehicle::new(hidden, 5), 1200).response();
    assert!((found.gain - hidden.gain).xy().amax() < 0.02, "{found:?}");
    assert!((found.lag_s - hidden.lag_s).abs() < 4e-3, "{found:?}");
    assert!((found.delay_s - hidden.delay_s).abs() < 3e-3, "{found:?}");
}

/// A short lag that is not yet known looks like a command that acts too early.
#[test]
fn no_command_acts_before_it_is_sent() {
    let hidden = RateResponse { gain: ONE, lag_s: 0.02, delay_s: -DELAY_S };
    let mut least_s = f64::INFINITY;
    for seed in 0..20 {
        for ticks in 1..60 {
            let found = estimated(BOUNDS, &mut Vehicle::new(hidden, seed), ticks).response();
            least_s = least_s.min(found.delay_s);
        }
    }
    assert!((least_s + DELAY_S).abs() < 1e-12, "{least_s} s");
}

/// The squares of the errors over the variances that the estimator states are 1 in the mean, over many vehicles.
#[test]
fn the_errors_are_as_large_as_the_estimator_states() {
    let mut squares = Vector4::zeros();
    let deviation = RateResponse { gain: ONE * 0.2, lag_s: 0.03, delay_s: 0.02 };
    let bounds = ResponseBounds { deviation, ..BOUNDS };
    let vehicles = 240;
    for seed in 0..vehicles {
        // As the estimator supposes: the bounds are two standard deviations away, and half of the gains' variance is common.
        let mut draw = Noise(1000 + seed);
        let own = draw.vector();
        let [common, lag, delay] = [1.0, 0.015, 0.01].map(|sd| sd * draw.normal().clamp(-2.0, 2.0));
        let gain = ONE + own.add_scalar(common) * (0.1 * 0.5_f64.sqrt());
        let hidden = RateResponse { gain, lag_s: LAG_S + lag, delay_s: delay };
        let estimator = estimated(bounds, &mut Vehicle::new(hidden, seed), 480);
        let (found, sd) = (estimator.response(), estimator.deviations());
        squares += Vector4::new(
            (found.gain.x - hidden.gain.x) / sd.gain.x,
            (found.gain.y - hidden.gain.y) / sd.gain.y,
            (found.lag_s - hidden.lag_s) / sd.lag_s,
            (found.delay_s - hidden.delay_s) / sd.delay_s,
        )
        .map(|error| error * error);
    }
    // The mean of 240 squares has a standard deviation of 0.09.
    let mean = squares / vehicles as f64;
    assert!(mean.iter().all(|mean| (0.4..1.7).contains(mean)), "{mean}");
}

/// An estimator after `ticks` of a vehicle whose thrust follows random commands with the lag `lag_s` \[s\] and the gain `gain`, in a
/// wind that comes and goes.
fn climbed([gain, lag_s]: [f64; 2], seed: u64, ticks: u32) -> ThrustEstimator {
    let (options, model) = (FilterOptions::default(), quadrotor());
    let mut noise = Noise(seed);
    let mut history = CommandHistory::new(DELAY_S);
    let (mut z, mut v, mut wind) = (1.0, 0.0, 0.0);
    let mut f = model.gravity_m_s2;
    let mut estimator =
        ThrustEstimator::new(&model, Vector2::new(0.4, 0.12), &options, Vector3::new(z, v, f));
    for tick in 0..ticks {
        let from_s = f64::from(tick) * PERIOD_S;
        let climb = model.gravity_m_s2 / gain - 4.0 * (z - 1.0) - 3.0 * v + 0.6 * noise.normal();
        let input = ModelInput { thrust_n: model.mass_kg * climb, ..ModelInput::default() };
        history.push(u64::from(tick), from_s, input);
        wind += options.acceleration_walk_m_s2 * PERIOD_S.sqrt() * noise.normal() - wind * PERIOD_S;
        let h = PERIOD_S / 200.0;
        for step in 0..200 {
            let aim = gain * history.reported(from_s + f64::from(step) * h, 0.0).0.thrust_n;
            f = aim / model.mass_kg + (f - aim / model.mass_kg) * (-h / lag_s).exp();
            v += (f + wind - model.gravity_m_s2 - model.drag_per_s * v) * h;
            z += v * h;
        }
        let height_m = z + noise.normal() * options.position_noise_mm * 1e-3;
        let interval = (from_s, from_s + PERIOD_S);
        estimator.take(&ClimbInterval { height_m, cosine: 1.0, history: &history, interval }, 1.0);
    }
    estimator
}

#[test]
fn the_lag_of_the_thrust_is_found_in_wind_as_well_as_the_estimator_states() {
    let (mut square, seeds) = (0.0, 120);
    for seed in 0..seeds {
        let lag_s = [0.02, 0.06, 0.1, 0.15][seed as usize % 4];
        let found = climbed([[0.8, 1.2][seed as usize % 2], lag_s], seed, 900);
        let off_s = found.lag_s() - lag_s;
        assert!(off_s.abs() < 0.1 * lag_s + 15e-3, "{lag_s} s: {} s", found.lag_s());
        square += (off_s / found.deviations().y).powi(2) / seeds as f64;
    }
    assert!((0.3..2.0).contains(&square), "{square}");
}

#[test]
fn without_motion_nothing_is_learnt() {
    let hidden = RateResponse { gain: ONE * 0.7, lag_s: 0.09, delay_s: 0.02 };
    let mut vehicle = Vehicle::new(hidden, 5);
    vehicle.attitude = Attitude::LEVEL;
    let mut estimator = RotationEstimator::new(BOUNDS, &FilterOptions::default(), vehicle.attitude);
    for tick in 0..600 {
        let t_s = f64::from(tick) * PERIOD_S;
        let interval = (t_s, t_s + PERIOD_S);
        estimator.take(
            &TurnInterval { attitude: Attitude::LEVEL, history: &vehicle.history, interval },
            1.0,
        );
    }
    assert_eq!(estimator.response(), BOUNDS.nominal);
}

fn adaptation() -> Adaptation {
    Adaptation::new(&AdaptationOptions::default(), &FilterOptions::default(), &quadrotor())
}

/// Flies `vehicle` for some ticks under `adaptation`; returns for how many the adapted model was not flown.
fn fly(adaptation: &mut Adaptation, vehicle: &mut Vehicle, ticks: u32) -> u32 {
    let hovering = Motion { thrust_n: 0.5 * 9.81, ..Motion::default() };
    let mut fell_back = 0;
    for _ in 0..ticks {
        let measured = vehicle.turn(0.6);
        adaptation.take(vehicle.now_s(), (&measured, &hovering, 0.0), &vehicle.history);
        fell_back += u32::from(adaptation.model().fell_back);
    }
    fell_back
}

#[test]
fn a_response_that_jumps_is_flown_by_the_fixed_model_until_it_is_learnt_again() {
    let hidden = RateResponse { gain: ONE * 0.65, lag_s: 0.1, delay_s: 0.03 };
    let mut vehicle = Vehicle::new(hidden, 9);
    let mut adaptation = adaptation();
    assert_eq!(fly(&mut adaptation, &mut vehicle, 1200), 0);
    assert!((adaptation.model().rate_gain - hidden.gain).xy().amax() < 0.04);
    // The vehicle is as configured from now on: what was learnt is wrong, and the configured model is flown.
    vehicle.response = BOUNDS.nominal;
    let fell_back = fly(&mut adaptation, &mut vehicle, 300);
    // For two seconds at least.
    assert!(fell_back >= 120, "{fell_back}");
    let model = adaptation.model();
    assert!((model.rate_gain - ONE).xy().amax() < 0.05, "{model:?}");
    // The adapted model is flown again once it has been as good for a while, and learns again.
    fly(&mut adaptation, &mut vehicle, 300);
    assert!(!adaptation.model().fell_back);
    vehicle.response = hidden;
    fly(&mut adaptation, &mut vehicle, 1200);
    let model = adaptation.model();
    assert!(!model.fell_back && (model.rate_gain - hidden.gain).xy().amax() < 0.04, "{model:?}");
}

#[test]
fn the_thrust_follows_the_acceleration_that_it_lacks_within_bounds() {
    let mut adaptation = adaptation();
    let mut vehicle = Vehicle::new(BOUNDS.nominal, 3);
    let hovering = Motion { thrust_n: 0.5 * 9.81 / 0.8, ..Motion::default() };
    for _ in 0..3600 {
        let measured = vehicle.turn(0.1);
        // The filter finds what the model does not explain: here of a thrust of four fifths.
        let lift = hovering.thrust_n / 0.5;
        let missing = (0.8 - adaptation.model().thrust_gain) * lift;
        adaptation.take(vehicle.now_s(), (&measured, &hovering, missing), &vehicle.history);
    }
    assert!((adaptation.model().thrust_gain - 0.8).abs() < 1e-3);
    for _ in 0..1200 {
        let measured = vehicle.turn(0.1);
        adaptation.take(vehicle.now_s(), (&measured, &hovering, -8.0), &vehicle.history);
    }
    assert_eq!(adaptation.model().thrust_gain, 0.6);
}

#[test]
fn the_adaptation_is_reset_on_the_floor() {
    let hidden = RateResponse { gain: ONE * 0.7, lag_s: 0.09, delay_s: 0.02 };
    let mut adaptation = adaptation();
    let configured = adaptation.model();
    let mut vehicle = Vehicle::new(hidden, 7);
    let weak = Motion { thrust_n: 0.5 * 9.81, ..Motion::default() };
    for _ in 0..600 {
        let measured = vehicle.turn(0.6);
        adaptation.take(vehicle.now_s(), (&measured, &weak, -1.0), &vehicle.history);
    }
    let learnt = adaptation.model();
    assert!(learnt.rate_gain.x < 0.8 && learnt.thrust_gain < 0.9, "{learnt:?}");
    adaptation.reset();
    assert_eq!(adaptation.model(), configured);
}

#[test]
fn the_floor_teaches_nothing_and_a_push_teaches_little() {
    let mut adaptation = adaptation();
    let configured = adaptation.model();
    let held = RateResponse { gain: Vector3::zeros(), ..BOUNDS.nominal };
    let mut vehicle = Vehicle::new(held, 4);
    let at = |height_m| Motion {
        position: Vector3::z() * height_m,
        thrust_n: 0.5 * 9.81,
        ..Motion::default()
    };
    for _ in 0..120 {
        let measured = vehicle.turn(0.6);
        adaptation.take(vehicle.now_s(), (&measured, &at(0.05), 2.0), &vehicle.history);
    }
    assert_eq!(adaptation.model(), configured);
    vehicle.response = BOUNDS.nominal;
    for tick in 0..1260 {
        // For a second, late in the flight, a force of three tenths of the weight.
        let push = if tick >= 1200 { 3.0 } else { 0.0 };
        let measured = vehicle.turn(0.6);
        adaptation.take(vehicle.now_s(), (&measured, &at(1.0), push), &vehicle.history);
    }
    let thrust_gain = adaptation.model().thrust_gain;
    assert!((1.02..1.05).contains(&thrust_gain), "{thrust_gain}");
}
