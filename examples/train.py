"""An agent learns to move the spacer: PPO or SAC of Stable-Baselines3 against the best fixed setting.

    pip install 'newtons-cradle[examples]'
    python examples/train.py [--algorithm PPO|SAC] [--task sustain|synchronize] [--steps N] [--out DIR] [--gif]

The tasks are those of examples/tasks.py. Agents learn on 16 cradles at once, in the native vector environment; all
methods are compared on the same episodes, which none has seen.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from cradle_env.envs.sb3 import CradleVecEnv

sys.path.insert(0, str(Path(__file__).resolve().parent))

from tasks import (
    BLUE,
    ENVIRONMENT,
    GREY,
    OTHERS,
    SKY,
    TASKS,
    VERMILLION,
    Policy,
    again,
    baselines,
    draw_behaviour,
    line,
    play,
)

#: Cradles at once.
CRADLES = 16
ALGORITHMS: dict[str, tuple[Any, int, dict[str, Any]]] = {
    "PPO": (PPO, 400_000, {"n_steps": 256, "batch_size": 512, "n_epochs": 10}),
    "SAC": (SAC, 80_000, {"train_freq": 4, "gradient_steps": 16, "learning_starts": 3000, "ent_coef": 0.01}),
}


class Progress(BaseCallback):
    """Plays some episodes with the agent as it is, now and then; `curve` has steps, mean return, standard error."""

    def __init__(self, task: str, every: int, episodes: int) -> None:
        super().__init__()
        self.task, self.every, self.episodes = task, every, episodes
        self.curve: list[tuple[int, float, float]] = []

    def _on_step(self) -> bool:
        if self.num_timesteps >= self.every * len(self.curve):
            returns = play(self.task, policy_of(self.model), self.episodes, OTHERS)["returns"]
            error = returns.std() / np.sqrt(max(len(returns) - 1, 1))
            self.curve.append((self.num_timesteps, float(returns.mean()), float(error)))
        return True


def policy_of(model: Any) -> Policy:
    """What the agent does when it does not explore."""
    scaled = model.get_vec_normalize_env().normalize_obs
    return lambda observations: model.predict(scaled(observations), deterministic=True)[0]


def train(algorithm: str, task: str, steps: int, seed: int, episodes: int) -> tuple[Any, np.ndarray]:
    """The trained agent, and its learning curve: rows of steps, return, standard error."""
    kind, _, numbers = ALGORITHMS[algorithm]
    # Angles, speeds and δ differ by orders of magnitude, and a step's reward is 1/600 at most: both are scaled.
    cradles = VecNormalize(CradleVecEnv(ENVIRONMENT, CRADLES, reward=task))
    numbers = {"learning_rate": lambda left: 1e-3 * left, "policy_kwargs": {"net_arch": [64, 64]}, **numbers}
    model = kind("MlpPolicy", cradles, seed=seed, device="cpu", **numbers)
    progress = Progress(task, max(steps // 20, 2048), episodes)
    model.learn(steps, callback=progress)
    cradles.close()
    return model, np.array(progress.curve)


def draw_learning(curve: np.ndarray, levels: dict[str, float], name: str, path: Path) -> None:
    """Return against steps, with the levels of the other methods."""
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    panel = figure.subplots()
    steps, returns, errors = curve[:, 0] / 1000.0, curve[:, 1], curve[:, 2]
    panel.fill_between(steps, returns - errors, returns + errors, color=BLUE, alpha=0.25, lw=0)
    panel.plot(steps, returns, color=BLUE, marker="o", ms=3.5, label=name)
    styles = ((SKY, "-", 4.0), (VERMILLION, "--", 1.5), (GREY, "-.", 1.5))
    for (method, level), (colour, style, width) in zip(levels.items(), styles, strict=True):
        panel.axhline(level, color=colour, ls=style, lw=width, label=method, zorder=1)
    panel.set(xlabel="control intervals seen in training [thousands]", ylabel="return of an episode")
    panel.set_xlim(0.0, None)
    panel.legend(facecolor="white", framealpha=1.0, edgecolor="none", loc="center right")
    figure.savefig(path, dpi=150)


def main() -> None:
    """Trains, compares, draws."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--algorithm", choices=tuple(ALGORITHMS), default="PPO")
    parser.add_argument("--task", choices=TASKS, default="sustain", help="what is wanted of the bobs")
    parser.add_argument("--steps", type=int, help="control intervals to learn from")
    parser.add_argument("--episodes", type=int, default=40, help="episodes to compare on")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    parser.add_argument("--gif", action="store_true", help="also a film of the first 8 s")
    options = parser.parse_args()
    torch.set_num_threads(1)
    options.out.mkdir(parents=True, exist_ok=True)
    task, name = options.task, f"{options.task}-{options.algorithm}"
    others = baselines(task, options.episodes)
    began = time.monotonic()
    steps = options.steps or ALGORITHMS[options.algorithm][1]
    model, curve = train(options.algorithm, task, steps, options.seed, min(options.episodes, 20))
    took = time.monotonic() - began
    learned = play(task, policy_of(model), options.episodes)
    print(f"{task}, {options.episodes} episodes, mean ± standard error")
    for method, played in {**others, options.algorithm: learned}.items():
        print(line(method, played))
    print(f"{options.algorithm} learned for {took:.0f} s from {model.num_timesteps} control intervals")
    levels = {method: float(played["returns"].mean()) for method, played in others.items()}
    paths = [options.out / f"{name}-{picture}" for picture in ("learning.png", "behaviour.png")]
    draw_learning(curve, levels, options.algorithm, paths[0])
    draw_behaviour(task, {"best fixed δ": others["best fixed δ"], options.algorithm: learned}, paths[1])
    if options.gif:
        from cradle_env.rendering import save_animation

        paths.append(options.out / f"{name}.gif")
        save_animation(again(task, learned, 2, 8.0, frames=True)["frames"], paths[-1], 20.0)
    print("Look at", *paths, sep="\n  ")


if __name__ == "__main__":
    main()
