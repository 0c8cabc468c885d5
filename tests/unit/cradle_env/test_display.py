"""How cradles, releases and runs show themselves in a terminal and in a notebook, and what they turn into."""

import base64

import numpy as np
import pytest

from cradle_env import Cradle, InitialState, Release, display, simulate, simulate_batch
from tests.fragment import Fragment

PNG = b"\x89PNG\r\n\x1a\n"
DRAGGED = {"quadratic_drag": {"c2": 0.002}}
LONG = Cradle(
    bobs=40, delta=tuple(0.001 * i for i in range(39)), effects={"spacer_offset": {"offset": 1e-4}, **DRAGGED}
)


@pytest.fixture(scope="module")
def run():
    return simulate(Cradle(bobs=3, delta=(0.0, 0.01)), Release(angle=0.228), 6.0, 120.0)


@pytest.mark.parametrize(
    ("instance", "text"),
    [
        (Cradle(), "Cradle()"),
        (Cradle(kappa=Cradle().kappa, delta=0.0), "Cradle()"),
        (Cradle(mass=0.5), "Cradle(mass=0.5)"),  # κ follows from the mass
        (Cradle(bobs=2, kappa=196.6, model="pendulum"), "Cradle(bobs=2, kappa=196.6, model='pendulum')"),
        (Cradle(bobs=3, delta=(0.0, 0.01)), "Cradle(bobs=3, delta=(0, 0.01))"),
        (Cradle(effects=DRAGGED), "Cradle(effects={'quadratic_drag': {'c2': 0.002}})"),
        (Cradle(power_law=(0.03, 0.2)), "Cradle(power_law=(0.03, 0.2))"),
        (Release(angle=0.228), "Release(angle=0.228)"),
        (Release(angle=0.1, bobs=2, start="hanging"), "Release(angle=0.1, bobs=2, start='hanging')"),
        (Release(angles={5: 0.2, 1: -0.2}), "Release(angles={5: 0.2, 1: -0.2})"),
    ],
)
def test_repr_shows_what_differs_from_the_defaults(instance, text):
    assert repr(instance) == text


def test_repr_of_a_plain_cradle_makes_it_again():
    cradle = Cradle(bobs=3, length=0.25, delta=(0.0, 0.01), model="ho", effects={"large_angle": {}, **DRAGGED})
    assert eval(repr(cradle)) == cradle


@pytest.mark.parametrize("instance", [LONG, Release(angles={i: 0.01 * i for i in range(1, 41)})])
def test_repr_is_one_line_whatever_it_holds(instance):
    assert len(repr(instance)) <= display.LINE and "\n" not in repr(instance) and "…" in repr(instance)


def test_repr_of_a_run_says_what_was_simulated(run):
    assert repr(run).startswith("Trajectory(bobs=3, t=0 to 6 s in 721 samples, impacts=")
    assert repr(run).endswith("release=Release(angle=0.228))") and len(repr(run)) <= display.LINE


def test_a_summary_counts_what_it_leaves_out():
    line = display.summary_line("Kind", [f"parameter_{i}={i}" for i in range(20)], "end")
    assert len(line) <= display.LINE and line.endswith("more, end)")
    shown = line.count("parameter_")
    assert f"… {20 - shown} more" in line and shown >= 5


def test_html_of_a_cradle_states_each_quantity_with_its_unit():
    fragment = Fragment(Cradle(bobs=3, length=0.25, effects=DRAGGED)._repr_html_())
    assert fragment.caption == "Cradle"
    assert ["length", "0.25", "m"] in fragment.rows and ["k_f", "18000", "N s m^-3/2"] in fragment.rows
    assert ["quadratic_drag.c2", "0.002", "kg/m"] in fragment.rows and ["bobs", "3", ""] in fragment.rows


def test_html_of_a_release_states_angles_in_rad():
    assert ["angle", "0.228", "rad"] in Fragment(Release(angle=0.228)._repr_html_()).rows
    assert ["angle of bob 1", "-0.2", "rad"] in Fragment(Release(angles={1: -0.2})._repr_html_()).rows


def test_html_of_a_run_holds_a_picture(run):
    fragment = Fragment(run._repr_html_())
    assert ["release", "Release(angle=0.228)"] in fragment.rows
    (image,) = fragment.images
    assert image["alt"] and base64.b64decode(image["src"].partition(",")[2]).startswith(PNG)


def test_texts_in_html_are_escaped():
    evil = '"><script>alert(1)</script><img src=x onerror="alert(1)">'
    fragment = Fragment(display.table(evil, [(evil, evil)], (evil, evil)))
    assert fragment.rows == [[evil, evil], [evil, evil]] and fragment.caption == evil


@pytest.mark.parametrize(
    "what",
    ["a run", "one bob", "an initial state", "no ledger", "one sample", "uneven times", "all lifted", "many bobs"],
)
def test_every_run_can_be_drawn(what, run):
    release, state = Release(angle=0.1), InitialState(theta=np.array([-0.1, 0.2]), theta_dot=np.zeros(2))
    made = {
        "a run": lambda: run,
        "one bob": lambda: simulate(Cradle(bobs=1), release, 4.0),
        "an initial state": lambda: simulate(Cradle(bobs=2), state, 4.0),
        "no ledger": lambda: simulate_batch(Cradle(bobs=2), release, 4.0)[0],
        "one sample": lambda: simulate(Cradle(bobs=2), release, times=np.array([0.0])),
        "uneven times": lambda: simulate(Cradle(bobs=2), release, times=np.array([0.0, 0.1, 0.3])),
        "all lifted": lambda: simulate(Cradle(bobs=2), Release(angle=0.1, bobs=2), 4.0),
        "many bobs": lambda: simulate(Cradle(bobs=12), release, 1.5),
    }[what]()
    from matplotlib.figure import Figure

    figure = made.plot()
    assert isinstance(figure, Figure) and figure._repr_png_().startswith(PNG)
    assert len(Fragment(made._repr_html_()).images) == 1
    assert len(repr(made)) <= display.LINE and len(made.to_dataframe()) == made.to_xarray().sizes["time"] == len(made.t)


def test_a_picture_shows_angle_sigma_and_energy(run):
    titles = [axes.get_title(loc="left") for part in run.plot().subfigs for axes in part.axes]
    assert "angle of each bob" in titles and "energy, by where it is" in titles
    assert any(title.startswith("λ = ") for title in titles)


def test_a_dataset_holds_the_numbers_and_their_units(run, tmp_path):
    xarray = pytest.importorskip("xarray")
    run.to_xarray().to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    with xarray.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as data:
        assert dict(data.sizes) == {"time": 721, "bob": 3, "impact": len(run.impacts)}
        units = {"theta": "rad", "r": "m", "theta_dot": "rad/s", "r_dot": "m/s"}
        for name, unit in units.items():
            assert np.array_equal(data[name], getattr(run, name)) and data[name].attrs["units"] == unit
            assert np.array_equal(data[name].sel(bob=3), getattr(run, name)[:, 2])
        assert np.array_equal(data.sigma, run.sigma()) and data.sigma.attrs["units"] == "1"
        assert np.array_equal(data.time, run.t) and data.time.attrs["units"] == "s"
        impact_units = {"time": "s", "pair": "1", "speed": "m/s", "loss": "J"}
        for name, unit in impact_units.items():
            assert np.array_equal(data[f"impact_{name}"], run.impacts[name])
            assert data[f"impact_{name}"].attrs["units"] == unit
        assert data.attrs["cradle"] == repr(run.cradle) and data.attrs["release"] == repr(run.release)


def test_a_data_frame_has_a_column_per_bob_with_its_unit(run):
    frame = run.to_dataframe()
    assert frame.index.name == "t [s]" and np.array_equal(frame.index, run.t)
    assert len(frame.columns) == 4 * 3 + 1
    for name, unit in {"theta": "rad", "r": "m", "theta_dot": "rad/s", "r_dot": "m/s"}.items():
        for bob in (1, 2, 3):
            assert np.array_equal(frame[f"{name}_{bob} [{unit}]"], getattr(run, name)[:, bob - 1])
    assert np.array_equal(frame["sigma"], run.sigma())
