"""The sampler: exact on a known posterior, resumable bit for bit, honest about convergence."""

import dataclasses
import math
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from cradle_env import CATALOGUE, Effect, Parameter
from identification.inference.checkpoint import Chains, Checkpoint
from identification.inference.convergence import assess_convergence
from identification.inference.laplace import Mode
from identification.inference.low_rank_noise import LowRankNoise
from identification.inference.mcmc import sample, verdict_steps
from identification.inference.unknowns import Unknown
from identification.storage.files import ExperimentError


@dataclasses.dataclass
class Gaussian:
    """A stand-in for a likelihood: two correlated normal unknowns and a blob, their sum."""

    workers: int | None = 1

    def __post_init__(self):
        self.unknowns = (Unknown("a", "1", "a", 0.0), Unknown("b", "1", "b", 0.0))
        self.names = ["a", "b"]
        self.experiment = SimpleNamespace(digest="same", cradle=SimpleNamespace(composition=()))
        self.precision = np.linalg.inv([[1.0, 0.6], [0.6, 2.0]])

    def log_densities(self, points):
        density = -0.5 * np.einsum("ki,ij,kj->k", points, self.precision, points)
        return np.column_stack([density, points.sum(axis=1)])


def quiet(*_):
    pass


def chains(folder, steps, seed=3):
    likelihood = Gaussian()
    checkpoint = Checkpoint(folder / "chain.h5", likelihood, seed)
    if not checkpoint.exists():
        # Off centre and half as wide: the proposals must not need a good mode to be exact.
        checkpoint.begin(Mode(np.array([0.5, -0.5]), 0.25 * np.eye(2), 0.0), [], [1.0])
    verdict = sample(likelihood, checkpoint, steps=steps, max_steps=20000, progress=quiet)
    return verdict, checkpoint.read()


def test_a_known_posterior_is_recovered(tmp_path):
    verdict, sampled = chains(tmp_path, None)
    assert verdict.converged and verdict.rhat_max < 1.01 and verdict.ess_min >= 400
    points = sampled.chain[:, verdict.burn_in :].reshape(-1, 2)
    error = 4.0 / math.sqrt(verdict.ess_min)  # four standard errors of a mean
    assert np.all(np.abs(points.mean(axis=0)) < error * np.sqrt([1.0, 2.0]))
    assert np.cov(points.T) == pytest.approx(np.array([[1.0, 0.6], [0.6, 2.0]]), abs=2.5 * error)
    blob = sampled.newton_exponent[:, verdict.burn_in :].ravel()
    assert blob.var() == pytest.approx(4.2, rel=2.5 * error)


def test_jumps_are_kept_beside_the_chains(tmp_path):
    checkpoint, rng = Checkpoint(tmp_path / "chain.h5", Gaussian(), 0), np.random.default_rng(0)
    jumps = [LowRankNoise(rng.standard_normal((30, k)), rng.standard_normal(k)) for k in (2, 0)]
    checkpoint.begin(Mode(np.zeros(2), np.eye(2), 0.0), jumps, [1.0, 3.0])
    assert checkpoint.inflations() == [1.0, 3.0]
    for kept, own in zip(checkpoint.impact_order(), jumps, strict=True):
        np.testing.assert_array_equal(kept.directions, own.directions)
        np.testing.assert_array_equal(kept.sizes, own.sizes)


def test_a_resumed_chain_is_the_uninterrupted_one(tmp_path):
    (tmp_path / "whole").mkdir()
    (tmp_path / "parts").mkdir()
    _, whole = chains(tmp_path / "whole", 90)
    for steps in (50, 63, 90):
        _, parts = chains(tmp_path / "parts", steps)
    assert np.array_equal(whole.chain, parts.chain)
    assert np.array_equal(whole.newton_exponent, parts.newton_exponent)


def test_a_chain_of_another_seed_is_not_gone_on_with(tmp_path):
    chains(tmp_path, 60)
    with pytest.raises(ExperimentError, match="holds chains of seed 3, not 7"):
        chains(tmp_path, 60, seed=7)


@pytest.mark.parametrize("steps", [41, 44, 45, 46, *(pytest.param(n, marks=pytest.mark.slow) for n in range(240, 247))])
def test_few_steps_after_an_adaptation_are_too_few_to_tell(tmp_path, steps):
    """One step kept has no halves, and no number of steps may be a dead end."""
    verdict, _ = chains(tmp_path, steps)
    assert verdict.steps == steps
    assert (verdict.reasons == ("too few steps",)) == (steps - max(s for s in (0, 40, 240) if s < steps) <= 4)
    assert chains(tmp_path, steps + 1)[0].steps == steps + 1


@pytest.mark.slow
def test_where_a_chain_ends_does_not_hang_on_how_fast_the_machine_is(tmp_path, monkeypatch):
    ends = []
    for seconds in (1e-6, 0.02, 100.0):
        monkeypatch.setattr("identification.inference.mcmc._CHECKPOINT_SECONDS", seconds)
        folder = tmp_path / str(seconds)
        folder.mkdir()
        ends.append(chains(folder, None)[1].chain)
    assert all(np.array_equal(ends[0], end) for end in ends[1:])
    several = [step for step, _ in zip(verdict_steps(), range(60), strict=False)]
    assert several[:11] == [*range(20, 240, 20)] and np.diff(several).max() < 0.12 * several[-1]


def test_asking_for_the_total_again_adds_nothing(tmp_path):
    chains(tmp_path, 60)
    verdict, sampled = chains(tmp_path, 60)
    assert verdict.steps == 60 and sampled.chain.shape[1] == 60


def test_walkers_stuck_in_two_modes_are_not_called_converged():
    rng = np.random.default_rng(0)
    chain = rng.standard_normal((2, 2000, 16, 1))
    chain[1] += 1.0  # the second ensemble sits elsewhere; each alone looks perfect
    verdict = assess_convergence(Chains(chain, np.zeros(chain.shape[:3]), chain[..., 0]))
    assert not verdict.converged and verdict.rhat_max > 1.1
    assert any("R̂" in reason for reason in verdict.reasons)


def test_a_slow_chain_is_refused_with_its_autocorrelation_time():
    rng = np.random.default_rng(1)
    steps = rng.standard_normal((2, 1200, 16, 1))
    slow = np.zeros_like(steps)
    for k in range(1, 1200):  # first-order autoregression with tau = (1 + 0.95) / (1 - 0.95) = 39
        slow[:, k] = 0.95 * slow[:, k - 1] + steps[:, k]
    verdict = assess_convergence(Chains(slow, np.zeros(slow.shape[:3]), np.full(slow.shape[:3], np.nan)))
    assert not verdict.converged and 25 < verdict.tau_max < 60
    assert any("τ" in reason for reason in verdict.reasons)


def test_a_walker_that_never_moved_is_no_converged_chain():
    rng = np.random.default_rng(2)
    chain = rng.standard_normal((2, 600, 16, 1))
    chain[0, :, 3] = 0.1
    verdict = assess_convergence(Chains(chain, np.zeros(chain.shape[:3]), np.full(chain.shape[:3], np.nan)))
    assert not verdict.converged and any("τ" in reason for reason in verdict.reasons)


def test_chains_of_other_data_are_refused(tmp_path):
    chains(tmp_path, 60)
    other = Gaussian()
    other.experiment.digest = "other"
    with pytest.raises(ValueError, match="other data"):
        Checkpoint(tmp_path / "chain.h5", other, 0).exists()


def test_chains_by_another_program_are_refused_and_kept(tmp_path, monkeypatch):
    """Or by one that did not write down which it was."""
    checkpoint, file = Checkpoint(tmp_path / "chain.h5", Gaussian(), 3), tmp_path / "chain.h5"
    refusal = r"chain\.h5: holds chains by another version of the program, .* choose another --out, or remove the file"
    chains(tmp_path, 60)
    assert checkpoint.exists()
    with monkeypatch.context() as patch:
        patch.setattr("identification.storage.provenance._sources", lambda: "other")
        with pytest.raises(ExperimentError, match=refusal):
            checkpoint.exists()
    assert checkpoint.exists()
    with h5py.File(file, "a") as content:
        del content.attrs["program"]
    with pytest.raises(ExperimentError, match=refusal):
        checkpoint.exists()
    assert file.exists()


def braked(by: float) -> Effect:
    """An effect of one's own, whose force is edited."""
    text = dict.fromkeys(("symbol", "summary", "equation", "reference", "energy", "looks_like"), "brake")
    strength = Parameter("strength", "c", "kg/s", "drag", absent=0.0, low=0.0, high=1.0, scale=1e-2)
    force = lambda t, r, theta, v_r, v_t, p: (-by * p[0] * v_r, -by * p[0] * v_t)  # noqa: E731
    return Effect(name="brake", acts_on="bob", parameters=(strength,), force=force, **text)


def test_chains_of_an_edited_effect_are_refused(tmp_path):
    likelihood = Gaussian()
    checkpoint, cradle = Checkpoint(tmp_path / "chain.h5", likelihood, 3), likelihood.experiment.cradle
    cradle.composition = [CATALOGUE[0], braked(1.0)]
    checkpoint.begin(Mode(np.zeros(2), np.eye(2), 0.0), [], [1.0])
    cradle.composition = [CATALOGUE[0], braked(1.0)]
    assert checkpoint.exists()
    cradle.composition = [CATALOGUE[0], braked(2.0)]
    with pytest.raises(ExperimentError, match="or with another declaration of an effect"):
        checkpoint.exists()


def test_chains_that_know_nothing_of_jumps_are_refused(tmp_path):
    """As calibrations of before wrote them."""
    chains(tmp_path, 60)
    with h5py.File(tmp_path / "chain.h5", "a") as file:
        del file["jumps"]
    with pytest.raises(
        ValueError, match=r"chain\.h5: jumps is missing; it is not a chain that can be resumed; remove it"
    ):
        Checkpoint(tmp_path / "chain.h5", Gaussian(), 0).exists()


def test_chains_that_deny_their_blobs_are_refused(tmp_path):
    chains(tmp_path, 60)
    with h5py.File(tmp_path / "chain.h5", "a") as file:
        file["ensemble_1"].attrs["has_blobs"] = False
    with pytest.raises(ExperimentError, match=r"ensemble_1\.has_blobs is not true"):
        Checkpoint(tmp_path / "chain.h5", Gaussian(), 3).exists()


def test_a_half_written_stretch_is_ignored(tmp_path):
    """What a kill leaves behind: the working copy, cut short."""
    chains(tmp_path, 60)
    whole = (tmp_path / "chain.h5").read_bytes()
    (tmp_path / "chain.h5.part").write_bytes(whole[: len(whole) // 2])
    verdict, _ = chains(tmp_path, 70)
    assert verdict.steps == 70
