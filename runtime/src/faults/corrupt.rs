//! Falsified messages: plausible but wrong, or arbitrary.

use std::any::Any;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use oqtal_bus::message::{CommandV1, Message, PoseV1, VehicleV1};
use oqtal_config::{Fault, FaultUnit};
use rand::{Rng, RngExt};

use crate::random::{Generator, normal3};

/// Values that no sensor sends: a quarter of the numbers in garbage.
const ABSURD: [f64; 6] =
    [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE / 2.0, -0.0];

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
            Some(FaultUnit::Degree) => turn(pose, fault.value().to_radians()),
            _ => shift(pose, fault.value(), generator),
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

/// Shifts a pose by `distance_m` in a direction drawn from `generator`.
fn shift(pose: &mut PoseV1, distance_m: f64, generator: &mut Generator) {
    let direction = normal3(generator).try_normalize(0.0).unwrap_or_else(Vector3::x);
    pose.position = (Vector3::from(pose.position) + direction * distance_m).into();
}

/// Turns a pose by `angle_rad` about the body's z axis, as when the markers of a body are swapped.
fn turn(pose: &mut PoseV1, angle_rad: f64) {
    let [x, y, z, w] = pose.attitude;
    let about_z = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad);
    let turned = Quaternion::new(w, x, y, z) * about_z.quaternion();
    pose.attitude = [turned.i, turned.j, turned.k, turned.w];
}
