"""DAgger: a policy with vision imitates a teacher, on the app's real images.

The student acts, so that it meets the situations its own mistakes lead to, and the teacher labels
each of them with its own action. The student's network learns the teacher's mean action; heads on
its image features, which are dropped afterwards, learn facts that the image shows, such as which
targets are visible. Ross, Gordon & Bagnell (2011), "A Reduction of Imitation Learning and
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
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.utils import get_device
from torch import Tensor, nn

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.progress import View
from sim2vr_harness.base.rotations import turned
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

PICTURE_FILES = "frames.*.bin"
"""Files of the student's recorded images; ``*`` stands for the sense's key."""
COLLECTED = 0.4
"""Proportion of a round's time that is over after collecting."""


@dataclass(frozen=True)
class DaggerSettings:
    """Constants of the student's training; the same for all games."""

    imitation_weight: float = 4.0
    """Weight of the actions in the loss."""
    facts_weight: float = 0.2
    """Weight of the facts that the picture shows."""
    crops_weight: float = 0.2
    """Weight of the places of the attention crops."""
    weight_decay: float = 1e-4
    max_grad_norm: float = 1.0
    noisy_users: float = 0.25
    """Proportion of users with noise on their actions, so that unusual situations are seen."""
    rollout_steps: int = 32
    """User steps per user between two times of learning: 1.6 s at 20 Hz."""
    teacher_rounds: int = 3
    """Rounds in which the teacher acts for every user: an untrained student meets few of the
    situations that it has to learn."""
    checkpoint_rounds: int = 20
    """Rounds of collecting between two checkpoints: 41,000 frames of 64 users."""
    statistics_episodes: int = 100
    """Number of latest episodes in the printed statistics."""
    farthest: float = 3.0
    """Standard deviations from the mean at which the teacher's numbers are cut."""
    nearest_m: float = 0.1
    """Nearer things, or those behind the eyes, get no attention crop."""
    scale_steps: int = 120
    """User steps from which the scale of the proprioception is estimated."""


SETTINGS = DaggerSettings()
_TARGETS = ("label", "facts", "numbers", "crop_places")
"""Fields that a stored frame has in addition to the observation."""


class TeacherExpert:
    """A trained teacher that acts on more than the student observes."""

    crop_columns: tuple[tuple[int, ...], ...]
    """Of each of :meth:`crop_places`, which of :meth:`numbers` are about it."""

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
        """Return the teacher's actions in the present state, (N, A) in [-1, 1]."""
        return self._policy.act({OBSERVATION: self._senses.observe()})

    def facts(self, simulation: Any) -> NDArray[np.float32]:
        """Return facts (N, F) in [0, 1]: which places have a target in the image; F may be 0."""
        columns = [self._senses.seen(name) for name in self._facts]
        if not columns:
            return np.zeros((simulation.n, 0), np.float32)
        return np.clip(np.stack(columns, axis=1), 0.0, 1.0)

    def numbers(self, simulation: Any) -> NDArray[np.float32]:
        """Return the teacher's observations of the game, standardised for its network, (N, K)."""
        with torch.inference_mode():
            told = {OBSERVATION: torch.from_numpy(self._senses.observe())}
            scaled: NDArray[np.float32] = self._policy.normaliser(told).numpy()
        return np.clip(scaled[:, self._game], -SETTINGS.farthest, SETTINGS.farthest)

    def crop_places(self, simulation: Any) -> NDArray[np.float32]:
        """Return the places (N, G, 3) of the game's ``attention_targets``; see :func:`seen_at`."""
        heads = pose_to_app(*simulation.users.device_poses("headset"))
        told = [
            np.stack(
                [self._senses.field(f"{name}.{part}") for part in ("present", "x_m", "y_m", "z_m")],
                1,
            )
            for name in self._attention_targets
        ]
        return seen_at(np.stack(told, 1), heads[:, 3:])

    def proprioception_scale(
        self, simulation: Simulation
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and standard deviation of the proprioception while the teacher plays, (P,).

        The users' present rounds are lost.
        """
        simulation.reset(seeds=list(range(simulation.n)))
        seen = []
        for step in range(SETTINGS.scale_steps):
            if step % 4 == 0:
                seen.append(simulation.proprioception.observe(simulation.users))
            simulation.renew(simulation.step(self.actions(simulation)))
        values = np.concatenate(seen).astype(np.float64)
        return values.mean(0), values.std(0)


def seen_at(told: NDArray[np.floating[Any]], head_xyzw: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the positions of objects in the image.

    Args:
        told: (N, G, 4) 1 if there is an object, else 0, and its position relative to the head, m,
            in the app's frame.
        head_xyzw: (N, 4) orientations of the heads, app frame.

    Returns:
        (N, G, 3) tangents of the angles right and up of straight ahead, at most 10, and 1 if the
        object is in front of the eyes, else 0.
    """
    # In the frame of the head: turned back by the conjugate.
    axis, w = -head_xyzw[:, None, :3], head_xyzw[:, None, 3:]
    off = told[..., 1:].astype(np.float64)
    off = turned(axis, w, off)
    ahead = off[..., 2]
    there = (told[..., 0] > 0.0) & (ahead > SETTINGS.nearest_m)
    place = np.clip(off[..., :2] / np.maximum(ahead, SETTINGS.nearest_m)[..., None], -10.0, 10.0)
    place *= there[..., None]
    return np.concatenate([place, there[..., None]], 2).astype(np.float32)


@dataclass
class StudentProgress:
    """The numbers of one round of collecting and learning."""

    frames: int
    """User steps collected so far."""
    imitation_error: float
    """Root mean square difference to the teacher's action, per muscle."""
    facts_error: float
    """Mean cross entropy of the facts, 0 without any."""
    numbers_error: float
    """Mean squared error of the predicted game observations of the teacher; 0 if not predicted."""
    crops_error: float
    """Of the locator, see ``AttentionCrops.loss``; 0 without attention crops."""
    reading_error: float
    """Mean squared error of the facts of a thing, from its crop alone."""
    teacher_share: float
    """Proportion of user steps in which the teacher acted."""
    episodes: int
    """Episodes that ended, in which the student alone acted."""
    means: dict[str, float]
    """Means over the last of those, as :func:`episode_means` gives them."""
    collect_seconds: float
    learn_seconds: float


class Student(State):
    """DAgger on N users.

    Args:
        policy: the network to train, on the device of its training; its critic is not trained.
        simulation: N users with vision; owned by the caller.
        folder: of the collected images; made or reused.
        game: facts that the game publishes, for the means of episodes.
    """

    def __init__(
        self,
        config: StudentConfig,
        policy: VisualActorCritic,
        simulation: Any,
        guide: TeacherExpert,
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
            self._looked_at = 0 if self._crops is None else self._crops.count
            if self._crops is not None:
                known = len(guide.crop_columns)
                if known < self._looked_at:
                    raise InputError(
                        "policy.attention_crops.count",
                        str(self._looked_at),
                        f"at most {known}, the things that the game says are worth looking at",
                    )
                self._crops.teach(True)
            if self._crops is None or self._tell is None:
                self._read = None
            else:
                columns = self.guide.crop_columns[: self._looked_at]
                heads = [nn.Linear(self._crops.features, len(which)) for which in columns]
                self._read = nn.ModuleList(heads).to(self._device)
        mlp: Any = policy.mlp_extractor
        heads_only = (self._heads, self._tell, self._read)  # dropped after this stage
        self._parameters = [
            *policy.features_extractor.parameters(),
            *mlp.actor.parameters(),
            *policy.action_net.parameters(),
            *(weights for head in heads_only if head is not None for weights in head.parameters()),
        ]
        # Fused: one pass over the weights instead of a dozen.
        self._optimizer = torch.optim.AdamW(
            self._parameters, config.learning_rate, weight_decay=SETTINGS.weight_decay, fused=True
        )
        # Store of observations and of what the student learns from them.
        each, kept = self.n * SETTINGS.rollout_steps, config.kept_frames
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
            -(-min(config.frames, kept or config.frames) // each) * each,
            shapes | {name: (size, np.float32) for name, size in sizes.items()},
            slack=SETTINGS.checkpoint_rounds * each if kept else 0,
        )
        self.round = 0
        # Rounds end at different times, so that every minibatch has all phases of a round in it.
        longest = min(simulation.max_steps, config.stagger_steps)
        self._cut = self._rng.integers(1, longest + 1, self.n)
        self._episodes: deque[dict[str, Any]] = deque(maxlen=SETTINGS.statistics_episodes)
        self._acted, self._ended = np.zeros(self.n), 0

    @property
    def finished(self) -> bool:
        """Return whether all frames are collected and all updates on them are done."""
        return self.store.count >= self.config.frames

    # --- a round -----------------------------------------------------------------------------

    def step(self, on_progress: Callable[[float], None] = lambda share: None) -> StudentProgress:
        """Collect user steps of every user, then learn; ``on_progress`` gets the part done."""
        began = time.monotonic()
        with torch_threads(1):
            config = self.config
            late = self.round - SETTINGS.teacher_rounds
            collect_share = (
                1.0 if late < 0 else config.teacher_share * config.teacher_share_decay**late
            )
            noisy = np.arange(self.n) < SETTINGS.noisy_users * self.n
            shown = 0
            for step in range(SETTINGS.rollout_steps):
                on_progress(COLLECTED * step / SETTINGS.rollout_steps)
                observation = self.simulation.observation()
                label = np.clip(self.guide.actions(self.simulation), -1.0, 1.0)
                facts = self.guide.facts(self.simulation)
                told, places = np.zeros((self.n, 0), np.float32), np.zeros((self.n, 0, 3), "f4")
                if self._tell is not None:
                    told = self.guide.numbers(self.simulation)
                if self._looked_at:
                    places = self.guide.crop_places(self.simulation)[:, : self._looked_at]
                row = {"label": label, "facts": facts, "numbers": told, "crop_places": places}
                self.store.append({**observation, **row})
                # Whole stretches by one of the two would show fewer of the student's mistakes.
                by_teacher = self._rng.random(self.n) < collect_share
                noise = self._rng.standard_normal(label.shape).astype(np.float32)
                action = np.where(by_teacher[:, None], label, self.act(observation))
                action = action + noise * (config.noise_std * noisy[:, None])
                outcome = self.simulation.step(np.clip(action, -1.0, 1.0))
                self._count(outcome, by_teacher)
                shown += int(by_teacher.sum())
            share = shown / (SETTINGS.rollout_steps * self.n)
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

    def act(self, observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
        """Return the student's mean actions, (N, A)."""
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
        samples = round(config.samples_per_frame * self.n * SETTINGS.rollout_steps)
        minibatches = max(1, round(samples / config.batch_size))
        done = min(1.0, self.store.count / config.frames)
        fall = min(1.0, 2.0 * (1.0 - done))  # constant in the first half, then linear to 0
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * max(fall, 0.02)
        self.policy.train()
        found: list[dict[str, Tensor]] = []
        weights = {
            "imitation": SETTINGS.imitation_weight,
            "facts": SETTINGS.facts_weight,
            "numbers": config.numbers_weight,
            "crops": SETTINGS.crops_weight,
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
            nn.utils.clip_grad_norm_(self._parameters, SETTINGS.max_grad_norm)
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
        """Return mean actions (B, A), fact logits (B, F), numbers (B, K), places (B, G, 3, cells).

        Outputs that the student does not learn are left out.
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
        super().load_state_dict(state)
        torch.set_rng_state(state["torch"].cpu())


class StudentStage(Stage):
    """The training of a student; ``guide`` makes the teacher of its users."""

    name, unit, result = "student", "frames", "policy.pt"
    title = "a student learns to do the same from what the user sees."
    state_of, leftovers = "the state of this student", (PICTURE_FILES,)

    _learner: Student

    def __init__(
        self, config: TrainingConfig, folder: Path, guide: Callable[[Simulation], TeacherExpert]
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
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            spaces = (simulation.observation_space, simulation.action_space)
            policy = VisualActorCritic(*spaces, lambda _: 0.0, config=config.policy)
        if config.policy.scale_proprioception:
            # What the teacher has met is what the student will meet.
            policy.fit_scaling(*guide.proprioception_scale(simulation))
        with torch.no_grad():
            policy.log_std.fill_(config.student.log_std)
        policy.to(get_device(config.device))
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
        """Return the parts of the state that must be finite."""
        heads = {"heads": "_heads", "tell": "_tell", "read": "_read", "optimizer": "_optimizer"}
        return {"policy": state["policy"]} | {title: state[k] for title, k in heads.items()}

    def run(self, callbacks: Callbacks) -> None:
        """Run the remaining rounds."""
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
            if student.finished or student.round % SETTINGS.checkpoint_rounds == 0:
                self.save()
            rate = (progress.frames - first) / (time.monotonic() - began)
            doing = _line(progress, rate, student.game)
            names = ("imitation_error", "facts_error", "numbers_error", "crops_error")
            row = {f"rollout/{key}": value for key, value in progress.means.items()}
            for name in (*names, "reading_error", "teacher_share"):
                row[f"student/{name}"] = getattr(progress, name)
            for name in ("collect_seconds", "learn_seconds"):
                row[f"time/{name}"] = getattr(progress, name)
            self.log(callbacks, {"step": progress.frames} | row)
        callbacks.say("Student: " + doing)
        write_tensors(self.folder / self.result, student.policy.state_dict())
        self.tidy()


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
