"""Forces from outside the package, compiled to one function that the kernels call by its address."""

import numba
from numba import carray

from cradle_env.mechanics.forces import USER_SIGNATURE
from cradle_env.mechanics.jit import once
from cradle_env.mechanics.layout import USER


def _sum_of(first, offset, count, rest):
    """A force that adds `first`, with the `count` parameters from `offset` on, to `rest`."""

    @numba.njit
    def total(t, r, theta, v_r, v_theta, parameters):
        f_r, f_theta = first(t, r, theta, v_r, v_theta, parameters[offset : offset + count])
        g_r, g_theta = rest(t, r, theta, v_r, v_theta, parameters)
        return f_r + g_r, f_theta + g_theta

    return total


@numba.njit
def _nothing(t, r, theta, v_r, v_theta, parameters):
    return 0.0, 0.0


@once
def compiled(forces):
    """The compiled sum of ((force, number of parameters), ...), kept alive, for its address is in use."""
    total, offset = _nothing, 0
    for force, count in forces:
        plain = getattr(force, "py_func", force)  # it may be compiled already
        total = _sum_of(numba.njit(plain), offset, count, total)
        offset += count

    @numba.cfunc(USER_SIGNATURE)
    def entry(t, state, parameters):
        s, values = carray(state, 6), carray(parameters, USER)
        s[4], s[5] = total(t, s[0], s[1], s[2], s[3], values)

    return entry
