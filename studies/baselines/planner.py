"""Model-predictive control: courses of the spacer are tried on exact copies of the cradle, the best is begun."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

# Courses tried at once, rounds of the cross-entropy method, the best from which the next round is drawn, moves of a
# course (1.6 s of the benchmarks), and moves made before planning again.
_COURSES, _ROUNDS, _BEST, _MOVES, _MADE = 32, 2, 6, 16, 2


def plan(name: str, seed: int) -> float:
    """The return of one episode; the planner knows the cradle and its state, whatever the observations show."""
    how: dict[str, Any] = {"vectorization_mode": "vector_entry_point", "autoreset_mode": "SameStep", "workers": 1}
    cradle, copies = gym.make_vec(name, 1, **how), gym.make_vec(name, _COURSES, **how)
    width, rng = cradle.single_action_space.shape[0], np.random.default_rng(seed)
    cradle.reset(seed=seed)
    copies.reset(seed=0)
    course, gained, over = np.zeros((_MOVES, width)), 0.0, False
    while not over:
        course = _better(course, cradle, copies, rng)
        for action in course[:_MADE]:
            _, rewards, terminated, truncated, _ = cradle.step(action[None])
            gained, over = gained + float(rewards[0]), bool(terminated[0] or truncated[0])
            if over:
                break
        course = np.concatenate([course[_MADE:], np.zeros((_MADE, width))])
    cradle.close()
    copies.close()
    return gained


def _better(course: np.ndarray, cradle: Any, copies: Any, rng: np.random.Generator) -> np.ndarray:
    """The best course (moves, A) found around `course`, by the cross-entropy method."""
    state = cradle.get_state().repeated(copies.num_envs)
    mean, spread = course, np.full_like(course, 0.8)
    best, most = course, -np.inf
    for _ in range(_ROUNDS):
        courses = np.clip(mean + spread * rng.standard_normal((copies.num_envs, *course.shape)), -1.0, 1.0)
        courses[0], courses[1] = mean, best
        returns = _returns(courses, copies, state)
        order = np.argsort(-returns)[:_BEST]
        mean, spread = courses[order].mean(axis=0), courses[order].std(axis=0) + 0.05
        if returns[order[0]] > most:
            best, most = courses[order[0]], returns[order[0]]
    return best


def _returns(courses: np.ndarray, copies: Any, state: Any) -> np.ndarray:
    """What each of the courses (K, moves, A) returns from a state on, up to the end of the episode."""
    copies.set_state(state)
    total, going = np.zeros(len(courses)), np.ones(len(courses), bool)
    for actions in np.moveaxis(courses, 1, 0):
        _, rewards, terminated, truncated, _ = copies.step(actions)
        total += going * rewards
        going &= ~(terminated | truncated)
    return total
