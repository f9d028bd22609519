"""Soft actor-critic of Stable-Baselines3: its stage, and checkpoints that continue exactly.

A checkpoint holds the actor as ``policy.pth``, and beside it critics, optimisers, random generators
and the environment. The replay buffer of the newest one is ``checkpoints/replay_STEP.npz``.
"""

from __future__ import annotations

import inspect
import os
import re
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import stable_baselines3
from gymnasium import spaces

from sim2vr_harness.base.errors import InputError, UnusableFile, closest, shown
from sim2vr_harness.base.files import read_arrays
from sim2vr_harness.base.finite import NotFinite, require_finite
from sim2vr_harness.base.signals import interrupts_deferred
from sim2vr_harness.client.errors import AppDied, AppTimeout
from sim2vr_harness.envs.protocols import SimulationLike
from sim2vr_harness.policies.registry import sac_policy_arguments
from sim2vr_harness.runs.checkpoint import (
    DAMAGE,
    EXPECTED,
    good_parts,
    in_words,
    last_good,
    set_random_state,
)
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder, write_atomically
from sim2vr_harness.training.ppo.checkpoint import load_moment
from sim2vr_harness.training.ppo.checkpointed import CheckpointedStage
from sim2vr_harness.training.ppo.rollout_buffer import buffer_bytes
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
from sim2vr_harness.training.run.callbacks import ProgressCallback
from sim2vr_harness.training.run.episode_stats import episode_means
from sim2vr_harness.training.run.loggers import make_logger
from sim2vr_harness.training.run.progress import TrainingProgress
from sim2vr_harness.training.run.stage import Callbacks
from sim2vr_harness.training.sac.checkpoint import (
    archive,
    buffer_arrays,
    learner_state,
    load_buffer,
    load_learner_state,
    npz,
)

_RANGES: dict[str, tuple[float, float]] = {
    "learning_rate": (0.0, 1.0),
    "buffer_size": (1, 1e9),
    "learning_starts": (0, 1e12),
    "batch_size": (1, 1e8),
    "tau": (0.0, 1.0),
    "gamma": (0.0, 1.0),
    "train_freq": (1, 1e8),
    "gradient_steps": (-1, 1e8),
    "ent_coef": (0.0, 1e6),
    "target_update_interval": (1, 1e12),
    "target_entropy": (-1e6, 1e6),
}
"""Arguments of ``stable_baselines3.SAC`` that a configuration may set, least and greatest value."""
_WORDS = {"ent_coef": r"auto(_\d+(\.\d+)?)?", "target_entropy": "auto"}
"""What an argument may be beside a number."""
_ROWS = 200
"""Rows of metrics.jsonl in a complete training."""


def checked_arguments(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of SAC that a configuration sets, checked against its signature.

    Raises:
        InputError: An argument is unknown, of another type or out of its range.
    """
    known = inspect.signature(stable_baselines3.SAC).parameters
    found: dict[str, Any] = {}
    for name, value in given.items():
        if name not in _RANGES:
            near = closest(name, _RANGES)
            hint = f" (did you mean 'sac.{near}'?)" if near else ""
            raise InputError(f"sac.{name}", "an unknown key", f"one of {', '.join(_RANGES)}{hint}")
        if re.fullmatch(_WORDS.get(name, "(?!)"), str(value)):
            found[name] = value
            continue
        whole = type(known[name].default) is int
        low, high = _RANGES[name]
        number = _number(value)
        if number is None or not low <= number <= high or (whole and number != int(number)):
            kind = "a whole number" if whole else "a number"
            expected = f"{kind} from {low:g} to {high:g}" + ", or auto" * (name in _WORDS)
            raise InputError(f"sac.{name}", shown(value), expected)
        found[name] = int(number) if whole else number
    return found


def _number(value: Any) -> float | None:
    """Return a number, also one that YAML takes for text (1e-3); None: it is none."""
    if isinstance(value, (bool, list, tuple)):
        return None
    try:
        return float(value)
    except ValueError:
        return None


class _SAC(stable_baselines3.SAC):
    """SAC that knows the means of its last episodes."""

    on_row: Callable[[int, dict[str, Any]], None] | None = None
    _means: tuple[int, dict[str, float]] = (-1, {})

    def episode_means(self) -> dict[str, float]:
        """Return the means of the last episodes; see :func:`.episode_means`."""
        if self._means[0] != self._episode_num:
            env = self.get_env()
            assert isinstance(env, SimulationVecEnv)
            means = episode_means(list(self.ep_info_buffer or []), env.facts)
            self._means = (self._episode_num, means)
        return self._means[1]


class SACStage(CheckpointedStage):
    """See :class:`~sim2vr_harness.training.run.stage.Stage`.

    Args:
        config: of the run.
        folder: where checkpoints and ``metrics.jsonl`` go.
        stop: user steps after which the stage ends, rounded up to whole iterations.
        make_simulation: makes the users.

    Raises:
        InputError: ``sac`` holds what SAC does not take.
    """

    name, title = "sac", "SAC from what the user senses."

    def __init__(
        self,
        config: TrainingConfig,
        folder: RunFolder,
        stop: int,
        make_simulation: Callable[[], SimulationLike],
    ) -> None:
        self.config, self.folder = config, folder
        self._arguments = checked_arguments(config.sac)
        self.size = config.ppo.n_envs * self._arguments.get("train_freq", 1)
        self.stop = -(-stop // self.size) * self.size
        self.total = float(self.stop)
        self._make_simulation = make_simulation
        self._env: SimulationVecEnv | None = None
        self._model: _SAC | None = None
        self.consistent = False
        """Whether the learner is between two iterations, so that it can be saved."""
        self.lost_steps = 0
        """User steps since the newest checkpoint, which resuming takes again."""

    def open(self) -> None:
        """See the protocol."""
        self._env = SimulationVecEnv(self._make_simulation())
        _require_memory(self._env.observation_space, self._arguments)
        self._model = _SAC(
            "MultiInputPolicy",
            self._env,
            policy_kwargs=sac_policy_arguments(self.config.policy),
            seed=self.config.seed,
            device=self.config.device,
            **self._arguments,
        )

    def run(self, callbacks: Callbacks) -> None:
        """See the protocol."""
        model, env = self._model, self._env
        assert model is not None
        assert env is not None
        resumed = self.begun
        if resumed:
            self._restore(model, env, callbacks)
        start = model.num_timesteps
        self.folder.drop_metrics_after(start)
        logger = make_logger(self.config, self.folder, start)
        model.set_logger(logger)
        progress = TrainingProgress(
            step=start,
            start_step=start,
            stop_step=self.stop,
            iteration_steps=self.size,
            minibatches=max(1, model.gradient_steps),
            game=env.facts,
        )
        moments = _Moments(progress, callbacks, self)
        self._greet(callbacks, model, env)
        try:
            model.learn(
                self.stop - start,
                moments,
                log_interval=None,  # type: ignore[arg-type]  # rows are written by _Moments
                reset_num_timesteps=not resumed,
            )
            self._require_finite(model)
        except BaseException:
            # What torch says of weights that are NaN is pages of them.
            self._require_finite(model)
            raise
        finally:
            moments.release()
            moments.detach()
            logger.close()
            if moments.failures:
                callbacks.note(app_failures=moments.failures)

    def save(self) -> None:
        """See the protocol."""
        model = self._model
        if model is None:
            return
        if self.consistent and not self.folder.checkpoint_file(model.num_timesteps).is_file():
            self.write()
        self.lost_steps = max(0, model.num_timesteps - self.folder.step)
        self.folder.note_session(end_step=self.folder.step)

    def close(self) -> None:
        """See the protocol."""
        super().close()
        self.consistent = False

    def _greet(self, callbacks: Callbacks, model: _SAC, env: SimulationVecEnv) -> None:
        start, space = model.num_timesteps, env.observation_space
        assert isinstance(space, spaces.Dict)
        renderer = getattr(env.simulation, "renderer_description", None)
        exact = getattr(env.simulation, "exact_states", True)
        callbacks.say(
            f"{'Continuing' if start else 'Training'} in {self.folder.path}, from step {start:,} "
            f"to {self.stop:,} ({model.n_envs} users, {model.device}); replay buffer of "
            f"{2 * buffer_bytes(space, model.buffer_size) / 2**20:,.0f} MiB. Ctrl-C saves and "
            + ("stops; --resume continues exactly." if exact else "stops; --resume starts rounds.")
        )
        self._note(callbacks, model, start, renderer)

    # --- checkpoints ----------------------------------------------------------------------------

    def write(self) -> Path:
        """Write the learner as it is, the replay buffer first; delete what is not kept.

        Raises:
            NotFinite: What was learned is NaN or infinite; nothing is written.
        """
        model, env = self._model, self._env
        assert model is not None
        assert env is not None
        self._require_finite(model)
        file = self.folder.checkpoint_file(model.num_timesteps)
        replay = self._replay_file(file)
        with interrupts_deferred():
            write_atomically(replay, npz(buffer_arrays(model)))
            write_atomically(file, archive(model, env))
            keep = self.config.checkpoint.keep
            for old in self.folder.checkpoints()[: -keep if keep else 0]:
                old.unlink(missing_ok=True)
            for old in self.folder.checkpoint_dir.glob("replay_*.npz"):
                if old != replay:
                    old.unlink(missing_ok=True)
        return file

    def _replay_file(self, checkpoint: Path) -> Path:
        return checkpoint.with_name(checkpoint.stem.replace("step", "replay") + ".npz")

    def _require_finite(self, model: _SAC) -> None:
        files = self.folder.checkpoints()
        learned = {"policy": model.actor.state_dict(), "learner": learner_state(model)}
        moment = f"after {model.num_timesteps:,} user steps"
        try:
            require_finite(learned, moment, files[-1] if files else None)
        except NotFinite:
            self.consistent = False
            raise

    def _restore(self, model: _SAC, env: SimulationVecEnv, callbacks: Callbacks) -> None:
        file = self.folder.latest_checkpoint()
        replay = self._replay_file(file)
        expected = "a replay buffer of this training"
        if replay.is_file():
            try:
                load_buffer(model, read_arrays(replay, expected))
            except (InputError, *DAMAGE) as error:
                raise UnusableFile(replay, in_words(error), expected) from error
        else:
            callbacks.say(f"There is no {replay}; the replay buffer is filled anew.")
        weights, learner, header, arrays = good_parts(file, model.actor, model.device)
        try:
            model.actor.load_state_dict(weights)
            load_learner_state(model, learner)
            model.num_timesteps = int(header["num_timesteps"])
            model._n_updates, model._episode_num = header["n_updates"], header["episode_num"]
            load_moment(model, env, arrays)
            # SB3 makes the statistics' buffers when it starts learning, unless they are there.
            model.ep_info_buffer = deque(header["episodes"], maxlen=model._stats_window_size)
            model.ep_success_buffer = deque(maxlen=model._stats_window_size)
            model.action_space.np_random.bit_generator.state = header["warm_up"]
            set_random_state(header["random"], arrays)
        except (AppDied, AppTimeout):
            raise  # the file may be good
        except DAMAGE as error:
            instead = last_good(file, model.actor)
            raise UnusableFile(file, in_words(error), EXPECTED, instead) from error


class _Moments(ProgressCallback):
    """Shows, logs and saves between two iterations; signals wait for such a moment.

    Args:
        progress: the numbers to keep.
        callbacks: the stage's.
        stage: what is saved.
    """

    model: Any

    def __init__(self, progress: TrainingProgress, callbacks: Callbacks, stage: SACStage) -> None:
        super().__init__(progress, callbacks)
        self._stage, self._hold = stage, ExitStack()
        self._began = time.monotonic()
        self._step = progress.start_step

    def release(self) -> None:
        """Let signals that came meanwhile interrupt."""
        self._hold.close()

    def _on_training_start(self) -> None:
        self.model.on_row = self._pass_on

    def _on_rollout_start(self) -> None:
        self._between()
        super()._on_rollout_start()
        self._hold.enter_context(interrupts_deferred())
        self._stage.consistent = False

    def _on_training_end(self) -> None:
        self._between()
        super()._on_training_end()

    def _between(self) -> None:
        """Log and save where it is due, then let signals interrupt."""
        self._stage.consistent = True
        config, step = self._stage.config, self.model.num_timesteps
        before, self._step = self._step, step
        every = max(1, config.total_timesteps // _ROWS)
        if step // every > before // every:
            self._write_row(step)
        every = config.checkpoint.every_steps
        if step // every > before // every:
            self._progress.note = f"Saved {self._stage.write()}"
        self.release()

    def _write_row(self, step: int) -> None:
        for key, value in self.model.episode_means().items():
            self.logger.record(f"rollout/{key}", value)
        seconds = time.monotonic() - self._began
        rate = (step - self._progress.start_step) / seconds
        self.logger.record("time/steps_per_second", rate)
        row = dict(self.logger.name_to_value)
        self.logger.dump(step=step)
        self.model.on_row(step, row)

    def _show(self, force: bool = False) -> None:
        """Show how far it is, and ask whether to stop, where that loses nothing."""
        if self._stage.consistent:
            super()._show(force)


def _require_memory(space: spaces.Space[Any], arguments: Mapping[str, Any]) -> None:
    """Check that the replay buffer can fit this machine's memory.

    Raises:
        InputError: It cannot.
    """
    assert isinstance(space, spaces.Dict)
    default = inspect.signature(stable_baselines3.SAC).parameters["buffer_size"].default
    size = arguments.get("buffer_size", default)
    need = 2 * buffer_bytes(space, size)
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if need > have:
        got = f"{size:,}, which needs {need / 2**30:,.0f} GiB for observations and those after them"
        expected = f"less than the machine's {have / 2**30:,.0f} GiB"
        raise InputError("sac.buffer_size", got, expected)
