//! Rotations seen by the cameras that wait for the vehicle's next report of its rates.

use nalgebra::Vector3;

/// Capacity \[-\]: at 60 Hz more rotations than between two reports. Beyond it the newest ones are joined.
const KEPT: usize = 16;

/// Rotation between two poses.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SeenRotation {
    /// Instants of the poses \[s\].
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    /// \[rad, body axes\].
    pub(super) turn: Vector3<f64>,
    pub(super) is_airborne: bool,
}

/// The rotations that wait, oldest first.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PendingRotations {
    waiting: [SeenRotation; KEPT],
    count: usize,
}

impl PendingRotations {
    /// Appends the rotation after the last one.
    pub(super) fn push(&mut self, seen: SeenRotation) {
        if self.count < KEPT {
            self.waiting[self.count] = seen;
            self.count += 1;
        } else {
            let newest = &mut self.waiting[KEPT - 1];
            newest.to_s = seen.to_s;
            newest.turn += seen.turn;
            newest.is_airborne &= seen.is_airborne;
        }
    }

    /// Removes and returns the oldest rotation if `is_due` holds for its end \[s\].
    pub(super) fn take_if(&mut self, is_due: impl FnOnce(f64) -> bool) -> Option<SeenRotation> {
        let oldest = self.waiting[..self.count].first().copied()?;
        is_due(oldest.to_s).then(|| {
            self.waiting.copy_within(1..self.count, 0);
            self.count -= 1;
            oldest
        })
    }
}
