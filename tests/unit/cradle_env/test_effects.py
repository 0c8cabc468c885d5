"""Every effect of the catalogue, by one body of tests: declared, absent, present, in the ledger; and effects from
outside."""

import dataclasses
import importlib
import math
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cradle_env import CATALOGUE, MODELS, Cradle, Effect, Parameter, Release, register, restitution_curve, simulate
from cradle_env import effects as effects_module
from cradle_env.effects import FILMED, known_effects
from cradle_env.mechanics.user_force import compiled
from identification.bench import scipy_peer
from tests.reference.soft_contact import SoftCradle, simulate_soft

RELEASE = Release(angle=0.3)
TIMES = np.linspace(0, 5, 501)
EACH = pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)

Force = Callable[[float, float, float, float, float], tuple[float, float]]


def one_bob(cradle: Cradle, force: Force, angle: float = 0.3, *, linear: bool = False, elastic: bool = False):
    """θ of one bob at TIMES by SciPy, in polar coordinates: weight, strings, −b v and force(t, r, θ, v_r, v_θ)."""
    m, g, r0, a, b = cradle.mass, cradle.gravity, cradle.length, cradle.pivot_half_spacing, cradle.b
    L0 = math.hypot(r0, a)

    def motion(t: float, y: np.ndarray) -> list[float]:
        r, theta, r_dot, theta_dot = y
        f_r, f_t = force(t, r, theta, r_dot, r * theta_dot)
        swing = (
            -g * (theta if linear else math.sin(theta)) + f_t / m - b / m * r * theta_dot - 2 * r_dot * theta_dot
        ) / r
        if not elastic:
            return [0, theta_dot, 0, swing]
        pull = 4 * cradle.kappa * max(0.0, math.hypot(r, a) - L0) * r0 / L0
        return [r_dot, theta_dot, r * theta_dot**2 + g * math.cos(theta) + (f_r - pull - b * r_dot) / m, swing]

    hanging = math.sqrt((L0 + m * g * L0 / (4 * cradle.kappa * r0)) ** 2 - a**2)
    start = [hanging if elastic else r0, angle, 0, 0]
    run = solve_ivp(motion, (0, TIMES[-1]), start, "DOP853", t_eval=TIMES, rtol=1e-12, atol=1e-14, max_step=2e-3)
    return run.y[1]


def angles(cradle: Cradle, angle: float = 0.3) -> np.ndarray:
    """θ of the last bob at TIMES, let go at its hanging length."""
    return simulate(cradle, Release(angle=angle, start="hanging"), times=TIMES).theta[:, -1]


@dataclasses.dataclass(frozen=True)
class Example:
    """What an effect does: measure(base with the effect at `values`) is `expected`, without it is not."""

    base: Cradle
    values: dict[str, float]
    measure: Callable[[Cradle], np.ndarray]
    expected: Callable[[], np.ndarray]
    tolerance: float


def no_force(*_: float) -> tuple[float, float]:
    return 0.0, 0.0


def quadratic_drag(_t: float, _r: float, _theta: float, v_r: float, v_t: float) -> tuple[float, float]:
    speed = math.hypot(v_r, v_t)
    return -0.02 * speed * v_r, -0.02 * speed * v_t


def pivot_friction(_t: float, r: float, _theta: float, _v_r: float, v_t: float) -> tuple[float, float]:
    return 0.0, -1e-3 * math.tanh(v_t / r / 0.02) / r


HO, PENDULUM = Cradle(bobs=1, model="ho"), Cradle(bobs=1, model="pendulum")
ELASTIC = Cradle(bobs=1, effects={"-string_hysteresis": {}})
CONSTANT = {"-velocity_dependent_restitution": {}}
SINE = 0.2 * np.sin(7 * TIMES)


def reading(cradle: Cradle) -> np.ndarray:
    """What the file shows of a θ of 0.2 sin 7t."""
    theta = SINE
    for effect in cradle.composition:
        values = cradle.effects.get(effect.name, {})
        if effect.clock is not None:
            theta = 0.2 * np.sin(7 * TIMES / effect.clock(values))
        if effect.instants is not None:
            offsets, weights = effect.instants(values)
            theta = 0.2 * np.sin(7 * (TIMES[:, None] + offsets)) @ weights
        if effect.reading is not None:
            theta = effect.reading(values, theta)
    return theta


# The strings' own effects start at rest on r0, where they matter most; the tolerances are the interpolation of
# samples, 1e-9 of the swing and 1e-6 of the ripple, unless they say otherwise.
EXAMPLES = {
    "velocity_dependent_restitution": Example(
        Cradle(bobs=2, model="ho", effects=CONSTANT, power_law=(0.1, 0.3)),
        {},
        lambda cradle: restitution_curve(cradle, np.array([0.01, 0.1, 1.0])),
        lambda: 1 - 0.1 * np.array([0.01, 0.1, 1.0]) ** 0.3,
        1e-12,
    ),
    "large_angle": Example(HO, {}, angles, lambda: one_bob(HO, no_force), 5e-9),
    "radial_elasticity": Example(PENDULUM, {}, angles, lambda: one_bob(ELASTIC, no_force, elastic=True), 5e-9),
    "string_hysteresis": Example(
        ELASTIC,
        {},
        lambda cradle: simulate(cradle, RELEASE, times=TIMES).r[:, 0],
        lambda: scipy_peer.simulate(1, angle=0.3, times=TIMES, kappa=ELASTIC.kappa, rtol=1e-12, atol=1e-14)[1][:, 0],
        1e-8,
    ),
    "quadratic_drag": Example(
        ELASTIC, {"c2": 0.02}, angles, lambda: one_bob(ELASTIC, quadratic_drag, elastic=True), 5e-9
    ),
    # The torque turns about within 3 ms, a third of a step.
    "pivot_friction": Example(
        ELASTIC, {"tau_c": 1e-3}, angles, lambda: one_bob(ELASTIC, pivot_friction, elastic=True), 1e-6
    ),
    # 3e-7 rad were measured; without, 6e-4.
    "contact_duration": Example(
        Cradle(bobs=2),
        {"scale": 1.0},
        lambda cradle: simulate(cradle, RELEASE, times=TIMES).theta,
        lambda: simulate_soft(SoftCradle(2, kappa=Cradle().kappa), {2: 0.3}, times=TIMES).theta,
        5e-6,
    ),
    # Midpoints in place of the integral: (7 · 0.1)²/24/100 of 0.2 rad.
    "exposure_blur": Example(HO, {"duration": 0.1}, reading, lambda: SINE * math.sin(0.35) / 0.35, 5e-5),
    "angle_scale": Example(HO, {"scale": 0.02}, reading, lambda: 1.02 * SINE, 1e-15),
    "clock_scale": Example(HO, {"scale": 0.01}, reading, lambda: 0.2 * np.sin(7 * TIMES / 1.01), 1e-12),
    "angle_offset": Example(HO, {"offset": 0.01}, reading, lambda: SINE + 0.01, 1e-15),
}


def soft_example(name: str, values: dict) -> Example:
    """Two bobs for 5 s, against every contact followed in time, contacts 40 × shorter than real; 1.5e-5 rad without
    any effect."""
    return Example(
        Cradle(bobs=2),
        values,
        lambda cradle: simulate(cradle, RELEASE, times=TIMES).theta,
        lambda: (
            simulate_soft(
                SoftCradle(2, kappa=Cradle().kappa, stiffness_factor=1e4, effects={name: values}), {2: 0.3}, times=TIMES
            ).theta
        ),
        4e-5,
    )


EXAMPLES |= {
    name: soft_example(name, values)
    for name, values in {
        "group_drag": {"slope": 2.0, "range": 0.005},
        "bob_attraction": {"force": 0.05, "range": 0.003},
        "frame_compliance": {"frame_mass": 5.0, "frequency": 8.0, "damping_ratio": 0.05},
        "string_creep": {"rate": 1e-4},
        "added_mass": {"mass": 0.01},
        "mass_mismatch": {"relative": [0.02, -0.02]},
        "length_mismatch": {"relative": [0.005, -0.002]},
        "spacer_offset": {"offset": [0.003]},
    }.items()
}


def with_effect(example: Example, name: str) -> Cradle:
    others = {key: values for key, values in example.base.effects.items() if key != f"-{name}"}
    base = "nsp" if name == "string_hysteresis" else example.base.model
    already = name in MODELS[base]
    return example.base.replace(effects=others if already else {**others, name: example.values})


def test_every_effect_has_an_example() -> None:
    assert set(EXAMPLES) == {effect.name for effect in CATALOGUE}


@EACH
def test_declared_fully(effect: Effect) -> None:
    for name in ("name", "symbol", "acts_on", "summary", "equation", "reference", "energy", "looks_like"):
        assert getattr(effect, name).strip(), name
    for p in effect.parameters:
        assert p.key.isidentifier()
        assert p.symbol.strip()
        assert p.unit.strip()
        assert p.meaning.strip()
        assert p.low < p.high
        assert not math.isfinite(p.absent) or p.low <= p.absent <= p.high
        assert p.low <= p.scale <= p.high
        assert p.scale != p.absent
    assert set(effect.requires) <= {other.name for other in CATALOGUE}
    module = importlib.import_module(f"cradle_env.effects.{effect.name}")
    assert getattr(module, effect.name) is effect
    assert module.__doc__
    switches = not effect.parameters
    assert switches == any(effect.name in names for names in MODELS.values()), "neither strength nor switch"


@EACH
def test_absent_is_the_base_bit_for_bit(effect: Effect) -> None:
    """At its absent values, or taken out of the model that has it."""
    release = Release(angles={3: 0.3, 1: -0.1})

    def run(cradle: Cradle):
        return simulate(cradle, release, 10.0)

    if effect.parameters:
        for model in MODELS:
            if not set(effect.requires) <= set(MODELS[model]):
                continue
            base = Cradle(bobs=3, model=model)
            found, expected = run(base.replace(effects={effect.name: effect.absent_values()})), run(base)
            np.testing.assert_array_equal(found.theta, expected.theta)
            np.testing.assert_array_equal(found.r, expected.r)
            np.testing.assert_array_equal(found.impacts, expected.impacts)
            np.testing.assert_array_equal(found.ledger, expected.ledger)
    else:
        out = {name: {} for name in MODELS["nsp"] if effect.name == name or effect.name in needs(name)}
        taken_out = Cradle(bobs=3, effects={f"-{name}": {} for name in out})
        added = {name: {} for name in MODELS["nsp"] if name not in out and name not in MODELS["ho"]}
        if effect.name == "velocity_dependent_restitution":
            added[f"-{effect.name}"] = {}
        built_up = Cradle(bobs=3, model="ho", effects=added)
        assert not taken_out.has(effect.name)
        assert taken_out.composition == built_up.composition
        np.testing.assert_array_equal(run(taken_out).theta, run(built_up).theta)


def needs(name: str) -> set[str]:
    """All that an effect requires, directly or not."""
    direct = next(effect.requires for effect in CATALOGUE if effect.name == name)
    return set(direct).union(*(needs(other) for other in direct))


@EACH
def test_present_is_what_it_says(effect: Effect) -> None:
    example = EXAMPLES[effect.name]
    expected = example.expected()
    np.testing.assert_allclose(
        example.measure(with_effect(example, effect.name)), expected, rtol=0, atol=example.tolerance
    )
    without = np.abs(example.measure(example.base) - expected).max()
    assert without > 10 * example.tolerance, "the example does not show the effect"


@pytest.mark.parametrize("strings, effects", [("hysteretic", {}), ("elastic", {"-string_hysteresis": {}})])
def test_strings_creep_while_bobs_fly(strings, effects) -> None:
    """One bob, whose reference has no contacts to be soft: 2e-10 rad are left; 2e-6 to 5e-5 where strings creep from
    one step to the next only. The ledger closes as without creep; where the strings' work is that at their length in
    the middle of a step, to 1.5e-6 J."""
    times, values = np.arange(0.0, 30.0, 1.0 / 60.0), {"string_creep": {"rate": 1e-3}}
    soft = SoftCradle(1, kappa=Cradle().kappa, strings=strings, effects=values)
    run = simulate(Cradle(bobs=1, effects=values | effects), Release(angle=0.3), times=times)
    np.testing.assert_allclose(run.theta, simulate_soft(soft, {1: 0.3}, times=times).theta, rtol=0, atol=1e-8)
    assert np.ptp(run.energy().total) < 2e-7


@EACH
def test_ledger_closes(effect: Effect) -> None:
    example = EXAMPLES[effect.name]
    of_three = {p.key: [0.01, -0.004, -0.006][: p.count(3)] for p in effect.parameters if p.each}
    base = example.base.replace(bobs=3, delta=-0.001)
    cradle = with_effect(dataclasses.replace(example, base=base, values=example.values | of_three), effect.name)
    total = simulate(cradle, RELEASE, 10.0, tolerance=1e-19).energy().total
    # As in test_energy. What acts between neighbours has a kink at touch, friction all but jumps at each turn.
    kinks = {"pivot_friction": 2e-8, "group_drag": 2e-8, "bob_attraction": 2e-7}
    np.testing.assert_allclose(total, total[0], rtol=0, atol=kinks.get(effect.name, 3e-9))


@EACH
def test_round_trips(effect: Effect) -> None:
    cradle = with_effect(EXAMPLES[effect.name], effect.name)
    assert cradle.has(effect.name)
    again = cradle.replace(effects={name: dict(values) for name, values in cradle.effects.items()})
    assert again == cradle
    assert hash(again) == hash(cradle)
    assert again.composition == cradle.composition
    for field in dataclasses.fields(cradle):
        assert getattr(cradle.replace(b=0.5).replace(b=cradle.b), field.name) == getattr(cradle, field.name)


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize(
    ("name", "force", "angle", "tolerance"),
    [
        # Both have a kink, or nearly one, at each turning point, which costs the order there.
        ("quadratic_drag", quadratic_drag, 0.3, 2e-7),
        ("pivot_friction", pivot_friction, 0.3, 1e-6),
        # At most 0.017 rad/s: friction never saturates, and is smooth.
        ("pivot_friction", pivot_friction, 0.003, 5e-9),
    ],
    ids=["c2", "tau_c", "tau_c, slow"],
)
def test_forces_on_rigid_strings(name: str, force: Force, angle: float, tolerance: float, linear: bool) -> None:
    cradle = (HO if linear else PENDULUM).replace(effects={name: EXAMPLES[name].values})
    expected = one_bob(cradle, force, angle, linear=linear)
    np.testing.assert_allclose(angles(cradle, angle), expected, rtol=0, atol=tolerance)


# --- refusals ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "chosen", "message"),
    [
        ("nsp", {"quadratic_drg": {"c2": 1e-3}}, r"unknown effect 'quadratic_drg'; did you mean 'quadratic_drag'\?"),
        ("nsp", {"-string_hysteresi": {}}, r"did you mean 'string_hysteresis'\?"),
        ("npp", {}, r"unknown model 'npp'; did you mean 'nsp'\?"),
        ("nsp", {"quadratic_drag": {"c_2": 1e-3}}, r"unknown parameter of quadratic_drag 'c_2'; did you mean 'c2'\?"),
        ("nsp", {"quadratic_drag": {}}, r"quadratic_drag: c2 \[kg/m\] is missing"),
        ("nsp", {"quadratic_drag": {"c2": -1e-3}}, r"quadratic_drag: c2 is -0.001 kg/m; it must be at least 0"),
        ("nsp", {"quadratic_drag": {"c2": math.nan}}, "quadratic_drag: c2"),
        ("nsp", {"quadratic_drag": {"c2": "much"}}, "quadratic_drag: c2"),
        ("nsp", {"quadratic_drag": {"c2": [1e-3, 1e-3]}}, "quadratic_drag: c2"),
        ("pendulum", {"string_hysteresis": {}}, "'string_hysteresis' requires 'radial_elasticity'"),
        ("nsp", {"-radial_elasticity": {}}, "requires 'radial_elasticity'"),
        ("ho", {"radial_elasticity": {}}, "requires 'large_angle'"),
        ("nsp", {"-quadratic_drag": {}}, "has no effect 'quadratic_drag' to take out"),
        ("nsp", {"-string_hysteresis": {"strength": 0.5}}, "string_hysteresis"),
    ],
)
def test_refusals(model: str, chosen: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Cradle(bobs=2, model=model, effects=chosen)


# --- effects from outside ---------------------------------------------------------------------------------------


@pytest.fixture
def own_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a test registers is gone after it."""
    monkeypatch.setattr(effects_module, "_EFFECTS", dict(effects_module._EFFECTS))


def wind(t, r, theta, v_r, v_t, parameters):
    push = parameters[0] * math.cos(parameters[1] * t)
    return push * math.sin(theta), push * math.cos(theta)


def cubic_drag(t, r, theta, v_r, v_t, parameters):
    speed2 = v_r * v_r + v_t * v_t
    return -parameters[0] * speed2 * v_r, -parameters[0] * speed2 * v_t


def outside(name: str, force, *keys: str) -> Effect:
    parameters = tuple(Parameter(key, key, "1", key, absent=0.0, low=-10.0, high=10.0, scale=1.0) for key in keys)
    text = dict.fromkeys(("symbol", "summary", "equation", "reference", "energy", "looks_like"), name)
    return Effect(name=name, acts_on="bob", parameters=parameters, force=force, **text)


WIND = {"wind": {"push": 0.01, "frequency": 3.0}}
DRAG = {"cubic_drag": {"c3": 0.3}}


@pytest.mark.usefixtures("own_catalogue")
@pytest.mark.parametrize("chosen", [WIND, DRAG, {**WIND, **DRAG}, {**DRAG, **WIND}], ids=["1", "2", "12", "21"])
def test_forces_from_outside(chosen: dict) -> None:
    register(outside("wind", wind, "push", "frequency"))
    register(outside("cubic_drag", cubic_drag, "c3"))

    def force(t: float, r: float, theta: float, v_r: float, v_t: float) -> tuple[float, float]:
        total = np.zeros(2)
        if "wind" in chosen:
            total += wind(t, r, theta, v_r, v_t, [0.01, 3.0])
        if "cubic_drag" in chosen:
            total += cubic_drag(t, r, theta, v_r, v_t, [0.3])
        return float(total[0]), float(total[1])

    for base, options in ((HO, {"linear": True}), (PENDULUM, {}), (ELASTIC, {"elastic": True})):
        cradle = base.replace(effects={**base.effects, **chosen})
        np.testing.assert_allclose(angles(cradle), one_bob(cradle, force, **options), rtol=0, atol=5e-9)
    run = simulate(Cradle(bobs=3, effects=chosen), RELEASE, 5.0, tolerance=1e-19)
    np.testing.assert_allclose(run.energy().total, run.energy().total[0], rtol=0, atol=3e-9)


@pytest.mark.usefixtures("own_catalogue")
def test_absent_force_from_outside_is_the_base_bit_for_bit() -> None:
    effect = register(outside("cubic_drag", cubic_drag, "c3"))
    runs = [simulate(Cradle(bobs=3, effects=e), RELEASE, 5.0) for e in ({}, {"cubic_drag": effect.absent_values()})]
    np.testing.assert_array_equal(runs[0].theta, runs[1].theta)


def test_threads_share_one_compiled_force() -> None:
    """Another, once dropped, would take its machine code with it while a run calls it by its address."""
    ready = threading.Barrier(4)

    def compile_it(_: int):
        ready.wait()
        return compiled(((cubic_drag, 1),))

    with ThreadPoolExecutor(4) as pool:
        assert len(set(map(id, pool.map(compile_it, range(4))))) == 1


@pytest.mark.usefixtures("own_catalogue")
def test_refused_from_outside() -> None:
    with pytest.raises(ValueError, match="in the catalogue already"):
        register(outside("quadratic_drag", cubic_drag, "c2"))
    with pytest.raises(ValueError, match="does nothing"):
        register(outside("nothing", None))
    with pytest.raises(ValueError, match="acts_on is 'sky'"):
        dataclasses.replace(outside("wind", wind), acts_on="sky")
    with pytest.raises(ValueError, match="at most 48"):
        outside("too_much", wind, *(f"c{i}" for i in range(49)))
    with pytest.raises(ValueError, match="c: absent at its upper bound, 0; state it with the other sign"):
        Parameter("c", "c", "1", "of no use to a search", absent=0.0, low=-1.0, high=0.0, scale=0.1)
    keys = [f"c{i}" for i in range(25)]
    register(outside("wind", wind, *keys))
    register(outside("cubic_drag", cubic_drag, *keys))
    values = dict.fromkeys(("wind", "cubic_drag"), dict.fromkeys(keys, 1.0))
    with pytest.raises(ValueError, match="50 parameters"):
        simulate(Cradle(bobs=2, effects=values), RELEASE, 1.0)


def test_what_a_film_states_is_known_and_no_candidate():
    for declared in FILMED:
        assert effects_module.effect(declared.name) is declared
        assert declared not in (*CATALOGUE, *known_effects())
