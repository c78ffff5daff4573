//! Laws written in Python, asked in the control ticks of a flight in this process.

use numpy::{PyArray1, PyArrayMethods};
use oqtal_bus::code::HandoverCause;
use oqtal_bus::message::{ExternalV1, Message, StateV1};
use oqtal_daemon::{ExternalLaw, without_answer};
use pyo3::prelude::*;

/// Offset of the numbers of a question: `period_s` and all fields after it \[bytes\].
const NUMBERS_AT: usize = 6 * 8;
/// Numbers of an answer: rates, torque, attitude, thrust.
const ANSWER: usize = 3 + 3 + 4 + 1;

/// Answers of a law, with which its flight can be flown again.
pub type LawTape = Vec<ExternalV1>;

/// A law of `oqtal.python_law`: an object with `reset()` and `answer(numbers, flown, time_s)`.
pub struct PythonLaw {
    object: Py<PyAny>,
    /// The exception that ended the law.
    pub raised: Option<PyErr>,
    /// Answers of the law.
    pub tape: LawTape,
}

impl PythonLaw {
    /// The law `object`.
    pub fn new(object: Py<PyAny>) -> Self {
        Self { object, raised: None, tape: Vec::with_capacity(4096) }
    }

    /// Answer to `state`.
    fn asked(&self, py: Python<'_>, state: &StateV1) -> PyResult<ExternalV1> {
        let mut bytes = [0; StateV1::SIZE];
        state.encode(&mut bytes);
        let numbers = bytes[NUMBERS_AT..].as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b));
        let numbers = PyArray1::from_iter(py, numbers);
        let time_s = state.time.seconds();
        let question = (numbers, state.flown != 0, time_s);
        let answer = self.object.call_method1(py, "answer", question)?;
        let answer = answer.bind(py).cast::<PyArray1<f64>>()?.readonly();
        let [rx, ry, rz, tx, ty, tz, qx, qy, qz, qw, thrust]: [f64; ANSWER] = answer
            .as_slice()?
            .try_into()
            .map_err(|_| crate::error::usage("an answer has 11 numbers"))?;
        Ok(ExternalV1 {
            sequence: state.sequence,
            rate: [rx, ry, rz],
            torque: [tx, ty, tz],
            attitude: [qx, qy, qz, qw],
            thrust,
            ..ExternalV1::default()
        })
    }
}

impl ExternalLaw for PythonLaw {
    fn reset(&mut self) {
        if self.raised.is_some() {
            return;
        }
        if let Err(raised) = Python::attach(|py| self.object.call_method0(py, "reset")) {
            self.raised = Some(raised);
        }
    }

    fn has_ended(&self) -> bool {
        self.raised.is_some()
    }

    fn answer(&mut self, state: &StateV1) -> Option<ExternalV1> {
        let asked = match self.raised {
            None => Python::attach(|py| self.asked(py, state)),
            Some(_) => Ok(without_answer(HandoverCause::Ended)),
        };
        let answer = asked.unwrap_or_else(|raised| {
            self.raised = Some(raised);
            without_answer(HandoverCause::Ended)
        });
        self.tape.push(answer);
        Some(answer)
    }
}

/// The answers of a law, given again.
pub struct TapedLaw<'a>(pub std::slice::Iter<'a, ExternalV1>);

impl ExternalLaw for TapedLaw<'_> {
    fn reset(&mut self) {}

    fn answer(&mut self, _: &StateV1) -> Option<ExternalV1> {
        self.0.next().copied()
    }
}
