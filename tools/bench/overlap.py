"""Measures user steps while apps play beside bodies, for several parts of the users.

Physics alone, and users whose bodies move in one part, in two, three, four and eight, take turns.
With more than one part apps play, and are drawn, while the bodies of the next part move.

Run: python tools/bench/overlap.py --n 64 --threads 16 --seconds 2
"""

import argparse
from contextlib import ExitStack

import numpy as np

from measure.scene import BenchScene, Spec
from measure.scenes import EnvScene, PhysicsScene
from measure.turns import in_turns, paired_ratio
from sim2vr_harness.runs.config import defaults

SHARES = {
    "one part": (1.0,),
    "halves": (0.5, 0.5),
    "1/2 1/4 1/4": (0.5, 0.25, 0.25),
    "quarters": (0.25,) * 4,
    "eighths": (0.125,) * 8,
}


def main() -> None:
    """Measure, and print a row for each way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=64)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each way")
    given = parser.parse_args()
    config = defaults([])
    with ExitStack() as stack:
        scenes: dict[str, BenchScene] = {
            "physics": PhysicsScene(Spec("physics", config, given.n, given.threads, None))
        }
        for name, shares in SHARES.items():
            users = EnvScene(Spec("env", config, given.n, given.threads))
            users.env.simulation._apps.shares = shares
            scenes[name] = users
        for scene in scenes.values():
            stack.callback(scene.close)
        found = in_turns(scenes, given.seconds)
    rates = {name: [turn.rate_per_s for turn in turns] for name, turns in found.items()}
    for name, each in rates.items():
        ratio = paired_ratio(each, rates["physics"])
        cpu_us = np.median([turn.cpu_us for turn in found[name]])
        print(f"{name:12} {np.median(each):8.0f} /s  {ratio:.2f} of physics  {cpu_us:5.0f} us CPU")


if __name__ == "__main__":
    main()
