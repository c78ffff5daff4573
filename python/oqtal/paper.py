"""The mathematics of the paper (docs/paper.md): tracking error, error models, Riccati equations, gains, gravity turn.

Attitudes are quaternions ``[x, y, z, w]`` with the scalar last, body to world; units are SI.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from oqtal import _native
from oqtal.errors import UsageError
from oqtal.table import Table

#: Versions of the derivatives in the model of the error: decoupled axes, as printed in the paper (Eqs. (45) and (75)), and exact.
JACOBIANS = ("decoupled", "printed-45", "printed-75", "exact-constant-lambda", "exact")


class TrackingError(NamedTuple):
    """The tracking error of Eqs. (8) to (12) and (36)."""

    #: Axis of the error times the sine of half its angle.
    eps: NDArray[np.float64]
    #: Cosine of half the angle, 0 to 1.
    lam: float
    #: ``C``: takes desired-body components to body components.
    rotation: NDArray[np.float64]
    #: Body rate relative to the desired rate [rad/s, body].
    omega_e: NDArray[np.float64]

    @property
    def angle(self) -> float:
        """Angle of the error [rad]."""
        return float(2 * np.arctan2(np.linalg.norm(self.eps), self.lam))


def _array(values: ArrayLike, dimensions: int, name: str) -> NDArray[np.float64]:
    array = np.ascontiguousarray(values, dtype=float)
    if array.ndim != dimensions:
        raise UsageError(f"{name} has {array.ndim} dimensions; expected {dimensions}")
    if not np.isfinite(array).all():
        raise UsageError(f"{name} is {values!r}; expected finite numbers")
    if name == "eps" and np.linalg.norm(array) > 1.0:
        raise UsageError(f"eps is {values!r}; the vector part of a unit quaternion has a norm of at most 1")
    return array


def tracking_error(
    desired: ArrayLike,
    attitude: ArrayLike,
    rate: ArrayLike = (0.0, 0.0, 0.0),
    desired_rate: ArrayLike = (0.0, 0.0, 0.0),
) -> TrackingError:
    """The error of a body at ``attitude`` that should be at ``desired``, with rates in body and desired-body axes [rad/s]."""
    given = (("desired", desired), ("attitude", attitude), ("rate", rate), ("desired_rate", desired_rate))
    return TrackingError(*_native.tracking_error(*(_array(values, 1, name) for name, values in given)))


def error_model(jacobian: str, eps: ArrayLike, omega_e: ArrayLike, eps_ddot: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    """``A`` of Eq. (41) for the state ``[omega_e; eps]`` at an operating point, by one of ``JACOBIANS``."""
    if jacobian not in JACOBIANS:
        raise UsageError(f"jacobian is {jacobian!r}; expected one of {', '.join(JACOBIANS)}")
    given = (("eps", eps), ("omega_e", omega_e), ("eps_ddot", eps_ddot))
    return _native.error_model(jacobian, *(_array(values, 1, name) for name, values in given))


def oqtal_gain(
    eps: ArrayLike = (0.0, 0.0, 0.0),
    omega_e: ArrayLike = (0.0, 0.0, 0.0),
    *,
    inertia: ArrayLike | None = None,
    rate_authority: ArrayLike | None = None,
    **options: Any,
) -> NDArray[np.float64]:
    """``K`` of Eq. (56), 3 x 9 for ``[omega_e; eps; eps_I]``, at an operating point.

    Give the ``inertia`` of a vehicle commanded by torque [kg m^2], or the ``rate_authority`` of one commanded by sticks [rad/s].
    ``options`` are the keys of ``[control.oqtal]``, such as ``attitude_weight=80`` or ``jacobian="exact"``.
    """
    keys = json.dumps({name.replace("_", "-"): value for name, value in options.items()})
    point = np.concatenate([_array(omega_e, 1, "omega_e"), _array(eps, 1, "eps")])
    body = None if inertia is None else _array(inertia, 2, "inertia")
    authority = None if rate_authority is None else _array(rate_authority, 1, "rate_authority")
    return _native.oqtal_gain(keys, point, body, authority)


class RiccatiSolution(NamedTuple):
    """The stabilising solution of a Riccati equation."""

    #: The cost from ``x`` onwards is ``x' P x``.
    p: NDArray[np.float64]
    #: The gain of ``u = -K x``.
    k: NDArray[np.float64]


def care(a: ArrayLike, b: ArrayLike, q: ArrayLike, r: ArrayLike) -> RiccatiSolution:
    """Solves ``A'P + PA - P B R^-1 B' P + Q = 0``, for at most 12 states and 6 inputs."""
    given = (_array(values, 2, name) for name, values in (("a", a), ("b", b), ("q", q), ("r", r)))
    return RiccatiSolution(*_native.riccati(False, *given))


def dare(a: ArrayLike, b: ArrayLike, q: ArrayLike, r: ArrayLike) -> RiccatiSolution:
    """Solves ``P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q``, for at most 12 states and 6 inputs."""
    given = (_array(values, 2, name) for name, values in (("a", a), ("b", b), ("q", q), ("r", r)))
    return RiccatiSolution(*_native.riccati(True, *given))


class GravityTurn:
    """Descent with constant thrust opposite to the velocity, Eqs. (58) to (60): at rest at ``hover_time_s``, then rising."""

    def __init__(self, thrust_ratio: float, gravity: float, speed: float, angle: float) -> None:
        """``thrust_ratio``: thrust over weight. ``gravity`` [m/s^2]. ``speed`` [m/s] at ``angle`` from the vertical [rad]."""
        self._turn = ((float(thrust_ratio), float(gravity)), (float(speed), float(angle)))
        #: Time at which the lander hovers [s].
        self.hover_time_s: float = _native.gravity_turn(*self._turn, np.zeros(1))[0]

    def at(self, times: ArrayLike) -> Table:
        """States at ``times`` after the start [s]."""
        _, rows = _native.gravity_turn(*self._turn, _array(np.atleast_1d(times), 1, "times"))
        names = ("time_s", "angle_rad", "down_range_m", "drop_m", "forward_m_s", "sink_m_s")
        return Table(dict(zip(names, rows.T, strict=True)))
