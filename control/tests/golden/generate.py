"""Makes the golden data of this folder again, and compares it with what is committed.

    python3 -m venv ~/golden && ~/golden/bin/pip install -r requirements.txt
    ~/golden/bin/python generate.py               # compares, to the tolerances of the tests
    ~/golden/bin/python generate.py --write DIR   # writes care.json, dare.json and kinematics.json into DIR

Nothing here uses the project's own code. The data are from numpy, scipy and mpmath: models by complex-step derivatives of the
defining equations (models.py), Riccati solutions in 50 digits (riccati.py), rotations by scipy. The random attitudes and rates
of kinematics.json were drawn once and are read from the committed file; everything that follows from them is computed.
"""

import argparse
import json
import pathlib
import sys

import numpy as np
from scipy.spatial.transform import Rotation

import models
import riccati

HERE = pathlib.Path(__file__).parent
H = 1 / 60
ZERO, MID, LARGE = (
    (np.zeros(3),) * 3,
    ([0.2, -0.1, 0.15], [0.3, -0.2, 0.25], np.zeros(3)),
    ([0.5, 0.4, -0.3], [1, -0.8, 0.6], [0.1, 0.2, -0.3]),
)
J_HALF = 0.5 * np.eye(3)
J_FULL = np.array([[0.6, 0.05, -0.02], [0.05, 0.5, 0.03], [-0.02, 0.03, 0.7]])
J_HUMMINGBIRD = np.diag([0.0075, 0.0075, 0.013])
J_SMALL = np.array([[0.0082, 0.0006, -0.0003], [0.0006, 0.0075, 0.0004], [-0.0003, 0.0004, 0.0149]])
LARGEST = 2.0**20


def case(name, a, inertia, q, r=1.0, integral=False):
    """A problem with Q = q I, R = r I; q/100 on the integral, Eq. (62)."""
    weights = [q] * 6 if np.isscalar(q) else list(q)
    if integral:
        a, weights = models.with_integral(a), [*weights, *[0.01 * q] * 3]
    b = np.zeros((len(a), 3))
    b[:3] = np.linalg.inv(inertia)
    return {"name": name, "A": a, "B": b, "Q": np.diag(weights), "R": r * np.eye(3)}


def oqtal_cases():
    a = models.oqtal_a
    for q in (1, 4096, LARGEST):
        yield case(f"oqtal6_zero_J0.5_q{q:g}", a("decoupled", *ZERO), J_HALF, q)
    yield case("oqtal6_decoupled_mid", a("decoupled", *MID), J_HALF, 256)
    yield case("oqtal6_decoupled_large_Jfull", a("decoupled", *LARGE), J_FULL, 100)
    yield case("oqtal6_printed45_46_large_Jfull", a("printed45", *LARGE), J_FULL, 100)
    yield case("oqtal6_printed75_79_mid", a("printed75", *MID), J_HALF, 256)
    yield case("oqtal6_exact_lamconst_mid", a("exact_lamconst", *MID), J_HALF, 256)
    yield case("oqtal6_exact_lamconst_large_Jfull", a("exact_lamconst", *LARGE), J_FULL, 100)
    yield case("oqtal6_exact_lamvar_large_Jfull", a("exact_lamvar", *LARGE), J_FULL, 100)
    for q in (20, LARGEST):
        name = f"oqtal9_int_zero_Jhummingbird_q{q:g}"
        yield case(name, a("decoupled", *ZERO), J_HUMMINGBIRD, q, integral=True)
    yield case("oqtal9_int_exact_lamvar_Jfull", a("exact_lamvar", *MID), J_SMALL, 200, integral=True)


def classic_cases():
    a = models.classic_a
    swaying, turning = [0.2, -0.2, 0.2], [0.5, -0.5, 0.5]
    for name, omega, phi, theta in [
        ("classic6_th0.0000_w0_q128", np.zeros(3), 0.0, 0.0),
        ("classic6_th0.2000_w-0.2_q128", [0, -0.2, 0], 0.2, 0.2),
        ("classic6_th1.4000_w0_q128", np.zeros(3), 0.0, 1.4),
        ("classic6_th1.5000_w-0.2_q128", swaying, 0.2, 1.5),
        ("classic6_th1.5707_w0_q128", np.zeros(3), 0.0, np.pi / 2 - 1e-4),
    ]:
        yield case(name, a(J_HALF, omega, [phi, theta, 0]), J_HALF, 128)
    tilted = a(J_FULL, [0.4, -0.2, 0.6], [0.3, 0.6, 0])
    yield case("classic6_th0.6_Jfull_q1_r1", tilted, J_FULL, 1)
    yield case(f"classic6_th0.6_Jfull_q1_r{LARGEST:g}", tilted, J_FULL, 1, r=LARGEST)
    for theta, q in [(0, 20), (1, 200), (1.4, LARGEST)]:
        name = f"classic9_int_th{theta:g}_q{q:g}"
        yield case(name, a(J_SMALL, turning, [-0.2, theta, 0]), J_SMALL, q, integral=True)


def other_cases():
    # The rate is commanded: x = [eps; eps_I], and B is what the rate does to eps.
    for name, eps in [("oqtal_rate6_int_q200_eps0", np.zeros(3)), ("oqtal_rate6_int_q200_eps", [0.1, -0.05, 0.2])]:
        b = np.zeros((6, 3))
        b[:3] = 2 * models.oqtal_a("decoupled", eps, *ZERO[1:])[3:, :3]
        weights = np.diag([200] * 3 + [2] * 3)
        yield {"name": name, "A": models.with_integral(np.zeros((3, 3))), "B": b, "Q": weights, "R": np.eye(3)}
    random = np.random.default_rng(42)
    for n in (6, 9):
        a, b, root_q = (random.standard_normal((n, columns)) for columns in (n, 3, n))
        q, r = root_q @ root_q.T + 0.1 * np.eye(n), np.diag(random.uniform(0.1, 10, 3))
        yield {"name": f"random_{n}x3", "A": a, "B": b, "Q": q, "R": r}
    double_integrator = models.oqtal_a("decoupled", *ZERO)
    yield case("double_integrator_tinyJ_1e-5", double_integrator, 1e-5 * np.eye(3), 256)


def with_poles(case, a, b):
    poles = np.linalg.eigvals(a - b @ case["K"])
    poles = poles[np.lexsort((poles.imag, poles.real))]
    return case | {"eig_re": poles.real, "eig_im": poles.imag}


def care_data():
    cases = []
    for case in (*oqtal_cases(), *classic_cases(), *other_cases()):
        a, b, q, r = (case[key] for key in "ABQR")
        p, k = riccati.care(a, b, q, r)
        case |= {"n": len(a), "m": 3, "P": p, "K": k, "cond_P": np.linalg.cond(p)}
        cases.append(with_poles(case, a, b))
    return {"convention": "A'P + PA - P B R^-1 B'P + Q = 0, u = -Kx, lists row-major", "cases": cases}


def dare_data():
    a, cases = models.oqtal_a, []
    split = [1024.0] * 3 + [LARGEST] * 3
    for case_ in (
        case("oqtal6_J0.5_q256", a("decoupled", *ZERO), J_HALF, 256),
        case("oqtal6_split_qe2^20_qw1024", a("decoupled", *ZERO), J_HALF, split),
        case("oqtal6_Jfull_lamvar", a("exact_lamvar", *MID), J_FULL, 256),
        case("oqtal9_int_q200", a("decoupled", *ZERO), J_SMALL, 200, integral=True),
    ):
        ad, bd = riccati.zero_order_hold(case_["A"], case_["B"], H)
        q, r = H * case_["Q"], H * case_["R"]
        p, k = riccati.dare(ad, bd, q, r)
        case_ |= {"h": H, "Ad": ad, "Bd": bd, "Q": q, "R": r, "P": p, "K": k}
        cases.append(with_poles(case_, ad, bd))
    convention = "P = Ad'PAd - Ad'PBd (R + Bd'PBd)^-1 Bd'PAd + Q, Q = h Qc, R = h Rc, zero-order hold"
    return {"convention": convention, "cases": cases}


def rotation(euler):
    """Body to world, 3-2-1."""
    return Rotation.from_euler("ZYX", np.asarray(euler)[::-1])


def like(quaternion, sign_of):
    """The quaternion of the same attitude whose sign is that of `sign_of`."""
    return quaternion if quaternion @ np.asarray(sign_of) >= 0 else -quaternion


def error(sample, q, q_des):
    """q_e = q_des^-1 (x) q, C and omega_e."""
    turned = q_des.inv() * q
    raw = turned.as_quat()
    c = turned.inv().as_matrix()
    omega_e = np.array(sample["omega"]) - c @ np.array(sample["omega_d"])
    return raw if raw[3] >= 0 else -raw, c, omega_e


def kinematics_of(sample):
    theta, omega = np.array(sample["euler_phi_theta_psi"]), np.array(sample["omega"])
    q, q_des = rotation(theta), rotation(sample["euler_des"])
    q_e, c, omega_e = error(sample, q, q_des)
    q_e = like(q_e, sample["q_e"]) if abs(q_e[3]) < 1e-12 else q_e
    eps, lam = q_e[:3], q_e[3]
    eps_dot, lambda_dot = models.eps_dot(eps, lam, omega_e), -eps @ omega_e / 2
    omega_e_dot = np.array(sample["omega_e_dot"])
    # The time derivative of Eq. (38).
    eps_ddot = models.eps_dot(eps, lam, omega_e_dot) + models.eps_dot(eps_dot, lambda_dot, omega_e)
    quaternion = like(q.as_quat(), sample["q"])
    q_dot = np.array([*np.cross(quaternion[:3], omega) + quaternion[3] * omega, -quaternion[:3] @ omega]) / 2
    rates = models.euler_rate_matrix(theta)
    found = sample | {
        "q": quaternion,
        # Eq. (6) as printed is the quaternion of the angles with roll and pitch exchanged.
        "q_eq6_literal": like(rotation(theta[[1, 0, 2]]).as_quat(), sample["q_eq6_literal"]),
        "R16": q.inv().as_matrix(),
        "Hinv": rates,
        "q_des": like(q_des.as_quat(), sample["q_des"]),
        "q_e": q_e,
        "q_e_raw": like(q_e, sample["q_e_raw"]),
        "C_BB": c,
        "omega_e": omega_e,
        "q_dot": q_dot,
        "euler_rates": rates @ omega,
        "eps_dot": eps_dot,
        "lambda_dot": lambda_dot,
        "eps_ddot": eps_ddot,
    }
    if sample.get("jac") is not None:
        eps_ddot = np.array(sample["jac"]["eps_ddot_used"])
        known = {"eps": eps, "lam": lam, "omega_e": omega_e, "eps_ddot_used": eps_ddot}
        found["jac"] = known | models.jacobians(eps, lam, omega_e, eps_ddot)
    return found


def dynamics_of(sample):
    inertia, omega = np.array(sample["J"]), np.array(sample["omega"])
    omega_dot = models.acceleration(inertia, omega, np.array(sample["tau"]))
    q, q_des = Rotation.from_quat(sample["q"]), Rotation.from_quat(sample["q_des"])
    q_e, c, omega_e = error(sample, q, q_des)
    # omega_e = omega - C omega_d with C_dot = -omega_e x C.
    omega_d, omega_d_dot = np.array(sample["omega_d"]), np.array(sample["omega_d_dot"])
    omega_e_dot = omega_dot - c @ omega_d_dot + np.cross(omega_e, c @ omega_d)
    q_e = like(q_e, sample["q_e"])
    return sample | {"omega_dot": omega_dot, "q_e": q_e, "omega_e": omega_e, "omega_e_dot": omega_e_dot}


def kinematics_data(drawn):
    convention = (
        "quaternion [x, y, z, w] body to world; R16 world to body; Euler angles 3-2-1; q_e = q_des^-1 (x) q, lambda >= 0 in q_e, "
        "either sign in q_e_raw; C_BB desired body to body; omega_e = omega - C omega_d"
    )
    samples = [kinematics_of(sample) for sample in drawn["samples"]]
    return {"convention": convention, "samples": samples, "dynamics": [dynamics_of(d) for d in drawn["dynamics"]]}


def plain(value):
    """Lists and numbers, as JSON has them."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def worst(made, committed, path=""):
    """The greatest absolute difference of two kinematic records, and where it is."""
    if isinstance(made, dict):
        return max((worst(made[key], committed[key], f"{path}.{key}") for key in made), key=lambda pair: pair[0])
    if made is None:
        return (0.0, path)
    return (float(np.max(np.abs(np.subtract(made, committed)))), path)


def compare(name, made, committed):
    """Differences beyond the tolerances of the tests, one line each."""
    wrong = []
    if name == "kinematics":
        for kind in ("samples", "dynamics"):
            for index, pair in enumerate(zip(made[kind], committed[kind], strict=True)):
                difference, path = worst(*pair)
                if not difference <= 1e-12:
                    wrong.append(f"{kind}[{index}]{path} is off by {difference:.1e}")
        return wrong
    for ours, theirs in zip(made["cases"], committed["cases"], strict=True):
        if ours["name"] != theirs["name"]:
            wrong.append(f"{ours['name']} is {theirs['name']} in the file")
        loose = 1e-7 if theirs.get("cond_P", 0) > 1e12 else 1e-9
        for key, allowed in [("A", 1e-12), ("B", 1e-12), ("Q", 1e-12), ("R", 1e-12), ("P", loose), ("K", loose)]:
            known = np.array(theirs[key])
            difference = np.linalg.norm(np.array(ours[key]) - known) / max(np.linalg.norm(known), 1e-300)
            if not (difference <= allowed or np.array_equal(ours[key], known)):
                wrong.append(f"{ours['name']}: {key} is off by {difference:.1e}")
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", metavar="DIR", type=pathlib.Path)
    directory = parser.parse_args().write
    failed = False
    for name in ("care", "dare", "kinematics"):
        committed = json.loads((HERE / f"{name}.json").read_text())
        data = {"care": care_data, "dare": dare_data}.get(name, lambda: kinematics_data(committed))()
        data = plain(data)
        if directory:
            (directory / f"{name}.json").write_text(json.dumps(data))
        wrong = compare(name, data, committed)
        print(f"{name}.json: {'as committed' if not wrong else 'differs'}")
        print("".join(f"  {line}\n" for line in wrong), end="")
        failed |= bool(wrong)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
