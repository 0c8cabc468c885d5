"""Measure what controllers return on the registered environments: `python -m studies.baselines`.

Methods: random actions; the best constant δ of a grid (and release angle, where that is an action), chosen on other
episodes; a linear law written by hand; agents trained by PPO and SAC, one for each training seed; a planner that knows
the cradle and its state. Every measurement is kept as a line of results.jsonl beside this file, and made only where it
is not there yet; results.md and baselines.png are made from all of them.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from cradle_env import __version__
from cradle_env.envs.registration import ENVIRONMENTS
from studies.baselines.page import draw, page
from studies.baselines.policies import at_random, by_hand, constant, play
from studies.kept_rows import read_rows

#: One step of NewtonCradleRelease-v0 is an episode: its controllers are all constant.
NAMES = tuple(name for name in ENVIRONMENTS if name != "NewtonCradleRelease-v0")
#: First seeds: of the episodes that methods are compared on, and of those from which the constant is chosen.
HELD_OUT, OTHERS = 1_000_000, 2_000_000
#: δ of the grid, as actions.
GRID = np.linspace(-1.0, 1.0, 21)
SIMPLE, LEARNED = ("constant δ", "random", "by hand"), ("PPO", "SAC")
METHODS = (*SIMPLE, *LEARNED, "planner")
HERE = Path(__file__).parent


def main() -> None:
    """Measure what is missing, then write the page and the figure."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.baselines", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--methods", nargs="*", choices=METHODS, default=METHODS)
    parser.add_argument("--environments", nargs="*", choices=NAMES, default=NAMES)
    parser.add_argument("--episodes", type=int, default=20, help="episodes that methods are compared on, one seed each")
    parser.add_argument("--grid-episodes", type=int, default=6, help="episodes for each δ of the grid")
    parser.add_argument("--seeds", type=int, default=5, help="training seeds of PPO and SAC, an agent each")
    parser.add_argument("--ppo-steps", type=int, default=200_000, help="control intervals that PPO learns from")
    parser.add_argument("--sac-steps", type=int, default=50_000, help="control intervals that SAC learns from")
    parser.add_argument("--plans", type=int, default=5, help="episodes of the planner, which takes its time")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the results")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    file = asked.out / "results.jsonl"
    for key, measure in measurements(asked):
        # Read anew each time: several processes may share the work.
        if any(all(row.get(name) == value for name, value in key.items()) for row in read_rows(file)):
            continue
        began = time.process_time()
        row = {**key, **measure(), "cpu_s": round(time.process_time() - began, 1), "version": __version__}
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(row, ensure_ascii=False) + "\n")
        print(key, f"{np.mean(row['returns']):.3f}", flush=True)
    (asked.out / "results.md").write_text(page(read_rows(file), NAMES), encoding="utf-8")
    draw(read_rows(file), NAMES, asked.out / "baselines.png")
    print((asked.out / "results.md").read_text(encoding="utf-8"))


def measurements(asked: argparse.Namespace) -> Iterator[tuple[dict[str, Any], Callable[[], dict[str, Any]]]]:
    """What is asked for: what names a measurement, and what makes it."""
    for seed in range(asked.seeds):
        for name in asked.environments:
            for method in asked.methods:
                key = {"environment": name, "method": method}
                if method in LEARNED:
                    steps = {"PPO": asked.ppo_steps, "SAC": asked.sac_steps}[method]
                    yield (
                        {**key, "seed": seed, "steps": steps},
                        functools.partial(_learned, name, method, steps, seed, asked.episodes),
                    )
                elif seed == 0:
                    yield key, functools.partial(_simple, name, method, asked)


def _learned(name: str, method: str, steps: int, seed: int, episodes: int) -> dict[str, Any]:
    from studies.baselines.learned import train

    return {"returns": _rounded(play(name, train(method, name, steps, seed), episodes, HELD_OUT))}


def _simple(name: str, method: str, asked: argparse.Namespace) -> dict[str, Any]:
    if method == "constant δ":
        return best_constant(name, asked.episodes, asked.grid_episodes)
    if method == "planner":
        from studies.baselines.planner import plan

        return {"returns": _rounded([plan(name, HELD_OUT + k) for k in range(asked.plans)])}
    policy = at_random(name, 0) if method == "random" else by_hand(name)
    return {"returns": _rounded(play(name, policy, asked.episodes, HELD_OUT))}


def best_constant(name: str, episodes: int, grid_episodes: int) -> dict[str, Any]:
    """The best constant action of a grid: its δ and its returns, (episodes,); and of each δ of the grid, at the best
    release angle, the returns on other episodes, (21, grid_episodes)."""
    settings = gym.make(name).unwrapped.settings  # type: ignore[attr-defined]
    angles = (-1.0, 0.0, 1.0) if "release_angle" in settings.actions else (0.0,)
    actions = np.array([[delta, angle][: len(settings.actions)] for delta in GRID for angle in angles])
    returns = play(name, constant(np.repeat(actions, grid_episodes, axis=0)), len(actions) * grid_episodes, OTHERS)
    returns = returns.reshape(len(GRID), len(angles), grid_episodes)
    best = actions[np.argmax(returns.mean(axis=-1))]
    nearest = returns.mean(axis=-1).argmax(axis=1)
    low, high = settings.delta_range
    delta = functools.partial(np.interp, xp=[-1.0, 0.0, 1.0], fp=[low, 0.0, high])
    return {
        "returns": _rounded(play(name, constant(best), episodes, HELD_OUT)),
        "delta": round(float(delta(best[0])), 4),
        "grid": {"delta": _rounded(delta(GRID)), "returns": _rounded(returns[np.arange(len(GRID)), nearest])},
    }


def _rounded(values: Any) -> list:
    return np.round(values, 5).tolist()


if __name__ == "__main__":
    main()
