//! Axes: ours are x forward, y left, z up, in the world and in the body; MAVLink's are north, east, down and forward, right, down.
//!
//! Our x is MAVLink's north: both pairs of axes differ by half a turn about x. The turn is its own inverse, so that one function goes
//! both ways, for vectors of either frame and for attitudes.

/// Components of a vector in the other axes: positions and velocities in the world, rates in the body \[-\].
pub fn vector_axes([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -y, -z]
}

/// Attitude between the other axes, scalar last \[-\].
pub fn attitude_axes([x, y, z, w]: [f64; 4]) -> [f64; 4] {
    [x, -y, -z, w]
}

/// Converts an attitude in our axes, scalar last, to a MAVLink quaternion, scalar first, of unit length to the last bit of `f32` \[-\].
pub(super) fn wire_quaternion(attitude: [f64; 4]) -> [f32; 4] {
    let [x, y, z, w] = attitude_axes(attitude);
    let norm = (x * x + y * y + z * z + w * w).sqrt();
    [w, x, y, z].map(|number| (number / norm) as f32)
}

/// Converts a MAVLink quaternion, scalar first, to an attitude in our axes, scalar last \[-\].
pub(super) fn from_wire_quaternion([w, x, y, z]: [f32; 4]) -> [f64; 4] {
    attitude_axes([x, y, z, w].map(f64::from))
}

/// Roll, pitch and yaw in MAVLink's axes, 3-2-1 \[rad\].
pub(super) fn wire_angles(attitude: [f64; 4]) -> [f32; 3] {
    let [x, y, z, w] = attitude_axes(attitude);
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    [roll, pitch, yaw].map(|angle| angle as f32)
}

/// Converts roll, pitch and yaw in MAVLink's axes \[rad\] to an attitude in our axes, scalar last \[-\].
pub(super) fn from_wire_angles([roll, pitch, yaw]: [f32; 3]) -> [f64; 4] {
    let half = |angle: f32| (f64::from(angle) / 2.0).sin_cos();
    let ((sr, cr), (sp, cp), (sy, cy)) = (half(roll), half(pitch), half(yaw));
    attitude_axes([
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_to_the_left_is_negative_yaw_and_nose_down_is_negative_pitch() {
        let half = 0.1_f64;
        // About z up, anticlockwise from above.
        let [_, _, yaw] = wire_angles([0.0, 0.0, half.sin(), half.cos()]);
        assert!((f64::from(yaw) + 2.0 * half).abs() < 1e-6);
        // About y left: the nose goes down.
        let [_, pitch, _] = wire_angles([0.0, half.sin(), 0.0, half.cos()]);
        assert!((f64::from(pitch) + 2.0 * half).abs() < 1e-6);
        // About x forward: the left side goes up, which is roll to the right in both.
        let [roll, ..] = wire_angles([half.sin(), 0.0, 0.0, half.cos()]);
        assert!((f64::from(roll) - 2.0 * half).abs() < 1e-6);
    }

    #[test]
    fn angles_and_quaternions_are_read_back() {
        let attitude = [0.1, -0.2, 0.3, 0.927_361_849_549_570_4];
        for read in [
            from_wire_angles(wire_angles(attitude)),
            from_wire_quaternion(wire_quaternion(attitude)),
        ] {
            assert!(read.iter().zip(attitude).all(|(read, sent)| (read - sent).abs() < 1e-6));
        }
    }
}
