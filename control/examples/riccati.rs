//! Gains from both Riccati equations for a cart on a track, with position and velocity as its states.

use std::error::Error;

use nalgebra::{Matrix1, Matrix2, Vector2};
use oqtal_control::linear::discretise;
use oqtal_control::riccati::{RiccatiError, care, dare};

fn main() -> Result<(), Box<dyn Error>> {
    // dx/dt = A x + B u; the cost is the integral of x'Qx + u'Ru.
    let a = Matrix2::new(0.0, 1.0, 0.0, -0.1);
    let b = Vector2::new(0.0, 1.0);
    let (q, r) = (Matrix2::from_diagonal(&Vector2::new(4.0, 1.0)), Matrix1::new(0.5));
    let continuous = care(&a, &b, &q, &r)?;
    println!("continuous time:      K = {:.4?}", continuous.k.as_slice());
    let closed = a - b * continuous.k;
    println!("poles of the closed loop: {:.4?}", closed.complex_eigenvalues().as_slice());

    // The same cart under a controller that runs at 20 Hz and holds its input in between.
    let period_s = 0.05;
    let (ad, bd) = discretise(&a, &b, period_s);
    let discrete = dare(&ad, &bd, &(q * period_s), &(r * period_s))?;
    println!("discrete time, 20 Hz: K = {:.4?}", discrete.k.as_slice());

    // The defining property: the residual vanishes.
    let p = continuous.p;
    let residual = a.transpose() * p + p * a - p * b * continuous.k + q;
    assert!(residual.norm() < 1e-12, "residual {residual}");
    assert!((ad - bd * discrete.k).complex_eigenvalues().iter().all(|pole| pole.norm() < 1.0));

    // A mode that no input can reach causes an error.
    let unreachable = care(&Matrix2::identity(), &b, &q, &r);
    assert_eq!(unreachable, Err(RiccatiError::NoStabilisingSolution));
    println!("without a way to reach a mode: {}", unreachable.unwrap_err());
    Ok(())
}
