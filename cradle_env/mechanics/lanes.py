"""Machine code for four bobs at once: the text of `taylor`, traced once into vector instructions.

A number of `taylor` is here a vector of four, one lane for each bob. Loops over lanes would be scalar code; and a
series for four bobs takes as long as one for a single bob, for it waits on its own results. Each lane is what it would
be alone, bit for bit: nothing is contracted or reordered.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from cradle_env.mechanics import taylor
from cradle_env.mechanics.layout import ORDER, SERIES_WIDTH

WIDTH = 4

# Rows of the lanes in scratch, WIDTH numbers each. What is known of a bob at the start of its segment: place and
# velocity from the pivot, what acts on it, place and velocity along x in the room, drag [kg/s]; for its step: the
# longest [s], the error [m] that it may make; where in the state its series goes.
X, Z, U, W, FORCES = 0, 1, 2, 3, 4
ROOM_X = FORCES + len(taylor.Forces._fields)
ROOM_U, DRAG_B, LONGEST, ALLOWED, PLACE = ROOM_X + 1, ROOM_X + 2, ROOM_X + 3, ROOM_X + 4, ROOM_X + 5
# What comes out: the step h [s]; r^2 with its slope and second derivative at h; the coefficients of r^2.
STEP, SQUARE, SLOPE, BEND, SQUARES = PLACE + 1, PLACE + 2, PLACE + 3, PLACE + 4, PLACE + 5
ROWS = SQUARES + ORDER - 1

_DOUBLE, _INT, _INT32 = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
_VECTOR, _INTS = ir.VectorType(_DOUBLE, WIDTH), ir.VectorType(_INT, WIDTH)
# The bits of 1.0, as a whole number.
_ONE_BITS = 1023 * 2**52


class Lanes:
    """Four numbers in the making; arithmetic on them adds instructions to a function."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    def _like(self, x):
        """A number of Python as lanes."""
        return x.value if isinstance(x, Lanes) else ir.Constant(_VECTOR, [ir.Constant(_DOUBLE, float(x))] * WIDTH)

    def __add__(self, other):
        return Lanes(self.builder, self.builder.fadd(self.value, self._like(other)))

    def __sub__(self, other):
        return Lanes(self.builder, self.builder.fsub(self.value, self._like(other)))

    def __mul__(self, other):
        return Lanes(self.builder, self.builder.fmul(self.value, self._like(other)))

    def __rtruediv__(self, other):
        return Lanes(self.builder, self.builder.fdiv(self._like(other), self.value))

    def __truediv__(self, other):
        return Lanes(self.builder, self.builder.fdiv(self.value, self._like(other)))

    __radd__, __rmul__ = __add__, __mul__

    def _called(self, name):
        """What a function of LLVM makes of these lanes."""
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.{name}.v{WIDTH}f64")
        return Lanes(self.builder, self.builder.call(function, [self.value]))

    def sqrt(self):
        """Square roots."""
        return self._called("sqrt")

    def size(self):
        """Absolute values."""
        return self._called("fabs")

    def larger(self, other, sign=">"):
        """The larger of each pair; with sign "<" the smaller."""
        chosen = self.builder.fcmp_ordered(sign, self.value, other.value)
        return Lanes(self.builder, self.builder.select(chosen, self.value, other.value))

    def root(self, n):
        """The n-th root, to 6 %, too large: the bits of a number are all but its logarithm. A step needs no better."""
        b = self.builder
        scaled = Lanes(b, b.sitofp(b.bitcast(self.value, _INTS), _VECTOR)) * (1.0 / n) + (1.0 - 1.0 / n) * _ONE_BITS
        return Lanes(b, b.bitcast(b.fptosi(scaled.value, _INTS), _VECTOR))


def array_data(context, builder, kind, array):
    """The address of an array's first number."""
    return context.make_array(kind)(context, builder, array).data


def _vector_at(builder, data, index):
    """The address of four numbers from `index` on."""
    place = builder.gep(data, [index if isinstance(index, ir.Value) else ir.Constant(_INT, index)])
    return builder.bitcast(place, _VECTOR.as_pointer())


def load_vector(builder, data, index):
    """Four numbers from `index` on."""
    return builder.load(_vector_at(builder, data, index), align=8)


def store_vector(builder, value, data, index):
    """Stores four numbers from `index` on."""
    builder.store(value, _vector_at(builder, data, index), align=8)


def _transposed(builder, rows):
    """Four vectors with the numbers of lane 0, 1, 2, 3 of four vectors."""

    def mixed(a, b, *which):
        mask = ir.Constant(ir.VectorType(_INT32, WIDTH), [ir.Constant(_INT32, i) for i in which])
        return builder.shuffle_vector(a, b, mask)

    low0, high0 = mixed(rows[0], rows[1], 0, 4, 2, 6), mixed(rows[0], rows[1], 1, 5, 3, 7)
    low1, high1 = mixed(rows[2], rows[3], 0, 4, 2, 6), mixed(rows[2], rows[3], 1, 5, 3, 7)
    pairs = ((low0, low1, (0, 1, 4, 5)), (high0, high1, (0, 1, 4, 5)), (low0, low1, (2, 3, 6, 7)))
    return [mixed(a, b, *which) for a, b, which in (*pairs, (high0, high1, (2, 3, 6, 7)))]


def _store_lanes(builder, rows, data, places, offset):
    """Stores of four vectors the numbers of each lane at its place, the first lane last: an idle lane has its place."""
    for place, value in reversed(list(zip(places, _transposed(builder, rows), strict=True))):
        store_vector(builder, value, data, builder.add(place, ir.Constant(_INT, offset)))


@intrinsic
def expand(typing, scratch, first, state):
    """Expands the flights of four bobs whose lanes stand in `scratch` from number `first` on.

    Their series go to `state`, each from number PLACE on: for each power of time x, z and their velocities, in the
    room, and behind these the work of drag. Lanes in which there is no bob have the place of the first.
    """

    def codegen(context, builder, signature, arguments):
        scratch, first, state = arguments
        lanes = builder.gep(array_data(context, builder, signature.args[0], scratch), [first])
        state = array_data(context, builder, signature.args[2], state)
        rows = [Lanes(builder, load_vector(builder, lanes, WIDTH * row)) for row in range(STEP)]
        places = [builder.fptosi(place, _INT) for place in numbers_in(builder, rows[PLACE])]
        forces = taylor.Forces(*rows[FORCES:ROOM_X])
        x, z, squares = taylor.flight(rows[X], rows[Z], rows[U], rows[W], forces, ORDER, Lanes.sqrt)

        # The last coefficient of a series may be small by chance, the last two are not; `longest` is 2 / omega.
        longest, greatest = rows[LONGEST], x[-1].size().larger(z[-1].size())
        before = x[-2].size().larger(z[-2].size()) * (2.0 / ORDER) / longest
        step = (rows[ALLOWED] / greatest.larger(before)).root(ORDER).larger(longest, "<")
        for row, value in zip((STEP, SQUARE, SLOPE, BEND), (step, *taylor.bends(squares, step)), strict=True):
            store_vector(builder, value.value, lanes, WIDTH * row)
        for k, value in enumerate(squares):
            store_vector(builder, value.value, lanes, WIDTH * (SQUARES + k))

        x[0], x[1] = rows[ROOM_X], rows[ROOM_U]
        u, w = taylor.velocity(x), taylor.velocity(z)
        zero = Lanes(builder, ir.Constant(_VECTOR, [ir.Constant(_DOUBLE, 0.0)] * WIDTH))
        work = [zero, *taylor.work_of_drag(u, w, rows[DRAG_B]), *[zero] * 3]
        u, w = [*u, zero], [*w, zero]
        for k in range(ORDER + 1):
            block = [series[k].value for series in (x, z, u, w)]
            _store_lanes(builder, block, state, places, WIDTH * k)
        for k in range(0, SERIES_WIDTH - 4 * (ORDER + 1), 4):
            block = [coefficient.value for coefficient in work[k : k + 4]]
            _store_lanes(builder, block, state, places, WIDTH * (ORDER + 1) + k)
        return context.get_dummy_value()

    return types.void(scratch, types.int64, state), codegen


def in_all_lanes(builder, number):
    """One number in all lanes."""
    nothing = ir.Constant(_VECTOR, ir.Undefined)
    one = builder.insert_element(nothing, number, ir.Constant(_INT32, 0))
    mask = ir.Constant(ir.VectorType(_INT32, WIDTH), [ir.Constant(_INT32, 0)] * WIDTH)
    return Lanes(builder, builder.shuffle_vector(one, nothing, mask))


def numbers_in(builder, lanes):
    """The numbers in all lanes."""
    return [builder.extract_element(lanes.value, ir.Constant(_INT32, i)) for i in range(WIDTH)]


def polynomial_at(coefficients, t):
    """A polynomial at t."""
    value = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = value * t + coefficient
    return value


@intrinsic
def work_on(typing, state, place, t):
    """Work of drag [J] at time t [s] of the series in `state` from number `place` on: every fourth power in one lane,
    which takes a quarter as long as one after the other."""

    def codegen(context, builder, signature, arguments):
        state, place, t = arguments
        data = builder.gep(array_data(context, builder, signature.args[0], state), [place])
        t2 = builder.fmul(t, t)
        blocks = range(4 * (ORDER + 1), SERIES_WIDTH, WIDTH)
        sums = polynomial_at(
            [Lanes(builder, load_vector(builder, data, k)) for k in blocks], in_all_lanes(builder, builder.fmul(t2, t2))
        )
        even0, odd0, even1, odd1 = numbers_in(builder, sums)
        low = builder.fadd(even0, builder.fmul(odd0, t))
        return builder.fadd(low, builder.fmul(builder.fadd(even1, builder.fmul(odd1, t)), t2))

    return types.float64(state, types.int64, types.float64), codegen


@intrinsic
def motion_on(typing, state, place, t):
    """(x, z, dx/dt, dz/dt) at time t [s] of the series in `state` from number `place` on: even and odd powers apart,
    which takes half as long as one after the other."""

    def codegen(context, builder, signature, arguments):
        state, place, t = arguments
        data = builder.gep(array_data(context, builder, signature.args[0], state), [place])
        t = in_all_lanes(builder, t)
        coefficients = [Lanes(builder, load_vector(builder, data, WIDTH * k)) for k in range(ORDER + 1)]
        value = polynomial_at(coefficients[1::2], t * t) * t + polynomial_at(coefficients[0::2], t * t)
        return context.make_tuple(builder, signature.return_type, numbers_in(builder, value))

    return types.UniTuple(types.float64, 4)(state, types.int64, types.float64), codegen
