"""Bayesian optimisation of an experiment: δ and release angle for the fastest synchronization, and for the slowest.

    pip install 'newtons-cradle[examples]'
    python examples/design.py [--budget N] [--repeats K] [--seed S] [--out DIR]

Every experiment is one step of NewtonCradleRelease-v0. Random search has the same number of experiments; both are
repeated with several seeds. The map in the background, which neither knows, takes a grid of experiments.
"""

import argparse
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
from bayes_opt import BayesianOptimization
from bayes_opt.acquisition import ExpectedImprovement
from matplotlib.figure import Figure
from sklearn.gaussian_process.kernels import Matern

import cradle_env  # noqa: F401  registers the environment

#: Sign of λ in what is maximised.
GOALS = {"fastest": 1.0, "slowest": -1.0}
#: Experiments at random before the first one is chosen.
FIRST = 6
BLUE, ORANGE, VERMILLION, GREY = "#0072B2", "#E69F00", "#D55E00", "#777777"


class Laboratory:
    """Makes experiments: λ [1/s] of two numbers in [−1, 1], which stand for δ and the release angle."""

    def __init__(self) -> None:
        self.cradle = gym.make("NewtonCradleRelease-v0", bobs=5)

    def measure(self, x: float, y: float) -> tuple[float, float, float]:
        """λ [1/s], δ and release angle [rad] of an experiment."""
        self.cradle.reset()
        info = self.cradle.step(np.array([x, y]))[4]
        return info["newton_exponent"], info["delta"], info["release_angle"]


def bayesian(laboratory: Laboratory, sign: float, budget: int, seed: int) -> np.ndarray:
    """Experiments chosen by expected improvement under a Gaussian process: rows of λ, δ, angle."""
    search = BayesianOptimization(
        f=None, pbounds={"x": (-1.0, 1.0), "y": (-1.0, 1.0)}, random_state=seed, verbose=0,
        acquisition_function=ExpectedImprovement(xi=0.01), allow_duplicate_points=True,
    )  # fmt: skip
    # λ changes faster with δ than with the angle, and beats: a length for each, and some of it counted as noise.
    search.set_gp_params(kernel=Matern([0.3, 1.0], [(0.05, 3.0), (0.2, 10.0)], nu=2.5), alpha=0.01)
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(budget):
        point = dict(zip("xy", rng.uniform(-1.0, 1.0, 2), strict=True)) if k < FIRST else search.suggest()
        rows.append(laboratory.measure(**point))
        search.register(point, sign * rows[-1][0])
    return np.array(rows)


def random(laboratory: Laboratory, budget: int, seed: int) -> np.ndarray:
    """Experiments at random: rows of λ, δ, angle."""
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (budget, 2))
    return np.array([laboratory.measure(*point) for point in points])


def mapped(laboratory: Laboratory, columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """δ (C,), angle (R,) [rad] and λ (R, C) [1/s] of a grid of experiments."""
    grid = np.array(
        [
            [laboratory.measure(x, y) for x in np.linspace(-1.0, 1.0, columns)]
            for y in np.linspace(-1.0, 1.0, max(columns // 4, 2))
        ]
    )
    return grid[0, :, 1], grid[:, 0, 2], grid[:, :, 0]


def draw(found: dict[str, dict[str, np.ndarray]], grid: tuple[np.ndarray, np.ndarray, np.ndarray], path: Path) -> None:
    """For each goal, the experiments of one search on the map of λ, and the best so far of all searches."""
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    panels = figure.subplots(len(found), 2, squeeze=False, gridspec_kw={"width_ratios": [1.25, 1.0]})
    for (left, right), (goal, runs) in zip(panels, found.items(), strict=True):
        image = left.pcolormesh(*grid, cmap="cividis", shading="nearest", rasterized=True)
        figure.colorbar(image, ax=left, label="λ [1/s]", pad=0.01)
        rows = runs["Bayesian"][0]
        best = np.argmax(GOALS[goal] * rows[:, 0])
        left.plot(*rows[:FIRST, 1:].T, "o", mfc="none", mec="white", ms=6, clip_on=False, label="at random, to begin")
        left.plot(*rows[FIRST:, 1:].T, "o", color=ORANGE, mec="black", ms=6, clip_on=False, label="chosen")
        left.plot(*rows[best, 1:], "*", color=VERMILLION, mec="white", ms=17, clip_on=False, label="best")
        left.set(xlabel="δ", ylabel="release angle [rad]", title=f"{goal}: one search of {len(rows)} experiments")
        for (method, runs_of), colour in zip(runs.items(), (BLUE, GREY), strict=True):
            so_far = GOALS[goal] * np.maximum.accumulate(GOALS[goal] * runs_of[:, :, 0], axis=1)
            count = np.arange(1, so_far.shape[1] + 1)
            low, middle, high = np.quantile(so_far, [0.1, 0.5, 0.9], axis=0)
            right.fill_between(count, low, high, color=colour, alpha=0.25, lw=0, step="post")
            right.step(count, middle, color=colour, where="post", label=method)
        extreme = grid[2].max() if GOALS[goal] > 0.0 else grid[2].min()
        right.axhline(extreme, color=VERMILLION, ls="--", label=f"best of a grid of {grid[2].size}")
        title = f"{goal}: median of {len(runs_of)} searches, 10 % to 90 %"
        right.set(xlabel="experiments", ylabel="best λ so far [1/s]", title=title, xlim=(1, len(rows)))
        right.legend(frameon=False, loc="lower right" if GOALS[goal] > 0.0 else "upper right")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    frame = {"frameon": True, "facecolor": "#555555", "labelcolor": "white", "edgecolor": "none"}
    figure.legend(handles, labels, loc="outside lower left", ncols=3, **frame)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Searches, compares, draws."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--budget", type=int, default=40, help="experiments of a search")
    parser.add_argument("--repeats", type=int, default=5, help="searches of each kind")
    parser.add_argument("--columns", type=int, default=61, help="values of δ on the map")
    parser.add_argument("--seed", type=int, default=0, help="of the first search")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    laboratory = Laboratory()
    seeds = range(options.seed, options.seed + options.repeats)
    # One series at random serves both goals. Its seeds are others: the first experiments of the two should differ.
    blind = np.array([random(laboratory, options.budget, 1000 + seed) for seed in seeds])
    found = {}
    for goal, sign in GOALS.items():
        chosen = np.array([bayesian(laboratory, sign, options.budget, seed) for seed in seeds])
        found[goal] = {"Bayesian": chosen, "random": blind}
        for method, runs in found[goal].items():
            best = sign * (sign * runs[:, :, 0]).max(axis=1)
            error = best.std(ddof=1) / np.sqrt(len(best)) if len(best) > 1 else np.nan
            run, row = np.unravel_index(np.argmax(sign * runs[:, :, 0]), runs.shape[:2])
            at = f"δ = {runs[run, row, 1]:+.4f}, {runs[run, row, 2]:.3f} rad"
            print(
                f"{goal}, {method:<8}: λ = {best.mean():.4f} ± {error:.4f} 1/s; of all {runs[run, row, 0]:.4f} at {at}"
            )
    grid = mapped(laboratory, options.columns)
    print(f"grid of {grid[2].size}: λ from {grid[2].min():.4f} to {grid[2].max():.4f} 1/s")
    path = options.out / "design.png"
    draw(found, grid, path)
    print(f"{options.repeats} searches of {options.budget} each, in {time.monotonic() - began:.0f} s. Look at {path}")


if __name__ == "__main__":
    main()
