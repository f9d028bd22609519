"""Timers around named stages of a step, put in place for a profile and taken away again."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Any

__all__ = ["SEAMS", "StageClock", "timed_stages"]

SEAMS: tuple[tuple[str, str], ...] = (
    ("physics", "mujoco.batch:Batch.step"),
    ("physics", "mujoco.batch:Batch.forward"),
    ("physics", "mujoco.batch:Batch.reset"),
    ("effort", "sim2vr_harness.users.effort:EffortModel.update"),
    ("users, Python", "sim2vr_harness.users.batch:UserBatch.step"),
    ("users, Python", "sim2vr_harness.users.batch:UserBatch.reset"),
    ("pose conversion", "sim2vr_harness.client.frames:pose_to_app"),
    ("pose conversion", "sim2vr_harness.users.batch:UserBatch.device_poses"),
    ("game and drawing", "sim2vr_harness._app_runtime:AppBatch.step"),
    ("game and drawing", "sim2vr_harness._app_runtime:AppBatch.reset"),
    ("apps, Python", "sim2vr_harness.envs.app_group:BatchGroup.step"),
    ("apps, Python", "sim2vr_harness.envs.app_group:BatchGroup.reset"),
    ("apps, Python", "sim2vr_harness.envs.app_group:BatchGroup.logs"),
    ("perception", "sim2vr_harness.perception.vision:HeadsetVision.take"),
    ("perception", "sim2vr_harness.perception.proprioception:Proprioception.observe"),
    ("simulation, Python", "sim2vr_harness.envs.simulation:Simulation.step"),
    ("simulation, Python", "sim2vr_harness.envs.simulation:Simulation.reset"),
    ("observation", "sim2vr_harness.envs.simulation:Simulation.observation"),
    ("vector env, Python", "sim2vr_harness.training.vec_env:SimulationVecEnv.step_wait"),
    ("policy, acting", "sim2vr_harness.training.policy:UserPolicy.forward"),
    ("policy, acting", "sim2vr_harness.training.policy:UserPolicy.predict_values"),
    ("buffer", "sim2vr_harness.training.buffer:FrameRolloutBuffer.reset"),
    ("buffer", "sim2vr_harness.training.buffer:FrameRolloutBuffer.add"),
    (
        "buffer",
        "sim2vr_harness.training.buffer:FrameRolloutBuffer.compute_returns_and_advantage",
    ),
    ("update, minibatches", "sim2vr_harness.training.buffer:FrameRolloutBuffer._get_samples"),
    ("update, forward", "sim2vr_harness.training.policy:UserPolicy.evaluate_actions"),
    ("update, backward", "torch:Tensor.backward"),
    ("update, optimiser", "torch.optim:Adam.step"),
    ("rollout, Python", "sim2vr_harness.training.ppo:PPO.collect_rollouts"),
    ("update, other", "sim2vr_harness.training.ppo:PPO.train"),
)
"""Stages and the functions they consist of, ``module:name``. What another stage does inside a
function does not count for it."""


class StageClock:
    """Time of nested stages, each without the stages inside it.

    Args:
        wall: seconds of wall time.
        cpu: seconds of processor time of all threads of the process.
    """

    def __init__(
        self,
        wall: Callable[[], float] = time.perf_counter,
        cpu: Callable[[], float] = time.process_time,
    ) -> None:
        self._clocks = (wall, cpu)
        self._open: list[str] = []
        self._since = (0.0, 0.0)
        self.times: dict[str, tuple[float, float]] = {}
        """Wall and processor time by stage, s."""

    @contextmanager
    def paused(self) -> Iterator[None]:
        """What happens within the block is not booked."""
        before = dict(self.times)
        yield
        self.times = before

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """The time within the block counts for ``name``."""
        self._switch()
        self._open.append(name)
        try:
            yield
        finally:
            self._switch()
            self._open.pop()

    def _switch(self) -> None:
        """Books the time since the last switch for the innermost open stage."""
        now = (self._clocks[0](), self._clocks[1]())
        if self._open:
            wall, cpu = self.times.get(self._open[-1], (0.0, 0.0))
            spent = (wall + now[0] - self._since[0], cpu + now[1] - self._since[1])
            self.times[self._open[-1]] = spent
        self._since = now

    def timed(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        """``function`` with its time booked for stage ``name``."""

        @wraps(function)
        def timed_function(*args: Any, **kwargs: Any) -> Any:
            with self.stage(name):
                return function(*args, **kwargs)

        return timed_function


@contextmanager
def timed_stages(clock: StageClock) -> Iterator[list[str]]:
    """Puts timers around the functions of :data:`SEAMS` within the block.

    Outside of it nothing is slowed: the functions are those that the modules define.

    Yields:
        The functions that do not exist (renamed since), which are therefore not timed.
    """
    missing: list[str] = []
    with ExitStack() as stack:
        for stage, target in SEAMS:
            places = list(_places(target))
            if not places:
                missing.append(target)
            for owner, name in places:
                # Taken from the owner itself: an inherited method is put back by deleting it.
                own = name in vars(owner)
                original = getattr(owner, name)
                setattr(owner, name, clock.timed(original, stage))
                undo: Callable[..., Any] = setattr if own else delattr
                stack.callback(undo, owner, name, *([original] if own else []))
        yield missing


def _places(target: str) -> Iterator[tuple[Any, str]]:
    """Where a function must be replaced: (owner, attribute)."""
    module_name, _, path = target.partition(":")
    try:
        module = importlib.import_module(module_name)
    except ImportError:
        return
    class_name, _, name = path.rpartition(".")
    if class_name:
        owner = getattr(module, class_name, None)
        if owner is None or not hasattr(owner, name):
            return
        yield owner, name
        yield from ((child, name) for child in _subclasses(owner) if name in vars(child))
        return
    function = getattr(module, name, None)
    if function is None:
        return
    # A plain function also goes by the names under which other modules have imported it.
    for loaded in [m for key, m in sys.modules.items() if key.startswith("sim2vr_harness")]:
        for attribute, value in list(vars(loaded).items()):
            if value is function:
                yield loaded, attribute


def _subclasses(owner: type[Any]) -> Iterator[type[Any]]:
    children: list[type[Any]] = owner.__subclasses__()
    for child in children:
        yield child
        yield from _subclasses(child)
