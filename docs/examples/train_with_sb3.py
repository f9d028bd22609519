"""A simulated user learns with plain Stable-Baselines3: no stages, no configuration file.

    python docs/examples/train_with_sb3.py --steps 20000 --out user.zip

`sim2vr-harness train` does more: the reference's network, images kept once, exact resumption.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import stable_baselines3

from sim2vr_harness.envs import EnvConfig, Simulation
from sim2vr_harness.envs.config import AppConfig
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv


def main() -> None:
    """Train, and write a model that Stable-Baselines3 loads."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20_000, help="user steps, of all users")
    parser.add_argument("--users", type=int, default=8)
    parser.add_argument("--n-steps", type=int, default=256, help="per user and iteration")
    parser.add_argument("--out", type=Path, default=Path("user.zip"))
    arguments = parser.parse_args()

    config = EnvConfig(app=AppConfig(game="whacamole", options={"condition": "easy"}))
    # N users in one simulation: far quicker than N environments in N processes.
    env = SimulationVecEnv(Simulation(config, arguments.users))
    model = stable_baselines3.PPO(
        "MultiInputPolicy",
        env,
        n_steps=arguments.n_steps,
        batch_size=arguments.users * arguments.n_steps // 8,
        learning_rate=3e-4,
        gamma=0.99,
        seed=1,
        verbose=1,
    )
    model.learn(arguments.steps)
    model.save(arguments.out)
    env.close()
    print(f"Written: {arguments.out}")


if __name__ == "__main__":
    main()
