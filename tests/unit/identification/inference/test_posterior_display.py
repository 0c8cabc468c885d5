"""What a posterior is to a notebook: one line, a table, pictures, and data for ArviZ."""

import os
import subprocess
import sys

import numpy as np
import pytest
from matplotlib import get_cachedir

from cradle_env import Cradle, display
from identification.experiment.experiment import Experiment
from identification.inference.posterior import Posterior
from tests.fragment import Fragment
from tests.synthetic import made_up_posterior, simulated_run

EVIL = '"><script>alert(1)</script>.csv'


@pytest.fixture(scope="module")
def posterior():
    cradle = Cradle(bobs=2)
    return made_up_posterior(Experiment(cradle, (simulated_run(cradle, duration=6.0, file=EVIL),)))


def test_repr_states_each_unknown_with_its_uncertainty_and_unit(posterior):
    line = repr(posterior)
    assert line.startswith("Posterior(k_f = 180") and line.endswith(", converged)") and len(line) <= display.LINE
    assert " N s m^-3/2, kappa = 196.6" in line and ")·10⁻³ kg/s, converged)" in line


def test_repr_says_that_chains_have_not_converged():
    cradle = Cradle(bobs=1, model="pendulum")
    posterior = made_up_posterior(Experiment(cradle, (simulated_run(cradle, duration=4.0),)), converged=False)
    assert repr(posterior).endswith(", not converged)")
    assert "not converged: R̂ = 1.0700, wanted below 1.01" in Fragment(posterior._repr_html_()).caption


def test_html_has_a_row_for_each_unknown_and_one_picture(posterior):
    fragment = Fragment(posterior._repr_html_())
    assert EVIL in fragment.caption and "1.00 fitted, 1.01 held out" in fragment.caption
    header, *rows = fragment.rows
    assert header == ["unknown", "median", "sd", "95 % interval", "unit"]
    assert [row[0] for row in rows] == [*posterior.likelihood.names, "lambda"]
    found = {row[0]: row for row in rows}
    assert float(found["k_f"][1]) == pytest.approx(np.median(posterior.samples("k_f")), abs=1.0)
    assert found["k_f"][4] == "N s m^-3/2" and found["b"][4] == "10⁻³ kg/s"
    assert len(fragment.images) == 1 and fragment.images[0]["alt"]


def test_the_small_picture_holds_what_the_table_holds(posterior):
    from identification.inference.posterior_plots import marginals_figure

    titles = [axes.get_title(loc="left") for axes in marginals_figure(posterior).axes if axes.get_visible()]
    assert len(titles) == 4 and all(" ± " in title for title in titles)
    assert titles[0].startswith(r"$k_{\mathrm{f}}$ = 180") and titles[-1].startswith("$λ$ = ")


def test_pictures_are_matplotlib_figures_that_a_notebook_shows(posterior):
    from matplotlib.figure import Figure

    for figure, panels in ((posterior.plot_corner(), 16), (posterior.plot_fit(), 6)):
        assert isinstance(figure, Figure) and len(figure.axes) == panels
        assert figure._repr_png_().startswith(b"\x89PNG")


def test_inference_data_holds_the_samples_in_their_units(posterior):
    data = posterior.to_inference_data()
    for unknown in posterior.unknowns:
        variable = data["posterior"][unknown.name]
        assert variable.dims == ("chain", "draw") and variable.attrs["units"] == unknown.unit
        assert np.array_equal(np.ravel(variable), posterior.samples(unknown.name))
    assert np.array_equal(np.ravel(data["posterior"]["lambda"]), posterior.newton_exponents.ravel())
    assert data["posterior"]["lambda"].attrs["units"] == "1/s"
    assert np.array_equal(np.ravel(data["sample_stats"]["lp"]), posterior.log_density.ravel())


def test_inference_data_and_posterior_nc_are_the_same(posterior, tmp_path):
    import arviz

    ours, theirs = tmp_path / "ours.nc", tmp_path / "theirs.nc"
    posterior.save(ours)
    data = posterior.to_inference_data()
    data.to_netcdf(str(theirs), engine="h5netcdf")
    read = arviz.from_netcdf(str(ours))
    for group in ("posterior", "sample_stats"):
        assert set(read[group].data_vars) == set(data[group].data_vars)
        for name in data[group].data_vars:
            assert np.array_equal(read[group][name], data[group][name])
            assert read[group][name].attrs == data[group][name].attrs
    for again in (Posterior.load(ours), Posterior.load(theirs)):
        assert np.allclose(again.chain, posterior.chain, rtol=1e-12, atol=0.0)
        assert again.convergence == posterior.convergence and again.seed == posterior.seed


STUB = """
from types import SimpleNamespace as Stub
import numpy as np
from identification.inference.arviz_data import inference_data
from identification.inference.convergence import Convergence
from identification.inference.gap import Gap
from identification.inference.posterior_plots import corner_figure
from identification.inference.unknowns import Unknown

z = np.random.default_rng(0).standard_normal((1, 50, 4, 2))
stub = Stub(unknowns=[Unknown("k_f", "N s m^-3/2", "k_f", 1.0), Unknown("b", "kg/s", "b", 1.0)], chain=z, seed=0,
    samples=lambda name: z[..., "kb".index(name[0])].ravel(), newton_exponents=None, log_density=z[..., 0],
    gap=Gap(1.0, 1.0), contributions=None, convergence=Convergence(True, 1.0, 800.0, 3.0, 50, 0),
    likelihood=Stub(noise_model=Stub(inflations=[1.0])), experiment=Stub(texts=dict, digest=""))
"""


@pytest.mark.slow
@pytest.mark.parametrize("use", ["corner_figure(stub)", "inference_data(stub)"])
def test_no_notice_of_arviz_reaches_the_user(use, tmp_path):
    """ArviZ 0.23 announces 1.0 once a day and home; what it has announced is noted in the cache."""
    run = subprocess.run(
        [sys.executable, "-W", "default", "-c", STUB + use],
        capture_output=True,
        text=True,
        timeout=300.0,
        # Matplotlib keeps its list of fonts, which takes seconds to make.
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path), "MPLCONFIGDIR": get_cachedir()},
    )
    assert run.returncode == 0, run.stderr
    assert "ArviZ" not in run.stderr and "FutureWarning" not in run.stderr
