"""A force on single bobs of which only its shape in the data is known."""

import math

import numpy as np

from cradle_env.effects.declaration import Effect, Parameter, Values

#: Speeds, in units of the scale: over which dry friction turns about; at which slow friction has half its value; and
#: of the hump of friction that sticks. √(2e) makes that hump 1 high.
DRY, SLOW, STICK, HUMP = 0.01, 0.1, 0.07, math.sqrt(2.0 * math.e)

#: Where humps of force stand, in units of the scale of angles, and their width.
CENTRES, WIDTH = (-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75), 0.25


def _humps(key: str, sign: str, what: str) -> dict[str, tuple[str, str]]:
    """Terms that act around each of the centres."""
    found = {}
    for i, centre in enumerate(CENTRES, 1):
        away = f"(x {'−' if centre > 0.0 else '+'} {abs(centre):g})" if centre else "x"
        where = f"around {'−' if centre < 0.0 else ''}{abs(100 * centre):g} %" if centre else "about the middle"
        found[f"{key}_{i}"] = (f"{sign}exp(−({away}/{WIDTH:g})²)", f"{what} {where} of the swing")
    return found


#: Parameters that are no coefficients; all stand in the order of these, then `TERMS`.
SCALES = ("angle", "speed", "frequency")
#: Each term's shape, x = θ/angle, u = v/speed, ω = 2π frequency, t from the start of the run, and its meaning. All act
#: along the swing but drag and pulls along the string, and the last two, which are horizontal, as in a room that
#: shakes.
TERMS = {
    "push": ("1", "a constant push"),
    "even": ("x²", "a push by the square of the angle"),
    "surge": ("u²", "a push by the square of the speed"),
    "cubic": ("x³", "a push by the cube of the angle"),
    "quintic": ("x⁵", "a push by the fifth power of the angle"),
    "well": ("−x exp(−25 x²)", "a well about the middle of the swing"),
    "dry": ("−tanh(100 u)", "dry friction"),
    "slow": ("−u/(|u| + 0.1)", "friction that reaches its full value slowly"),
    "stick": ("−√(2e) w exp(−w²), w = u/0.07", "friction at slow speeds alone"),
    "square": ("−|u| u", "drag by the square of the speed"),
    "cube": ("−u³", "drag by the cube of the speed"),
    "wide": ("−x² u", "drag that grows by the square of the angle"),
    "loaded": ("−x² tanh(100 u)", "dry friction that grows by the square of the angle"),
    "radial": ("−u_r", "drag along the string"),
    **_humps("hump", "", "a push"),
    **_humps("tug", "−", "a pull along the string"),
    "cosine": ("cos ωt", "a horizontal force that swings by itself, as it is at the start"),
    "sine": ("sin ωt", "a horizontal force that swings by itself, a quarter of its period later"),
}
#: Of these, those that depend on time alone, those that pull along the string, and all that act along it.
IN_TIME = ("cosine", "sine")
_TUGS = tuple(key for key in TERMS if key.startswith("tug"))
ALONG_STRINGS = ("radial", *_TUGS)


def force(t, r, theta, v_r, v_theta, parameters):
    """(F_r, F_theta) [N]; parameters: angle [rad], speed [m/s], frequency [Hz], then the coefficient [N] of each of
    `TERMS`. Before the run, at t < 0, all is still."""
    p = parameters
    x, u = theta / p[0], v_theta / p[1]
    x2, size = x * x, abs(u)
    along = -p[16] * v_r / p[1]
    total = p[3] + p[4] * x2 + p[5] * u * u + (p[6] + p[7] * x2) * x * x2
    total -= u * (p[10] / (size + SLOW) + p[12] * size + p[13] * u * u + p[14] * x2)
    if p[8] != 0.0:
        total -= p[8] * x * math.exp(-25.0 * x2)
    if p[11] != 0.0:
        total -= p[11] * HUMP * (u / STICK) * math.exp(-((u / STICK) ** 2))
    if p[9] != 0.0 or p[15] != 0.0:
        total -= (p[9] + p[15] * x2) * math.tanh(u / DRY)
    for i in range(len(CENTRES)):
        if p[17 + i] != 0.0 or p[24 + i] != 0.0:
            hump = math.exp(-(((x - CENTRES[i]) / WIDTH) ** 2))
            total += p[17 + i] * hump
            along -= p[24 + i] * hump
    if t >= 0.0 and (p[31] != 0.0 or p[32] != 0.0):
        phase = 2.0 * math.pi * p[2] * t
        horizontal = p[31] * math.cos(phase) + p[32] * math.sin(phase)
        along += horizontal * math.sin(theta)
        total += horizontal * math.cos(theta)
    return along, total


def _bounds(key: str) -> tuple[float, float]:
    """[N]. Pulls along the string as large as the weight of usual bobs are no small departure: strings go slack."""
    return (-0.5, 0.5) if key in _TUGS else (-100.0, 100.0)


def has_dry_friction(values: Values) -> bool:
    """Whether terms act that all but jump where the swing turns."""
    return any(np.any(values.get(key, 0.0)) for key in ("dry", "loaded"))


learned_force = Effect(
    name="learned_force",
    symbol="F(θ, v, t)",
    acts_on="bob",
    summary="a smooth force on each bob, by its angle, velocity and time; learned from data, it explains nothing",
    equation="F = Σ c_k φ_k(θ/angle, v/speed, ωt)",
    reference="a sparse library: Brunton, Proctor & Kutz, Proc. Natl. Acad. Sci. 113, 3932 (2016)",
    energy="takes −F v, booked with the drag",
    looks_like="whatever no effect of the catalogue explains",
    parameters=(
        Parameter("angle", "θ_s", "rad", "scale of angles", absent=math.nan, low=1e-6, high=10.0, scale=0.2),
        Parameter("speed", "v_s", "m/s", "scale of speeds", absent=math.nan, low=1e-6, high=100.0, scale=0.3),
        Parameter("frequency", "f", "Hz", "that of a force in time", absent=math.nan, low=1e-4, high=100.0, scale=1.0),
        *(
            Parameter(key, f"c_{key}", "N", f"{meaning}: {shape}", 0.0, *_bounds(key), 1e-3, each="bob")
            for key, (shape, meaning) in TERMS.items()
        ),
    ),
    force=force,
)
