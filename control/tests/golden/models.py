"""Models of the attitude error and of Euler angles, from their defining equations.

Derivatives are taken of the equations themselves, by complex steps, so that a slip in a derived formula cannot hide here.
The printed Jacobians of the paper are no derivatives of anything and are written out as printed.
"""

import numpy as np

EYE = np.eye(3)


def skew(v):
    """The matrix of the cross product: skew(v) @ w = v x w."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def derivative(function, x):
    """The Jacobian of a real-analytic function at x, exact to rounding: a complex step has no difference to cancel."""
    step = 1e-30
    columns = [np.imag(function(x + 1j * step * axis)) / step for axis in np.eye(len(x))]
    return np.array(columns).T


def eps_dot(eps, lam, omega_e):
    """Eq. (38)."""
    return (lam * omega_e + skew(eps) @ omega_e) / 2


def omega_e_dot_of_eps(eps, lam, omega_e, eps_ddot):
    """Eq. (37)."""
    m = lam * EYE - skew(eps) + np.outer(eps, eps) / lam
    return 2 * m @ (eps_ddot + omega_e @ omega_e / 4 * eps)


def lambda_of(eps):
    """lambda of a unit quaternion, the short way round."""
    return np.sqrt(1 - eps @ eps)


def lambda_near(eps, lam):
    """lambda as a function about (eps, lam): without the rounding of 1 - eps'eps, which matters where lam is small."""
    return lambda x: np.sqrt(lam * lam + (eps @ eps - x @ x))


def jacobians(eps, lam, omega_e, eps_ddot):
    """Every version of the blocks of Eq. (41), under the names of the data files."""
    e, w, a = eps, omega_e, eps_ddot
    lam_of = lambda_near(eps, lam)
    ee, e_e_i = np.outer(e, e), (e @ e) * EYE
    acceleration = skew(a) + (np.outer(e, a) + e @ a * EYE) / lam
    # Eqs. (45) and (75) as printed.
    printed_45 = 2 * (acceleration + w @ w / 4 * (lam * EYE - 2 * skew(e) + ee / lam) + (ee + e_e_i) / lam)
    printed_75 = 2 * (acceleration + w @ w / 4 * (lam * EYE - 2 * skew(e) + (ee + e_e_i) / lam))
    # Eqs. (46) and (79) as printed: half of the derivative.
    printed_46 = np.outer((lam * EYE - skew(e) + ee / lam) @ e / 2, w)
    return {
        "A_w_eps_exact_lambda_const": derivative(lambda x: omega_e_dot_of_eps(x, lam, w, a), e),
        "A_w_eps_exact_lambda_of_eps": derivative(lambda x: omega_e_dot_of_eps(x, lam_of(x), w, a), e),
        "A_w_eps_printed45": printed_45,
        "A_w_eps_printed75": printed_75,
        "A_w_w_exact": derivative(lambda x: omega_e_dot_of_eps(e, lam, x, a), w),
        "A_w_w_printed46_79": printed_46,
        "A_epsdot_eps_lambda_const": derivative(lambda x: eps_dot(x, lam, w), e),
        "A_epsdot_eps_lambda_of_eps": derivative(lambda x: eps_dot(x, lam_of(x), w), e),
        "A_epsdot_w": derivative(lambda x: eps_dot(e, lam, x), w),
    }


def oqtal_a(variant, eps, omega_e, eps_ddot):
    """A of Eq. (41) for [omega_e; eps]."""
    eps, omega_e, eps_ddot = (np.asarray(v, float) for v in (eps, omega_e, eps_ddot))
    jac = jacobians(eps, lambda_of(eps), omega_e, eps_ddot)
    zero = np.zeros((3, 3))
    omega_omega, omega_eps, lam = {
        "decoupled": (zero, zero, "of_eps"),
        "printed45": (jac["A_w_w_printed46_79"], jac["A_w_eps_printed45"], "const"),
        "printed75": (jac["A_w_w_printed46_79"], jac["A_w_eps_printed75"], "const"),
        "exact_lamconst": (jac["A_w_w_exact"], jac["A_w_eps_exact_lambda_const"], "const"),
        "exact_lamvar": (jac["A_w_w_exact"], jac["A_w_eps_exact_lambda_of_eps"], "of_eps"),
    }[variant]
    return np.block([[omega_omega, omega_eps], [jac["A_epsdot_w"], jac[f"A_epsdot_eps_lambda_{lam}"]]])


def euler_rate_matrix(theta):
    """H^-1 of Eq. (2): Euler rates [phi, theta, psi] from body rates."""
    (sin_phi, sin_theta, _), (cos_phi, cos_theta, _) = np.sin(theta), np.cos(theta)
    # The columns of H: the body components of the three axes of rotation.
    h = np.array([[1, 0, -sin_theta], [0, cos_phi, cos_theta * sin_phi], [0, -sin_phi, cos_theta * cos_phi]])
    return np.linalg.inv(h)


def acceleration(inertia, omega, torque):
    """Eq. (3), corrected."""
    return np.linalg.solve(inertia, torque - skew(omega) @ (inertia @ omega))


def classic_a(inertia, omega, theta):
    """A of the classic law for [omega; Theta], Eq. (31), which takes omega x and H^-1 for constants: no derivative."""
    a = np.zeros((6, 6))
    a[:3, :3] = -np.linalg.inv(inertia) @ skew(omega) @ inertia
    a[3:, :3] = euler_rate_matrix(np.asarray(theta, float))
    return a


def with_integral(a):
    """A with the integral of the error, its sign changed, as three further states: Eq. (57), corrected."""
    n = len(a)
    grown = np.zeros((n + 3, n + 3))
    grown[:n, :n] = a
    grown[n:, n - 3 : n] = -EYE
    return grown
