"""Riccati equations in 50 digits: scipy's solution, refined by Newton's method."""

import mpmath
import numpy as np
import scipy.linalg

mpmath.mp.dps = 50
STEPS = 3


def to_mp(matrix):
    return mpmath.matrix(np.asarray(matrix).tolist())


def to_double(matrix):
    return np.array(matrix.tolist(), dtype=float).reshape(matrix.rows, matrix.cols)


def lyapunov(left, right, weight):
    """X of left' X right - X + weight = 0 if discrete, else of left' X + X left + weight = 0 (`right` is None)."""
    n = left.rows
    system, rhs = mpmath.zeros(n * n), mpmath.zeros(n * n, 1)
    for i in range(n):
        for j in range(n):
            row = i * n + j
            rhs[row] = -weight[i, j]
            if right is None:
                for k in range(n):
                    system[row, k * n + j] += left[k, i]
                    system[row, i * n + k] += left[k, j]
            else:
                system[row, row] -= 1
                for k in range(n):
                    for l in range(n):
                        system[row, k * n + l] += left[k, i] * right[l, j]
    x = mpmath.lu_solve(system, rhs)
    return mpmath.matrix([[x[i * n + j] for j in range(n)] for i in range(n)])


def care(a, b, q, r):
    """P and K of A'P + PA - P B R^-1 B' P + Q = 0, K = R^-1 B' P (Kleinman, 1968)."""
    p = to_mp(scipy.linalg.solve_continuous_are(a, b, q, r))
    a, b, q, r = (to_mp(m) for m in (a, b, q, r))
    inverse_r = mpmath.inverse(r)
    gain = lambda p: inverse_r * (b.T * p)
    for _ in range(STEPS):
        k = gain(p)
        p = lyapunov(a - b * k, None, q + k.T * r * k)
    return to_double(p), to_double(gain(p))


def dare(a, b, q, r):
    """P and K of P = A'PA - A'PB (R + B'PB)^-1 B'PA + Q (Hewer, 1971)."""
    p = to_mp(scipy.linalg.solve_discrete_are(a, b, q, r))
    a, b, q, r = (to_mp(m) for m in (a, b, q, r))
    gain = lambda p: mpmath.inverse(r + b.T * p * b) * (b.T * p * a)
    for _ in range(STEPS):
        k = gain(p)
        closed = a - b * k
        p = lyapunov(closed, closed, q + k.T * r * k)
    return to_double(p), to_double(gain(p))


def zero_order_hold(a, b, h):
    """(Ad, Bd) of a system whose input is held for h."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a * h, b * h
    held = scipy.linalg.expm(block)
    return held[:n, :n], held[:n, n:]
