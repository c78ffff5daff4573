//! The closed loop of a set-point-tracking LQR as a linear system whose input is the set-point. Paper, Section II.F.1.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::regulator::{AugmentedModel, Gain, INTEGRAL, LawState};

/// The columns of a [`Gain`], and the rows of a [`LawState`], that hold the attitude.
const ATTITUDE: usize = 3;

/// Linear system `x_dot = a x + b r`, `y = c x + d r` with the set-point `r` and the attitude `y`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPointLoop {
    /// Map from the state to its derivative \[units of the states per s\].
    pub a: SMatrix<f64, 9, 9>,
    /// Map from the set-point to the derivative of the state \[units of the states per s and rad\].
    pub b: SMatrix<f64, 9, 3>,
    /// Map from the state to the attitude \[rad over the units of the states\].
    pub c: SMatrix<f64, 3, 9>,
    /// Map from the set-point to the attitude \[-\].
    pub d: Matrix3<f64>,
}

impl SetPointLoop {
    /// Closed loop of the gain `k` and `model`.
    pub fn new(model: &AugmentedModel, k: &Gain) -> Self {
        // Eqs. (24), (25), erratum E-25: N_x = [0; I; 0] and N_u = 0
        let n_bar = k.fixed_columns::<3>(ATTITUDE).into_owned();
        // Eqs. (21), (32), (35): y = Theta, without feed-through
        let mut c = SMatrix::<f64, 3, 9>::zeros();
        c.fixed_view_mut::<3, 3>(0, ATTITUDE).fill_with_identity();
        let feed_through = Matrix3::zeros();
        // Eq. (26); erratum E-28: the integral is of r - y
        let mut b = model.b * n_bar;
        b.fixed_view_mut::<3, 3>(INTEGRAL, 0).fill_with_identity();
        // Eq. (27)
        Self { a: model.a - model.b * k, b, c: c - feed_through * k, d: feed_through * n_bar }
    }

    /// Attitude \[rad\] at `count` multiples of `dt_s` \[s\], from rest at zero, after a step of the set-point to `set_point`
    /// \[rad\]. Exact, by the matrix exponential.
    pub fn step_response(
        &self,
        set_point: &Vector3<f64>,
        dt_s: f64,
        count: usize,
    ) -> impl Iterator<Item = Vector3<f64>> + use<> {
        let mut generator = SMatrix::<f64, 12, 12>::zeros();
        generator.fixed_view_mut::<9, 9>(0, 0).copy_from(&(self.a * dt_s));
        generator.fixed_view_mut::<9, 3>(0, 9).copy_from(&(self.b * dt_s));
        let solved = generator.exp();
        let keep = solved.fixed_view::<9, 9>(0, 0).into_owned();
        let push = solved.fixed_view::<9, 3>(0, 9) * set_point;
        let (c, through) = (self.c, self.d * set_point);
        let mut x = LawState::zeros();
        (0..count).map(move |_| {
            let y = c * x + through;
            x = keep * x + push;
            y
        })
    }
}
