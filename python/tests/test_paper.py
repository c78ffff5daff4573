"""The mathematics of the paper, against scipy."""

from __future__ import annotations

import numpy as np
import pytest

import oqtal
from oqtal import paper

linalg = pytest.importorskip("scipy.linalg")
rotations = pytest.importorskip("scipy.spatial.transform").Rotation
integrate = pytest.importorskip("scipy.integrate")


def random_system(rng, n, m):
    a, b = rng.normal(size=(n, n)), rng.normal(size=(n, m))
    root = rng.normal(size=(n, n))
    return a, b, root @ root.T + np.eye(n), np.diag(rng.uniform(0.5, 2.0, m))


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (3, 3), (4, 2), (6, 3), (9, 3), (12, 6)])
@pytest.mark.parametrize("seed", range(5))
def test_riccati_solutions_are_those_of_scipy(n, m, seed):
    a, b, q, r = random_system(np.random.default_rng(seed), n, m)
    p = linalg.solve_continuous_are(a, b, q, r)
    ours = paper.care(a, b, q, r)
    np.testing.assert_allclose(ours.p, p, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(ours.k, np.linalg.solve(r, b.T @ p), rtol=1e-7, atol=1e-8)
    p = linalg.solve_discrete_are(a, b, q, r)
    ours = paper.dare(a, b, q, r)
    np.testing.assert_allclose(ours.p, p, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(ours.k, np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a), rtol=1e-7, atol=1e-8)


def test_equations_without_a_solution_are_refused():
    eye = np.eye(2)
    with pytest.raises(oqtal.DataError, match="reached by the input"):
        paper.care(eye, np.zeros((2, 1)), eye, np.eye(1))
    with pytest.raises(oqtal.DataError, match="R is not positive definite"):
        paper.care(eye, eye, eye, -eye)
    with pytest.raises(oqtal.UsageError, match="expected"):
        paper.care(eye, np.zeros((3, 1)), eye, np.eye(1))
    with pytest.raises(oqtal.UsageError, match="dimensions"):
        paper.care([1.0], eye, eye, eye)


@pytest.mark.parametrize("seed", range(20))
def test_the_tracking_error_is_the_rotation_between_attitudes(seed):
    desired, actual = rotations.random(2, rng=np.random.default_rng(seed))
    rng = np.random.default_rng(1000 + seed)
    rate, desired_rate = rng.normal(size=3), rng.normal(size=3)
    found = paper.tracking_error(desired.as_quat(), actual.as_quat(), rate, desired_rate)
    between = desired.inv() * actual
    assert found.angle == pytest.approx(between.magnitude(), abs=1e-12)
    np.testing.assert_allclose(found.rotation, between.inv().as_matrix(), atol=1e-12)
    np.testing.assert_allclose(found.omega_e, rate - between.inv().apply(desired_rate), atol=1e-12)
    assert found.lam >= 0


def errors_of_eps(eps, omega_e, eps_ddot):
    """Eqs. (37) and (38) with lambda as a function of eps."""
    lam = np.sqrt(1 - eps @ eps)
    cross = np.array([[0, -eps[2], eps[1]], [eps[2], 0, -eps[0]], [-eps[1], eps[0], 0]])
    m = lam * np.eye(3) - cross + np.outer(eps, eps) / lam
    return np.concatenate([2 * m @ (eps_ddot + omega_e @ omega_e / 4 * eps), (lam * omega_e + cross @ omega_e) / 2])


@pytest.mark.parametrize("seed", range(10))
def test_the_exact_jacobian_is_the_derivative(seed):
    rng = np.random.default_rng(seed)
    eps, omega_e, eps_ddot = rng.uniform(-0.4, 0.4, 3), rng.normal(size=3), rng.normal(size=3)
    h = 1e-6
    columns = []
    for index in range(6):
        step = np.zeros(6)
        step[index] = h
        ahead = errors_of_eps(eps + step[3:], omega_e + step[:3], eps_ddot)
        behind = errors_of_eps(eps - step[3:], omega_e - step[:3], eps_ddot)
        columns.append((ahead - behind) / (2 * h))
    found = paper.error_model("exact", eps, omega_e, eps_ddot)
    np.testing.assert_allclose(found, np.column_stack(columns), atol=1e-7)
    printed = paper.error_model("printed-45", eps, omega_e, eps_ddot)
    assert np.abs(printed - found).max() > 1e-2, "the printed derivatives have errata"
    assert not paper.error_model("decoupled", eps, omega_e)[:3].any()


def test_unknown_models_are_named():
    with pytest.raises(oqtal.UsageError, match="printed-75"):
        paper.error_model("printed-46", [0, 0, 0], [0, 0, 0])


def test_the_gain_is_that_of_scipy():
    inertia = np.diag([0.01, 0.012, 0.02])
    found = paper.oqtal_gain(inertia=inertia, attitude_weight=100.0, rate_weight=2.0, integral_weight=0.0)
    a = paper.error_model("decoupled", [0, 0, 0], [0, 0, 0])
    b = np.vstack([np.linalg.inv(inertia), np.zeros((3, 3))])
    q, r = np.diag([2.0] * 3 + [100.0] * 3), np.eye(3)
    p = linalg.solve_continuous_are(a, b, q, r)
    np.testing.assert_allclose(found[:, :6], b.T @ p, rtol=1e-8, atol=1e-10)
    sticks = paper.oqtal_gain(rate_authority=[2.0, 2.0, 2.0])
    assert sticks.shape == (3, 9) and (np.diag(sticks[:, 3:6]) > 0).all()
    with pytest.raises(oqtal.UsageError, match="either"):
        paper.oqtal_gain()


def test_the_gravity_turn_satisfies_its_equations():
    turn = paper.GravityTurn(1.5, 3.7, 70.0, np.pi / 2)
    times = np.linspace(0, 0.98 * turn.hover_time_s, 40)
    solved = integrate.solve_ivp(
        lambda _, y: [3.7 * (np.cos(y[1]) - 1.5), -3.7 * np.sin(y[1]) / y[0], y[0] * np.sin(y[1]), y[0] * np.cos(y[1])],
        (0, times[-1]),
        [70.0, np.pi / 2, 0.0, 0.0],
        t_eval=times,
        rtol=1e-11,
        atol=1e-11,
    )
    states = turn.at(times)
    np.testing.assert_allclose(np.hypot(states["forward_m_s"], states["sink_m_s"]), solved.y[0], rtol=1e-7)
    np.testing.assert_allclose(states["down_range_m"], solved.y[2], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(states["drop_m"], solved.y[3], rtol=1e-7, atol=1e-7)
    assert turn.hover_time_s == pytest.approx(22.7027, abs=5e-5)
    with pytest.raises(oqtal.UsageError, match="thrust-ratio"):
        paper.GravityTurn(0.9, 3.7, 70.0, 1.0)
