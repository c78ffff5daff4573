//! A frame of a camera system for the tests.

use oqtal_wire::motion::{BodySample, MarkerSample, MotionFrame, RigidPose};
use proptest::prelude::*;

/// A frame that owns its content.
#[derive(Clone, Debug)]
pub struct OwnedFrame {
    pub number: u32,
    pub captured_ns: u64,
    pub bodies: Vec<BodySample>,
    pub markers: Vec<MarkerSample>,
}

impl OwnedFrame {
    pub fn as_frame(&self) -> MotionFrame<'_> {
        MotionFrame {
            number: self.number,
            captured_ns: self.captured_ns,
            sent_ns: self.captured_ns + 1_000_000,
            bodies: &self.bodies,
            markers: &self.markers,
        }
    }
}

pub fn pose() -> impl Strategy<Value = RigidPose> {
    let numbers = (prop::array::uniform3(-10.0..10.0_f64), prop::array::uniform4(-1.0..1.0_f64));
    numbers.prop_filter_map("near zero", |(position, attitude)| RigidPose::new(position, attitude))
}

pub fn body() -> impl Strategy<Value = BodySample> {
    let seen = (pose(), 0.0..0.01_f64)
        .prop_map(|(pose, residual_m)| BodySample { pose: Some(pose), residual_m });
    prop_oneof![4 => seen, 1 => Just(BodySample::LOST)]
}

fn marker() -> impl Strategy<Value = MarkerSample> {
    let position = prop::option::weighted(0.8, prop::array::uniform3(-10.0..10.0_f64));
    (position, 0.0..0.01_f64)
        .prop_map(|(position_m, residual_m)| MarkerSample { position_m, residual_m })
}

pub fn frame() -> impl Strategy<Value = OwnedFrame> {
    let bodies = prop::collection::vec(body(), 0..6);
    let markers = prop::collection::vec(marker(), 0..24);
    (1..1_000_000_u32, 0..1_u64 << 50, bodies, markers).prop_map(
        |(number, captured_ns, bodies, markers)| OwnedFrame {
            number,
            captured_ns,
            bodies,
            markers,
        },
    )
}

/// Whether two poses agree within these errors of position \[m\] and of the quaternion \[-\].
pub fn agree(a: &RigidPose, b: &RigidPose, (position_m, attitude): (f64, f64)) -> bool {
    let apart =
        a.position_m.iter().zip(b.position_m).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
    let product: f64 = a.attitude.iter().zip(b.attitude).map(|(x, y)| x * y).sum();
    apart <= position_m && 1.0 - product.abs() <= attitude
}
