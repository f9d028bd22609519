"""What eyes do in Pointing: persons whose decisions are right play with and without the fovea.

Nothing is learned: the hand always goes to what is red. Prints how far the place that a hand goes
to is from the target, and how trials end.

    python tools/research/sight.py --people 6 --seconds 30 --vigour 36
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import torch
from torch import Tensor

from sim2vr_harness.cli.train import _of_people
from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.hierarchical.motor_store import human_policy_for
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy
from sim2vr_harness.runs.config import TrainingConfig, load_config

_STYLUS_M = 0.1
_EYES = ("fovea", "fovea_depth", "gaze")


def _config(*, fovea: bool) -> TrainingConfig:
    """Return the configuration of ``train pointing --people``, or the same without the fovea."""
    config = _of_people(load_config("skills", ["env.app.game=pointing", "env.cores=1"]))
    if fovea:
        return config
    vision = config.env.vision.model_copy(update={"fovea": None})
    senses = tuple(sense for sense in config.env.senses if sense.sense not in _EYES)
    env = config.env.model_copy(update={"vision": vision, "senses": senses})
    return config.model_copy(update={"env": env})


def _target(app: Any) -> np.ndarray:
    """(3,) where the target that is up is, MuJoCo's frame."""
    targets = [each for each in app.scene().objects if each.path == "Board/Target"]
    up = max(targets, key=lambda each: each.color[0] / (each.color[1] + 0.01))
    return np.asarray(position_to_mujoco(up.pose[:3]))


def played(given: argparse.Namespace, *, fovea: bool) -> str:
    """Play, and return a row of a table."""
    config, n = _config(fovea=fovea), given.people
    policy = PersonPolicy(config)
    policy.human.take(human_policy_for(config.env.user, policy.layer.step_s).weights())
    policy.together, policy.draws = n, np.random.default_rng(given.seed)
    policy.vigour.fill_(given.vigour)
    policy.tool[:, 0, 0], policy.tool[:, 1, 0] = _STYLUS_M, 0.6 * _STYLUS_M
    sight, options = policy.values.sight, policy.values.options

    def values(pictures: Tensor, geometry: Tensor, hands: Tensor) -> Tensor:
        red, green, blue = (127.5 * (pictures[:, :3] + 1.0)).unbind(1)
        up = ((red > 150) & (green < 110) & (blue < 110)).float()
        found = torch.zeros(len(pictures), 1, options.count(sight.cells))
        found[:, 0, : sight.cells] = torch.nn.functional.avg_pool2d(up[:, None], 4).flatten(1)
        found[:, 0, options.rest(sight.cells)] = 0.01
        return found

    policy.values.values = values  # type: ignore[method-assign]
    simulation = Simulation(config.env, n)
    simulation.reset(seeds=[given.seed + i for i in range(n)])
    memory, off = policy.begin(n), []
    for _ in range(round(20 * given.seconds)):
        with torch.no_grad():
            actions = policy.act(simulation.observation(), memory, [None] * n)
        goes = memory[0].choice.move[:, 0].numpy() >= 0
        true = np.stack([_target(app) for app in simulation.apps])
        off.append(np.linalg.norm(memory[0].choice.seen[:, 0].numpy() - true, axis=1)[goes])
        policy.restart(memory, simulation.renew(simulation.step(actions)))
    logs = [simulation.logs[i] for i in range(n)]
    taken, wrong, late = (sum(log[k] for log in logs) for k in ("Selections", "Errors", "Timeouts"))
    off_mm = 1e3 * np.concatenate(off)
    placed = np.median(off_mm[off_mm < 60.0])
    rates = f"{wrong / (taken + late):.3f} | {late / (taken + late):.3f}"
    return f"| {fovea} | {given.vigour:g} | {placed:.2f} | {taken + late:.0f} | {rates} |"


def main() -> None:
    """Print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--vigour", type=float, default=36.0)
    parser.add_argument("--seed", type=int, default=500)
    given = parser.parse_args()
    torch.set_num_threads(1)
    print("| fovea | vigour | place off, mm (same target) | trials | errors | time-outs |")
    print("|---|---|---|---|---|---|")
    for fovea in (True, False):
        print(played(given, fovea=fovea), flush=True)


if __name__ == "__main__":
    main()
