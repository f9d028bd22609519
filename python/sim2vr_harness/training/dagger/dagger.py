"""A policy that sees learns from a teacher that observes (DAgger, on the app's real pictures).

The student acts, so that it meets the situations its own mistakes lead to, and the teacher labels
each of them with what it would have done. The student's network learns the teacher's mean action;
heads on its image features, which are dropped afterwards, learn facts that the picture shows, such
as which targets are there. Ross, Gordon & Bagnell (2011), "A Reduction of Imitation Learning and
Structured Prediction to No-Regret Online Learning".
"""

import fnmatch
import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.utils import get_device
from torch import Tensor, nn

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.progress import View
from sim2vr_harness.base.state import State
from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.client import GameFacts
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.envs.config import with_options
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.attention_crops import AttentionCrops
from sim2vr_harness.policies.sharding import in_shards
from sim2vr_harness.policies.teacher import load_teacher
from sim2vr_harness.policies.visual_actor_critic import VisualActorCritic
from sim2vr_harness.runs.checkpoint import read_tensors, write_tensors
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.dagger_config import StudentConfig
from sim2vr_harness.runs.run_folder import metric_key
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.replay import ReplayStore
from sim2vr_harness.training.run.loggers import episode_means
from sim2vr_harness.training.run.stage import Callbacks, Stage
from sim2vr_harness.training.teacher.env import game_of, privileged_senses

_FARTHEST = 3.0
"""Deviations from the mean at which numbers are cut."""
_TARGET_FIELDS = ("present", "x_m", "y_m", "z_m")
_NEAREST_M = 0.1
"""What is nearer to the eyes, or behind them, is not looked at."""
SCALE_STEPS, SCALE_EVERY = 120, 4
"""User steps in which the teacher shows what a body goes through."""


class TeacherExpert:
    """See :class:`~sim2vr_harness.training.dagger.dagger.Guide`.

    Args:
        file: the teacher's weights.
        config: the teacher's.
        simulation: the student's users, in this process.
    """

    def __init__(self, file: Path, config: TeacherConfig, simulation: Simulation) -> None:
        game = game_of(simulation.config)
        self._senses = privileged_senses(simulation, config, game, simulation.config)
        self._policy = load_teacher(file, self._senses.space, simulation.action_space)
        known = {f"felt {name}" for name in self._senses.names} | set(self._senses.names)
        self._game = [i for i, name in enumerate(self._senses.observed_names) if name in known]
        self._attention_targets = game.attention_targets
        told = [self._senses.observed_names[i].removeprefix("felt ") for i in self._game]
        self.crop_columns = tuple(
            tuple(i for i, name in enumerate(told) if name.startswith(f"{target}."))
            for target in self._attention_targets
        )
        self._facts = [name for name in self._senses.names if fnmatch.fnmatchcase(name, game.facts)]

    def actions(self, simulation: Any) -> NDArray[np.float32]:
        return self._policy.act({OBSERVATION: self._senses.observe()})

    def facts(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: which places have a target."""
        columns = [self._senses.seen(name) for name in self._facts]
        if not columns:
            return np.zeros((simulation.n, 0), np.float32)
        return np.clip(np.stack(columns, axis=1), 0.0, 1.0)

    def numbers(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: what the teacher observes of the game, as its network takes it."""
        with torch.inference_mode():
            told = {OBSERVATION: torch.from_numpy(self._senses.observe())}
            scaled: NDArray[np.float32] = self._policy.normaliser(told).numpy()
        return np.clip(scaled[:, self._game], -_FARTHEST, _FARTHEST)

    def crop_places(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: places of the game's ``attention_targets``, as the head is now."""
        heads = pose_to_app(*simulation.users.device_poses("headset"))
        told = [
            np.stack([self._senses.field(f"{name}.{part}") for part in _TARGET_FIELDS], 1)
            for name in self._attention_targets
        ]
        return seen_at(np.stack(told, 1), heads[:, 3:])

    def proprioception_scale(
        self, simulation: Simulation
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return proprioception_scale(self, simulation)


def seen_at(told: NDArray[np.floating[Any]], head_xyzw: NDArray[np.float64]) -> NDArray[np.float32]:
    """Where in the picture things are.

    Args:
        told: (N, G, 4) whether there is one, and where it is from the head, m, in the app's frame.
        head_xyzw: (N, 4) how the heads are turned, app frame.

    Returns:
        (N, G, 3) tangents of the angles right and up of straight ahead, at most 10, and 1 if there
        is one before the eyes, else 0.
    """
    # In the frame of the head: turned back by the conjugate.
    axis, w = -head_xyzw[:, None, :3], head_xyzw[:, None, 3:]
    off = told[..., 1:].astype(np.float64)
    off = off + 2.0 * np.cross(axis, np.cross(axis, off) + w * off)
    ahead = off[..., 2]
    there = (told[..., 0] > 0.0) & (ahead > _NEAREST_M)
    place = np.clip(off[..., :2] / np.maximum(ahead, _NEAREST_M)[..., None], -10.0, 10.0)
    place *= there[..., None]
    return np.concatenate([place, there[..., None]], 2).astype(np.float32)


def proprioception_scale(
    guide: Any, simulation: Simulation
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of the proprioception while a guide plays, (P,) each.

    The users' present rounds are lost.
    """
    simulation.reset(seeds=list(range(simulation.n)))
    seen = []
    for step in range(SCALE_STEPS):
        if step % SCALE_EVERY == 0:
            seen.append(simulation.proprioception.observe(simulation.users))
        simulation.renew(simulation.step(guide.actions(simulation)))
    values = np.concatenate(seen).astype(np.float64)
    return values.mean(0), values.std(0)


PICTURE_FILES = "frames.*.bin"
"""Files of what the student has seen, the star being the sense's key."""
_IMITATION_WEIGHT, _FACTS_WEIGHT, _CROPS_WEIGHT = 4.0, 0.2, 0.2
"""Weights in the loss: actions, facts of the picture, places of the attention crops."""
_WEIGHT_DECAY, _MAX_GRAD_NORM = 1e-4, 1.0
_NOISY_USERS = 0.25
"""Proportion of users with noise on their actions, so that unusual situations are seen."""
_ROLLOUT_STEPS = 32
"""User steps per user between two times of learning: 1.6 s at 20 Hz."""
_TEACHER_ROUNDS = 3
"""Rounds of collecting in which the teacher acts for every user: an untrained student meets few of
the situations that it has to learn."""
CHECKPOINT_ROUNDS = 20
"""Rounds of collecting between two checkpoints: 41,000 frames of 64 users."""
_STATISTICS_EPISODES = 100
"""Latest episodes that the printed statistics are taken over."""
COLLECTED = 0.4
"""Share of a round's time that is over after collecting."""
_TARGETS = ("label", "facts", "numbers", "crop_places")
"""What a stored frame holds beside the observation."""


class Expert(Protocol):
    """An expert that acts on more than the student observes."""

    crop_columns: tuple[tuple[int, ...], ...]
    """Of each of :meth:`crop_places`, which of :meth:`numbers` are about it."""

    def actions(self, simulation: Any) -> NDArray[np.float32]:
        """(N, A) what the teacher would do now, in [-1, 1]."""

    def facts(self, simulation: Any) -> NDArray[np.float32]:
        """(N, F) numbers in [0, 1] that the picture shows; F may be 0."""

    def numbers(self, simulation: Any) -> NDArray[np.float32]:
        """(N, K) what the teacher knows of the game, about 1 in size, for ``numbers_weight``."""

    def crop_places(self, simulation: Any) -> NDArray[np.float32]:
        """(N, G, 3) places of the game's ``attention_targets`` in the picture.

        Tangents right and up of its middle, and 1 if there is one, else 0.
        """

    def proprioception_scale(
        self, simulation: Any
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and standard deviation of the users' proprioception while the teacher plays."""


@dataclass
class StudentProgress:
    """The numbers of one round of collecting and learning.

    Attributes:
        frames: user steps collected so far.
        imitation_error: root mean square difference to the teacher's action, per muscle.
        facts_error: mean cross entropy of the facts, 0 without any.
        numbers_error: mean squared error of what the teacher knows of the game, 0 where the student
            does not learn to tell it.
        crops_error: of the locator, see ``AttentionCrops.loss``; 0 without attention crops.
        reading_error: mean squared error of the facts of a thing, from its crop alone.
        teacher_share: share of users for which the teacher acted.
        episodes: episodes that ended, in which the student alone acted.
        means: means over the last of those, as :func:`episode_means` gives them.
        collect_seconds: wall time.
        learn_seconds: wall time.
    """

    frames: int
    imitation_error: float
    facts_error: float
    numbers_error: float
    crops_error: float
    reading_error: float
    teacher_share: float
    episodes: int
    means: dict[str, float]
    collect_seconds: float
    learn_seconds: float


class Student(State):
    """DAgger on N users.

    Args:
        config: of the stage.
        policy: the network to train, where it is to learn (CPU or GPU); its critic is left alone.
        simulation: N users who see; owned by the caller.
        guide: the teacher.
        folder: that the collected pictures go to; made or reused.
        seed: of everything drawn here.
        game: what the game publishes, for the means of episodes.
    """

    def __init__(
        self,
        config: StudentConfig,
        policy: VisualActorCritic,
        simulation: Any,
        guide: Expert,
        folder: Path,
        *,
        seed: int,
        game: GameFacts | None = None,
    ) -> None:
        self.config, self.policy, self.simulation, self.guide = config, policy, simulation, guide
        self._device = policy.device
        self.game = game or GameFacts("")
        self.n: int = simulation.n
        self._rng = np.random.default_rng([seed, 77])
        seeds = np.random.SeedSequence([seed, 78]).generate_state(self.n, np.uint32)
        simulation.reset(seeds=[int(value) for value in seeds])
        self._facts = guide.facts(simulation).shape[1]
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            extractor: Any = policy.features_extractor
            width = extractor.picture_features
            self._heads = nn.Linear(width, self._facts).to(self._device) if self._facts else None
            if self.config.numbers_weight == 0.0:
                self._tell = None
            else:
                told = self.guide.numbers(self.simulation).shape[1]
                self._tell = nn.Linear(policy.features_dim, told).to(self._device)
            self._crops: AttentionCrops | None = extractor.attention_crops
            self._looked_at = self._looking()
            if self._crops is None or self._tell is None:
                self._read = None
            else:
                columns = self.guide.crop_columns[: self._looked_at]
                heads = [nn.Linear(self._crops.features, len(which)) for which in columns]
                self._read = nn.ModuleList(heads).to(self._device)
        mlp: Any = policy.mlp_extractor
        self._parameters = [
            *policy.features_extractor.parameters(),
            *mlp.actor.parameters(),
            *policy.action_net.parameters(),
            *(weights for head in self._dropped.values() for weights in head.parameters()),
        ]
        # Fused: one pass over the weights instead of a dozen.
        self._optimizer = torch.optim.AdamW(
            self._parameters, config.learning_rate, weight_decay=_WEIGHT_DECAY, fused=True
        )
        # Store of observations and of what the student learns from them.
        store_config, each = self.config, self.n * _ROLLOUT_STEPS
        observation = self.simulation.observation()
        shapes = {key: (value.shape[1:], value.dtype) for key, value in observation.items()}
        sizes = {
            "label": self.simulation.action_space.shape,
            "facts": (self._facts,),
            "numbers": (self._tell.out_features if self._tell else 0,),
            "crop_places": (self._looked_at, 3),
        }
        self.store = ReplayStore(
            folder / PICTURE_FILES,
            -(-min(store_config.frames, store_config.kept_frames or store_config.frames) // each)
            * each,
            shapes | {name: (size, np.float32) for name, size in sizes.items()},
            slack=CHECKPOINT_ROUNDS * each if store_config.kept_frames else 0,
        )
        self.round = 0
        # Rounds end at different times, so that every minibatch has all phases of a round in it.
        longest = min(simulation.max_steps, config.stagger_steps)
        self._cut = self._rng.integers(1, longest + 1, self.n)
        self._acted = np.zeros(self.n)
        self._episodes: deque[dict[str, Any]] = deque(maxlen=_STATISTICS_EPISODES)
        self._ended = 0

    @property
    def _dropped(self) -> dict[str, nn.Module]:
        """The heads that there are; only this stage has them."""
        heads = {"heads": self._heads, "tell": self._tell, "read": self._read}
        return {name: head for name, head in heads.items() if head is not None}

    def _looking(self) -> int:
        """How many things are looked at; from now on it is learned where they are."""
        if self._crops is None:
            return 0
        count, known = self._crops.count, len(self.guide.crop_columns)
        if known < count:
            raise InputError(
                "policy.attention_crops.count",
                str(count),
                f"at most {known}, the things that the game says are worth looking at",
            )
        self._crops.teach(True)
        return count

    @property
    def finished(self) -> bool:
        """Whether all frames are collected and learned from."""
        return self.store.count >= self.config.frames

    # --- a round -----------------------------------------------------------------------------

    def step(self, on_progress: Callable[[float], None] = lambda share: None) -> StudentProgress:
        """Collect ``_ROLLOUT_STEPS`` of every user, then learn.

        Args:
            on_progress: called with the share of the round that is done, more or less.
        """
        began = time.monotonic()
        with torch_threads(1):
            config = self.config
            late = self.round - _TEACHER_ROUNDS
            collect_share = (
                1.0 if late < 0 else config.teacher_share * config.teacher_share_decay**late
            )
            noisy = np.arange(self.n) < _NOISY_USERS * self.n
            shown = 0
            for step in range(_ROLLOUT_STEPS):
                on_progress(COLLECTED * step / _ROLLOUT_STEPS)
                observation = self.simulation.observation()
                label = np.clip(self.guide.actions(self.simulation), -1.0, 1.0)
                facts = self.guide.facts(self.simulation)
                told = {"label": label, "facts": facts, "numbers": self._told()}
                self.store.append({**observation, **told, "crop_places": self._crop_places()})
                # Whole stretches by one of the two would show fewer of the student's mistakes.
                by_teacher = self._rng.random(self.n) < collect_share
                noise = self._rng.standard_normal(label.shape).astype(np.float32)
                action = np.where(by_teacher[:, None], label, self.act(observation))
                action = action + noise * (config.noise_std * noisy[:, None])
                outcome = self.simulation.step(np.clip(action, -1.0, 1.0))
                self._count(outcome, by_teacher)
                shown += int(by_teacher.sum())
            share = shown / (_ROLLOUT_STEPS * self.n)
        collected = time.monotonic()
        with torch_threads(1 if self.policy.in_shards else torch.get_num_threads()):
            errors = self._learn(on_progress)
        self.round += 1
        return StudentProgress(
            frames=self.store.count,
            imitation_error=math.sqrt(errors["imitation"]),
            facts_error=errors["facts"],
            numbers_error=errors["numbers"],
            crops_error=errors["crops"],
            reading_error=errors["reading"],
            teacher_share=share,
            episodes=self._ended,
            means=episode_means(list(self._episodes), self.game),
            collect_seconds=collected - began,
            learn_seconds=time.monotonic() - collected,
        )

    def _told(self) -> NDArray[np.float32]:
        """(N, K) what the student learns to tell; K may be 0."""
        if self._tell is None:
            return np.zeros((self.n, 0), np.float32)
        return self.guide.numbers(self.simulation)

    def _crop_places(self) -> NDArray[np.float32]:
        """(N, G, 3) where the things are that are looked at; G may be 0."""
        if self._looked_at == 0:
            return np.zeros((self.n, 0, 3), np.float32)
        return self.guide.crop_places(self.simulation)[:, : self._looked_at]

    def act(self, observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
        """(N, A) the student's mean actions."""
        batch = {
            key: torch.from_numpy(value).to(self._device) for key, value in observation.items()
        }
        with torch.inference_mode():
            action: NDArray[np.float32] = self.policy.action_mean(batch).float().cpu().numpy()
        return action

    def _count(self, outcome: Any, by_teacher: NDArray[np.bool_]) -> None:
        self._acted += by_teacher
        self._cut -= 1
        over = outcome.over
        for i in np.flatnonzero(over).tolist():
            info = outcome.info(i)
            if (
                self._cut[i] < 0
                and info["termination"] in ("finished", "app_left")
                and self._acted[i] == 0
            ):
                self._ended += 1
                self._episodes.append({"r": 0.0, "l": 0, "log": dict(outcome.logs[i])})
        again = np.flatnonzero(over | (self._cut == 0)).tolist()
        if again:
            self.simulation.reset(ids=again)
            self._acted[again] = 0

    def _learn(self, on_progress: Callable[[float], None]) -> dict[str, float]:
        config = self.config
        samples = round(config.samples_per_frame * self.n * _ROLLOUT_STEPS)
        minibatches = max(1, round(samples / config.batch_size))
        done = min(1.0, self.store.count / config.frames)
        fall = min(1.0, 2.0 * (1.0 - done))  # constant in the first half, then linear to 0
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * max(fall, 0.02)
        self.policy.train()
        found: list[dict[str, Tensor]] = []
        weights = {
            "imitation": _IMITATION_WEIGHT,
            "facts": _FACTS_WEIGHT,
            "numbers": config.numbers_weight,
            "crops": _CROPS_WEIGHT,
            "reading": config.numbers_weight,
        }
        for number, batch in enumerate(self._minibatches(minibatches)):
            on_progress(COLLECTED + (1.0 - COLLECTED) * number / minibatches)
            # The errors that there are, each a number.
            observation = {key: value for key, value in batch.items() if key not in _TARGETS}
            if self.policy.in_shards:
                losses_weights = [weight for weight in self._parameters if weight.requires_grad]
                answers = in_shards(self._network, losses_weights, observation, self.policy.workers)
            else:
                answers = self._network(observation)
            left = list(answers)
            losses = {"imitation": nn.functional.mse_loss(left.pop(0), batch["label"])}
            if self._heads is not None:
                logits = left.pop(0)
                losses["facts"] = nn.functional.binary_cross_entropy_with_logits(
                    logits, batch["facts"]
                )
            if self._tell is not None:
                losses["numbers"] = nn.functional.mse_loss(left.pop(0), batch["numbers"])
            if self._crops is not None:
                places = batch["crop_places"]
                losses["crops"] = self._crops.loss(left.pop(0), places[..., :2], places[..., 2])
            if self._read is not None:
                numbers = batch["numbers"]
                there = places[..., 2]
                errors = torch.zeros(())
                for k, (read, columns) in enumerate(
                    zip(left, self.guide.crop_columns, strict=False)
                ):
                    wrong = (read - numbers[:, columns]).square().mean(1)
                    errors = errors + (wrong * there[:, k]).sum()
                losses["reading"] = errors / there.sum().clamp(min=1.0)
            loss = torch.stack([weights[name] * loss for name, loss in losses.items()]).sum()
            self._optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(self._parameters, _MAX_GRAD_NORM)
            self._optimizer.step()
            found.append({name: value.detach() for name, value in losses.items()})
        self.policy.eval()
        # Read at the end: a GPU would be waited for in each minibatch.
        return {
            name: sum(float(one[name]) for one in found if name in one) / minibatches
            for name in weights
        }

    def _minibatches(self, count: int) -> Iterator[dict[str, Tensor]]:
        """Yield minibatches on the device; the next one is read while one is learned from."""
        first, last = self.store.first, self.store.count

        def read() -> dict[str, Tensor]:
            rows = np.sort(self._rng.integers(first, last, self.config.batch_size))
            batch = self.store.rows(rows)
            if self._device.type != "cuda":
                return batch
            return {key: value.pin_memory() for key, value in batch.items()}

        with ThreadPoolExecutor(1, "minibatch") as beside:
            following = beside.submit(read)
            for number in range(count):
                batch = following.result()
                if number + 1 < count:
                    following = beside.submit(read)
                yield {
                    key: value.to(self._device, non_blocking=True) for key, value in batch.items()
                }

    def _network(self, batch: dict[str, Tensor]) -> tuple[Tensor, ...]:
        """Mean actions (B, A), facts' logits (B, F), numbers (B, K), places (B, G, 3, cells).

        What the student does not learn is left out.
        """
        extractor: Any = self.policy.features_extractor
        features, where = extractor.look(batch)
        latent = self.policy.mlp_extractor.forward_actor(features)
        answers = [torch.tanh(self.policy.action_net(latent))]
        if self._heads is not None:
            answers.append(self._heads(features[:, : self._heads.in_features]))
        if self._tell is not None:
            answers.append(self._tell(features))
        if where is not None:
            answers.append(where)
        if self._read is not None:
            assert self._crops is not None
            seen = self._crops.parted(features)
            answers += [head(seen[:, k]) for k, head in enumerate(self._read)]
        return tuple(answers)

    # --- exact resume ------------------------------------------------------------------------

    _state = (
        *("policy", "_heads", "_tell", "_read", "_optimizer", "_rng", "simulation", "store"),
        *("round", "_ended", "_episodes", "_cut", "_acted"),
    )

    def state_dict(self) -> dict[str, Any]:
        """Copy everything that the next round depends on; images stay in the store's file."""
        return super().state_dict() | {"torch": torch.get_rng_state()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        super().load_state_dict(state)
        torch.set_rng_state(state["torch"].cpu())


class StudentStage(Stage):
    """The training of a student.

    Args:
        config: of the run.
        folder: of the stage.
        guide: makes the teacher of N users.
    """

    name, unit, result = "student", "frames", "policy.pt"
    title = "a student learns to do the same from what the user sees."
    state_of, leftovers = "the state of this student", (PICTURE_FILES,)

    _learner: Student

    def __init__(
        self, config: TrainingConfig, folder: Path, guide: Callable[[Simulation], Expert]
    ) -> None:
        super().__init__(config, folder, config.student.frames)
        self._guide = guide

    @property
    def done(self) -> float:
        """Frames that the student has had."""
        return self._learner.store.count

    def weights(self) -> dict[str, Tensor]:
        """Return the policy's weights in the end."""
        return read_tensors(self.folder / self.result, "the student's weights")

    def open(self) -> None:
        """Make the student, its teacher and users."""
        config = self._config
        env = with_options(config.env, config.student.app_options)
        self._simulation = simulation = Simulation(env, config.student.n_envs)
        guide = self._guide(simulation)
        policy = _new_policy(config, simulation, guide).to(get_device(config.device))
        self.folder.mkdir(parents=True, exist_ok=True)
        self._learner = Student(
            config.student,
            policy,
            simulation,
            guide,
            self.folder,
            seed=config.seed,
            game=simulation.resolved.facts,
        )

    def learned(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return what may not be NaN."""
        heads = {"heads": "_heads", "tell": "_tell", "read": "_read", "optimizer": "_optimizer"}
        return {"policy": state["policy"]} | {title: state[k] for title, k in heads.items()}

    def run(self, callbacks: Callbacks) -> None:
        """Go through the rounds that are left."""
        student = self._learner
        self.resume(callbacks)
        first, began, doing = student.store.count, time.monotonic(), "collecting the first frames"
        while not student.finished:
            view = View(student.store.count, doing)

            def show(share: float, view: View = view) -> None:
                callbacks.doing("playing" if share < COLLECTED else "learning")
                callbacks.show(lambda: view)

            progress = student.step(show)
            self.remember()
            if student.finished or student.round % CHECKPOINT_ROUNDS == 0:
                self.save()
            rate = (progress.frames - first) / (time.monotonic() - began)
            doing = _line(progress, rate, student.game)
            self.log(callbacks, _row(progress))
        callbacks.say("Student: " + doing)
        write_tensors(self.folder / self.result, student.policy.state_dict())
        self.tidy()


def _new_policy(config: TrainingConfig, simulation: Simulation, guide: Expert) -> VisualActorCritic:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        policy = VisualActorCritic(
            simulation.observation_space,
            simulation.action_space,
            lambda _: 0.0,
            config=config.policy,
        )
    if config.policy.scale_proprioception:
        # What the teacher has met is what the student will meet.
        policy.fit_scaling(*guide.proprioception_scale(simulation))
    with torch.no_grad():
        policy.log_std.fill_(config.student.log_std)
    return policy


def _row(progress: StudentProgress) -> dict[str, Any]:
    return {
        "step": progress.frames,
        **{f"rollout/{key}": value for key, value in progress.means.items()},
        "student/imitation_error": progress.imitation_error,
        "student/facts_error": progress.facts_error,
        "student/numbers_error": progress.numbers_error,
        "student/crops_error": progress.crops_error,
        "student/reading_error": progress.reading_error,
        "student/teacher_share": progress.teacher_share,
        "time/collect_seconds": progress.collect_seconds,
        "time/learn_seconds": progress.learn_seconds,
    }


def _line(progress: StudentProgress, rate: float, game: GameFacts) -> str:
    played = "".join(
        f"{measure.heading.lower()} {value:.{measure.digits}f} in its last rounds, "
        for measure in game.scalars
        if measure.name == game.score
        and (value := progress.means.get(metric_key(measure))) is not None
    )
    return (
        f"{progress.frames:,} frames, {played}differs from the teacher by "
        f"{progress.imitation_error:.3f} ({rate:,.0f} frames/s)"
    )
