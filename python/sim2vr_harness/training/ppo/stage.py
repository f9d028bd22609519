"""The stage that learns by PPO, from checkpoints that continue exactly."""

import copy
import io
import json
import zipfile
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from torch import nn

from sim2vr_harness import __version__
from sim2vr_harness.base.errors import UnusableFile
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.finite import NotFinite, require_finite
from sim2vr_harness.base.progress import View
from sim2vr_harness.base.signals import interrupts_deferred
from sim2vr_harness.client.errors import AppDied, AppTimeout
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.runs.checkpoint import (
    DAMAGE,
    EXPECTED,
    FORMAT,
    RESUME,
    good_parts,
    in_words,
    last_good,
    random_state,
    set_random_state,
)
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder, metric_key
from sim2vr_harness.training.ppo import ppo
from sim2vr_harness.training.ppo.ppo import PPO
from sim2vr_harness.training.ppo.rollout_buffer import buffer_bytes
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv
from sim2vr_harness.training.run.loggers import make_logger
from sim2vr_harness.training.run.stage import Callbacks, Stage


@dataclass(frozen=True)
class Snapshot:
    """State of the training between two iterations.

    Attributes:
        step: Number of user steps so far.
        weights: The policy's state.
        optimizer: The optimiser's state.
        header: Counters, random generators and episode statistics, as JSON.
        arrays: Arrays of the learner and the bytes of the environment.
    """

    step: int
    weights: dict[str, torch.Tensor]
    optimizer: dict[str, Any]
    header: dict[str, Any]
    arrays: dict[str, NDArray]

    def write(self, path: Path, model: PPO) -> None:
        """Write the checkpoint; ``model`` gives the parts that never change."""
        archive = io.BytesIO()
        with interrupts_deferred(), _holding(model, self):
            model.save(archive)
        header = np.frombuffer(json.dumps(self.header).encode(), dtype=np.uint8)
        arrays = io.BytesIO()
        np.savez(arrays, allow_pickle=False, header=header, **self.arrays)
        with zipfile.ZipFile(archive, "a") as members:
            members.writestr(RESUME, arrays.getvalue(), zipfile.ZIP_DEFLATED)
        write_atomically(path, archive.getvalue())


def take(model: PPO) -> Snapshot:
    """Copy the state of a learner between two iterations."""
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    arrays: dict[str, NDArray] = {
        **{f"environment.{key}": value for key, value in env.state_dict().items()},
        "episode_starts": np.array(model._last_episode_starts),
    }
    last_observation = model._last_obs
    assert isinstance(last_observation, dict)
    for key, value in last_observation.items():
        arrays[f"observation.{key}"] = np.array(value)
    generators, generator_arrays = random_state()
    header = {
        "format": FORMAT,
        "version": __version__,
        "num_timesteps": model.num_timesteps,
        "n_updates": model._n_updates,
        "progress_remaining": model._current_progress_remaining,
        "episodes": list(model.ep_info_buffer or []),
        "random": generators,
    }
    return Snapshot(
        step=model.num_timesteps,
        weights=copy.deepcopy(model.policy.state_dict()),
        optimizer=copy.deepcopy(model.policy.optimizer.state_dict()),
        header=header,
        arrays=arrays | generator_arrays,
    )


def restore(path: Path, model: PPO) -> None:
    """Load a checkpoint into a new learner and its environment.

    Raises:
        UnusableFile: The file is no checkpoint, is damaged or belongs to another configuration. The
            learner and its environment may then be in an inconsistent state and have to be made
            again.
    """
    weights, optimizer, header, arrays = good_parts(path, model.policy, model.device)
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    try:
        model.policy.load_state_dict(weights)
        model.policy.optimizer.load_state_dict(optimizer)
        # Check what torch does not: that moments have the shape of their weights.
        for weight, state in model.policy.optimizer.state.items():
            for name, value in state.items():
                if isinstance(value, torch.Tensor) and value.dim() and value.shape != weight.shape:
                    shapes = f"{tuple(value.shape)}, expected {tuple(weight.shape)}"
                    raise ValueError(f"{name} of the optimiser of shape {shapes}")
        model.num_timesteps = int(header["num_timesteps"])
        model._n_updates = int(header["n_updates"])
        model._current_progress_remaining = float(header["progress_remaining"])
        load_moment(model, env, arrays)
        # SB3 makes the statistics' buffers when it starts learning, unless they are there.
        model.ep_info_buffer = deque(header["episodes"], maxlen=model._stats_window_size)
        model.ep_success_buffer = deque(maxlen=model._stats_window_size)
        set_random_state(header["random"], arrays)
    except (AppDied, AppTimeout):
        raise  # the file may be good
    except DAMAGE as error:
        instead = last_good(path, model.policy)
        raise UnusableFile(path, in_words(error), EXPECTED, instead) from error


def load_moment(model: BaseAlgorithm, env: SimulationVecEnv, arrays: dict[str, NDArray]) -> None:
    """Restore the environment and its last observation from a checkpoint."""
    parts: dict[str, dict[str, NDArray]] = {"environment": {}, "observation": {}}
    for key, value in arrays.items():
        part, _, name = key.partition(".")
        if part in parts:
            parts[part][name] = value
    anew, observation = env.load_state_dict(parts["environment"]), parts["observation"]
    starts = arrays["episode_starts"]
    if anew:
        starts[anew] = True
        for key, value in env.simulation.observation().items():
            observation[key][anew] = value[anew]
    model._last_obs, model._last_episode_starts = observation, starts


@contextmanager
def _holding(model: PPO, snapshot: Snapshot) -> Iterator[None]:
    """Load a snapshot's weights and counters into ``model`` temporarily."""
    now = (
        copy.deepcopy(model.policy.state_dict()),
        copy.deepcopy(model.policy.optimizer.state_dict()),
        model.num_timesteps,
        model._n_updates,
    )

    def hold(weights: Any, optimizer: Any, step: int, updates: int) -> None:
        model.policy.load_state_dict(weights)
        # A copy: loading does not copy every tensor, and later steps would write into them.
        model.policy.optimizer.load_state_dict(copy.deepcopy(optimizer))
        model.num_timesteps, model._n_updates = step, updates

    hold(snapshot.weights, snapshot.optimizer, snapshot.step, snapshot.header["n_updates"])
    try:
        yield
    finally:
        hold(*now)


NOT_EXACT = "--resume starts new rounds, since this app cannot save its state."


class PPOStage(Stage):
    """PPO on the user's own observations.

    Its checkpoints are the trained users; it works in the run's own folder.

    Args:
        begin: sets the policy's initial weights when the stage begins.
        stop: user steps after which the stage ends, rounded up to whole iterations.
    """

    name, unit = "ppo", "user steps"

    _simulation: SimulationVecEnv
    _learner: ppo.PPO

    def __init__(
        self,
        config: TrainingConfig,
        folder: RunFolder,
        title: str,
        make_simulation: Callable[[TrainingConfig], Simulation],
        begin: Callable[[nn.Module], object],
        stop: int,
    ) -> None:
        size = config.ppo.steps_per_iteration
        self.stop = -(-stop // size) * size
        super().__init__(config, folder.path, self.stop)
        self._run, self.title = folder, title
        self._make_simulation, self._begin = make_simulation, begin
        self._checkpoints: CheckpointCallback | None = None
        self.lost_steps = 0
        """User steps of an unfinished iteration, which resuming repeats."""

    @property
    def begun(self) -> bool:
        """Return whether there is a checkpoint."""
        return bool(self._run.checkpoints())

    @property
    def finished(self) -> bool:
        """Return whether a checkpoint has at least ``stop`` user steps."""
        return self.begun and self._run.step >= self.stop

    @property
    def saved(self) -> str:
        """Progress at the newest checkpoint, as text."""
        return f"{self._run.step:,} of {self.stop:,} user steps" if self.begun else ""

    @property
    def done(self) -> float:
        """User steps of all users."""
        return self._learner.num_timesteps

    def open(self) -> None:
        """Make users and learner."""
        self._simulation = SimulationVecEnv(self._make_simulation(self._config))
        self._learner = ppo.build(self._config, self._simulation)

    def run(self, callbacks: Callbacks) -> None:
        """Run the remaining iterations."""
        model, kept = self._learner, self._config.checkpoint
        if self.begun:
            restore(self._run.latest_checkpoint(), model)
            self._run.drop_metrics_after(model.num_timesteps)
            start = model.num_timesteps
        else:
            self._run.drop_metrics_after(0)
            self._begin(model.policy)
            start = 0
        logger = make_logger(self._config, self._run, start)
        model.set_logger(logger)
        tracker = ProgressCallback(callbacks, start, self.stop)
        self._checkpoints = CheckpointCallback(
            self._run, kept.every_steps, kept.keep, tracker.note_checkpoint
        )
        self._greet(callbacks, start)
        try:
            model.learn(
                self.stop - start,
                callback=[self._checkpoints, tracker],
                reset_num_timesteps=start == 0,
            )
            self._checkpoints.remember()
        except NotFinite:
            raise
        except Exception:
            # What torch says of weights that are NaN is pages of them.
            if self._checkpoints.snapshot_step is not None:
                self._checkpoints.require_finite()
            raise
        finally:
            tracker.detach()
            logger.close()
            if tracker.failures:
                callbacks.note(app_failures=tracker.failures)

    def save(self) -> None:
        """Write the checkpoint of the last iteration, unless it is on disk."""
        if self._checkpoints is None or self._checkpoints.write() is None:
            return
        self.lost_steps = max(0, self._learner.num_timesteps - self._run.step)
        self._run.note_session(end_step=self._run.step)

    def close(self) -> None:
        """Free users and learner."""
        super().close()
        self._checkpoints = None

    def tidy(self) -> None:
        """Do nothing: checkpoints are kept."""

    def _greet(self, callbacks: Callbacks, start: int) -> None:
        model, env = self._learner, self._simulation
        space = model.rollout_buffer.observation_space
        assert isinstance(space, spaces.Dict)
        steps = self._config.ppo.steps_per_iteration
        memory = buffer_bytes(space, steps) / 2**20
        exact = getattr(env.simulation, "exact_states", True)
        renderer = getattr(env.simulation, "renderer_description", None)
        verb = "Continuing" if start else "Training"
        callbacks.say(
            f"{verb} in {self._run.path}, from step {start:,} to "
            f"{self.stop:,} in iterations of {steps:,} user steps ({model.n_envs} users, "
            f"{model.device})."
        )
        if renderer is not None:
            callbacks.say(f"Headset images by {renderer}.")
        callbacks.say(
            f"Observations of one iteration: {memory:,.0f} MiB. Ctrl-C saves and stops; "
            + ("--resume continues exactly." if exact else NOT_EXACT)
        )
        callbacks.note(
            start_step=start,
            device=str(model.device),
            renderer=renderer,
            torch_threads=torch.get_num_threads(),
            parameters=sum(weight.numel() for weight in model.policy.parameters()),
        )


class CheckpointCallback(BaseCallback):
    """Remembers the moment between two iterations and writes it when it is due.

    Args:
        every_steps: User steps between two checkpoints.
        keep: How many of the newest checkpoints to keep; None keeps all.
        on_written: Called with the file and the step of every checkpoint.
    """

    model: PPO

    def __init__(
        self,
        folder: RunFolder,
        every_steps: int,
        keep: int | None = None,
        on_written: Callable[[Path, int], None] = lambda file, step: None,
    ) -> None:
        super().__init__()
        self._folder = folder
        self._every_steps = every_steps
        self._keep = keep
        self._on_written = on_written
        self._snapshot: Snapshot | None = None
        self._written_step: int | None = None

    @property
    def snapshot_step(self) -> int | None:
        """The step that :meth:`write` would save, None before the first iteration."""
        return None if self._snapshot is None else self._snapshot.step

    def _on_rollout_start(self) -> None:
        self.remember()

    def _on_step(self) -> bool:
        return True

    def remember(self) -> None:
        """Take a snapshot now, between two iterations, and write it if it is due.

        Raises:
            NotFinite: The last update has spoilt the learner; the snapshot before it is written.
        """
        self.require_finite()
        self._snapshot = take(self.model)
        step = self._snapshot.step
        if self._written_step is None:  # The session starts: on disk already, or step 0.
            self._written_step = step
        elif step // self._every_steps > self._written_step // self._every_steps:
            self.write()

    def require_finite(self) -> None:
        """Check that the learner may be saved; otherwise write the last snapshot and say so.

        Raises:
            NotFinite: A weight or a moment of the optimiser is NaN or infinite.
        """
        policy = self.model.policy
        learned = {"policy": policy.state_dict(), "optimizer": policy.optimizer.state_dict()}
        where = f"after {self.model.num_timesteps:,} user steps"
        try:
            require_finite(learned, where, None)
        except NotFinite:
            require_finite(learned, where, self.write())
            raise

    def write(self) -> Path | None:
        """Write the last snapshot unless it is on disk, and return its file."""
        if self._snapshot is None:
            return None
        step = self._snapshot.step
        file = self._folder.checkpoint_file(step)
        if not file.is_file():
            self._snapshot.write(file, self.model)
            self._on_written(file, step)
            if self._keep is not None:
                for old_file in self._folder.checkpoints()[: -self._keep]:
                    old_file.unlink(missing_ok=True)
        self._written_step = step
        return file


class ProgressCallback(BaseCallback):
    """Shows how far the learner is, during the update as well, and passes rows on."""

    model: PPO

    def __init__(self, callbacks: Callbacks, start: int, stop: int) -> None:
        super().__init__()
        self._callbacks, self._start, self._stop = callbacks, start, stop
        self._phase, self._share, self._note = "starting", 0.0, ""
        self._hook: Any = None
        self._minibatches = self._played = 0
        """Minibatches of this update, and user steps of this iteration."""
        self.failures: list[dict[str, Any]] = []
        """Every app that failed in this session: step of the training, user, step of its round and
        error."""

    def note_checkpoint(self, file: Path, step: int) -> None:
        """Show the newest checkpoint."""
        self._note = f"Saved {file}"

    def view(self) -> View:
        """Return the present state for display."""
        model, size = self.model, self.model.n_envs * self.model.n_steps
        parts = self._callbacks.watch.parts
        took = {name: parts[name].seconds for name in ("playing", "learning") if name in parts}
        steps = model.num_timesteps - self._start
        rates = {
            name: f"{steps / seconds:,.0f}" if seconds else "-" for name, seconds in took.items()
        }
        whole = f"{steps / sum(took.values()):,.0f}" if len(took) == 2 else "-"
        playing, learning = (rates.get(name, "-") for name in ("playing", "learning"))
        details = [f"{whole} steps/s (playing {playing}, learning {learning})"]
        facts = self._env.facts
        means = model.episode_means()
        if means:
            digits = {metric_key(one): (one.heading.lower(), one.digits) for one in facts.headlines}
            shown = {"ep_rew_mean": ("return", 1)} | digits | {"ep_effort_cost_mean": ("effort", 1)}
            numbers = [
                f"{label} {means[key]:,.{places}f}" if key in means else f"{label} -"
                for key, (label, places) in shown.items()
            ]
            details.append("per round: " + ", ".join(numbers))
        elif self._env.last_logs is not None and facts.counters:
            counts = [
                f"{one.label.lower()} {self._env.last_logs.total(one.log_key):,.0f}"
                for one in facts.counters[:2]
            ]
            details.append("first rounds: " + ", ".join(counts) + " so far")
        if self.failures:
            details.append(f"app failures {len(self.failures):,}")
        if self._note:
            details.append(self._note)
        doing = f"step {model.num_timesteps:,}/{self._stop:,}, {self._phase} {self._share:.0%}"
        half = 0.5 if self._phase == "playing" else -0.5 * (1.0 - self._share)
        done = model.num_timesteps - (half * self._played if half > 0.0 else -half * size)
        return View(done, doing, tuple(details))

    @property
    def _env(self) -> SimulationVecEnv:
        env = self.model.get_env()
        assert isinstance(env, SimulationVecEnv)
        return env

    def _on_training_start(self) -> None:
        self.model.on_row = self._callbacks.report
        self._hook = self.model.policy.optimizer.register_step_post_hook(self._count_minibatch)

    def _on_rollout_start(self) -> None:
        self._phase, self._share, self._played = "playing", 0.0, 0
        self._show()

    def _on_step(self) -> bool:
        self._played += self.model.n_envs
        self._share = self._played / (self.model.n_envs * self.model.n_steps)
        # Say which apps failed since the last step; their users go on with new ones.
        failed = getattr(self._env.simulation, "app_failures", [])
        for failure in failed[len(self.failures) :]:
            self.failures.append(
                {
                    "training_step": self.model.num_timesteps,
                    "user": failure.user,
                    "round_step": failure.step,
                    "error": failure.error,
                }
            )
            self._callbacks.say(
                f"User {failure.user}: {failure.error.splitlines()[0]}\n"
                "Its round is over; the app is started again and the training goes on."
            )
        self._show()
        return True

    def _on_rollout_end(self) -> None:
        if self.failures:
            self.logger.record("rollout/app_failures", len(self.failures))
        self._phase, self._share, self._minibatches = "learning", 0.0, 0
        self._show()

    def _on_training_end(self) -> None:
        self._share = 1.0
        self.detach()
        self._callbacks.show(self.view, force=True)

    def detach(self) -> None:
        """Stop counting minibatches and passing rows on."""
        if getattr(self, "model", None) is not None:
            self.model.on_row = None
        if self._hook is not None:
            self._hook.remove()
            self._hook = None

    def _show(self) -> None:
        self._callbacks.doing(self._phase)
        self._callbacks.show(self.view)

    def _count_minibatch(self, *_: Any) -> None:
        self._minibatches += 1
        size = self.model.n_envs * self.model.n_steps
        self._share = self._minibatches / (size // self.model.batch_size * self.model.n_epochs)
        self._show()
