//! The mathematics of the paper: tracking error, error models, Riccati equations, gains, gravity turn.

use nalgebra::{DMatrix, SMatrix, Vector3};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use oqtal_control::controller::{Oqtal, OqtalOptions, RateInput, TorqueInput};
use oqtal_control::error_model::{ErrorModel, Jacobian, OperatingPoint};
use oqtal_control::gravity_turn::{GravityTurn, TurnState};
use oqtal_control::quantity::BodyRate;
use oqtal_control::quaternion::Attitude;
use oqtal_control::riccati::{RiccatiError, Solution, care, dare};
use oqtal_control::rigid_body::Inertia;
use oqtal_control::tracking_error::AttitudeError;
use oqtal_runtime::process::{Exit, Failure};
use pyo3::prelude::*;
use serde_json::Value;

use crate::error;

/// Matrix of a result, and of an argument.
type Matrix<'py> = Bound<'py, PyArray2<f64>>;
type GivenMatrix<'py> = PyReadonlyArray2<'py, f64>;
type GivenVector<'py> = PyReadonlyArray1<'py, f64>;

/// A failure of the mathematics: the data have no solution.
fn data(error: impl ToString) -> PyErr {
    error::raised(Failure::new(Exit::Data, error.to_string()))
}

/// The numbers of a vector argument.
fn numbers<const N: usize>(vector: &GivenVector<'_>, name: &str) -> PyResult<[f64; N]> {
    let given: Vec<f64> = vector.as_array().iter().copied().collect();
    let count = given.len();
    given.try_into().map_err(|_| error::usage(format!("{name} has {count} numbers; expected {N}")))
}

fn vector3(vector: &GivenVector<'_>, name: &str) -> PyResult<Vector3<f64>> {
    numbers::<3>(vector, name).map(Vector3::from)
}

fn attitude(vector: &GivenVector<'_>, name: &str) -> PyResult<Attitude> {
    let numbers = numbers::<4>(vector, name)?;
    let unusable =
        || error::usage(format!("{name} is not a quaternion [x, y, z, w] that can be normalised"));
    Attitude::from_xyzw(numbers).ok_or_else(unusable)
}

fn matrix_of<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    matrix: &SMatrix<f64, R, C>,
) -> Matrix<'py> {
    rows_of(py, &DMatrix::from_fn(R, C, |row, column| matrix[(row, column)]))
}

fn rows_of<'py>(py: Python<'py>, matrix: &DMatrix<f64>) -> Matrix<'py> {
    let rows: Vec<Vec<f64>> = matrix.row_iter().map(|row| row.iter().copied().collect()).collect();
    PyArray2::from_vec2(py, &rows).expect("rows of one length")
}

/// The tracking error of Eqs. (8) to (12) and (36): `eps`, `lambda`, the rotation `C`, and `omega_e`.
#[pyfunction]
fn tracking_error<'py>(
    py: Python<'py>,
    desired: GivenVector<'py>,
    actual: GivenVector<'py>,
    rate: GivenVector<'py>,
    desired_rate: GivenVector<'py>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, f64, Matrix<'py>, Bound<'py, PyArray1<f64>>)> {
    let error =
        AttitudeError::between(&attitude(&desired, "desired")?, &attitude(&actual, "attitude")?);
    let (rate, desired_rate) = (vector3(&rate, "rate")?, vector3(&desired_rate, "desired_rate")?);
    let omega_e = error.rate_error(BodyRate(rate), BodyRate(desired_rate));
    let eps = error.eps().as_slice().to_pyarray(py);
    Ok((eps, error.lambda(), matrix_of(py, &error.rotation()), omega_e.as_slice().to_pyarray(py)))
}

fn jacobian(name: &str) -> PyResult<Jacobian> {
    serde_json::from_value(Value::from(name))
        .map_err(|error| error::usage(format!("jacobian: {error}")))
}

/// The matrix `A` of Eq. (41) for the state `[omega_e; eps]`, by the model `name` at an operating point.
#[pyfunction]
fn error_model<'py>(
    py: Python<'py>,
    name: &str,
    eps: GivenVector<'py>,
    omega_e: GivenVector<'py>,
    eps_ddot: GivenVector<'py>,
) -> PyResult<Matrix<'py>> {
    let point = OperatingPoint::new(vector3(&eps, "eps")?, vector3(&omega_e, "omega_e")?);
    let point = OperatingPoint { eps_ddot: vector3(&eps_ddot, "eps_ddot")?, ..point };
    Ok(matrix_of(py, &ErrorModel::at(jacobian(name)?, &point).state_matrix()))
}

/// The gain `K` of Eq. (56) at the operating point `[omega_e; eps]`: of a vehicle with this inertia \[kg m^2\], commanded by torque, or
/// with these greatest rates \[rad/s\], commanded by sticks. `options` are the keys of `[control.oqtal]` as JSON.
#[pyfunction]
#[pyo3(signature = (options, point, inertia=None, rate_authority=None))]
fn oqtal_gain<'py>(
    py: Python<'py>,
    options: &str,
    point: GivenVector<'py>,
    inertia: Option<GivenMatrix<'py>>,
    rate_authority: Option<GivenVector<'py>>,
) -> PyResult<Matrix<'py>> {
    let options: OqtalOptions = serde_json::from_str::<Value>(options)
        .and_then(serde_json::from_value)
        .map_err(|error| error::usage(format!("options: {error}")))?;
    options.check().map_err(|error| error::usage(error.to_string()))?;
    let point = numbers::<6>(&point, "point")?.into();
    let gain = match (inertia, rate_authority) {
        (Some(inertia), None) => {
            let inertia = Inertia::new(padded::<3, 3>(&inertia, "inertia", 0.0)?).map_err(data)?;
            let input = TorqueInput::new(inertia, f64::MAX).map_err(data)?;
            Oqtal::gain_at(&options, &input, &point)
        }
        (None, Some(authority)) => {
            let input = RateInput::new(vector3(&authority, "rate_authority")?).map_err(data)?;
            Oqtal::gain_at(&options, &input, &point)
        }
        _ => return Err(error::usage("give either inertia or rate_authority")),
    };
    Ok(matrix_of(py, &gain.map_err(data)?))
}

/// The data of a Riccati equation.
struct Equation<'py> {
    a: GivenMatrix<'py>,
    b: GivenMatrix<'py>,
    q: GivenMatrix<'py>,
    r: GivenMatrix<'py>,
}

/// Solver for systems with `N` states and `M` inputs.
type Solver<const N: usize, const M: usize> = fn(
    &SMatrix<f64, N, N>,
    &SMatrix<f64, N, M>,
    &SMatrix<f64, N, N>,
    &SMatrix<f64, M, M>,
) -> Result<Solution<N, M>, RiccatiError>;

/// `given` in the upper left corner of a matrix with `fill` on the rest of its diagonal.
fn padded<const R: usize, const C: usize>(
    given: &GivenMatrix<'_>,
    name: &str,
    fill: f64,
) -> PyResult<SMatrix<f64, R, C>> {
    let given = given.as_array();
    let [rows, columns] = [given.shape()[0], given.shape()[1]];
    if rows > R || columns > C {
        return Err(error::usage(format!("{name} is {rows} x {columns}; at most {R} x {C}")));
    }
    Ok(SMatrix::from_fn(|row, column| match (row < rows && column < columns, row == column) {
        (true, _) => given[[row, column]],
        (false, true) if row >= rows && column >= columns => fill,
        (false, _) => 0.0,
    }))
}

impl<'py> Equation<'py> {
    /// Checks the shapes; returns the numbers of states and inputs.
    fn shape(&self) -> PyResult<(usize, usize)> {
        let shape = |matrix: &GivenMatrix<'py>| {
            (matrix.as_array().shape()[0], matrix.as_array().shape()[1])
        };
        let (n, m) = shape(&self.b);
        let found = [shape(&self.a), shape(&self.b), shape(&self.q), shape(&self.r)];
        let is_right = n > 0 && m > 0 && found == [(n, n), (n, m), (n, n), (m, m)];
        let reason =
            || format!("a, b, q, r are {found:?}; expected (n, n), (n, m), (n, n), (m, m)");
        is_right.then_some((n, m)).ok_or_else(|| error::usage(reason()))
    }

    /// Solves with further states that decay by themselves, at `decay`, and further inputs without effect: neither changes the solution
    /// for the given states.
    fn solve<const N: usize, const M: usize>(
        &self,
        solver: Solver<N, M>,
        decay: f64,
    ) -> PyResult<(DMatrix<f64>, DMatrix<f64>)> {
        let (n, m) = self.shape()?;
        let a = padded::<N, N>(&self.a, "a", decay)?;
        let b = SMatrix::<f64, N, M>::from_fn(|row, column| {
            if row < n && column < m { self.b.as_array()[[row, column]] } else { 0.0 }
        });
        let (q, r) = (padded(&self.q, "q", 1.0)?, padded(&self.r, "r", 1.0)?);
        let Solution { p, k } = solver(&a, &b, &q, &r).map_err(data)?;
        let part =
            |rows, columns, at: &dyn Fn(usize, usize) -> f64| DMatrix::from_fn(rows, columns, at);
        Ok((part(n, n, &|i, j| p[(i, j)]), part(m, n, &|i, j| k[(i, j)])))
    }
}

/// Solves the equation with the least sizes that hold it.
macro_rules! solve {
    ($equation:expr, $solver:ident, $decay:expr) => {{
        let (n, m) = $equation.shape()?;
        match (n, m) {
            (0..=3, 0..=3) => $equation.solve::<3, 3>($solver, $decay),
            (0..=6, 0..=3) => $equation.solve::<6, 3>($solver, $decay),
            (0..=9, 0..=3) => $equation.solve::<9, 3>($solver, $decay),
            _ => $equation.solve::<12, 6>($solver, $decay),
        }
    }};
}

/// Solves a Riccati equation in continuous time, or in discrete time; returns `P` and the gain `K` of `u = -Kx`.
#[pyfunction]
fn riccati<'py>(
    py: Python<'py>,
    is_discrete: bool,
    a: GivenMatrix<'py>,
    b: GivenMatrix<'py>,
    q: GivenMatrix<'py>,
    r: GivenMatrix<'py>,
) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
    // Of the size of the data, so that the solver's scaling is not changed.
    let size = a.as_array().iter().fold(0.0, |size: f64, entry| size.max(entry.abs()));
    let decay = if is_discrete { 0.0 } else { -size.max(f64::MIN_POSITIVE) };
    let equation = Equation { a, b, q, r };
    let (p, k) =
        if is_discrete { solve!(equation, dare, decay)? } else { solve!(equation, care, decay)? };
    Ok((rows_of(py, &p), rows_of(py, &k)))
}

/// States of a gravity turn at `times`, Eqs. (58) to (60): the time at which the lander hovers, and rows of time, angle, down-range
/// distance, drop, forward and sinking velocity.
#[pyfunction]
fn gravity_turn<'py>(
    py: Python<'py>,
    ratios: (f64, f64),
    start: (f64, f64),
    times: GivenVector<'py>,
) -> PyResult<(f64, Matrix<'py>)> {
    let turn = GravityTurn::new(ratios.0, ratios.1, start.0, start.1)
        .map_err(|error| error::usage(error.to_string()))?;
    let row = |time_s: &f64| {
        let TurnState { time_s, angle_rad, down_range_m, drop_m, forward_m_s, sink_m_s } =
            turn.at_time(*time_s);
        vec![time_s, angle_rad, down_range_m, drop_m, forward_m_s, sink_m_s]
    };
    let rows: Vec<Vec<f64>> = times.as_array().iter().map(row).collect();
    let rows = PyArray2::from_vec2(py, &rows).map_err(|error| error::usage(error.to_string()))?;
    Ok((turn.hover_time_s(), rows))
}

/// Registers the functions.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(tracking_error, module)?)?;
    module.add_function(wrap_pyfunction!(error_model, module)?)?;
    module.add_function(wrap_pyfunction!(oqtal_gain, module)?)?;
    module.add_function(wrap_pyfunction!(riccati, module)?)?;
    module.add_function(wrap_pyfunction!(gravity_turn, module)?)
}
