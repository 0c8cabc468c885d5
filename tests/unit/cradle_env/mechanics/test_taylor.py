"""The Taylor series of a bob's flight: against SciPy's integration, and machine code against the text it is made of."""

import math

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cradle_env.mechanics import lanes, layout, taylor

A, L = 0.1, math.hypot(0.3, 0.1)
PULL = 4 * 0.3 / L / 0.2813
#: Strings that load from (0, 0), from elsewhere, that unload, and slack ones: coefficients of the tension [N].
BRANCHES = {
    "new": (0.0, 196.6, 0.0),
    "loading": (-0.3, 196.6, 0.0),
    "unloading": (0.0, 0.0, 5e4),
    "slack": (0.0, 0.0, 0.0),
}
STATE = (0.06, -0.2985, 0.4, 0.05)


def forces(branch: str) -> taylor.Forces:
    return taylor.Forces(A * A, L, *(PULL * t for t in BRANCHES[branch]), 0.0071, 0.0071 * 0.02, 9.7)


@pytest.mark.parametrize("branch", BRANCHES)
def test_a_series_is_the_motion(branch: str) -> None:
    """Truncated after order 18, at 0.6 to 0.9 rad of the radial motion."""
    f = forces(branch)

    def motion(_: float, y: np.ndarray) -> list[float]:
        x, z, u, w, _ = y
        r = math.hypot(x, z)
        s = math.hypot(r, A) - L
        tension = f.t0 + f.t1 * s + f.t2 * s * s
        ax, az = -tension * x / r - f.drag * u - f.wind, -tension * z / r - f.drag * w - f.fall
        return [u, w, ax, az, 0.002 * ((u + 0.02) ** 2 + w**2)]

    t = 0.012
    exact = solve_ivp(motion, (0, t), [*STATE, 0.0], "DOP853", rtol=1e-13, atol=1e-16, max_step=1e-3).y[:, -1]
    x, z, squares = taylor.flight(*STATE, f, layout.ORDER, math.sqrt)
    u, w = taylor.velocity(x), taylor.velocity(z)
    work = taylor.work_of_drag([u[0] + 0.02, *u[1:]], w, 0.002)
    found = [np.polyval(series[::-1], t) for series in (x, z, u, w, [0.0, *work])]
    # Without the hysteresis, or the drag, of these forces: 1e-4 and more.
    np.testing.assert_allclose(found[:2], exact[:2], rtol=0, atol=1e-14)
    np.testing.assert_allclose(found[2:4], exact[2:4], rtol=0, atol=1e-12)
    assert found[4] == pytest.approx(exact[4], abs=1e-15)
    value, slope, _ = taylor.bends(squares, t)
    assert value == pytest.approx(exact[0] ** 2 + exact[1] ** 2, abs=1e-13)
    assert slope == pytest.approx(2 * (exact[0] * exact[2] + exact[1] * exact[3]), abs=1e-11)


@numba.njit
def expanded(scratch: np.ndarray, state: np.ndarray) -> None:
    lanes.expand(scratch, 0, state)


@numba.njit
def evaluated(state: np.ndarray, place: int, t: float) -> tuple[tuple[float, ...], float]:
    return lanes.motion_on(state, place, t), lanes.work_on(state, place, t)


def load(scratch: np.ndarray, lane: int, branch: str, place: int = 0) -> None:
    scratch[: lanes.STEP, lane] = [*STATE, *forces(branch), STATE[0] - 0.5, STATE[2] + 0.02, 0.002, 0.04, 3e-15, place]


def test_lanes_are_the_series_bit_for_bit() -> None:
    """Whichever lane a bob is in, and whoever is in the others."""
    for lane in range(lanes.WIDTH):
        scratch, state = np.zeros((lanes.ROWS, lanes.WIDTH)), np.zeros((4, layout.SERIES_WIDTH))
        for other, branch in enumerate(BRANCHES):
            at = (lane + other) % lanes.WIDTH
            load(scratch, at, branch, layout.SERIES_WIDTH * at)
        expanded(scratch, state)
        for other, branch in enumerate(BRANCHES):
            row = state[(lane + other) % lanes.WIDTH]
            x, z, squares = taylor.flight(*STATE, forces(branch), layout.ORDER, math.sqrt)
            x[:2] = STATE[0] - 0.5, STATE[2] + 0.02
            u, w = taylor.velocity(x), taylor.velocity(z)
            block = row[: 4 * len(x)].reshape(-1, 4)
            for column, series in enumerate((x, z, [*u, 0.0], [*w, 0.0])):
                np.testing.assert_array_equal(block[:, column], series)
            work = [0.0, *taylor.work_of_drag(u, w, 0.002)]
            np.testing.assert_array_equal(row[4 * len(x) :][: len(work)], work)
            np.testing.assert_array_equal(scratch[lanes.SQUARES :, (lane + other) % lanes.WIDTH], squares)


def test_an_idle_lane_leaves_the_first_alone() -> None:
    scratch, state = np.full((lanes.ROWS, lanes.WIDTH), np.nan), np.zeros((2, layout.SERIES_WIDTH))
    load(scratch, 0, "new")
    scratch[lanes.PLACE] = 0
    expanded(scratch, state)
    assert np.isfinite(state[0]).all()
    t, powers = 0.013, 0.013 ** np.arange(layout.ORDER + 1)
    motion, work = evaluated(state, 0, t)
    np.testing.assert_allclose(motion, powers @ state[0, : 4 * len(powers)].reshape(-1, 4), rtol=1e-14)
    assert work == pytest.approx(powers @ state[0, 4 * len(powers) :][: len(powers)], rel=1e-13)


def test_the_step_keeps_what_is_left_out_below_what_is_allowed() -> None:
    """The last term of the series, at its step, is what was allowed but for the 6 % of a root that is no better."""
    scratch, state = np.zeros((lanes.ROWS, lanes.WIDTH)), np.zeros((1, layout.SERIES_WIDTH))
    load(scratch, 0, "new")
    scratch[lanes.PLACE] = 0
    expanded(scratch, state)
    step = scratch[lanes.STEP, 0]
    last = np.abs(state[0, : 4 * (layout.ORDER + 1)].reshape(-1, 4)[-1, :2]).max() * step**layout.ORDER
    assert 0.005 < step < 0.04
    assert last <= 3e-15 * 1.07**layout.ORDER
