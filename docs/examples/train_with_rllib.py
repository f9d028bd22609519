"""A simulated user learns with RLlib (`pip install "ray[rllib]"`): one environment per worker.

python docs/examples/train_with_rllib.py --iterations 20
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env


def make_env(settings: dict[str, Any]) -> gymnasium.Env:
    """Runs in a worker: import and registration happen there."""
    import sim2vr_harness  # noqa: F401 - registers the environments

    env = gymnasium.make("sim2vr/WhacAMole-v0", **settings)
    # RLlib's default networks take one box: the numbers here, see its docs for pictures beside.
    keys = ["proprioception", "stateful_information"]
    return gymnasium.wrappers.FlattenObservation(
        gymnasium.wrappers.FilterObservation(env, filter_keys=keys)
    )


def main() -> None:
    """Train, and print the mean return of every iteration."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--iterations", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--batch-size", type=int, default=4000, help="user steps per iteration")
    arguments = parser.parse_args()

    register_env("sim2vr", make_env)
    config = (
        PPOConfig()
        .environment("sim2vr")
        .env_runners(num_env_runners=arguments.workers)
        .training(
            train_batch_size_per_learner=arguments.batch_size,
            minibatch_size=min(500, arguments.batch_size),
            num_epochs=5,
            lr=3e-4,
            gamma=0.99,
        )
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[256, 256]))
    )
    algorithm = config.build_algo()
    for iteration in range(arguments.iterations):
        result = algorithm.train()
        mean = result["env_runners"].get("episode_return_mean", float("nan"))
        print(f"iteration {iteration + 1}: return {mean:.1f}")
    algorithm.stop()


if __name__ == "__main__":
    main()
