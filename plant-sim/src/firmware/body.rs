//! Body of a firmware under test: the firmware's motor values drive the plant's rotors, and inertial sensors measure the motion.
//! Pure.

use nalgebra::Vector3;
use oqtal_bus::message::TruthV1;
use oqtal_bus::time::{Grid, Span, Time};
use oqtal_config::{Config, Fidelity};
use oqtal_control::quaternion::Attitude;

use crate::disturbance::SceneDisturbance;
use crate::plant::{Plant, PlantOutput};

/// Rate of the inertial sensors \[Hz\]; the firmware's loops are clocked by their samples.
const IMU_HZ: f64 = 1000.0;

/// Sample of the sensors of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialSample {
    /// Specific force \[m/s^2, body\].
    pub force: [f64; 3],
    /// Body rate \[rad/s, body\].
    pub rate: [f64; 3],
    /// Attitude \[body to world\], scalar last.
    pub attitude: [f64; 4],
}

/// Output of the body.
#[derive(Clone, Copy, Debug)]
pub enum BodyOutput {
    /// A sample of the truth.
    Truth(TruthV1),
    /// A sample of the sensors.
    Sensors(InertialSample),
}

/// Body of a firmware under test.
#[derive(Clone, Debug)]
pub struct FirmwareBody {
    plant: Plant,
    imu: Grid,
    /// Instant of the last sensor sample, and the velocity at that instant \[m/s, world\].
    measured: (Time, Vector3<f64>),
    gravity: f64,
}

impl FirmwareBody {
    /// The vehicle of `config` on the floor at `start`, its motors off.
    pub fn new(config: &Config, start: Time) -> Self {
        let mut config = config.clone();
        // The firmware executes the control loops; of the plant's model only the rotors remain.
        config.plant.fidelity = Fidelity::Rotors;
        Self {
            gravity: config.plant.gravity_m_s2,
            plant: Plant::new(&config, start),
            imu: Grid::new(start, IMU_HZ),
            measured: (start, Vector3::zeros()),
        }
    }

    /// The next instant at which there is an output.
    pub fn next_event(&self) -> Time {
        self.plant.next_sample().min(self.imu.next())
    }

    /// The instant up to which the motion is integrated.
    pub fn time(&self) -> Time {
        self.plant.truth().time
    }

    /// Drives the motors at the powers that the firmware commands \[0..1\], from now on.
    pub fn drive(&mut self, motors: [f64; 4]) {
        self.plant.drive(motors);
    }

    /// Disturbs the body, whose time lags by `slip`, from now on. The times of disturbances count on its time.
    pub fn disturb(&mut self, disturbance: SceneDisturbance, slip: Span) {
        let armed_at = disturbance.armed_at.map(|at| at - slip);
        self.plant.disturb(SceneDisturbance { armed_at, ..disturbance });
    }

    /// Integrates to `until`, and passes the outputs to `out`.
    pub fn advance(&mut self, until: Time, mut out: impl FnMut(BodyOutput)) {
        let truth = |output: PlantOutput, out: &mut dyn FnMut(BodyOutput)| {
            if let PlantOutput::Truth(truth) = output {
                out(BodyOutput::Truth(truth));
            }
        };
        while self.imu.next() <= until {
            let at = self.imu.next();
            self.imu.advance();
            self.plant.advance(at, |output| truth(output, &mut out));
            out(BodyOutput::Sensors(self.measure(at)));
        }
        self.plant.advance(until, |output| truth(output, &mut out));
    }

    /// Skips the excess of a pause of the process that ends at `now`; see [`Plant::skip_pause`].
    pub fn skip_pause(&mut self, now: Time) -> Span {
        let skipped = self.plant.skip_pause(now);
        if skipped > Span::ZERO {
            self.imu.skip_to(now);
            self.measured = (now, Vector3::from(self.plant.truth().velocity));
        }
        skipped
    }

    /// The simulated vehicle.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Samples the sensors at `now`. The accelerometer averages since its last sample, so that a touch-down is not missed.
    fn measure(&mut self, now: Time) -> InertialSample {
        let truth = self.plant.truth();
        let velocity = Vector3::from(truth.velocity);
        let (then, before) = std::mem::replace(&mut self.measured, (now, velocity));
        let elapsed = now.since(then).seconds();
        let acceleration =
            if elapsed > 0.0 { (velocity - before) / elapsed } else { Vector3::zeros() };
        let attitude = Attitude::from_xyzw(truth.attitude).unwrap_or_default();
        let force = acceleration + Vector3::z() * self.gravity;
        let force = attitude.unit_quaternion().inverse_transform_vector(&force);
        InertialSample { force: force.into(), rate: truth.rate, attitude: truth.attitude }
    }
}
