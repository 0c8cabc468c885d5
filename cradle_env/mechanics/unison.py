"""How far the bobs are from swinging in unison: every bob's swing about its resting angle.

A swing is the pair (departure from the resting angle, dtheta/dt over the rate of small swings), in rad: a point whose
distance from the origin is the amplitude. Impacts keep the momentum, and with it the mean swing of equal bobs; what
they take, they take from the swings about that mean.
"""

import math

from cradle_env.mechanics.forces import pivot_at
from cradle_env.mechanics.jit import jit
from cradle_env.mechanics.layout import IMPACTS


@jit
def resting_angles(cradle, bobs, t, angles):
    """Writes the angles [rad] at which the bobs rest at time t [s], to first order, to angles (N,).

    Bobs hang straight down, but where the spacer holds their pivots nearer than a diameter: those lean on each other,
    each row of them about its own middle.
    """
    n, first, lean, total = len(bobs), 0, 0.0, 0.0
    for i in range(n):
        angles[i] = lean
        total += lean
        gap = 0.0
        if i < n - 1:
            gap = pivot_at(bobs[i + 1], t) - pivot_at(bobs[i], t) - 2.0 * cradle.radius
        if gap < 0.0:
            lean -= gap
        else:
            for j in range(first, i + 1):
                angles[j] = (angles[j] - total / (i + 1 - first)) / bobs[j].length
            first, lean, total = i + 1, 0.0, 0.0


@jit
def swings(cradle, bobs, seen, angles):
    """(sum of the squared swings about the mean swing, sum of the squared swings), rad^2.

    seen: an observation as `control_interval.observe` writes it; angles (N,): the resting angles.
    """
    n = len(bobs)
    mean_angle, mean_speed = 0.0, 0.0
    for i in range(n):
        mean_angle += (seen[n + i] - angles[i]) / n
        mean_speed += seen[3 * n + i] / n
    apart, total = 0.0, 0.0
    for i in range(n):
        angle, speed, time2 = seen[n + i] - angles[i], seen[3 * n + i], bobs[i].length / cradle.gravity
        apart += (angle - mean_angle) ** 2 + time2 * (speed - mean_speed) ** 2
        total += angle * angle + time2 * speed * speed
    return apart, total


@jit
def have_met(S):
    """Whether every pair of neighbours has had an impact."""
    for q in range(len(S) - 1):
        if S[q, IMPACTS] == 0.0:
            return False
    return True


@jit
def asynchrony(apart, total, lifted, n):
    """Root of the part that the swings about the mean have of all swing, over that at the release of `lifted` bobs: 1
    as these swing and the others rest, 0 in unison. apart, total: what `swings` returns."""
    if total == 0.0:
        return 1.0
    return math.sqrt(apart / total * n / (n - lifted))


@jit
def relative_swing(apart, angle, lifted, n):
    """Amplitude of the swings about the mean over that at the release of `lifted` bobs at `angle` [rad]."""
    return math.sqrt(apart * n / (lifted * (n - lifted))) / angle
