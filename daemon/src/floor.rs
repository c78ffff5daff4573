//! Heights and thrusts at which a vehicle stands on the floor, is lifted off it, or is in the air.

/// Thrust over the weight that lifts every vehicle that may be flown off the floor \[-\].
pub(crate) const LIFTING: f64 = 1.35;
/// Thrust over the weight below which no vehicle that may be flown stays in the air \[-\].
pub(crate) const STANDING: f64 = 0.5;

/// Height above the floor below which a vehicle has landed, once its reference is below the floor \[m\].
pub(crate) const LANDED_M: f64 = 0.04;
/// Height above the floor at the last accepted pose from which on a vehicle is in the air \[m\].
pub(crate) const AIRBORNE_M: f64 = 0.1;
/// Least height above the floor of the way of a request \[m\].
pub(crate) const LEAST_WAY_M: f64 = 0.1;
/// Least height of a path that is planned before the flight: the margin keeps the daemon from raising it when the vehicle is a little
/// below it \[m\].
pub(crate) const LEAST_PLAN_M: f64 = 0.15;
/// Height of the reference above the floor from which on the vehicle must have left the floor \[m\].
pub(crate) const OFF_FLOOR_M: f64 = 0.3;
