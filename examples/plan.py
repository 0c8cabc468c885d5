"""Model-predictive control: the spacer's next moves are tried on copies of the cradle, and the best are made.

    python examples/plan.py [--task sustain|synchronize] [--candidates K] [--horizon S] [--out DIR]

The state of the cradle, repeated K times and given to K others at once, copies it exactly, the strings' memory and
all. The copies try K courses of the spacer at once, the cross-entropy method draws better ones around the
best of them, and the cradle makes the first moves of what it finds. Nothing is learned. The tasks are those of
examples/tasks.py.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv

sys.path.insert(0, str(Path(__file__).resolve().parent))

from tasks import HELD_OUT, SETTINGS, TASKS, baselines, best_fixed, draw_behaviour, line, make

#: Moves made before planning again, rounds of the search, and how many of the best courses it goes on from.
MADE, ROUNDS, BEST = 2, 3, 8


def returns_of(courses: np.ndarray, state: Any, imagined: VectorEnv) -> np.ndarray:
    """What each of the courses (K, moves) returns from a state, up to the end of the episode."""
    imagined.set_state(state)  # type: ignore[attr-defined]
    total, going = np.zeros(len(courses)), np.ones(len(courses), bool)
    for actions in courses.T:
        _, rewards, terminated, truncated, _ = imagined.step(actions[:, None])
        total += going * rewards
        going &= ~(terminated | truncated)
    return total


def planned(course: np.ndarray, state: Any, imagined: VectorEnv, rng: np.random.Generator) -> np.ndarray:
    """A better course of the spacer than `course` (moves,), by the cross-entropy method."""
    count = imagined.num_envs
    state = state.repeated(count)
    mean, spread = course, np.full(len(course), 0.8)
    best, most = course, -np.inf
    for _ in range(ROUNDS):
        courses = np.clip(mean + spread * rng.standard_normal((count, len(course))), -1.0, 1.0)
        courses[0], courses[1] = mean, best
        returns = returns_of(courses, state, imagined)
        order = np.argsort(-returns)[:BEST]
        mean, spread = courses[order].mean(axis=0), courses[order].std(axis=0) + 0.05
        if returns[order[0]] > most:
            best, most = courses[order[0]], returns[order[0]]
    return best


def play_planned(
    task: str, fixed: float, episode: int, candidates: int, moves: int, seed: int
) -> dict[str, np.ndarray]:
    """One of the held-out episodes under the planner, as `tasks.play` gives it. Where nothing is planned yet, the
    spacer is to stay at the best fixed action, `fixed`."""
    cradle, imagined = make(task, 1), make(task, candidates)
    rng = np.random.default_rng((seed, episode))
    cradle.reset(seed=HELD_OUT + episode)
    imagined.reset(seed=0)
    course, gained, rows, over = np.full(moves, fixed), 0.0, [], False
    while not over:
        course = planned(course, cradle.get_state(), imagined, rng)  # type: ignore[attr-defined]
        for action in course[:MADE]:
            observations, rewards, terminated, truncated, info = cradle.step(np.array([[action]]))
            gained, over = gained + rewards[0], bool(terminated[0] or truncated[0])
            rows.append(info["final_obs"][0] if over else observations[0])
            if over:
                break
        course = np.concatenate([course[MADE:], np.full(MADE, fixed)])
    cradle.close()
    imagined.close()
    delta, sigma, times = np.array(rows)[:, -3:].T
    length = len(rows) * SETTINGS["control_interval"]
    return {
        "returns": np.array([gained]), "lengths": np.array([length]), "time": times, "delta": delta, "sigma": sigma,
    }  # fmt: skip


def main() -> None:
    """Plans, compares, draws."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", choices=TASKS, default="sustain", help="what is wanted of the bobs")
    parser.add_argument("--candidates", type=int, default=48, help="courses tried at once")
    parser.add_argument("--horizon", type=float, default=2.5, help="how far ahead is planned [s]")
    parser.add_argument("--episodes", type=int, default=4, help="episodes to compare on")
    parser.add_argument("--seed", type=int, default=0, help="of the courses drawn")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder for the results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    others = baselines(options.task, options.episodes)
    moves = max(round(options.horizon / SETTINGS["control_interval"]), MADE)
    began = time.monotonic()
    fixed = best_fixed(options.task)
    runs = [
        play_planned(options.task, fixed, k, options.candidates, moves, options.seed) for k in range(options.episodes)
    ]
    took = time.monotonic() - began
    planner = {**runs[0], **{key: np.concatenate([run[key] for run in runs]) for key in ("returns", "lengths")}}
    print(f"{options.task}, {options.episodes} episodes, mean ± standard error")
    for method, played in {**others, "planned": planner}.items():
        print(line(method, played))
    print(f"planned for {took:.0f} s: {ROUNDS} × {options.candidates} courses of {moves} moves, every {MADE} moves")
    path = options.out / f"{options.task}-plan.png"
    draw_behaviour(options.task, {"best fixed δ": others["best fixed δ"], "planned": planner}, path)
    print(f"Look at {path}")


if __name__ == "__main__":
    main()
