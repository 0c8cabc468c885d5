"""PPO of Stable-Baselines3 on a registered environment; needs `pip install 'newtons-cradle[examples]'`."""
# pyright: reportMissingImports=false

from __future__ import annotations

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from cradle_env.envs.sb3 import CradleVecEnv
from studies.baselines.policies import Policy

#: Cradles that one agent learns on at once.
_CRADLES = 16


def train(name: str, steps: int, seed: int) -> Policy:
    """What an agent does that has learned from `steps` control intervals, without exploring."""
    torch.set_num_threads(1)
    cradles = VecNormalize(CradleVecEnv(name, _CRADLES))
    model = PPO(
        "MlpPolicy", cradles, seed=seed, device="cpu", n_steps=256, batch_size=512, n_epochs=10,
        learning_rate=lambda left: 1e-3 * left, policy_kwargs={"net_arch": [64, 64]},
    )  # fmt: skip
    model.learn(steps)
    return lambda observations: model.predict(cradles.normalize_obs(observations), deterministic=True)[0]
