"""Q-learning of motor options over the cells of the image.

A decision is an option of each hand and a cell to apply it at (Zeng et al. 2018, "Learning
Synergies between Pushing and Grasping": action value maps). Values of the hands add up to the
user's (Sunehag et al. 2018, value decomposition). Exploratory decisions prefer rare colours, and
are completed.
"""

import copy
import json
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.state import State
from sim2vr_harness.play.player import reward_per_minute
from sim2vr_harness.policies.hierarchical.action_selection import (
    OptionScene,
    best_choices,
    choose,
    committed,
)
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import CELL_PX
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy, Moment
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy
from sim2vr_harness.runs.option_config import QLearningConfig
from sim2vr_harness.training.replay import ReplayStore


@dataclass(frozen=True)
class LearningSettings:
    """Constants of the Q-learning; the same for all apps."""

    n_step: int = 3
    """Decisions whose rewards are added up before a value is bootstrapped."""
    decide_steps: int = 3
    """User steps from one decision to the next: 0.15 s at 20 Hz. The final policy may hold a
    decision for longer."""
    gamma: float = 0.85
    """Discount factor per decision: rewards follow within about 7 decisions."""
    learning_rate: float = 1e-3
    """Of Adam."""
    batch_size: int = 64
    """Decisions per minibatch."""
    parts: int = 2
    """Parts of a minibatch, whose gradients are computed in parallel."""
    rewarded_share: float = 0.25
    """Proportion of a minibatch that precedes a reward (prioritised replay, Schaul et al. 2016)."""
    kept_decisions: int = 24_000
    """Size of the replay buffer."""
    target_rate: float = 0.01
    """Rate at which the target network follows."""
    scale_percentile: float = 99.0
    """Rewards are divided by this percentile of the app's rewards that are not 0."""
    max_grad_norm: float = 5.0
    """Gradients are clipped to this norm."""
    updates: int = 1
    """Updates per decision of all users."""
    updates_for_persons: int = 2
    """The same if persons will use the values: they decide and move more slowly."""
    explore_first: float = 0.9
    """Proportion of exploratory decisions after the first, random ones."""
    settle_share: float = 0.5
    """Last proportion of the user steps, over which learning rate and exploration fall."""
    settled_rate: float = 0.05
    """Factor on the learning rate at the end."""
    settled_tries: float = 0.25
    """Factor on exploration at the end."""
    explore_steps: tuple[int, int] = (6, 16)
    """Duration of an exploratory decision, user steps: least, and beyond the longest."""
    pull_steps: int = 24
    """Duration of an exploratory pull, which has an end of its own."""
    rest_share: float = 0.1
    """Proportion of exploratory decisions that rest or take an option without a place."""
    reach_m: float = 0.1
    """Cells nearer than this to what a hand can reach are explored more often."""
    colours: int = 8
    """Levels of each colour channel by which colours are counted."""


SETTINGS = LearningSettings()


def draw_decisions(
    rewarded: NDArray[np.bool_], size: int, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Draw decisions; rewards are rare at first, so those before them are preferred.

    Args:
        rewarded: (R, N) whether decisions of N users were rewarded, in order.

    Returns:
        Rows, users, and importance weights without an exponent: how much more likely each were if
        all were drawn alike; their mean is 1.
    """
    first, n = len(rewarded) - SETTINGS.n_step + 1, rewarded.shape[1]
    rows, users = rng.integers(0, first, size), rng.integers(0, n, size)
    when, who = np.nonzero(rewarded)
    if not len(when):
        return rows, users, np.ones(size)
    preferred = round(SETTINGS.rewarded_share * size)
    drawn = rng.integers(0, len(when), preferred)
    before = np.clip(when[:, None] - np.arange(SETTINGS.n_step), 0, first - 1)
    rows[:preferred] = before[drawn, rng.integers(0, SETTINGS.n_step, preferred)]
    users[:preferred] = who[drawn]
    ways = np.zeros((first, n))
    np.add.at(ways, (before, who[:, None]), 1.0)
    share = preferred / size
    times = ways[rows, users] * first * n / (SETTINGS.n_step * len(when))
    return rows, users, 1.0 / (1.0 - share + share * times)


Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
SCENE = ("pictures", "head", "turned", "tips", "velocities")
"""Fields of a scene, in their order."""


class ValueLearner(State):
    """Learns the values of options from decisions of N users and their rewards."""

    _state = ("slow", "optimizer", "scale", "since")

    def __init__(
        self,
        net: ActionValueMap,
        decisions: ReplayStore,
        rng: np.random.Generator,
        users: int,
    ) -> None:
        self.net, self.decisions, self._rng = net, decisions, rng
        self._n = users
        self.slow = copy.deepcopy(net).requires_grad_(False)
        """The target network."""
        self.optimizer = torch.optim.Adam(net.parameters(), SETTINGS.learning_rate, fused=True)
        self.since = 0
        """First decision that counts."""
        self.scale = 1.0
        """Divisor of the rewards."""
        self.corrected = 0.0
        """Exponent of the importance weights: 0 at first, 1 at the end (Schaul et al. 2016)."""

    def settle_scale(self) -> None:
        """Set the scale of rewards so that a good decision has a value of about 1."""
        if self.scale != 1.0:
            return
        known = np.abs(self.decisions.read("game_reward", np.arange(self.decisions.count)))
        known = known[known > 0.0]
        self.scale = float(np.percentile(known, SETTINGS.scale_percentile)) if len(known) else 1.0

    def learn(self, updates: int, rate: float, each: Map) -> float:
        """Return the loss of the last update; NaN of none. ``each`` maps over its parts."""
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        loss = float("nan")
        for _ in range(updates if self.decisions.count - self.since > SETTINGS.n_step else 0):
            loss = self._update(each)
        return loss

    def _update(self, each: Map) -> float:
        """Run one training step on a batch, which is always divided in the same way."""
        memory = self.decisions
        have = min(
            memory.count - self.since, max(SETTINGS.n_step + 1, SETTINGS.kept_decisions // self._n)
        )
        first = memory.count - have
        rewarded = memory.read("game_reward", np.arange(first, memory.count - 1)) > 0.0
        rows, users, odds = draw_decisions(rewarded, SETTINGS.batch_size, self._rng)
        split = np.array_split(np.arange(len(rows)), min(SETTINGS.parts, len(rows)))
        weights = odds**self.corrected
        rows = first + rows
        found = list(each(lambda i: self._gradients(rows[i], users[i], weights[i]), split))
        self.optimizer.zero_grad()
        for parameter, *shares in zip(
            self.net.parameters(), *(grads for _, grads in found), strict=True
        ):
            parameter.grad = sum(shares[1:], shares[0]).contiguous()
        nn.utils.clip_grad_norm_(self.net.parameters(), SETTINGS.max_grad_norm)
        self.optimizer.step()
        with torch.no_grad():
            for slow, fast in zip(self.slow.parameters(), self.net.parameters(), strict=True):
                slow.lerp_(fast, SETTINGS.target_rate)
        return sum(loss for loss, _ in found)

    def _gradients(
        self, rows: NDArray[np.int64], users: NDArray[np.int64], weights: NDArray[np.float64]
    ) -> tuple[float, tuple[Tensor, ...]]:
        """Return the parts of decisions (K,) of users (K,) in a batch's mean loss and gradients."""
        memory = self.decisions
        total, weight, last, known = self.returns(rows, users)
        then = self._scene(last, users)
        with torch.no_grad():
            seen = then.inputs(self.net)
            best = best_choices(self.net.values(*seen), then.something, self.net.options)
            worth = self._worth(self.slow.values(*seen), best)
            wanted = torch.from_numpy(total) + torch.from_numpy(weight) * worth
        scene = self._scene(rows, users)
        chosen = torch.from_numpy(memory.read("chosen", rows, users))
        guessed = self._worth(self.net.values(*scene.inputs(self.net)), chosen)
        losses = functional.smooth_l1_loss(guessed, wanted, reduction="none")
        loss = (losses * torch.from_numpy(weights * known).float()).sum() / SETTINGS.batch_size
        return float(loss.detach()), torch.autograd.grad(loss, tuple(self.net.parameters()))

    def returns(
        self, rows: NDArray[np.int64], users: NDArray[np.int64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64], NDArray[np.bool_]]:
        """Add up the rewards after decisions (K,) of users (K,), until a value is bootstrapped.

        A truncated round has a value after its end, but its last image is not stored, so the value
        of the last decision before it is used. The outcome of a decision during which a round was
        truncated is unknown.

        Returns:
            (K,) rewards, weights of the value, rows of the scenes with the value, and True if the
            outcome is known.
        """
        total, weight = np.zeros(len(rows), np.float32), np.ones(len(rows), np.float32)
        last, left = rows + SETTINGS.n_step, np.ones(len(rows), bool)
        for k in range(SETTINGS.n_step):
            at = (rows + k, users)
            cut = left & self.decisions.read("cut", *at)
            last[cut] = rows[cut] + k
            left &= ~cut
            reward = self.decisions.read("reward", *at) / self.scale
            total[left] += (weight * reward)[left]
            weight[left] *= SETTINGS.gamma
            over = left & self.decisions.read("over", *at)
            weight[over] = 0.0
            left &= ~over
        return total, weight, last, last > rows

    def _scene(self, rows: NDArray[np.int64], users: NDArray[np.int64]) -> OptionScene:
        """Return the scenes of decisions (K,) of users (K,)."""
        pictures, *others = (self.decisions.read(name, rows, users) for name in SCENE)
        seen = (pictures.transpose(0, 3, 1, 2), *others)
        parts: list[Any] = [torch.from_numpy(each) for each in seen]
        return OptionScene(self.net.sight, *parts)

    @staticmethod
    def _worth(values: Tensor, chosen: Tensor) -> Tensor:
        """Return the sums over hands of the values of choices (N, H), (N,)."""
        return values.gather(-1, chosen[..., None])[..., 0].sum(1)


class Exploration:
    """Draws exploratory decisions of N users."""

    def __init__(self, policy: HierarchicalPolicy, rng: np.random.Generator) -> None:
        self._policy, self._sight, self.rng = policy, policy.values.sight, rng
        self._options = policy.values.options
        self.colours = np.ones(SETTINGS.colours**3)
        """Number of times that each colour was seen."""

    def draw(self, near: NDArray[np.float64], far: NDArray[np.float64]) -> int:
        """Draw a choice, by weights (cells,) of cells to touch and of cells to point at."""
        options, cells = self._options, self._sight.cells
        if self.rng.random() < SETTINGS.rest_share:
            free = int(self.rng.integers(1 + len(options.free))) if options.free else 0
            return options.rest(cells) + free
        drawn = self.rng.random()
        # Half of the tries take options with inputs; without any, they touch or push.
        favoured = options.favoured
        if self.rng.random() < 0.5:
            move = favoured[self.rng.integers(len(favoured))]
        else:
            move = int(self.rng.integers(len(options.placed)))
        weights = far if options.placed[move] == "point" else near
        cell = int(np.searchsorted(np.cumsum(weights), drawn * weights.sum()))
        return move * cells + min(cell, cells - 1)

    def steps(self, chosen: int) -> int:
        """Return the duration of an exploratory action, in user steps."""
        placed, option = self._options.placed, chosen // self._sight.cells
        if option < len(placed) and placed[option] == "pull":
            return SETTINGS.pull_steps
        return int(self.rng.integers(*SETTINGS.explore_steps))

    def curiosity(
        self, scene: OptionScene, users: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(K, cells) weights of cells to touch (in reach, of rare colour) and to point at."""
        if not len(users):
            none = np.zeros((0, self._sight.cells))
            return none, none
        # (K, cells) how rare the rarest colour in each cell is.
        rarity = 1.0 / (0.002 + self.colours / self.colours.sum())
        rows, columns = self._sight.rows, self._sight.columns
        own = scene.pictures.numpy()[users][:, :, : rows * CELL_PX, : columns * CELL_PX]
        each = rarity[_colours(own)].reshape(-1, rows, CELL_PX, columns, CELL_PX)
        rare: NDArray[np.float64] = each.max((2, 4)).reshape(len(users), -1)
        flat = scene.places[users].flatten(2).transpose(1, 2).reshape(-1, 3)
        reach = self._policy.primitives.near(flat, SETTINGS.reach_m).reshape(len(users), -1)
        there = np.where(scene.something.numpy()[users], 1.0, 1e-9)
        near = _spread(there * np.where(reach, 1.0, 0.03), rare)
        return near, _spread(there, rare) if "point" in self._options.placed else near

    def note_colours(self, scene: OptionScene) -> None:
        """Count colours, with exponential forgetting."""
        pictures = scene.pictures.numpy()[:, :, ::2, ::2]
        seen = np.bincount(_colours(pictures).ravel(), minlength=SETTINGS.colours**3)
        self.colours = 0.999 * self.colours + seen / seen.sum()


def _colours(pictures: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Return the numbers of the colours of pixels, (N, H, W)."""
    level = (pictures[:, :3].astype(np.int64) * SETTINGS.colours) // 256
    number: NDArray[np.int64] = (
        level[:, 0] * SETTINGS.colours + level[:, 1]
    ) * SETTINGS.colours + level[:, 2]
    return number


def _spread(where: NDArray[np.float64], rare: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return weights (K, cells) that prefer rare colours among places; half of them strongly."""
    weights: NDArray[np.float64] = where * (0.3 * rare / rare.mean() + 0.7)
    rarest = where * rare
    return 0.5 * weights / weights.sum(1, keepdims=True) + 0.5 * rarest / rarest.sum(
        1, keepdims=True
    )


@dataclass(frozen=True)
class QLearningReport:
    """Progress of the Q-learning."""

    step: int
    """User steps of all users so far."""
    reward: float
    """Mean reward per minute, less effort, of the last decisions."""
    loss: float
    explore: float
    """Proportion of exploratory decisions."""


class OptionQLearning(State):
    """Learns option values while N users play.

    Args:
        simulation: N users; owned by the caller.
        policy: theirs; its values are learned.
        pictures: the file of the stored images; made or reused.
        for_persons: whether persons will use the values.
        loss_weight: weight, where manners of the hands are compared, of user steps that cost more
            than they earn.
    """

    def __init__(
        self,
        config: QLearningConfig,
        simulation: Any,
        policy: HierarchicalPolicy,
        pictures: Path,
        *,
        seed: int,
        for_persons: bool = False,
        loss_weight: float = 1.0,
    ) -> None:
        self.config, self._seed, self._loss_weight = config, seed, loss_weight
        self.updates = SETTINGS.updates_for_persons if for_persons else SETTINGS.updates
        """Updates of the Q-network per decision of all users."""
        n = self.n = int(simulation.n)
        hands = self.hands = len(policy.tool)
        self.rng = np.random.default_rng([seed, 55])
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.net = ActionValueMap(policy.values.sight, hands, policy.values.options)
        self._take_up(simulation, policy)
        self.persons = False
        """True if the present users are virtual participants."""
        self.manner_chosen = False
        """True if the manners of moving the hands have been compared."""
        self.step_count = self.compared = 0
        """User steps of learning, and of comparisons of manners and durations, of all users."""
        sight = self.net.sight
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            "pictures": ((n, sight.height, sight.width, 8), np.uint8),
            "head": ((n, 3), np.float32),
            "turned": ((n, 3, 3), np.float32),
            "tips": ((n, hands, 3), np.float32),
            "velocities": ((n, hands, 3), np.float32),
            "chosen": ((n, hands), np.int64),
            "reward": ((n,), np.float32),
            "game_reward": ((n,), np.float32),
            "over": ((n,), np.bool_),
            "cut": ((n,), np.bool_),
        }
        length = -(-config.user_steps // (n * SETTINGS.decide_steps)) + 1
        self._decisions = ReplayStore(pictures, length, shapes)
        """Decisions of all users, and their outcomes."""
        self._rewards: deque[float] = deque(maxlen=200)
        self.learner = ValueLearner(self.net, self._decisions, self.rng, n)

    def _take_up(self, simulation: Any, policy: HierarchicalPolicy) -> None:
        """Continue with these users, in new rounds."""
        self.simulation, self.policy = simulation, policy
        policy.values, policy.together = self.net, self.n
        if isinstance(policy, PersonPolicy):
            policy.draws = np.random.default_rng([self._seed, 57])
        self.begin_rounds(self._seed, 56)
        self._trying = np.zeros((self.n, self.hands), np.int64)
        """User steps for which a random try is still seen through."""
        self._tried = np.zeros((self.n, self.hands), np.int64)
        self._exploration = Exploration(policy, self.rng)

    def begin_rounds(self, *seed: int) -> None:
        """Start new rounds for all users."""
        self.simulation.reset(seeds=self._round_seeds(*seed))
        self._memory = self.policy.begin(self.n)

    def _round_seeds(self, *seed: int) -> list[int]:
        return np.random.SeedSequence(seed).generate_state(self.n, np.uint32).tolist()

    def continue_with_persons(self, simulation: Any, policy: PersonPolicy) -> None:
        """Continue learning the same values from the decisions of virtual participants.

        Args:
            simulation: N persons in the same app; owned by the caller.
            policy: their policy, with the same tool and options.
        """
        self._take_up(simulation, policy)
        self.learner.since = self._decisions.count
        self.persons = True
        self._rewards.clear()

    def scene(self) -> tuple[Moment, OptionScene]:
        """Return the users' present observations, and the scenes on which they base decisions."""
        moment = self.policy.sense(self.simulation.observation(), self._memory[0])
        return moment, self.policy.scene(moment, self._memory[0], moment.decides)

    @property
    def explore(self) -> float:
        """Share of random tries now."""
        config = self.config
        late = max(0, self.step_count - config.try_steps) / config.explore_steps
        if self.step_count < config.try_steps:
            return 1.0
        fallen = min(1.0, late) * (config.explore_last - SETTINGS.explore_first)
        return (SETTINGS.explore_first + fallen) * self._settling(SETTINGS.settled_tries)

    def _settling(self, end: float) -> float:
        """Factor that falls from 1 to ``end`` over the last share of the user steps."""
        left = max(0.0, 1.0 - self.step_count / self.config.user_steps)
        return (
            1.0
            if left >= SETTINGS.settle_share
            else end + (1.0 - end) * left / SETTINGS.settle_share
        )

    @property
    def finished(self) -> bool:
        """Return whether all user steps are done."""
        return self.step_count >= self.config.user_steps

    def step(self, doing: Callable[[str], None] = lambda part: None) -> QLearningReport:
        """Decide, complete the decision, and learn; ``doing`` receives the part that begins."""
        doing("choosing options")
        explore, (moment, scene) = self.explore, self.scene()
        # (N, H) what every user chooses; cells and moves in one number, the last one rests.
        primitives, choice = self.policy.primitives, self._memory[0].choice
        with torch.no_grad():
            decide_values = self.net.values(*scene.inputs(self.net))
            chosen = committed(
                decide_values, scene.something, choice, scene.places, primitives
            ).numpy()
        still = self._trying > 0  # the place stays the one that was tried
        changed = ~still
        chosen[still] = self._tried[still]
        anew = changed & (self.rng.random((self.n, self.hands)) < explore)
        users = np.flatnonzero(anew.any(1))
        self._exploration.note_colours(scene)
        weights = self._exploration.curiosity(scene, users)
        for i, near, far in zip(users, *weights, strict=True):
            for hand in np.flatnonzero(anew[i]):
                chosen[i, hand] = self._tried[i, hand] = self._exploration.draw(near, far)
                self._trying[i, hand] = self._exploration.steps(int(chosen[i, hand]))
        self._trying -= SETTINGS.decide_steps
        aims = scene.aims(choice, chosen, primitives.options)
        choose(choice, chosen, scene.places, primitives, changed, aims, scene.late_s)
        # A try that meets something lasts until then.
        step_s = self.policy.layer.step_s
        until = (choice.due_s.nan_to_num() / step_s).ceil().long().numpy()
        self._trying = np.where(anew, np.maximum(self._trying, until), self._trying)
        seen = {name: getattr(scene, name).numpy()[None] for name in SCENE}
        seen["pictures"] = seen["pictures"].transpose(0, 1, 3, 4, 2)
        self._decisions.append({**seen, "chosen": chosen[None]})
        updates = 0
        if self.step_count >= self.config.try_steps:
            self.learner.settle_scale()
            updates = self.updates
        # What is learned from ends where the present decision was made, so that the bits are the
        # same whether learning comes first or has a core of its own beside playing.
        rate = SETTINGS.learning_rate * self._settling(SETTINGS.settled_rate)
        self.learner.corrected = 1.0 - self._settling(0.0)
        if budget(self.simulation.config.cores) == 1 or not updates:
            doing("learning")
            loss = self.learner.learn(updates, rate, map)
            doing("playing")
            came = self._play(moment)
        else:
            doing("playing and learning")
            with ThreadPoolExecutor(SETTINGS.parts) as parts, ThreadPoolExecutor(1) as beside:
                learning = beside.submit(self.learner.learn, updates, rate, parts.map)
                came = self._play(moment)
                loss = learning.result()
        self._decisions.amend({name: values[None] for name, values in came.items()})
        step_s = 1.0 / self.simulation.config.action_frequency_hz
        self._rewards.append(float(came["reward"].mean()) * 60.0 / (SETTINGS.decide_steps * step_s))
        return QLearningReport(self.step_count, float(np.mean(self._rewards)), loss, explore)

    def _play(self, moment: Moment) -> dict[str, NDArray[Any]]:
        """Complete the present decision.

        Returns:
            (N,) rewards minus effort, rewards of the app, True if the episode ended, and True if it
            was truncated.
        """
        (memory,) = self._memory
        reward, game_reward = np.zeros((2, self.n), np.float32)
        over, cut = np.zeros((2, self.n), bool)
        for step in range(SETTINGS.decide_steps):
            if step:
                moment = self.policy.sense(self.simulation.observation(), memory)
            result = self.simulation.step(self.policy.move(moment, memory))
            self.step_count += self.n
            reward += np.where(over, 0.0, result.reward).astype(np.float32)
            game_reward += np.where(over, 0.0, result.game_reward).astype(np.float32)
            again = self.simulation.renew(result)
            self.policy.restart(self._memory, again)
            self._trying[again] = 0
            cut |= result.truncated & ~result.terminated & ~over
            over |= result.over
        return {"reward": reward, "game_reward": game_reward, "over": over, "cut": cut}

    def earned(
        self,
        hold: int,
        steps: int,
        *,
        on_step: Callable[[], None] = lambda: None,
    ) -> float:
        """Return what a minute is worth to the users, who mind losses, without exploration.

        Args:
            hold: user steps from one decision to the next.
            steps: user steps to play, of each.
            on_step: called before each of them.
        """
        self._trying[:] = 0
        self.policy.hold.fill_(hold)

        value = 0.0

        def advance(outcome: Any) -> None:
            nonlocal value
            loss = outcome.reward < 0.0
            value += float((outcome.reward * np.where(loss, self._loss_weight, 1.0)).mean())
            self.compared += self.n
            on_step()

        seeds = self._round_seeds(self.step_count, 59)
        reward_per_minute(
            self.simulation, self.policy, seeds, steps, deterministic=True, on_step=advance
        )
        return value * 60.0 * self.simulation.config.action_frequency_hz / steps

    def diagnosis(self) -> tuple[float, float]:
        """Return the proportions of rewarded decisions, and of near cells within reach."""
        _, scene = self.scene()
        flat = scene.places.flatten(2).transpose(1, 2).reshape(-1, 3)
        head = scene.head.repeat_interleave(scene.sight.cells, 0)
        near = flat[(flat - head).norm(dim=1) < 1.2]
        primitives = self.policy.primitives
        within = float(primitives.near(near, 0.06).mean()) if len(near) else 0.0
        known = self._decisions.read("game_reward", np.arange(self._decisions.count))
        return float((known > 0.0).mean()), within

    _state = (
        *(
            "step_count",
            "persons",
            "compared",
            "manner_chosen",
            "_rewards",
            "rng",
            "net",
            "learner",
        ),
        *("_decisions", "_trying", "_tried", "_exploration.colours", "simulation"),
    )

    def state_dict(self) -> dict[str, Any]:
        """Copy everything that the next decision depends on; pictures stay in their file."""
        draws = getattr(self.policy, "draws", None)
        return super().state_dict() | {
            "manner": {name: value.clone() for name, value in self._manner().items()},
            "memory": self._memory[0].state_dict(),
            "draws": json.dumps(draws and draws.bit_generator.state),
        }

    def _manner(self) -> dict[str, Tensor]:
        """Return the manner of moving the hands, which :func:`choose_manner` compares."""
        policy = self.policy
        own = {"vigour": policy.vigour} if isinstance(policy, PersonPolicy) else {}
        return {"lifts": policy.lifts} | own

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        super().load_state_dict(state)
        for name, value in self._manner().items():
            value.copy_(state["manner"][name])
        self._memory = self.policy.begin(self.n)
        self._memory[0].load_state_dict(state["memory"])
        if isinstance(self.policy, PersonPolicy) and self.policy.draws is not None:
            self.policy.draws.bit_generator.state = json.loads(state["draws"])
