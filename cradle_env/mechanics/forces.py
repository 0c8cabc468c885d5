"""What acts on one bob in flight: eqs. 3, 5 and 6, and one guarded line for every further effect.

A guard keeps an absent effect free of cost, and keeps 0 * inf from making NaN. Every effect's force is its own
small kernel, so that a test can hold it against the declaration of the effect.
"""

import math

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cradle_env.mechanics.jit import jit, leaf
from cradle_env.mechanics.layout import FRAME
from cradle_env.mechanics.strings import stretch, tension

# Angular speed [rad/s] over which pivot friction changes sign: 1e-2 of the swing's, and far from a jump.
FRICTION_SMOOTHING = 0.02

#: Signature of a force from outside: (time, state (6,), parameters (USER,)). The state is (r, theta, v_r, v_theta)
#: on entry, SI; the force's radial and tangential component [N] go into state[4] and state[5].
USER_SIGNATURE = types.void(types.float64, types.CPointer(types.float64), types.CPointer(types.float64))


@intrinsic
def _call(typing, address, t, state, parameters):
    """Calls a compiled function by its address, so that a force from outside recompiles nothing here."""

    def codegen(context, builder, signature, arguments):
        double = ir.DoubleType()
        kind = ir.FunctionType(ir.VoidType(), [double, double.as_pointer(), double.as_pointer()])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), list(arguments[1:]))
        return context.get_dummy_value()

    pointer = types.CPointer(types.float64)
    return types.void(types.int64, types.float64, pointer, pointer), codegen


@intrinsic
def _pointer(typing, array):
    """The address of an array's first element."""

    def codegen(context, builder, signature, arguments):
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(types.float64)(array), codegen


@jit
def quadratic_drag(c2, speed, v):
    """-c2 |v| v [N] along one component v [m/s] of a velocity of magnitude `speed`."""
    return -c2 * speed * v


@jit
def pivot_friction(tau_c, theta_dot):
    """Torque [N m] of friction tau_c against theta_dot [rad/s], smoothed about rest."""
    return -tau_c * math.tanh(theta_dot / FRICTION_SMOOTHING)


@jit
def user_force(cradle, bob, t, r, theta, v_r, v_t):
    """(radial, tangential) force [N] of an effect from outside the package."""
    state = bob.user_state
    state[0], state[1], state[2], state[3] = r, theta, v_r, v_t
    _call(cradle.user_force, t, _pointer(state), _pointer(bob.user))
    return state[4], state[5]


@jit
def added_forces(cradle, bob, t, drive, r, theta, v_r, v_t, cos):
    """(radial, tangential) force [N] of all effects over strings, gravity and linear drag.

    drive [m/s]: velocity of the pivot; v_r, v_t [m/s]: velocity in the room; cos: of theta.
    """
    f_r, f_t = 0.0, 0.0
    if bob.c2 != 0.0:
        speed = math.sqrt(v_r * v_r + v_t * v_t)
        f_r += quadratic_drag(bob.c2, speed, v_r)
        f_t += quadratic_drag(bob.c2, speed, v_t)
    if bob.tau_c != 0.0:
        f_t += pivot_friction(bob.tau_c, (v_t - drive * cos) / r) / r
    if cradle.user_force != 0:
        u_r, u_t = user_force(cradle, bob, t, r, theta, v_r, v_t)
        f_r += u_r
        f_t += u_t
    return f_r, f_t


@leaf
def has_added_forces(cradle, bob):
    """Whether any of `added_forces` acts."""
    return bob.c2 != 0.0 or bob.tau_c != 0.0 or cradle.user_force != 0


@leaf
def pivot_at(bob, t):
    """x of the bob's pivot [m] at time t [s]."""
    return bob.pivot + bob.drive * t


@leaf
def rates(cradle, bob, t0, t1, t2, t, pivot, drive, x, z, vx, vz):
    """(second derivatives of the two coordinates, power taken by drag [W], horizontal force of the strings on the
    pivot [N]) of one bob at time t [s], its strings' tension having the coefficients t0, t1, t2.

    Contacts apart. pivot, drive: place [m] and velocity [m/s] of the pivot. Coordinates as in `parameters.DIM`.
    Elastic strings: eqs. 5 and 6 in Cartesian coordinates.
    Rigid ones: eq. 6 at r = r0, or eq. 3. Drag acts on the velocity in the room.
    """
    if not cradle.elastic:
        return rates_on_rigid_strings(cradle, bob, t, drive, x, vx)
    ax, az, power, hold = rates_on_elastic_strings(bob, t0, t1, t2, t, pivot, x, z, vx, vz)
    if has_added_forces(cradle, bob):
        more_x, more_z, more = added_on_elastic_strings(cradle, bob, t, drive, x - pivot, z, vx, vz)
        return ax + more_x, az + more_z, power + more, hold
    return ax, az, power, hold


@leaf
def rates_on_elastic_strings(bob, t0, t1, t2, t, pivot, x, z, vx, vz):
    """`rates`, without `added_forces`."""
    from_pivot = x - pivot
    r2 = from_pivot * from_pivot + z * z
    pull = bob.grip * bob.mobility / math.sqrt(r2) * tension(t0, t1, t2, stretch(bob, t, r2))
    drag = bob.b * bob.mobility
    ax, az = -pull * from_pivot - drag * vx, -pull * z - drag * vz - bob.fall
    return ax, az, bob.b * (vx * vx + vz * vz), pull * from_pivot / bob.mobility


@jit
def added_on_elastic_strings(cradle, bob, t, drive, x, z, vx, vz):
    """Acceleration (x, z) by `added_forces`, and the power [W] that they take; x from the pivot."""
    r = math.sqrt(x * x + z * z)
    sin, cos = x / r, -z / r
    v_r, v_t = vx * sin - vz * cos, vx * cos + vz * sin
    f_r, f_t = added_forces(cradle, bob, t, drive, r, math.atan2(x, -z), v_r, v_t, cos)
    power = -f_r * v_r - f_t * v_t
    return (f_r * sin + f_t * cos) * bob.mobility, (f_t * sin - f_r * cos) * bob.mobility, power


@jit
def rates_on_rigid_strings(cradle, bob, t, drive, x, vx):
    """`rates`, for the angle x [rad]."""
    sin, cos = x, 1.0
    v_r, v_t = 0.0, bob.length * vx + drive
    if cradle.large_angle:
        sin, cos = math.sin(x), math.cos(x)
        v_r, v_t = drive * sin, bob.length * vx + drive * cos
    f_r, f_t = -bob.b * v_r, -bob.b * v_t
    if has_added_forces(cradle, bob):
        more_r, more_t = added_forces(cradle, bob, t, drive, bob.length, x, v_r, v_t, cos)
        f_r += more_r
        f_t += more_t
    pull = bob.mass * cradle.gravity  # of the string, per sin
    if cradle.large_angle:
        pull = bob.length * vx * vx / bob.mobility + bob.mass * cradle.gravity * cos + f_r
    acceleration = (f_t * bob.mobility - bob.fall * sin) / bob.length
    return acceleration, 0.0, -f_r * v_r - f_t * v_t, pull * sin


@jit
def radius_and_speed(cradle, bob, t, A, i, c):
    """(r, dr/dt) of bob i whose motion at time t [s] stands in A from column c on."""
    if cradle.elastic:
        x, z = A[i, c] - pivot_at(bob, t) - A[0, c + FRAME], A[i, c + 1]
        r = math.sqrt(x * x + z * z)
        return r, (x * (A[i, c + 2] - bob.drive - A[0, c + FRAME + 1]) + z * A[i, c + 3]) / r
    return bob.length, 0.0
