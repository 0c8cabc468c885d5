"""Measure what controllers without a plan return on the registered environments: `python -m studies.baselines`.

Writes results.md and baselines.png beside this file. Methods: random actions; the best constant δ of a grid (and
release angle, where that is an action), chosen on other episodes; a linear law written by hand; and, with --ppo, agents
trained by PPO on NewtonCradle5-v0, one for each of 5 seeds.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from cradle_env import __version__
from cradle_env.envs.registration import ENVIRONMENTS
from studies.baselines.figure import draw
from studies.baselines.policies import at_random, by_hand, constant, play

#: One step of NewtonCradleRelease-v0 is an episode: its controllers are all constant.
NAMES = tuple(name for name in ENVIRONMENTS if name != "NewtonCradleRelease-v0")
#: First seeds: of the episodes that methods are compared on, and of those from which the constant is chosen.
HELD_OUT, OTHERS = 1_000_000, 2_000_000
#: δ of the grid, as actions.
GRID = np.linspace(-1.0, 1.0, 21)
_LEARNED_ON, _AGENTS = "NewtonCradle5-v0", 5
_HERE = Path(__file__).parent


def main() -> None:
    """Measure, then write the page and the figure."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.baselines", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=20, help="episodes that methods are compared on, one seed each")
    parser.add_argument("--grid-episodes", type=int, default=6, help="episodes for each δ of the grid")
    parser.add_argument("--ppo", type=int, default=0, metavar="STEPS", help="train PPO for so many control intervals")
    parser.add_argument("--out", type=Path, default=_HERE, help="folder for results.md and baselines.png")
    asked = parser.parse_args()
    began, results = time.process_time(), {}
    for name in NAMES:
        results[name] = measure(name, asked.episodes, asked.grid_episodes)
        print(name, {method: round(float(r.mean()), 3) for method, r in results[name]["returns"].items()}, flush=True)
    if asked.ppo:
        from studies.baselines.ppo import train

        agents = [play(_LEARNED_ON, train(_LEARNED_ON, asked.ppo, seed), asked.episodes, HELD_OUT).mean()
                  for seed in range(_AGENTS)]  # fmt: skip
        results[_LEARNED_ON]["returns"]["PPO"] = np.array(agents)
    asked.out.mkdir(parents=True, exist_ok=True)
    took = time.process_time() - began
    (asked.out / "results.md").write_text(page(results, asked, took), encoding="utf-8")
    draw(results, asked.out / "baselines.png")
    print((asked.out / "results.md").read_text(encoding="utf-8"))


def measure(name: str, episodes: int, grid_episodes: int) -> dict[str, Any]:
    """Returns of the methods, each (episodes,), and those of the grid: δ (21,), returns (21, grid_episodes)."""
    settings = gym.make(name).unwrapped.settings  # type: ignore[attr-defined]
    angles = (-1.0, 0.0, 1.0) if "release_angle" in settings.actions else (0.0,)
    actions = np.array([[delta, angle][: len(settings.actions)] for delta in GRID for angle in angles])
    returns = play(name, constant(np.repeat(actions, grid_episodes, axis=0)), len(actions) * grid_episodes, OTHERS)
    returns = returns.reshape(len(GRID), len(angles), grid_episodes)
    best = actions[np.argmax(returns.mean(axis=-1))]
    nearest = returns.mean(axis=-1).argmax(axis=1)
    low, high = settings.delta_range
    return {
        "best": float(np.interp(best[0], [-1.0, 0.0, 1.0], [low, 0.0, high])),
        "grid": {
            "delta": np.interp(GRID, [-1.0, 0.0, 1.0], [low, 0.0, high]),
            "returns": returns[np.arange(len(GRID)), nearest],
        },
        "returns": {
            "random": play(name, at_random(name, 0), episodes, HELD_OUT),
            "constant δ": play(name, constant(best), episodes, HELD_OUT),
            "by hand": play(name, by_hand(name), episodes, HELD_OUT),
        },
    }


def page(results: dict[str, dict[str, Any]], asked: argparse.Namespace, took: float) -> str:
    """The results as Markdown."""
    options = f" --ppo {asked.ppo}" if asked.ppo else ""
    text = [
        "# Baselines of the registered environments",
        "",
        f"Made by `python -m studies.baselines{options}`, newtons-cradle {__version__}, in {took:.0f} s of processor "
        f"time. Mean return ± standard error over {asked.episodes} episodes, each with a seed of its own.",
        "",
        "| environment | random | best constant δ | at δ = | by hand | PPO | constant over best |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, result in results.items():
        returns = result["returns"]
        cells = [_cell(returns[method]) for method in ("random", "constant δ", "by hand")]
        cells.insert(2, f"{result['best']:.3f}")
        cells.append(_cell(returns["PPO"]) if "PPO" in returns else "not run")
        best = max(values.mean() for values in returns.values())
        text.append(f"| `{name}` | {' | '.join(cells)} | {returns['constant δ'].mean() / best:.0%} |")
    text += ["", "![What each constant δ returns, beside the other methods](baselines.png)", "", *_NOTES]
    return "\n".join(text) + "\n"


def _cell(returns: np.ndarray) -> str:
    return f"{returns.mean():.3f} ± {returns.std(ddof=1) / np.sqrt(len(returns)):.3f}"


_NOTES = (
    "- Where the last column is near 100 %, a constant δ is nearly as good as anything that was tried.",
    "- Bands of the figure are two standard errors to either side; for PPO over agents, one for each training seed.",
    f"- The constant δ is the best of {len(GRID)}, chosen on other episodes.",
    "- By hand: a linear law in the angle between the end bobs and its rate (`policies.py`), its weights found by "
    "trial with five bobs and used for all.",
    "- `NewtonCradle-v0` draws nothing at random: all its episodes under one policy are alike. Its return is at most "
    "−ln 0.05 = 3.0.",
    "- `NewtonCradleRelease-v0` is left out: its episode is one action, so that the best constant is the optimum.",
)


if __name__ == "__main__":
    main()
