//! Falsified messages: plausible but wrong, or arbitrary.

use std::any::Any;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use oqtal_bus::message::{CommandV1, Message, PoseV1, VehicleV1};
use oqtal_config::{Fault, FaultKind, FaultUnit};
use rand::{Rng, RngExt};

use crate::random::{Generator, normal3};

/// Values that no sensor sends: a quarter of the numbers in garbage.
const ABSURD: [f64; 6] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE / 2.0, -0.0];

/// Noise of the attitude for each millimetre of noise of the position in a frozen pose \[deg/mm\].
const NOISE_DEG_PER_MM: f64 = 0.4;

/// Makes every number of `message` arbitrary.
pub(super) fn garble<M: Message>(message: &mut M, generator: &mut Generator) {
    let message: &mut dyn Any = message;
    if let Some(pose) = message.downcast_mut::<PoseV1>() {
        pose.position = pose.position.map(|_| arbitrary(generator));
        pose.attitude = pose.attitude.map(|_| arbitrary(generator));
        pose.residual_m = arbitrary(generator);
        pose.tracked = generator.random();
    } else if let Some(command) = message.downcast_mut::<CommandV1>() {
        command.actuation = generator.random_range(0..4);
        command.sticks = command.sticks.map(|_| arbitrary(generator));
        command.torque = command.torque.map(|_| arbitrary(generator));
        command.attitude = command.attitude.map(|_| arbitrary(generator));
        command.thrust = arbitrary(generator);
    } else if let Some(vehicle) = message.downcast_mut::<VehicleV1>() {
        vehicle.battery_v = arbitrary(generator);
        vehicle.link_quality = arbitrary(generator);
        vehicle.command_sequence = generator.next_u64();
        vehicle.armed = generator.random();
        vehicle.starting = generator.random();
        vehicle.link = generator.random();
        vehicle.control = generator.random();
    }
}

/// Arbitrary number \[-\]: unphysical, of random bits, or of ordinary size.
fn arbitrary(generator: &mut Generator) -> f64 {
    match generator.random_range(0..4) {
        0 => ABSURD[generator.random_range(0..ABSURD.len())],
        1 | 2 => f64::from_bits(generator.next_u64()),
        _ => generator.random_range(-2.0..2.0),
    }
}

/// Makes `message` plausible but wrong by the magnitude of `fault`. The direction is drawn from `generator`, which must be in the
/// same state for every sample of one fault, so that the error is constant.
pub(super) fn falsify<M: Message>(message: &mut M, fault: &Fault, generator: &mut Generator) {
    let message: &mut dyn Any = message;
    if let Some(pose) = message.downcast_mut::<PoseV1>() {
        match fault.magnitude.map(|magnitude| magnitude.unit) {
            Some(FaultUnit::Degree) => turn(pose, &(Vector3::z() * fault.value().to_radians())),
            _ => shift(pose, &(direction(generator) * fault.value())),
        }
    } else if let Some(command) = message.downcast_mut::<CommandV1>() {
        let share = fault.value() / 100.0;
        command.sticks = command.sticks.map(|stick| stick * share);
        command.torque = command.torque.map(|torque| torque * share);
        command.thrust *= share;
    } else if let Some(vehicle) = message.downcast_mut::<VehicleV1>() {
        vehicle.armed = 0;
    }
}

/// Adds noise to a pose: to its position, or to its attitude if the magnitude of `fault` is an angle. A frozen pose with noise has both.
pub(super) fn add_noise<M: Message>(message: &mut M, fault: &Fault, generator: &mut Generator) {
    let message: &mut dyn Any = message;
    let Some(pose) = message.downcast_mut::<PoseV1>() else { return };
    let value = fault.value();
    let (position_mm, attitude_deg) = match fault.magnitude.map(|magnitude| magnitude.unit) {
        Some(FaultUnit::Degree) => (0.0, value),
        _ if fault.kind == FaultKind::FrozenNoise => (value, NOISE_DEG_PER_MM * value),
        _ => (value, 0.0),
    };
    shift(pose, &(normal3(generator) * position_mm * 1e-3));
    turn(pose, &(normal3(generator) * attitude_deg.to_radians()));
}

/// Moves a pose along with a drift, mirror or rotation that began at the pose `first`, `elapsed_s` ago \[s\]. The direction of a
/// drift is drawn from `generator`, as for [`falsify`].
pub(super) fn distort<M: Message>(
    message: &mut M,
    fault: &Fault,
    (first, elapsed_s): (&M, f64),
    generator: &mut Generator,
) {
    let (message, first): (&mut dyn Any, &dyn Any) = (message, first);
    let (Some(pose), Some(first)) =
        (message.downcast_mut::<PoseV1>(), first.downcast_ref::<PoseV1>())
    else {
        return;
    };
    let value = fault.value();
    match (fault.kind, fault.magnitude.map(|magnitude| magnitude.unit)) {
        (FaultKind::Drift, Some(FaultUnit::DegreePerSecond)) => {
            turn(pose, &(Vector3::x() * value.to_radians() * elapsed_s));
        }
        (FaultKind::Drift, _) => shift(pose, &(direction(generator) * value * elapsed_s)),
        (FaultKind::Mirror, _) => {
            pose.position[0] = 2.0 * first.position[0] - pose.position[0];
            let [x, y, z, w] = pose.attitude;
            pose.attitude = [x, -y, -z, w];
        }
        _ => {
            let moved = Vector3::from(pose.position) - Vector3::from(first.position);
            let about_z = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), value.to_radians());
            shift(pose, &(about_z * moved - moved));
        }
    }
}

/// Direction drawn from `generator`.
fn direction(generator: &mut Generator) -> Vector3<f64> {
    normal3(generator).try_normalize(0.0).unwrap_or_else(Vector3::x)
}

/// Shifts a pose \[m\].
fn shift(pose: &mut PoseV1, by_m: &Vector3<f64>) {
    pose.position = (Vector3::from(pose.position) + by_m).into();
}

/// Turns a pose by a rotation vector in body axes \[rad\].
fn turn(pose: &mut PoseV1, by_rad: &Vector3<f64>) {
    let [x, y, z, w] = pose.attitude;
    let by = UnitQuaternion::from_scaled_axis(*by_rad);
    let turned = Quaternion::new(w, x, y, z) * by.quaternion();
    pose.attitude = [turned.i, turned.j, turned.k, turned.w];
}
