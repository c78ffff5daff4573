//! Observer of the vehicle's velocity and of the acceleration by the thrust that balances weight and disturbances, from positions and
//! thrust.
//!
//! A position further from the predicted one than noise and disturbances explain is an outlier, or the vehicle was hit. The next
//! position decides: an outlier is left out, and a second such position corrects the observer by a bounded step (Huber, *Robust
//! Statistics*, 1981).

use nalgebra::Vector3;

/// Distance from the predicted position above which a position is an outlier \[m\], and as a multiple of the noise \[-\]; both are added.
const OUTLIER_M: f64 = 0.005;
const NOISE_OUTLIER: f64 = 3.0;
/// Greatest correction of the velocity by one position \[m/s\]: the time constant of the velocity is the distance of an outlier over it, so
/// noise slows the observer down but does not disturb it.
const GREATEST_M_S: f64 = 0.16;
/// Time constant of the balance by the positions over that of the velocity \[-\]: the observer of both is critically damped.
const BALANCE_RATIO: f64 = 4.0;
/// Time after a gap or a bounded correction until the velocity is known \[s\].
const UNKNOWN_S: f64 = 0.16;

/// The observer.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MotionObserver {
    /// The last position that was not left out \[m, world\], and the time since it \[s\].
    last: Option<Vector3<f64>>,
    since_s: f64,
    /// Motion predicted since that position \[m, world\].
    predicted: Vector3<f64>,
    velocity: Vector3<f64>,
    balance: Option<Vector3<f64>>,
    /// Whether the last position was left out.
    is_left_out: bool,
    /// Time until the velocity is known again after a gap \[s\].
    unknown_s: f64,
}

impl MotionObserver {
    /// Velocity \[m/s, world\].
    pub(super) fn velocity(&self) -> &Vector3<f64> {
        &self.velocity
    }

    /// Acceleration by the thrust at which the velocity is constant \[m/s^2, world\]; `None` until there is a position in the air.
    pub(super) fn balance(&self) -> Option<&Vector3<f64>> {
        self.balance.as_ref()
    }

    /// Whether the velocity is known.
    pub(super) fn is_known(&self) -> bool {
        self.unknown_s <= 0.0
    }

    /// Takes the `position` \[m, world\] with the noise `deviation_m` \[m\] after an interval of `dt_s` \[s\] with the acceleration
    /// `thrust` \[m/s^2, world\], gravity not subtracted.
    pub(super) fn take(
        &mut self,
        position: &Vector3<f64>,
        thrust: &Vector3<f64>,
        deviation_m: f64,
        dt_s: f64,
    ) {
        let balance = *self.balance.get_or_insert(*thrust);
        let error = self.predict(position, &(thrust - balance), dt_s);
        let change = self.correct(position, &error, deviation_m);
        self.balance = Some(balance - change);
    }

    /// Like [`Self::take`], with the `acceleration` \[m/s^2, world\] of a known balance.
    pub(super) fn take_balanced(
        &mut self,
        position: &Vector3<f64>,
        acceleration: &Vector3<f64>,
        deviation_m: f64,
        dt_s: f64,
    ) {
        self.balance = None;
        let error = self.predict(position, acceleration, dt_s);
        self.correct(position, &error, deviation_m);
    }

    /// Begins again after a gap with this balance.
    pub(super) fn interrupt(&mut self, balance: Option<Vector3<f64>>) {
        (self.last, self.balance, self.unknown_s) = (None, balance, UNKNOWN_S);
    }

    /// Returns the distance of `position` from the predicted one \[m, world\].
    fn predict(
        &mut self,
        position: &Vector3<f64>,
        acceleration: &Vector3<f64>,
        dt_s: f64,
    ) -> Vector3<f64> {
        self.unknown_s -= dt_s;
        self.since_s += dt_s;
        self.predicted += self.velocity * dt_s;
        self.velocity += acceleration * dt_s;
        self.last.map_or(Vector3::zeros(), |last| position - last - self.predicted)
    }

    /// Corrects the velocity by the `error` of the prediction \[m, world\]; returns the acceleration that the prediction lacks
    /// \[m/s^2, world\].
    fn correct(
        &mut self,
        position: &Vector3<f64>,
        error: &Vector3<f64>,
        deviation_m: f64,
    ) -> Vector3<f64> {
        let outlier_m = OUTLIER_M + NOISE_OUTLIER * deviation_m;
        let is_outlier = error.norm() > outlier_m;
        if is_outlier && !self.is_left_out {
            self.is_left_out = true;
            return Vector3::zeros();
        }
        if is_outlier {
            self.unknown_s = UNKNOWN_S;
        }
        let time_s = (outlier_m / GREATEST_M_S).max(self.since_s);
        let correction = error.cap_magnitude(outlier_m) / time_s;
        self.velocity += correction;
        (self.last, self.is_left_out) = (Some(*position), false);
        (self.predicted, self.since_s) = (Vector3::zeros(), 0.0);
        correction / (BALANCE_RATIO * time_s)
    }
}
