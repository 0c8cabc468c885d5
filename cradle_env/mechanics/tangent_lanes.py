"""The series of `taylor` on dual numbers: how a bob's flight depends on where it starts and on what acts on it.

A number of `taylor` is here a number and its derivatives by 12 inputs, four in the lanes of a vector: place and
velocity at the start, the fields of `taylor.Forces`. These serve any number of parameters, by the chain rule.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cradle_env.mechanics import taylor
from cradle_env.mechanics.lanes import (
    ALLOWED,
    BEND,
    FORCES,
    LONGEST,
    SLOPE,
    SQUARE,
    SQUARES,
    STEP,
    WIDTH,
    Lanes,
    U,
    W,
    X,
    Z,
    array_data,
    in_all_lanes,
    load_vector,
    numbers_in,
    polynomial_at,
    store_vector,
)
from cradle_env.mechanics.layout import ORDER

#: Order of the series: derivatives to 1e-7 of their size and better.
TANGENT_ORDER = 12
INPUTS = 12
_VECTORS = INPUTS // WIDTH
# Which input each of the eight fields of `taylor.Forces` is, behind the four of the start; wind is none.
_INPUT_OF_FORCE = (8, 9, 4, 5, 6, 7, None, 10)

# What stands in a sheet of scratch, in vectors: for each power of time (x, z, their velocities), the derivatives of x
# and of z by the inputs; then the same at an instant, and the derivatives of the velocities.
_TERM = 1 + 2 * _VECTORS
_AT = _TERM * (TANGENT_ORDER + 1)
#: Where they stand, in numbers.
AT, AT_X, AT_Z = WIDTH * _AT, WIDTH * (_AT + 1), WIDTH * (_AT + 1) + INPUTS
AT_U, AT_W = AT_Z + INPUTS, AT_Z + 2 * INPUTS
SHEET = AT_W + INPUTS

_DOUBLE, _INT32 = ir.DoubleType(), ir.IntType(32)
_VECTOR = ir.VectorType(_DOUBLE, WIDTH)


class Dual:
    """A number in the making, the same in all lanes, with its derivatives: vectors of lanes, None where all are 0."""

    def __init__(self, value, slopes):
        self.value, self.slopes = value, slopes

    def _with(self, value, own, other=None, theirs=None):
        """value, its derivatives own * self's + theirs * other's; a factor None is 1."""
        slopes = []
        for k, slope in enumerate(self.slopes):
            total = slope if slope is None or own is None else slope * own
            more = None if other is None else other.slopes[k]
            if more is not None:
                more = more if theirs is None else more * theirs
                total = more if total is None else total + more
            slopes.append(total)
        return Dual(value, slopes)

    def __add__(self, other):
        return self._with(self.value + other.value, None, other)

    def __sub__(self, other):
        return self._with(self.value - other.value, None, other, -1.0)

    def __mul__(self, other):
        if isinstance(other, Dual):
            return self._with(self.value * other.value, other.value, other, self.value)
        return self._with(self.value * other, other)

    def __rtruediv__(self, number):
        value = number / self.value
        return self._with(value, value * value * (-1.0 / number))

    def sqrt(self):
        """Its square root."""
        root = self.value.sqrt()
        return self._with(root, 0.5 / root)

    __rmul__ = __mul__


def _input(builder, which):
    """The derivatives of input number `which`."""
    lanes = [1.0 if which % WIDTH == lane else 0.0 for lane in range(WIDTH)]
    unit = Lanes(builder, ir.Constant(_VECTOR, [ir.Constant(_DOUBLE, x) for x in lanes]))
    return [unit if vector == which // WIDTH else None for vector in range(_VECTORS)]


@intrinsic
def expand_tangents(typing, scratch, first, sheet):
    """Expands the flight of the bob whose first lane stands in `scratch` from number `first` on, into a sheet; the
    step and the squares of the radius go to the lane, as those of `lanes.expand`."""

    def codegen(context, builder, signature, arguments):
        scratch, first, sheet = arguments
        lanes = builder.gep(array_data(context, builder, signature.args[0], scratch), [first])
        sheet = array_data(context, builder, signature.args[2], sheet)

        def read(row, which=None):
            value = in_all_lanes(builder, builder.load(builder.gep(lanes, [ir.Constant(ir.IntType(64), WIDTH * row)])))
            return Dual(value, [None] * _VECTORS if which is None else _input(builder, which))

        forces = taylor.Forces(*(read(FORCES + k, which) for k, which in enumerate(_INPUT_OF_FORCE)))
        start = [read(row, which) for which, row in enumerate((X, Z, U, W))]
        x, z, squares = taylor.flight(*start, forces, TANGENT_ORDER, Dual.sqrt)

        longest, greatest = read(LONGEST).value, x[-1].value.size().larger(z[-1].value.size())
        before = x[-2].value.size().larger(z[-2].value.size()) * (2.0 / TANGENT_ORDER) / longest
        allowed = read(ALLOWED).value / greatest.larger(before)
        step = allowed.root(TANGENT_ORDER).larger(longest, "<")
        squares = [square.value for square in squares]
        for row, value in zip((STEP, SQUARE, SLOPE, BEND), (step, *taylor.bends(squares, step)), strict=True):
            store_vector(builder, value.value, lanes, WIDTH * row)
        zero = ir.Constant(_VECTOR, [ir.Constant(_DOUBLE, 0.0)] * WIDTH)
        for k in range(ORDER - 1):
            store_vector(builder, squares[k].value if k < len(squares) else zero, lanes, WIDTH * (SQUARES + k))

        for k in range(TANGENT_ORDER + 1):
            motion = [x[k].value, z[k].value]
            motion += [a[k + 1].value * (k + 1.0) for a in (x, z)] if k < TANGENT_ORDER else [Lanes(builder, zero)] * 2
            own = ir.Constant(_VECTOR, ir.Undefined)
            for lane, value in enumerate(motion):
                place = ir.Constant(_INT32, lane)
                own = builder.insert_element(own, builder.extract_element(value.value, place), place)
            rows = [own, *(zero if s is None else s.value for a in (x, z) for s in a[k].slopes)]
            for row, value in enumerate(rows):
                store_vector(builder, value, sheet, WIDTH * (_TERM * k + row))
        return context.get_dummy_value()

    return types.void(scratch, types.int64, sheet), codegen


def _evaluation(with_velocities):
    """An intrinsic that puts what stands in a sheet at an instant t [s] behind it: motion, derivatives of x and z and,
    where asked, of the velocities."""

    @intrinsic
    def evaluate(typing, sheet, t):
        def codegen(context, builder, signature, arguments):
            data = array_data(context, builder, signature.args[0], arguments[0])
            t = in_all_lanes(builder, arguments[1])
            for row in range(_TERM):
                terms = [
                    Lanes(builder, load_vector(builder, data, WIDTH * (_TERM * k + row)))
                    for k in range(TANGENT_ORDER + 1)
                ]
                store_vector(builder, polynomial_at(terms, t).value, data, WIDTH * (_AT + row))
                if with_velocities and row > 0:
                    rates = [term * float(k) for k, term in enumerate(terms)][1:]
                    store_vector(builder, polynomial_at(rates, t).value, data, WIDTH * (_AT + 2 * _VECTORS + row))
            return context.get_dummy_value()

        return types.void(sheet, types.float64), codegen

    return evaluate


evaluate_places, evaluate = _evaluation(False), _evaluation(True)


@intrinsic
def by_parameter(typing, sheet, column, inputs, q):
    """Derivative by parameter q of what has its derivatives by the inputs in a sheet from this column on; inputs
    (P, INPUTS): the derivatives of these by the parameters."""

    def codegen(context, builder, signature, arguments):
        sheet, column, inputs, q = arguments
        by_input = builder.gep(array_data(context, builder, signature.args[0], sheet), [column])
        row = builder.mul(q, ir.Constant(q.type, INPUTS))
        of_inputs = builder.gep(array_data(context, builder, signature.args[2], inputs), [row])
        products = [
            Lanes(builder, load_vector(builder, by_input, k)) * Lanes(builder, load_vector(builder, of_inputs, k))
            for k in range(0, INPUTS, WIDTH)
        ]
        a, b, c, d = numbers_in(builder, products[0] + products[1] + products[2])
        return builder.fadd(builder.fadd(a, b), builder.fadd(c, d))

    return types.float64(sheet, types.int64, inputs, types.int64), codegen
