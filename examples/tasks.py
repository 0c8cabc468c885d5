"""Two tasks for the spacer of a cradle, and what can be had of them without learning or planning.

    python examples/tasks.py [--task sustain|synchronize] [--episodes N]

sustain: five bobs are to click on for a minute. Left alone they soon swing together; a spacer that moves at the right
moments does work on them. synchronize: the same bobs are to swing together as soon as possible. In both, the release
angle differs from episode to episode.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from cradle_env.envs.registration import ENVIRONMENTS

#: The registered environment whose settings both tasks have.
ENVIRONMENT = "NewtonCradleMedium-v0"
BOBS = 5
SETTINGS = ENVIRONMENTS[ENVIRONMENT]["kwargs"]
TASKS = ("sustain", "synchronize")
#: Seed of the first episode that methods are compared on; they learn and choose from others.
HELD_OUT, OTHERS = 1_000_000, 2_000_000
#: Colours of Okabe & Ito.
BLUE, SKY, GREEN, ORANGE, VERMILLION, GREY = "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#777777"
#: Weights (1, θ_N − θ_1 [rad], ω_N − ω_1 [rad/s]) of the hand-made controllers: found by trial, kept simple.
HAND_MADE = {"sustain": (1.3, -8.0, -0.25), "synchronize": (0.1, 12.0, -0.2)}

Policy = Callable[[np.ndarray], np.ndarray]


def make(task: str, count: int, **changes: Any) -> gym.vector.VectorEnv:
    """`count` cradles in the native vector environment; an episode that is over begins anew within the same step."""
    settings = {"reward": task, "autoreset_mode": "SameStep", **changes}
    return gym.make_vec(ENVIRONMENT, num_envs=count, vectorization_mode="vector_entry_point", **settings)


def play(task: str, policy: Policy, count: int, seed: int = HELD_OUT, **changes: Any) -> dict[str, np.ndarray]:
    """One episode of each of `count` cradles: returns, and lengths [s], (count,); and time [s], delta, sigma (T,) of
    the first. policy: actions (count, 1) in [−1, 1] from observations (count, 4 N + 3).
    """
    cradles = make(task, count, **changes)
    observations, _ = cradles.reset(seed=seed)
    returns, lengths, going = np.zeros(count), np.zeros(count), np.ones(count, bool)
    first = []
    while going.any():
        observations, rewards, terminated, truncated, info = cradles.step(policy(observations))
        over = terminated | truncated
        if going[0]:
            first.append(info["final_obs"][0] if over[0] else observations[0])
        returns += going * rewards
        lengths += going * SETTINGS["control_interval"]
        going &= ~over
    cradles.close()
    delta, sigma, time = np.array(first)[:, -3:].T
    return {"returns": returns, "lengths": lengths, "time": time, "delta": delta, "sigma": sigma}


def constant(actions: Any) -> Policy:
    """The spacer stays where it was at the release: one action for all cradles, or one for each."""
    return lambda observations: np.broadcast_to(np.reshape(actions, (-1, 1)), (len(observations), 1))


def by_hand(task: str) -> Policy:
    """A linear function of how far apart the end bobs are, and how fast they part."""
    level, angle, speed = HAND_MADE[task]

    def policy(observations: np.ndarray) -> np.ndarray:
        theta, omega = observations[:, BOBS : 2 * BOBS], observations[:, 3 * BOBS : 4 * BOBS]
        asked = level + angle * (theta[:, -1] - theta[:, 0]) + speed * (omega[:, -1] - omega[:, 0])
        return np.clip(asked, -1.0, 1.0)[:, None]

    return policy


def best_fixed(task: str, settings: int = 41, episodes: int = 10) -> float:
    """The action that, never changed, returns most: the best of a grid, on episodes that are not held out."""
    grid = np.linspace(-1.0, 1.0, settings)
    returns = play(task, constant(np.repeat(grid, episodes)), settings * episodes, OTHERS)["returns"]
    return float(grid[np.argmax(returns.reshape(settings, episodes).mean(axis=1))])


def baselines(task: str, episodes: int) -> dict[str, dict[str, np.ndarray]]:
    """What `play` gives for the controllers without learning or planning."""
    policies = {
        "nothing done": constant(0.0),
        "best fixed δ": constant(best_fixed(task, episodes=10 if episodes > 2 else 2)),
        "by hand": by_hand(task),
    }
    return {name: play(task, policy, episodes) for name, policy in policies.items()}


def line(name: str, played: dict[str, np.ndarray]) -> str:
    """Return and length of the episodes, mean ± standard error."""
    words = []
    for values in (played["returns"], played["lengths"]):
        error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.nan
        words.append((values.mean(), error))
    (gained, gained_error), (took, took_error) = words
    return f"{name:<14} return {gained:6.3f} ± {gained_error:.3f}   lasts {took:5.1f} ± {took_error:.1f} s"


def again(task: str, played: dict[str, np.ndarray], rate: int, seconds: float, frames: bool = False) -> dict[str, Any]:
    """The first episode that was played, `rate` times a control interval: the spacer takes the same course.

    time [s], theta (T, N) [rad]; frames: pictures, (T, H, W, 3) uint8.
    """
    interval = SETTINGS["control_interval"]
    settings = {"reward": task, "control_interval": interval / rate}
    mode = "rgb_array" if frames else None
    cradle = gym.make(ENVIRONMENT, render_mode=mode, max_episode_steps=10**6, **settings)
    low, high = cradle.unwrapped.settings.delta_range
    cradle.reset(seed=HELD_OUT)
    times = interval / rate * np.arange(1, round(min(seconds, played["time"][-1]) / interval) * rate + 1)
    # The spacer is set at the release, and moves at a constant speed within each control interval.
    delta = np.interp(times, played["time"], played["delta"])
    shown, pictures = [], []
    for action in np.interp(delta, [low, 0.0, high], [-1.0, 0.0, 1.0]):
        shown.append(cradle.step(np.array([action]))[0])
        if frames:
            pictures.append(cradle.render())
    cradle.close()
    return {"time": times, "theta": np.array(shown)[:, BOBS : 2 * BOBS], "frames": np.array(pictures)}


def draw_behaviour(task: str, played: dict[str, dict[str, np.ndarray]], path: Path, seconds: float = 10.0) -> None:
    """θ of all bobs for every one of `played`, δ and σ of all of them, on the first held-out episode."""
    from matplotlib.figure import Figure

    count = len(played)
    figure = Figure(figsize=(8.0, 2.0 * count + 4.2), layout="constrained")
    panels = figure.subplots(count + 2, 1, gridspec_kw={"height_ratios": [1.0] * (count + 1) + [1.2]})
    shades = [BLUE, SKY, GREY, ORANGE, VERMILLION]
    motions = {name: again(task, one, 6, seconds) for name, one in played.items()}
    widest = 1.1 * max(np.abs(motion["theta"]).max() for motion in motions.values())
    for panel, (name, motion) in zip(panels, motions.items(), strict=False):
        for bob in range(BOBS):
            panel.plot(motion["time"], motion["theta"][:, bob], color=shades[bob], lw=1.1, label=f"bob {bob + 1}")
        panel.set(ylabel="θ [rad]", ylim=(-widest, widest), title=name)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=BOBS, frameon=False)
    for (name, one), colour, width in zip(played.items(), (GREY, GREEN, ORANGE), (2.0, 1.3, 1.3), strict=False):
        course = np.interp([0.0, *one["time"]], one["time"], one["delta"])  # the first δ is that of the release
        panels[-2].plot([0.0, *one["time"]], course, color=colour, lw=width, label=name)
        panels[-1].plot(one["time"], one["sigma"], color=colour, lw=width, label=name)
    panels[-2].set(ylabel="spacer δ", xlabel="t [s]", ylim=(-0.025, 0.105))
    for panel in panels[:-1]:
        panel.set_xlim(0.0, seconds)
    longest = max(one["time"][-1] for one in played.values())
    panels[-1].set(ylabel="σ", xlabel="t [s], the whole episode", xlim=(0.0, longest), yscale="log", ylim=(0.02, 6.0))
    panels[-1].axhspan(0.02, 0.05, color=GREY, alpha=0.15, lw=0, zorder=0)
    panels[-1].annotate("synchronized", (0.5 * longest, 0.022), color=GREY, ha="center", va="bottom")
    panels[-1].legend(frameon=False, ncols=count, loc="upper right")
    figure.align_ylabels(panels)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Prints what the baselines return."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", choices=TASKS, default="sustain", help="what is wanted of the bobs")
    parser.add_argument("--episodes", type=int, default=40, help="episodes to compare on")
    options = parser.parse_args()
    for name, played in baselines(options.task, options.episodes).items():
        print(line(name, played))


if __name__ == "__main__":
    main()
