//! The whole autopilot with a vehicle that matches the model exactly.

use oqtal_control::controller::AttitudeReference;
use oqtal_control::predictive::{
    Bias, CommandHistory, CommandReport, ModelInput, Motion, PositionLaw, PredictiveOutput,
};
use oqtal_control::quaternion::Attitude;
use oqtal_control::trajectory::{Phase, Reference};

use super::*;

const LATENCY_S: f64 = 0.015;

/// The autopilot, its vehicle and the time between a pose and its effect.
struct Bench {
    autopilot: Autopilot<RateInput>,
    tracker: MotionTracker,
    history: CommandHistory,
    motion: Motion,
    bias: Bias,
    tick: u64,
}

impl Bench {
    fn new(bias: Bias) -> Self {
        Self::with(&PredictiveOptions::default(), bias)
    }

    fn with(options: &PredictiveOptions, bias: Bias) -> Self {
        let motion = Motion { thrust_n: 0.5 * 9.81, ..Motion::default() };
        let pose = MeasuredPose { position: motion.position, attitude: motion.attitude };
        Self {
            autopilot: autopilot(),
            tracker: tracker(options, 1.0 - PERIOD_S, &pose),
            history: CommandHistory::new(DELAY_S),
            motion,
            bias,
            tick: 0,
        }
    }

    fn now_s(&self) -> f64 {
        1.0 + self.tick as f64 * PERIOD_S
    }

    fn pose(&self) -> MeasuredPose {
        MeasuredPose { position: self.motion.position, attitude: self.motion.attitude }
    }

    /// One tick: a pose is captured and arrives, a command is sent, the vehicle moves on to the next pose.
    fn turn(&mut self, reference: &Reference) -> Option<Vector3<f64>> {
        self.step(reference).map(|output| output.u)
    }

    fn step(&mut self, reference: &Reference) -> Option<PredictiveOutput> {
        let captured_s = self.now_s();
        let sent_s = captured_s + LATENCY_S;
        self.tracker.take(captured_s, &self.pose());
        let output = self.autopilot.compute(sent_s, &self.tracker, reference);
        let hovering = ModelInput { thrust_n: 0.5 * 9.81, ..ModelInput::default() };
        let input = output.map_or(hovering, |output| ModelInput {
            demand: output.u * AUTHORITY,
            attitude: output.attitude,
            thrust_n: output.setpoint.thrust_n,
        });
        self.tick += 1;
        self.tracker.sent(self.tick, sent_s, input);
        self.history.push(self.tick, sent_s, input);
        let span = (captured_s, self.now_s());
        self.motion = self.history.propagate(&quadrotor(), (&self.motion, &self.bias), span);
        output
    }
}

fn hover() -> Reference {
    Reference::rest(Vector3::zeros(), Phase::Settle)
}

#[test]
fn each_gain_of_the_velocity_acts_on_its_own_axes() {
    let force = |gains: [f64; 2], velocity: Vector3<f64>| {
        let [velocity_gain_per_s, vertical_velocity_gain_per_s] = gains;
        let options = PredictiveOptions {
            velocity_gain_per_s,
            vertical_velocity_gain_per_s,
            ..PredictiveOptions::default()
        };
        let mut law =
            PositionLaw::new(&options, &PositionOptions::default(), (&quadrotor(), f64::INFINITY));
        let off = Motion { velocity, ..Motion::default() };
        // The first step begins at the vehicle.
        law.update((&Motion::default(), &Bias::default()), &hover(), (PERIOD_S, DELAY_S));
        law.update((&off, &Bias::default()), &hover(), (PERIOD_S, DELAY_S)).force.value
    };
    let [north, up] = [Vector3::x() * 0.01, Vector3::z() * 0.01];
    let base = [4.0, 5.0];
    for (gains, ratio) in [([8.0, 5.0], [2.0, 1.0]), ([4.0, 10.0], [1.0, 2.0])] {
        let of = |axis: Vector3<f64>| force(gains, axis).dot(&axis) - 9.81 * axis.z;
        let before = |axis: Vector3<f64>| force(base, axis).dot(&axis) - 9.81 * axis.z;
        for (axis, ratio) in [north, up].into_iter().zip(ratio) {
            assert!(before(axis) < 0.0, "{axis}");
            assert!((of(axis) / before(axis) - ratio).abs() < 1e-6, "{gains:?} {axis}");
        }
    }
}

#[test]
fn a_lasting_force_does_not_reduce_the_range_of_the_corrections() {
    let (options, loops) = (PredictiveOptions::default(), PositionOptions::default());
    let limit = loops.vertical_acceleration_limit_m_s2;
    for (external, speed) in [(0.0, -3.0), (-3.0, -3.0), (-3.0, 3.0), (2.0, -3.0)] {
        let mut law = PositionLaw::new(&options, &loops, (&quadrotor(), f64::INFINITY));
        law.update((&Motion::default(), &Bias::default()), &hover(), (PERIOD_S, DELAY_S));
        let off = Motion { velocity: Vector3::z() * speed, ..Motion::default() };
        let bias = Bias { acceleration: Vector3::z() * external, ..Bias::default() };
        for _ in 0..600 {
            law.update((&Motion::default(), &bias), &hover(), (PERIOD_S, DELAY_S));
        }
        let force = law.update((&off, &bias), &hover(), (PERIOD_S, DELAY_S)).force.value;
        // The range is wider against the force alone.
        let against = if external * speed > 0.0 { -external } else { 0.0 };
        let correction = force.z - 9.81;
        assert!((correction + limit.copysign(speed) - against).abs() < 1e-6, "{external} {speed}");
    }
}

/// The horizontal force along a motion at the start of a hold that is a stop or not, of a vehicle that follows a reference with this
/// acceleration \[m/s^2\] a tenth of a second late.
fn force_at_hold(acceleration: f64, stops: bool) -> f64 {
    let (options, loops) = (PredictiveOptions::default(), PositionOptions::default());
    let mut law = PositionLaw::new(&options, &loops, (&quadrotor(), f64::INFINITY));
    let (along, from_m_s) =
        (Vector3::new(0.6, 0.8, 0.0), if acceleration < 0.0 { 1.5 } else { 0.0 });
    let at = |t_s: f64| {
        let velocity = along * (from_m_s + acceleration * t_s);
        (along * ((from_m_s + 0.5 * acceleration * t_s) * t_s), velocity)
    };
    let mut motion = Motion::default();
    for step in 0..30 {
        let t_s = f64::from(step) * PERIOD_S;
        let (position, velocity) = at(t_s);
        let acceleration = along * acceleration;
        (motion.position, motion.velocity) = at((t_s - 0.1).max(0.0));
        let reference = Reference { position, velocity, acceleration, ..hover() };
        law.update((&motion, &Bias::default()), &reference, (PERIOD_S, DELAY_S));
    }
    if stops {
        law.begin_stop();
    }
    let hold = Reference::rest(motion.position, Phase::Settle);
    let setpoint = law.update((&motion, &Bias::default()), &hold, (PERIOD_S, DELAY_S));
    setpoint.force.value.dot(&along) - quadrotor().drag_per_s * motion.velocity.norm()
}

#[test]
fn f47_a_stop_continues_no_acceleration_along_the_velocity_and_does_continue_braking() {
    assert!(force_at_hold(2.0, false) > 1.0, "{}", force_at_hold(2.0, false));
    assert!(force_at_hold(2.0, true) < 0.0, "{}", force_at_hold(2.0, true));
    assert!(force_at_hold(-2.0, true) < -1.0, "{}", force_at_hold(-2.0, true));
}

#[test]
fn without_error_nothing_is_commanded_but_the_weight() {
    let mut bench = Bench::new(Bias::default());
    // Until the first command arrives the model has no thrust.
    for _ in 0..600 {
        bench.turn(&hover());
    }
    let u = bench.turn(&hover()).unwrap();
    assert!(u.amax() < 1e-6, "commands {u}");
    assert!(bench.motion.position.norm() < 1e-6);
}

#[test]
fn steady_disturbances_are_learnt_and_leave_no_error() {
    let bias = Bias {
        demand: Vector3::new(0.035, -0.026, 0.017),
        acceleration: Vector3::new(0.06, -0.04, 0.1),
    };
    let mut bench = Bench::new(bias);
    for _ in 0..1200 {
        bench.turn(&hover());
    }
    assert!(bench.motion.position.norm() < 1e-4, "off by {}", bench.motion.position);
    assert!(bench.motion.attitude.angle_to(&Attitude::LEVEL) < 0.02);
    let compensation = bench.step(&hover()).unwrap().terms.disturbance;
    let off = compensation + bias.demand / AUTHORITY;
    assert!(off.amax() < 1e-3, "the law shows the disturbance that it compensates: {off}");
}

#[test]
fn a_prescribed_attitude_is_followed_through_the_delay() {
    let mut bench = Bench::new(Bias::default());
    for _ in 0..300 {
        bench.turn(&hover());
    }
    let (mut worst, frequency) = (0.0_f64, std::f64::consts::TAU * 2.0);
    for tick in 0..120 {
        // The reference of the instant at which the pose is acted on.
        let angle = |t: f64| 0.05 * (1.0 - (frequency * t).cos());
        let t = f64::from(tick) * PERIOD_S + LATENCY_S;
        let (rate, acceleration) = (
            0.05 * frequency * (frequency * t).sin(),
            0.05 * frequency.powi(2) * (frequency * t).cos(),
        );
        let attitude = AttitudeReference {
            attitude: Attitude::from_rotation_vector(Vector3::x() * angle(t)),
            rate: oqtal_control::quantity::BodyRate(Vector3::x() * rate),
            acceleration: oqtal_control::quantity::AngularAcceleration(Vector3::x() * acceleration),
        };
        bench.turn(&Reference { attitude: Some(attitude), ..hover() });
        let expected = angle(t - LATENCY_S + PERIOD_S);
        let roll = Attitude::LEVEL.rotation_to(&bench.motion.attitude).x;
        if tick > 30 {
            worst = worst.max((roll - expected).abs());
        }
    }
    assert!(worst < 0.003, "off by {worst} rad");
}

/// The next flight may have another battery, load or vehicle.
#[test]
fn a_flight_after_a_landing_begins_with_the_configured_model() {
    let heavy = Bias { acceleration: Vector3::z() * -1.0, ..Bias::default() };
    let mut bench = Bench::new(heavy);
    let configured = bench.tracker.adapted();
    for _ in 0..600 {
        bench.turn(&hover());
    }
    assert!(bench.tracker.adapted().unwrap().thrust_gain < 0.95);
    let resting = bench.pose();
    for _ in 0..60 {
        bench.tick += 1;
        bench.tracker.take(bench.now_s(), &resting);
        bench.tracker.sent(bench.tick, bench.now_s(), ModelInput::default());
    }
    bench.tracker.end();
    bench.tracker.begin(bench.now_s(), &resting, resting.position.z);
    assert_eq!(bench.tracker.adapted(), configured);
}

/// A push is not a thrust: adaptation to it must not speed up the return by more than a few hundredths.
#[test]
fn a_vehicle_that_was_pushed_away_comes_back_no_faster_than_it_may() {
    for (adapt, limit_m_s) in [(false, 0.85), (true, 0.9)] {
        let mut options = PredictiveOptions::default();
        options.adaptation.adapt = adapt;
        let mut bench = Bench::with(&options, Bias::default());
        for _ in 0..300 {
            bench.turn(&hover());
        }
        // A push that no tilt holds against.
        bench.bias.acceleration = Vector3::new(6.0, -6.0, 4.0);
        for _ in 0..30 {
            bench.turn(&hover());
        }
        bench.bias.acceleration = Vector3::zeros();
        let (mut furthest, mut fastest) = (0.0_f64, 0.0_f64);
        for _ in 0..900 {
            bench.turn(&hover());
            let (away, velocity) = (bench.motion.position.xy(), bench.motion.velocity.xy());
            furthest = furthest.max(away.norm());
            fastest = fastest.max(-velocity.dot(&away.normalize()));
        }
        assert!(furthest > 1.0, "pushed by {furthest} m only");
        assert!(fastest < limit_m_s, "came back at {fastest} m/s");
        assert!(bench.motion.position.norm() < 1e-3, "left at {}", bench.motion.position);
    }
}

#[test]
fn before_the_first_pose_and_without_finite_numbers_nothing_is_computed() {
    let mut autopilot = autopilot();
    let mut tracker = MotionTracker::new(quadrotor(), ADMISSION, DELAY_S);
    assert_eq!(autopilot.compute(1.0, &tracker, &hover()), None);
    let pose = MeasuredPose { position: Vector3::zeros(), attitude: Attitude::LEVEL };
    tracker.begin(1.0, &pose, 0.0);
    let before = autopilot.clone();
    let nan = Reference { yaw_rad: f64::NAN, ..hover() };
    for (now_s, reference) in [(1.0, nan), (f64::NAN, hover()), (f64::INFINITY, hover())] {
        assert_eq!(autopilot.compute(now_s, &tracker, &reference), None);
        assert_eq!(autopilot, before);
    }
    assert!(autopilot.compute(1.015, &tracker, &hover()).is_some());
    assert_eq!(autopilot.compute(1.015, &tracker, &hover()), None, "no time has passed");
}

fn garbage() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<u64>().prop_map(f64::from_bits),
        Just(f64::NAN),
        Just(f64::INFINITY),
        -10.0..10.0_f64,
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn no_invalid_number_reaches_a_command_or_affects_a_later_one(
        numbers in prop::collection::vec(prop::array::uniform8(garbage()), 1..30),
    ) {
        let mut bench = Bench::new(Bias::default());
        for _ in 0..60 {
            bench.turn(&hover());
        }
        for [a, b, c, d, e, f, g, h] in numbers {
            let pose = MeasuredPose {
                position: Vector3::new(a, b, c),
                attitude: Attitude::from_rotation_vector(Vector3::new(d, e, f)),
            };
            bench.tracker.take(bench.now_s() + g.abs().min(1e-3), &pose);
            bench.tick += 1;
            // Commands are limited to the range of their interface before they are sent; clamping keeps NaN.
            let demand = Vector3::new(a, b, c).map(|stick| stick.clamp(-1.0, 1.0)) * AUTHORITY;
            let input = ModelInput { demand, attitude: Attitude::LEVEL, thrust_n: d.clamp(0.0, 20.0) };
            bench.tracker.sent(bench.tick, bench.now_s(), input);
            let report = CommandReport { sequence: bench.tick, acts_s: h, follows: true };
            bench.tracker.applied(report);
            let reference = Reference { position: Vector3::new(f, g, h), ..hover() };
            let now_s = bench.now_s();
            if let Some(output) = bench.autopilot.compute(now_s, &bench.tracker, &reference) {
                prop_assert!(output.u.iter().all(|stick| (-1.0..=1.0).contains(stick)));
                prop_assert!(output.setpoint.thrust_n.is_finite());
                prop_assert!(output.setpoint.attitude.is_finite());
            }
        }
        for _ in 0..1200 {
            bench.turn(&hover());
        }
        prop_assert!(bench.motion.position.norm() < 0.01, "left at {}", bench.motion.position);
    }
}
