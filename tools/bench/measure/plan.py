"""Benchmark plan: scenes, numbers of users, threads and transports to measure."""

import math
import os
from collections.abc import Sequence

from measure.bodies import body_variants
from measure.scaling import scaling_specs
from measure.scene import IN_PROCESS, Spec
from measure.senses import sense_variants
from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.client import list_transports, transport_named
from sim2vr_harness.runs.config import TrainingConfig

USUAL = ("physics", "render", "env", "train")
NAMES = (*USUAL, "scaling", "senses", "bodies", "memory")
"""What ``--scene`` takes; ``scaling`` is ``physics`` and ``env`` on 1, 2, 4, ... cores,
``senses`` is ``env`` with one sense more at a time, ``bodies`` is ``physics`` and ``env`` with
every body of the game, ``memory`` has no rate."""

DEFAULT_N = 64
_OVER_TRANSPORTS = ("render", "env")


def transports(chosen: str = IN_PROCESS) -> tuple[str, ...]:
    """The ways to an app that there are, in process first.

    Args:
        chosen: the configuration's; one that leads to apps of others leads to nothing else.
    """
    if not transport_named(chosen).reports_reward:
        return (chosen,)
    names = [one.name for one in list_transports() if one.reports_reward]
    return (IN_PROCESS, *(name for name in names if name != IN_PROCESS))


class BenchPlan:
    """What to measure; lists are written with commas.

    Args:
        config: users, apps and learner.
        scene: of :data:`NAMES`; None for :data:`USUAL`.
        n: numbers of users.
        threads: numbers of threads; None for the configuration's, or one per core.
        transport: of :func:`transports`, for the scenes that have apps.
        seconds: of measurement per scene.
        train_steps: user steps of a training iteration.

    Raises:
        InputError: names the option, what was got and what was expected.
    """

    def __init__(
        self,
        config: TrainingConfig,
        scene: Sequence[str] | None = None,
        *,
        n: str = str(DEFAULT_N),
        threads: str | None = None,
        transport: Sequence[str] | None = None,
        seconds: float = 2.0,
        train_steps: int = 1000,
    ) -> None:
        if not 0.0 < seconds < math.inf:
            raise InputError("--seconds", f"{seconds:g}", "more than 0")
        if train_steps < 1:
            raise InputError("--train-steps", str(train_steps), "at least 1")
        usual_threads = str(config.env.cores or len(os.sched_getaffinity(0)))
        self.config = config
        self.scenes = _names("--scene", scene, NAMES) or list(USUAL)
        self.n = _numbers("--n", n)
        self.threads = _numbers("--threads", usual_threads if threads is None else threads)
        known = transports(config.env.app.transport)
        self.transports = _names("--transport", transport, known) or [known[0]]
        self.seconds, self.train_steps = seconds, train_steps


def _names(option: str, given: Sequence[str] | None, known: Sequence[str]) -> list[str]:
    """The names of a list, in the order of ``known``; ``all`` means each of them."""
    names = [name.strip() for part in given or () for name in part.split(",")]
    for name in names:
        if name not in ("all", *known):
            raise unknown_name(option, name, ["all", *known])
    return [name for name in known if name in names or "all" in names]


def _numbers(option: str, given: str) -> list[int]:
    """The whole numbers of a list, each once."""
    numbers = []
    for part in given.split(","):
        try:
            numbers.append(int(part))
        except ValueError:
            expected = "whole numbers with commas, such as 16,64"
            raise InputError(option, repr(given), expected) from None
        if numbers[-1] < 1:
            raise InputError(option, part.strip(), "at least 1")
    return list(dict.fromkeys(numbers))


def specs(plan: BenchPlan) -> list[Spec]:
    """The scenes to take turns, in order; ``memory`` is none of them."""
    found: list[Spec] = []
    for n in plan.n:
        if "scaling" in plan.scenes:
            found += scaling_specs(plan.config, n, max(plan.threads))
        for threads in plan.threads:
            for name in plan.scenes:
                found += _specs(plan, name, n, threads)
    return list({(s.scene, s.n, s.threads, s.transport, s.variant): s for s in found}.values())


def _specs(plan: BenchPlan, name: str, n: int, threads: int) -> list[Spec]:
    if name in ("memory", "scaling"):
        return []
    if name == "physics":
        return [Spec(name, plan.config, n, threads, transport=None)]
    if name == "senses":
        variants = [("", plan.config), *sense_variants(plan.config)]
        return [Spec("env", config, n, threads, variant=variant) for variant, config in variants]
    if name == "bodies":
        return [
            Spec(scene, config, n, threads, transport, variant=variant)
            for variant, config in body_variants(plan.config)
            for scene, transport in (("physics", None), ("env", IN_PROCESS))
        ]
    if name == "train":
        return [Spec(name, plan.config, n, threads, train_steps=plan.train_steps)]
    assert name in _OVER_TRANSPORTS
    return [Spec(name, plan.config, n, threads, transport) for transport in plan.transports]
