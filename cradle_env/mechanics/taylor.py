"""The flight of one bob on elastic strings as Taylor series in time: plain arithmetic, on numbers of any kind.

With x and z from the pivot, z upwards, Q = x^2 + z^2, R = sqrt(Q), S = sqrt(Q + a^2) and the stretch s = S - L, eqs. 5
and 6 are

    x'' = -F x - c x' - wind,    z'' = -F z - c z' - fall,    F = T / R,    T = t0 + t1 s + t2 s^2,

T the pull of the four strings over the inertia. s^2 = Q + a^2 - 2 L S + L^2, so that T is linear in S and Q. Products
of series are Cauchy products, a square root is the series whose square is given; so each coefficient follows from those
before (Jorba and Zou, Experimental Mathematics 14, 99 (2005)). `lanes` makes machine code of this text.
"""

import functools
import operator
from typing import Any, NamedTuple


class Forces(NamedTuple):
    """What acts on a bob, per kg of its inertia."""

    half_spacing2: Any  # a^2, m^2
    string: Any  # L, m
    t0: Any  # pull of the strings, as the coefficients of 1, s and s^2
    t1: Any
    t2: Any
    drag: Any  # c, 1/s
    wind: Any  # of drag on a bob that moves with its pivot, m/s^2
    fall: Any  # m/s^2


def flight(x, z, u, w, forces, order, sqrt):
    """Coefficients of x and z, `order` + 1 each, and of Q, `order` - 1, of a bob at (x, z) with velocity (u, w)."""
    a2, string, t0, t1, t2, c, wind, fall = forces
    X, Z = [x, u], [z, w]
    Q = [x * x + z * z]
    R, S = [sqrt(Q[0])], [sqrt(Q[0] + a2)]
    inverse = 1.0 / R[0]
    half_r, half_s = 0.5 * inverse, 0.5 / S[0]
    s = S[0] - string
    F = [(t0 + s * (t1 + s * t2)) * inverse]
    by_s = t1 - 2.0 * string * t2
    X.append(-0.5 * (F[0] * x + c * u + wind))
    Z.append(-0.5 * (F[0] * z + c * w + fall))
    for k in range(1, order - 1):
        Q.append(square(X, k) + square(Z, k))
        R.append(next_of_root(R, Q[k], half_r))
        S.append(next_of_root(S, Q[k], half_s))
        pull = by_s * S[k] + t2 * Q[k]
        F.append((pull - product(F, R, k, range(k))) * inverse)
        scale = -1.0 / ((k + 1) * (k + 2))
        for A in (X, Z):
            A.append((product(F, A, k, range(k + 1)) + (k + 1) * c * A[k + 1]) * scale)
    return X, Z, Q


def product(A, B, k, indices):
    """Sum of A_j B_(k-j) over some j, those in the middle first: they are known before the others."""
    return functools.reduce(operator.add, [A[j] * B[k - j] for j in sorted(indices, key=lambda j: abs(2 * j - k))])


def square(A, k):
    """Coefficient k of A^2."""
    if k == 0:
        return A[0] * A[0]
    twice = 2.0 * product(A, A, k, range((k + 1) // 2))
    return twice if k % 2 else twice + A[k // 2] * A[k // 2]


def next_of_root(A, square_k, half):
    """Coefficient k = len(A) of the series A whose square has the coefficient square_k; half = 1 / (2 A_0)."""
    k = len(A)
    if k > 2:
        square_k = square_k - 2.0 * product(A, A, k, range(1, (k + 1) // 2))
    if k % 2 == 0:
        square_k = square_k - A[k // 2] * A[k // 2]
    return square_k * half


def velocity(A):
    """The derivative of a series; its last coefficient, which would need one more of A, is left out."""
    return [(k + 1) * A[k + 1] if k > 0 else A[1] for k in range(len(A) - 1)]


def work_of_drag(U, W, b):
    """The integral of b (u^2 + w^2) from 0 on, without its first coefficient, which is 0."""
    return [b * (1.0 / (k + 1)) * (square(U, k) + square(W, k)) for k in range(len(U))]


def bends(A, t):
    """(value, slope, second derivative) of a series at t."""
    value, slope, bend = A[-1], None, None
    for coefficient in A[-2::-1]:
        bend = slope if bend is None else bend * t + slope
        slope = value if slope is None else slope * t + value
        value = value * t + coefficient
    return value, slope, 2.0 * bend
