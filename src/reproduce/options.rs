//! Every option of `oqtal`, one at a time, and the term in the second derivative of `eps` that the paper drops.

use nalgebra::{SVector, Vector3};
use oqtal_bus::process::Failure;
use oqtal_control::controller::{
    AttitudeLaw, AttitudeReference, AttitudeState, AugmentedModel, Controller, Gain, InputForm,
    OqtalOptions, TorqueInput, Weights,
};
use oqtal_control::error::AttitudeError;
use oqtal_control::error_model::{ErrorModel, Jacobian, OperatingPoint};
use oqtal_control::quantity::Torque;
use oqtal_control::quaternion::Attitude;
use oqtal_control::schedule::{Cells, GainSchedule, Grid, Resolve};
use rayon::prelude::*;

use super::body::{Manoeuvre, turn_spacecraft};
use super::lander::{Descent, Lander, RATE_HZ};
use super::progress::Progress;
use super::roster::{self, CELLS};
use super::sheet::{Cell, Column, Row, Sheet, Variant};
use super::{Chapter, invalid};

/// A turn that exercises the model: far off, and turning about another axis \[rad, rad/s\].
const FAR: Vector3<f64> = Vector3::new(0.2, 1.2, -0.3);
const TURNING: Vector3<f64> = Vector3::new(0.8, -0.2, 0.5);
const DURATION_S: f64 = 20.0;
/// Width of the cells in the table, small enough that the model changes often.
const DELTA: f64 = 0.05;

const COLUMNS: [Column; 7] = [
    ("position_error", "turn: ∫|x̃| [m s]"),
    ("quaternion_error_norm", "turn: ∫|ε| [s]"),
    ("effort_norm", "turn: ∫|τ| [N m s]"),
    ("riccati_solves", "turn: solves"),
    ("far_quaternion_error_norm", "far: ∫|ε| [s]"),
    ("far_effort_norm", "far: ∫|τ| [N m s]"),
    ("far_riccati_solves", "far: solves"),
];

/// How the second derivative of `eps` enters the model.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Acceleration {
    /// Not at all, as the paper does.
    Dropped,
    /// Differentiated from `eps_dot`, through a low-pass of that many hertz if given.
    Differentiated(Option<f64>),
}

struct Case {
    settings: String,
    options: OqtalOptions,
    acceleration: Acceleration,
}

/// Flies every option.
///
/// # Errors
/// An option of a law has no meaning.
pub fn chapter(lander: &Lander, progress: &Progress) -> Result<Chapter, Failure> {
    let cases = cases();
    let bar = progress.start("options of oqtal", cases.len());
    let fly = |case: &Case| {
        let row = flown(lander, case)?;
        bar.inc();
        Ok(row)
    };
    let rows: Result<Vec<Row>, Failure> = cases.par_iter().map(fly).collect();
    let sheet = Sheet {
        name: "options".to_owned(),
        title: "Options of OQTAL".to_owned(),
        notes: NOTES.map(str::to_owned).to_vec(),
        columns: COLUMNS.to_vec(),
        rows: rows?,
        ..Sheet::default()
    };
    Ok(Chapter { title: "Options of OQTAL", sheets: vec![sheet], ..Chapter::default() })
}

const NOTES: [&str; 2] = [
    "q 256, r 1, 60 Hz hold; \"turn\" is the gravity turn, \"far\" a body 72 degrees from rest that turns at 1 rad/s about \
     another axis, with cells of 0.05.",
    "In the gravity turn the error never leaves the cell of zero, where all models are one: the Jacobians of the paper, with \
     their slips or without, are never used. Far off they differ, and the one that models the body itself, `decoupled`, is \
     not worse than those that count its motion twice. The second derivative of eps comes from differences of noise-free \
     rates here; a filter only delays it.",
];

fn cases() -> Vec<Case> {
    let base = roster::oqtal([256.0, 1.0], Cells::Centred).oqtal;
    let case = |settings: &str, options: OqtalOptions| Case {
        settings: settings.to_owned(),
        options: OqtalOptions { delta_rad: DELTA, ..options },
        acceleration: Acceleration::Dropped,
    };
    let mut cases = Vec::new();
    for (jacobian, name) in JACOBIANS {
        cases.push(case(&format!("jacobian {name}"), OqtalOptions { jacobian, ..base }));
    }
    for (cells, name) in CELLS {
        cases.push(case(&format!("cells {name}"), OqtalOptions { cells, ..base }));
    }
    let every = OqtalOptions { resolve: Resolve::EveryTick, ..base };
    cases.push(case("solved every tick", every));
    for (acceleration, name) in [
        (Acceleration::Differentiated(None), "without filter"),
        (Acceleration::Differentiated(Some(2.0)), "through 2 Hz"),
    ] {
        let exact = OqtalOptions { jacobian: Jacobian::Exact, ..base };
        let settings = format!("jacobian exact, with the second derivative of eps, {name}");
        cases.push(Case { acceleration, ..case(&settings, exact) });
    }
    let fed = OqtalOptions { feed_forward: true, ..base };
    cases.push(case("with feed-forward (not in the paper)", fed));
    cases
}

const JACOBIANS: [(Jacobian, &str); 5] = [
    (Jacobian::Decoupled, "decoupled"),
    (Jacobian::Printed45, "printed-45"),
    (Jacobian::Printed75, "printed-75"),
    (Jacobian::ExactConstantLambda, "exact, lambda constant"),
    (Jacobian::Exact, "exact, lambda of eps"),
];

fn flown(lander: &Lander, case: &Case) -> Result<Row, Failure> {
    let manoeuvre = Manoeuvre {
        attitude: Attitude::from_rotation_vector(FAR),
        rate: TURNING,
        target: Attitude::LEVEL,
        duration_s: DURATION_S,
    };
    let descent = Descent::default();
    let (turn, far) = match case.acceleration {
        Acceleration::Dropped => {
            let mut options = roster::oqtal([256.0, 1.0], Cells::Centred);
            options.oqtal = case.options;
            let law = Controller::new(&options, lander.input(false)).map_err(invalid)?;
            (lander.fly_with(law, &descent, |_| ()), turn_spacecraft(lander, law, &manoeuvre))
        }
        Acceleration::Differentiated(cutoff_hz) => {
            let law = Accelerated::new(case.options, lander.input(false), cutoff_hz);
            let far = turn_spacecraft(lander, law.clone(), &manoeuvre);
            (lander.fly_with(law, &descent, |_| ()), far)
        }
    };
    let eps = |attitude| AttitudeError::between(&Attitude::LEVEL, attitude).eps().norm();
    let far_error: f64 = far.ticks.iter().map(|tick| eps(&tick.attitude) / RATE_HZ).sum();
    let far_effort: f64 = far.ticks.iter().map(|tick| tick.input.norm() / RATE_HZ).sum();
    let cells = vec![
        turn.map(|m| m.position_error).into(),
        turn.map(|m| m.quaternion_error).into(),
        turn.map(|m| m.effort).into(),
        turn.map(|m| m.riccati_solves).into(),
        far_error.into(),
        far_effort.into(),
        Cell::Count(far.riccati_solves.into()),
    ];
    let variant = if case.options.feed_forward { Variant::Ours } else { Variant::AsPrinted };
    Ok(Row::new(variant, "oqtal", case.settings.clone(), cells))
}

/// OQTAL with the second derivative of `eps` in its model.
#[derive(Clone, Debug)]
struct Accelerated {
    options: OqtalOptions,
    input: TorqueInput,
    schedule: GainSchedule<6, Gain>,
    cutoff_hz: Option<f64>,
    eps_dot: Option<Vector3<f64>>,
    eps_ddot: Vector3<f64>,
}

impl Accelerated {
    fn new(options: OqtalOptions, input: TorqueInput, cutoff_hz: Option<f64>) -> Self {
        let OqtalOptions { cells, delta_rad, resolve, .. } = options;
        let schedule = GainSchedule::new(Grid { cells, delta: delta_rad, resolve });
        Self { options, input, schedule, cutoff_hz, eps_dot: None, eps_ddot: Vector3::zeros() }
    }

    /// Takes the newest derivative of `eps`.
    fn differentiate(&mut self, eps_dot: Vector3<f64>, dt_s: f64) {
        let weight = self
            .cutoff_hz
            .map_or(1.0, |cutoff_hz| -(-std::f64::consts::TAU * cutoff_hz * dt_s).exp_m1());
        if let Some(last) = self.eps_dot.replace(eps_dot) {
            self.eps_ddot += ((eps_dot - last) / dt_s - self.eps_ddot) * weight;
        }
    }
}

impl AttitudeLaw for Accelerated {
    type Command = Torque;

    fn command(
        &mut self,
        state: &AttitudeState,
        reference: &AttitudeReference,
        dt_s: f64,
    ) -> Torque {
        let error = AttitudeError::between(&reference.attitude, &state.attitude);
        let omega_e = error.rate_error(state.rate, reference.rate);
        self.differentiate(error.eps_dot(&omega_e), dt_s);
        let x = SVector::<f64, 6>::from_iterator(omega_e.iter().chain(error.eps()).copied());
        let (options, input, eps_ddot) = (&self.options, &self.input, self.eps_ddot);
        let gain = self.schedule.gain(&x, |point| {
            let (omega_e, eps) = (point.fixed_rows::<3>(0).into(), point.fixed_rows::<3>(3).into());
            let point = OperatingPoint { eps_ddot, ..OperatingPoint::new(eps, omega_e) };
            let model = ErrorModel::at(options.jacobian, &point).state_matrix();
            AugmentedModel::new(&model, input).gain(&Weights {
                rate: options.rate_weight,
                attitude: options.attitude_weight,
                integral: 0.0,
                input: options.input_weight,
            })
        });
        // Eq. (56), erratum E-56
        let torque = -(gain.fixed_columns::<6>(0) * x) + self.input.gyroscopic(state.rate);
        Torque(self.input.saturate(&torque))
    }

    fn reset(&mut self) {
        self.schedule.reset();
        self.eps_dot = None;
        self.eps_ddot = Vector3::zeros();
    }

    fn riccati_solves(&self) -> u32 {
        self.schedule.solves()
    }

    fn failed_solves(&self) -> u32 {
        self.schedule.failed_solves()
    }
}
