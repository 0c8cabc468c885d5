"""Agents of Stable-Baselines3 on a registered environment; needs `pip install 'newtons-cradle[examples]'`."""
# pyright: reportMissingImports=false

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.vec_env import VecNormalize

from cradle_env.envs.sb3 import CradleVecEnv
from studies.baselines.policies import Policy

#: Cradles that one agent learns on at once.
_CRADLES = 16
ALGORITHMS: dict[str, tuple[Any, dict[str, Any]]] = {
    "PPO": (PPO, {"n_steps": 256, "batch_size": 512, "n_epochs": 10}),
    "SAC": (SAC, {"train_freq": 4, "gradient_steps": 16, "learning_starts": 3000, "ent_coef": 0.01}),
}


def train(algorithm: str, name: str, steps: int, seed: int) -> Policy:
    """What an agent does that has learned from `steps` control intervals, without exploring."""
    torch.set_num_threads(1)
    kind, settings = ALGORITHMS[algorithm]
    cradles = VecNormalize(CradleVecEnv(name, _CRADLES, workers=1))
    model = kind(
        "MlpPolicy", cradles, seed=seed, device="cpu", learning_rate=lambda left: 1e-3 * left,
        policy_kwargs={"net_arch": [64, 64]}, **settings,
    )  # fmt: skip
    model.learn(steps)
    cradles.close()
    return lambda observations: model.predict(cradles.normalize_obs(observations), deterministic=True)[0]
