#!/usr/bin/env python3
"""What learning from images costs, and where: network, rollout buffer, whole iterations.

    tools/bench/policy.py                   everything, some five minutes
    tools/bench/policy.py network buffer    parts of it
    tools/bench/policy.py iteration --users 10 --epochs 10

Variants are measured in turns and medians are printed, so that other programs slow them alike;
the last line says how many cores those took meanwhile. ``plain`` is Stable-Baselines3 as it comes:
its DictRolloutBuffer, images channel by channel, torch's own threads.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal
from unittest import mock

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictRolloutBuffer
from stable_baselines3.common.logger import Logger
from torch import Tensor, nn

from sim2vr_harness.training import ppo
from sim2vr_harness.training.buffer import FrameRolloutBuffer
from sim2vr_harness.training.config import PolicyConfig, load_config
from sim2vr_harness.training.memory import keep_freed_memory
from sim2vr_harness.training.policy import UserPolicy, VisionEncoder
from sim2vr_harness.training.threads import torch_threads
from sim2vr_harness.training.vec_env import SimulationVecEnv

SPACE = spaces.Dict(
    {
        "vision": spaces.Box(0, 255, (2, 80, 120), np.uint8),
        "proprioception": spaces.Box(-np.inf, np.inf, (56,), np.float32),
        "stateful_information": spaces.Box(-1, 1, (1,), np.float32),
    }
)
ACTIONS = spaces.Box(-1, 1, (32,), np.float32)
MINIBATCH = 1000
CORES = len(os.sched_getaffinity(0))
Row = dict[str, Any]
Precision = Literal["float32", "bfloat16"]


class PlainEncoder(nn.Module):
    """The vision encoder written down as the reference has it; the weights are another's."""

    def __init__(self, encoder: VisionEncoder) -> None:
        super().__init__()
        convolutions: Any = encoder.convolutions
        self.convolutions = convolutions.to(memory_format=torch.contiguous_format)
        self.linear = encoder.linear

    def forward(self, image: Tensor) -> Tensor:
        """Encode (B, C, H, W) uint8."""
        return self.linear(self.convolutions((image.float() / 255.0 - 0.5) * 2.0).flatten(1))


class Whole(UserPolicy):
    """Leaves the cores to torch instead of giving every one a shard."""

    in_shards = False


def plain(policy: UserPolicy) -> UserPolicy:
    """Turn a policy into what it would be without any of our optimisations."""
    encoders: Any = policy.features_extractor.encoders
    encoders["vision"] = PlainEncoder(encoders["vision"])
    policy.__class__ = Whole
    policy.optimizer = torch.optim.Adam(policy.parameters(), lr=5e-5, eps=1e-5)
    return policy


# --- the network ---------------------------------------------------------------------------------


def network(rounds: int) -> Iterator[Row]:
    """Samples per second: forward as in a rollout, and a minibatch with everything."""
    for cores in sorted({1, CORES}):
        # Policy, its images, torch's threads: shards have threads of their own.
        variants = {
            "plain": (plain(_policy()), _observation, cores),
            "channels last, torch's threads": (_policy(kind=Whole), _channels_last, cores),
            "as shipped": (_policy(workers=cores), _channels_last, 1),
            "as shipped, bfloat16": (_policy("bfloat16", workers=cores), _channels_last, 1),
        }
        for batch in (1, 10, 64, 512, MINIBATCH):
            kind = _learning if batch == MINIBATCH else _acting
            rates = _in_turns(
                {
                    name: _with_threads(kind(policy, make(batch)), threads)
                    for name, (policy, make, threads) in variants.items()
                },
                rounds,
                repeat=max(1, 256 // batch),
            )
            for name, seconds in rates.items():
                yield {
                    "what": "minibatch" if batch == MINIBATCH else "forward",
                    "batch": batch,
                    "cores": cores,
                    "variant": name,
                    "samples_per_s": round(batch / seconds),
                    "ms": round(1e3 * seconds, 2),
                }


def _with_threads(call: Callable[[], None], threads: int) -> Callable[[], None]:
    def limited() -> None:
        with torch_threads(threads):
            call()

    return limited


def _policy(
    precision: Precision = "float32", workers: int = 1, kind: type[UserPolicy] = UserPolicy
) -> UserPolicy:
    torch.manual_seed(1)
    policy = kind(SPACE, ACTIONS, lambda _: 5e-5, PolicyConfig(vision_precision=precision))
    policy.workers = workers
    return policy


def _observation(batch: int) -> dict[str, Tensor]:
    return {
        "vision": torch.randint(0, 256, (batch, 2, 80, 120), dtype=torch.uint8),
        "proprioception": torch.randn((batch, 56)),
        "stateful_information": torch.rand((batch, 1)),
    }


def _channels_last(batch: int) -> dict[str, Tensor]:
    observation = _observation(batch)
    observation["vision"] = observation["vision"].contiguous(memory_format=torch.channels_last)
    return observation


def _acting(policy: UserPolicy, observation: dict[str, Tensor]) -> Callable[[], None]:
    def act() -> None:
        with torch.no_grad():
            policy(observation)

    return act


def _learning(policy: UserPolicy, observation: dict[str, Tensor]) -> Callable[[], None]:
    actions = torch.randn((MINIBATCH, 32))
    with torch.no_grad():
        _, old, _ = policy.evaluate_actions(observation, actions)

    def learn() -> None:
        values, log_prob, _ = policy.evaluate_actions(observation, actions)
        loss: Any = torch.exp(log_prob - old).mean() + 0.5 * (values - 1.0).square().mean()
        policy.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(policy.parameters(), 0.5)
        policy.optimizer.step()

    return learn


# --- the rollout buffer --------------------------------------------------------------------------


def buffer(rounds: int) -> Iterator[Row]:
    """Milliseconds to add one step of 64 users and to gather one minibatch."""
    users, steps = 64, 125
    kinds = {"plain": DictRolloutBuffer, "as shipped": FrameRolloutBuffer}
    made = {name: kind(steps, SPACE, ACTIONS, "cpu", n_envs=users) for name, kind in kinds.items()}
    rng = np.random.default_rng(1)
    seen = {key: value.numpy() for key, value in _observation(users).items()}
    turned = {key: value.numpy() for key, value in _channels_last(users).items()}
    action = rng.standard_normal((users, 32), dtype=np.float32)
    zeros = np.zeros(users, np.float32)
    step = (action, zeros, zeros, torch.zeros(users, 1), torch.zeros(users))

    def adding(kind: Any, observation: dict[str, np.ndarray]) -> Callable[[], None]:
        def add() -> None:
            kind.pos %= steps
            kind.add(observation, *step)

        return add

    def gathering(kind: Any) -> Callable[[], None]:
        batches: Iterator[Any] = iter(())

        def gather() -> None:
            nonlocal batches
            if next(batches, None) is None:
                batches = kind.get(MINIBATCH)
                next(batches)

        return gather

    calls = {f"add: {name}": adding(kind, seen) for name, kind in made.items()}
    calls["add: as shipped, images channels last"] = adding(made["as shipped"], turned)
    for name, seconds in _in_turns(calls, rounds, repeat=20).items():
        yield {"what": name, "users": users, "ms": round(1e3 * seconds, 3)}
    for kind in made.values():
        kind.pos, kind.full = steps, True
    calls = {f"gather: {name}": gathering(kind) for name, kind in made.items()}
    for name, seconds in _in_turns(calls, rounds, repeat=8).items():
        yield {"what": name, "batch": MINIBATCH, "ms": round(1e3 * seconds, 3)}


# --- whole iterations ----------------------------------------------------------------------------

ROLLOUT = ("env step", "policy forward", "buffer add", "other")
UPDATE = ("gather", "forward", "backward", "clip and Adam", "other")


def iteration(users: int, epochs: int, precision: Precision, rounds: int) -> Iterator[Row]:
    """Split one iteration of a training in the app; plain and as shipped, in turns."""
    steps = max(1, 8000 // users)
    while users * steps % MINIBATCH:
        steps += 1
    sets = (f"ppo.n_envs={users}", f"ppo.n_steps={steps}", f"ppo.n_epochs={epochs}")
    models = {
        "plain": _model((*sets,), is_plain=True),
        "as shipped": _model((*sets, f"policy.vision_precision={precision}"), is_plain=False),
    }
    spent: dict[str, list[dict[str, float]]] = {name: [] for name in models}
    for turn in range(rounds + 1):
        for name, model in models.items():
            with _stopwatch(model) as seconds:
                model.learn(users * steps, reset_num_timesteps=False)
            rollout, update = model.last_times
            seconds["rollout"], seconds["update"] = rollout, update
            seconds["rollout: other"] = rollout - sum(
                seconds[f"rollout: {part}"] for part in ROLLOUT[:-1]
            )
            seconds["update: other"] = update - sum(
                seconds[f"update: {part}"] for part in UPDATE[:-1]
            )
            if turn:
                spent[name].append(dict(seconds))
    for name, runs in spent.items():
        median = {key: float(np.median([run[key] for run in runs])) for key in runs[0]}
        total = users * steps
        row: Row = {"what": "iteration", "users": users, "epochs": epochs, "variant": name}
        row["train_steps_per_s"] = round(total / (median["rollout"] + median["update"]), 1)
        row["rollout_steps_per_s"] = round(total / median["rollout"], 1)
        row["update_samples_per_s"] = round(total * epochs / median["update"], 1)
        # Per step of all users, and per minibatch.
        share = {"rollout": steps, "update": total * epochs // MINIBATCH}
        for key, value in sorted(median.items()):
            row[f"{key}, ms"] = round(1e3 * value / share[key.partition(":")[0]], 2)
        yield row
        model = models[name]
        assert model.env is not None
        model.env.close()


def _model(overrides: tuple[str, ...], is_plain: bool) -> ppo.PPO:
    from sim2vr_harness.envs.simulation import Simulation

    config = load_config("whacamole_constrained", overrides)
    env = SimulationVecEnv(Simulation(config.env, config.ppo.n_envs))
    kind = DictRolloutBuffer if is_plain else FrameRolloutBuffer
    with mock.patch.object(ppo, "FrameRolloutBuffer", kind):
        model = ppo.build(config, env)
    if is_plain:
        assert isinstance(model.policy, UserPolicy)
        plain(model.policy)
    model.set_logger(Logger(folder=None, output_formats=[]))
    return model


@contextlib.contextmanager
def _stopwatch(model: ppo.PPO) -> Iterator[dict[str, float]]:
    """Time the parts of an iteration, seconds."""
    seconds: dict[str, float] = defaultdict(float)

    def timed(owner: Any, name: str, part: str) -> Any:
        original: Callable[..., Any] = getattr(owner, name)

        def call(*args: Any, **kwargs: Any) -> Any:
            began = time.perf_counter()
            try:
                return original(*args, **kwargs)
            finally:
                seconds[part] += time.perf_counter() - began

        return mock.patch.object(owner, name, call)

    def gathered(get: Any) -> Any:
        def batches(*args: Any) -> Iterator[Any]:
            generator = get(*args)
            while True:
                began = time.perf_counter()
                batch = next(generator, None)
                seconds["update: gather"] += time.perf_counter() - began
                if batch is None:
                    return
                yield batch

        return batches

    with contextlib.ExitStack() as stack:
        for owner, name, part in (
            (model.env, "step", "rollout: env step"),
            (model.policy, "forward", "rollout: policy forward"),
            (model.rollout_buffer, "add", "rollout: buffer add"),
            (model.policy, "evaluate_actions", "update: forward"),
            (torch.Tensor, "backward", "update: backward"),
            (torch.nn.utils, "clip_grad_norm_", "update: clip and Adam"),
            (model.policy.optimizer, "step", "update: clip and Adam"),
        ):
            stack.enter_context(timed(owner, name, part))
        buffer_ = model.rollout_buffer
        stack.enter_context(mock.patch.object(buffer_, "get", gathered(buffer_.get)))
        yield seconds


# --- measuring and printing ----------------------------------------------------------------------


def _in_turns(calls: dict[str, Callable[[], None]], rounds: int, repeat: int) -> dict[str, float]:
    """Return the median seconds of one call of each, measured in turns."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(rounds + 1):
        for name, call in calls.items():
            call()
            began = time.perf_counter()
            for _ in range(repeat):
                call()
            if turn:
                seconds[name].append((time.perf_counter() - began) / repeat)
    return {name: float(np.median(values)) for name, values in seconds.items()}


def _busy_seconds() -> float:
    """Return the processor time that the machine has spent so far (Linux), s."""
    user, nice, system = Path("/proc/stat").read_text().split()[1:4]
    return (int(user) + int(nice) + int(system)) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Run the parts asked for and print their rows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = ("network", "buffer", "iteration")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(parts)} (all)")
    parser.add_argument("--rounds", type=int, default=5, help="turns per measurement")
    parser.add_argument("--users", type=int, nargs="+", default=[64], help="of the iteration")
    parser.add_argument("--epochs", type=int, default=2, help="of the iteration; training has 10")
    parser.add_argument("--precision", default="float32", choices=("float32", "bfloat16"))
    parser.add_argument("--json", type=Path, help="write the rows to this file, too")
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(parts):
        parser.error(f"PART: got {sorted(unknown)[0]!r}, expected one of {', '.join(parts)}")
    keep_freed_memory()
    wall, mine, busy = time.perf_counter(), time.process_time(), _busy_seconds()
    rows: list[Row] = []
    for part in arguments.parts or parts:
        measurements: dict[str, Callable[[], Iterator[Row]]] = {
            "network": lambda: network(arguments.rounds),
            "buffer": lambda: buffer(arguments.rounds),
            "iteration": lambda: (
                row
                for users in arguments.users
                for row in iteration(
                    users, arguments.epochs, arguments.precision, max(1, arguments.rounds // 2)
                )
            ),
        }
        for row in measurements[part]():
            rows.append(row)
            print("  ".join(f"{key}={value}" for key, value in row.items()), flush=True)
    wall, mine = time.perf_counter() - wall, time.process_time() - mine
    others = (_busy_seconds() - busy - mine) / wall
    print(f"{CORES} cores; other programs took {max(0.0, others):.2f} of them on average")
    if arguments.json:
        arguments.json.write_text("".join(f"{json.dumps(row)}\n" for row in rows))


if __name__ == "__main__":
    main()
