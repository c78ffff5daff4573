//! The model adapted in flight.

use oqtal_control::predictive::{
    Adaptation, AdaptationOptions, CommandHistory, FilterOptions, ModelInput, Motion, RateResponse,
    ResponseBounds, RotationEstimator,
};
use oqtal_control::quaternion::Attitude;

use super::noise::Noise;
use super::*;

const BOUNDS: ResponseBounds = ResponseBounds {
    nominal: RateResponse { gain: Vector3::new(1.0, 1.0, 1.0), lag_s: LAG_S, delay_s: 0.0 },
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

    /// Sends random rates of this size \[rad/s\], moves on by a period and returns the attitude measured then.
    fn turn(&mut self, size: f64) -> Attitude {
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
            let aim = self.history.reported(t_s, delay_s).0.demand * gain + self.drift;
            let next = aim + (self.rate - aim) * (-h / lag_s).exp();
            self.attitude = self.attitude.turned_by((self.rate + next) * (0.5 * h));
            self.rate = next;
        }
        let sd = FilterOptions::default().attitude_noise_deg.to_radians();
        self.attitude.turned_by(self.noise.vector() * sd)
    }
}

/// An estimator after `ticks` of a vehicle that turns by random commands.
fn estimated(bounds: ResponseBounds, vehicle: &mut Vehicle, ticks: u32) -> RotationEstimator {
    let mut estimator = RotationEstimator::new(bounds, &FilterOptions::default(), vehicle.attitude);
    for _ in 0..ticks {
        let from_s = vehicle.now_s();
        let measured = vehicle.turn(0.5);
        estimator.take(&measured, &vehicle.history, (from_s, vehicle.now_s()));
    }
    estimator
}

#[test]
fn gain_lag_and_hidden_delay_are_found() {
    let hidden = RateResponse { gain: 0.82, lag_s: 0.075, delay_s: 0.012 };
    let found = estimated(BOUNDS, &mut Vehicle::new(hidden, 5), 1200).response();
    assert!((found.gain - hidden.gain).abs() < 0.02, "{found:?}");
    assert!((found.lag_s - hidden.lag_s).abs() < 4e-3, "{found:?}");
    assert!((found.delay_s - hidden.delay_s).abs() < 3e-3, "{found:?}");
}

/// A short lag that is not yet known looks like a command that acts too early.
#[test]
fn no_command_acts_before_it_is_sent() {
    let hidden = RateResponse { gain: Vector3::new(1.0, 1.0, 1.0), lag_s: 0.02, delay_s: -DELAY_S };
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
    let mut squares = Vector3::zeros();
    let deviation = RateResponse { gain: 0.2, lag_s: 0.03, delay_s: 0.02 };
    let bounds = ResponseBounds { deviation, ..BOUNDS };
    let vehicles = 240;
    for seed in 0..vehicles {
        // As the estimator supposes, the bounds are two standard deviations away.
        let mut draw = Noise(1000 + seed);
        let [gain, lag, delay] = [0.1, 0.015, 0.01].map(|sd| sd * draw.normal().clamp(-2.0, 2.0));
        let hidden = RateResponse { gain: 1.0 + gain, lag_s: LAG_S + lag, delay_s: delay };
        let estimator = estimated(bounds, &mut Vehicle::new(hidden, seed), 480);
        let (found, sd) = (estimator.response(), estimator.deviations());
        squares += Vector3::new(
            (found.gain - hidden.gain) / sd.gain,
            (found.lag_s - hidden.lag_s) / sd.lag_s,
            (found.delay_s - hidden.delay_s) / sd.delay_s,
        )
        .map(|error| error * error);
    }
    // The mean of 240 squares has a standard deviation of 0.09.
    let mean = squares / vehicles as f64;
    assert!(mean.iter().all(|mean| (0.4..1.7).contains(mean)), "{mean}");
}

#[test]
fn without_motion_nothing_is_learnt() {
    let hidden = RateResponse { gain: 0.7, lag_s: 0.09, delay_s: 0.02 };
    let mut vehicle = Vehicle::new(hidden, 5);
    vehicle.attitude = Attitude::LEVEL;
    let mut estimator = RotationEstimator::new(BOUNDS, &FilterOptions::default(), vehicle.attitude);
    for tick in 0..600 {
        let t_s = f64::from(tick) * PERIOD_S;
        estimator.take(&Attitude::LEVEL, &vehicle.history, (t_s, t_s + PERIOD_S));
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
    let hidden = RateResponse { gain: 0.65, lag_s: 0.1, delay_s: 0.03 };
    let mut vehicle = Vehicle::new(hidden, 9);
    let mut adaptation = adaptation();
    assert_eq!(fly(&mut adaptation, &mut vehicle, 1200), 0);
    assert!((adaptation.model().rate_gain - hidden.gain).abs() < 0.04);
    // The vehicle is as configured from now on: what was learnt is wrong, and the configured model is flown.
    vehicle.response = BOUNDS.nominal;
    let fell_back = fly(&mut adaptation, &mut vehicle, 300);
    assert!(fell_back > 200, "{fell_back}");
    let model = adaptation.model();
    assert!((model.rate_gain - 1.0).abs() < 0.05, "{model:?}");
    // The adapted model is flown again once it has been as good for a while, and learns again.
    fly(&mut adaptation, &mut vehicle, 300);
    assert!(!adaptation.model().fell_back);
    vehicle.response = hidden;
    fly(&mut adaptation, &mut vehicle, 1200);
    let model = adaptation.model();
    assert!(!model.fell_back && (model.rate_gain - hidden.gain).abs() < 0.04, "{model:?}");
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
    let hidden = RateResponse { gain: 0.7, lag_s: 0.09, delay_s: 0.02 };
    let mut adaptation = adaptation();
    let configured = adaptation.model();
    let mut vehicle = Vehicle::new(hidden, 7);
    let weak = Motion { thrust_n: 0.5 * 9.81, ..Motion::default() };
    for _ in 0..600 {
        let measured = vehicle.turn(0.6);
        adaptation.take(vehicle.now_s(), (&measured, &weak, -1.0), &vehicle.history);
    }
    let learnt = adaptation.model();
    assert!(learnt.rate_gain < 0.8 && learnt.thrust_gain < 0.9, "{learnt:?}");
    adaptation.reset();
    assert_eq!(adaptation.model(), configured);
}

#[test]
fn the_floor_teaches_nothing_and_a_push_teaches_little() {
    let mut adaptation = adaptation();
    let configured = adaptation.model();
    let held = RateResponse { gain: 0.0, ..BOUNDS.nominal };
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
