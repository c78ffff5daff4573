//! Integral action with anti-windup.

use nalgebra::Vector3;

/// The time integral of an error, each component within a limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Integral {
    value: Vector3<f64>,
    /// The value before the last step.
    before: Vector3<f64>,
    limit: f64,
}

impl Integral {
    /// An integral at zero whose components stay within `limit` \[the unit of the error times s\],
    /// which is not negative.
    pub fn new(limit: f64) -> Self {
        Self { value: Vector3::zeros(), before: Vector3::zeros(), limit }
    }

    /// The integral \[the unit of the error times s\].
    pub fn value(&self) -> &Vector3<f64> {
        &self.value
    }

    /// Adds `error` over `dt_s` \[s\], unless the command is saturated and the addition would drive it further out of
    /// range.
    ///
    /// `excess` is the unlimited command minus the limited one; `push` is the direction in which `error` moves the unlimited
    /// command. An `error` or a `dt_s` that is not finite adds nothing.
    #[inline]
    pub fn step(
        &mut self,
        error: &Vector3<f64>,
        push: &Vector3<f64>,
        excess: &Vector3<f64>,
        dt_s: f64,
    ) {
        self.before = self.value;
        let increment = error * dt_s;
        let winds_up = push.dot(excess) > 0.0;
        if !winds_up && increment.iter().all(|component| component.is_finite()) {
            self.value =
                (self.value + increment).map(|component| component.clamp(-self.limit, self.limit));
        }
    }

    /// Takes over the value of `other`, within the limit of this integral.
    pub fn adopt(&mut self, other: &Self) {
        self.value = other.value.map(|component| component.clamp(-self.limit, self.limit));
    }

    /// Takes the last step back, if its command was not sent.
    pub fn undo(&mut self) {
        self.value = self.before;
    }

    /// Sets the integral to zero.
    pub fn reset(&mut self) {
        (self.value, self.before) = (Vector3::zeros(), Vector3::zeros());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: Vector3<f64> = Vector3::new(1.0, 0.0, 0.0);

    #[test]
    fn the_integral_grows_up_to_its_limit() {
        let mut integral = Integral::new(0.25);
        integral.step(&X, &X, &Vector3::zeros(), 0.1);
        assert_eq!(*integral.value(), 0.1 * X);
        for _ in 0..10 {
            integral.step(&X, &X, &Vector3::zeros(), 0.1);
        }
        assert_eq!(*integral.value(), 0.25 * X);
        integral.step(&-X, &-X, &Vector3::zeros(), 0.1);
        integral.undo();
        assert_eq!(*integral.value(), 0.25 * X);
        integral.reset();
        assert_eq!(*integral.value(), Vector3::zeros());
    }

    #[test]
    fn the_integral_stops_only_while_it_would_increase_the_saturation() {
        let mut integral = Integral::new(1.0);
        integral.step(&X, &X, &X, 0.1);
        assert_eq!(*integral.value(), Vector3::zeros());
        integral.step(&X, &X, &-X, 0.1);
        assert_eq!(*integral.value(), 0.1 * X);
    }

    #[test]
    fn numbers_that_are_not_finite_add_nothing() {
        let mut integral = Integral::new(1.0);
        for (error, dt_s) in
            [(f64::NAN, 0.1), (f64::INFINITY, 0.1), (1.0, f64::NAN), (1.0, f64::INFINITY)]
        {
            integral.step(&(error * X), &X, &Vector3::zeros(), dt_s);
            assert_eq!(*integral.value(), Vector3::zeros());
        }
    }
}
