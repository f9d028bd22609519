"""Learning what is worth doing with what is seen, by trying: Q-learning over places in the picture.

A decision is a move of each hand and a place in the picture to do it with (Zeng et al. 2018,
"Learning Synergies between Pushing and Grasping", call such values action maps). What the hands
decide adds up to what the user gets (Sunehag et al. 2018, value decomposition). Random tries go to
rare colours more often than to common ones, and are seen through.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.state import State
from sim2vr_harness.play.player import reward_per_minute
from sim2vr_harness.policies.hierarchical.action_selection import OptionScene, choose, committed
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy, Moment
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy
from sim2vr_harness.runs.option_config import QLearningConfig
from sim2vr_harness.training.option_q_learning.exploration import Exploration
from sim2vr_harness.training.option_q_learning.value_learner import (
    LEARNING_RATE,
    PARTS,
    SCENE,
    ValueLearner,
)
from sim2vr_harness.training.replay import ReplayStore

DECIDE_STEPS = 3
"""User steps from one decision to the next: 0.15 s at 20 Hz.
Users see decisions through for longer where it pays."""
_UPDATES, _UPDATES_FOR_PERSONS = 1, 2
"""Updates of the Q-network per decision of all users; persons take longer to decide and to move."""
_EXPLORE_FIRST = 0.9
_SETTLE_SHARE = 0.5
"""Last share of the user steps, over which learning rate and exploration fall."""
_SETTLED_RATE, _SETTLED_TRIES = 0.05, 0.25
"""Factors on learning rate and random tries at the very end."""
_NEAR_M, _REACHED_M = 1.2, 0.06


@dataclass(frozen=True)
class QLearningReport:
    """Progress of the Q-learning.

    Attributes:
        step: user steps of all users so far.
        reward: mean reward per minute, effort taken off, over the last ones.
        loss: of the values.
        explore: proportion of exploratory decisions.
    """

    step: int
    reward: float
    loss: float
    explore: float


class OptionQLearning(State):
    """Learns values of places and moves while N users try.

    Args:
        config: of the stage.
        simulation: N users; owned by the caller.
        policy: theirs; what is learned are its values.
        pictures: the file that what is seen goes to; made or reused.
        seed: of everything drawn here.
        for_persons: whether persons will use what is learned.
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
    ) -> None:
        self.config, self._seed = config, seed
        self.updates = _UPDATES_FOR_PERSONS if for_persons else _UPDATES
        """Updates of the Q-network per decision of all users."""
        n = self.n = int(simulation.n)
        hands = self.hands = len(policy.tool)
        self.rng = np.random.default_rng([seed, 55])
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.net = ActionValueMap(policy.values.sight, hands, policy.values.options)
        self._take_up(simulation, policy)
        self.persons = False
        """Whether the present users are persons."""
        self.manner_chosen = False
        """Whether the manner of hands has been compared (see ``manner.py``)."""
        self.step_count = 0
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
        length = -(-config.user_steps // (n * DECIDE_STEPS)) + 1
        self._decisions = ReplayStore(pictures, length, shapes)
        """Decisions of all users, and what came of them."""
        self._rewards: deque[float] = deque(maxlen=200)
        self.learner = ValueLearner(self.net, self._decisions, self.rng, n)

    def _take_up(self, simulation: Any, policy: HierarchicalPolicy) -> None:
        """Let these users play from now on, in rounds that begin."""
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
        """Let every user's rounds begin anew."""
        self.simulation.reset(seeds=self._round_seeds(*seed))
        self._memory = self.policy.begin(self.n)

    def _round_seeds(self, *seed: int) -> list[int]:
        """Return seeds of the users' rounds."""
        return np.random.SeedSequence(seed).generate_state(self.n, np.uint32).tolist()

    def continue_with_persons(self, simulation: Any, policy: PersonPolicy) -> None:
        """Go on learning the same values with persons, from their own decisions.

        Args:
            simulation: N persons in the same app; owned by the caller.
            policy: theirs, with the same tool and options.
        """
        self._take_up(simulation, policy)
        self.learner.since = self._decisions.count
        self.persons = True
        self._rewards.clear()

    # --- deciding ----------------------------------------------------------------------------

    def _sense(self) -> Moment:
        return self.policy.sense(self.simulation.observation(), self._memory[0])

    def _scene(self, moment: Moment) -> OptionScene:
        """Return what users see by which they decide."""
        return self.policy.scene(moment, self._memory[0], moment.decides)

    # --- a decision and what comes of it -----------------------------------------------------

    @property
    def explore(self) -> float:
        """Share of random tries now."""
        config = self.config
        late = max(0, self.step_count - config.try_steps) / config.explore_steps
        if self.step_count < config.try_steps:
            return 1.0
        fallen = min(1.0, late) * (config.explore_last - _EXPLORE_FIRST)
        return (_EXPLORE_FIRST + fallen) * self._settling(_SETTLED_TRIES)

    def _settling(self, end: float) -> float:
        """Factor that falls from 1 to ``end`` over the last share of the user steps."""
        left = max(0.0, 1.0 - self.step_count / self.config.user_steps)
        return 1.0 if left >= _SETTLE_SHARE else end + (1.0 - end) * left / _SETTLE_SHARE

    @property
    def finished(self) -> bool:
        """Whether all user steps are taken."""
        return self.step_count >= self.config.user_steps

    def step(self, doing: Callable[[str], None] = lambda part: None) -> QLearningReport:
        """Decide, see it through, and learn.

        Args:
            doing: told what is done from now on, for a table of times.
        """
        doing("choosing options")
        explore, moment = self.explore, self._sense()
        scene = self._scene(moment)
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
        self._trying -= DECIDE_STEPS
        choose(choice, chosen, scene.places, primitives, changed, scene.aims(choice, chosen))
        seen = {name: getattr(scene, name).numpy()[None] for name in SCENE}
        seen["pictures"] = seen["pictures"].transpose(0, 1, 3, 4, 2)
        self._decisions.append({**seen, "chosen": chosen[None]})
        updates = 0
        if self.step_count >= self.config.try_steps:
            self.learner.settle_scale()
            updates = self.updates
        came, loss = self._play_and_learn(moment, updates, doing)
        self._decisions.amend({name: values[None] for name, values in came.items()})
        step_s = 1.0 / self.simulation.config.action_frequency_hz
        self._rewards.append(float(came["reward"].mean()) * 60.0 / (DECIDE_STEPS * step_s))
        return QLearningReport(self.step_count, float(np.mean(self._rewards)), loss, explore)

    def _play_and_learn(
        self, moment: Moment, updates: int, doing: Callable[[str], None]
    ) -> tuple[dict[str, NDArray[Any]], float]:
        """See the present choice through, and learn from the ones before it meanwhile.

        What is learned from ends where the present decision was made, so that it makes no
        difference, to the bit, whether there are cores for it or it comes first.
        """
        rate = LEARNING_RATE * self._settling(_SETTLED_RATE)
        self.learner.corrected = 1.0 - self._settling(0.0)
        if budget(self.simulation.config.cores) == 1 or not updates:
            doing("learning")
            loss = self.learner.learn(updates, rate, map)
            doing("playing")
            return self._play(moment), loss
        doing("playing and learning")
        with ThreadPoolExecutor(PARTS) as parts, ThreadPoolExecutor(1) as beside:
            learning = beside.submit(self.learner.learn, updates, rate, parts.map)
            played = self._play(moment)
            return played, learning.result()

    def _play(self, moment: Moment) -> dict[str, NDArray[Any]]:
        """See the present choice through.

        Returns:
            (N,) rewards, of which effort is taken off, and those of the app; whose episodes ended,
            and whose of these were only cut off.
        """
        (memory,) = self._memory
        reward, game_reward = np.zeros((2, self.n), np.float32)
        over, cut = np.zeros((2, self.n), bool)
        for step in range(DECIDE_STEPS):
            if step:
                moment = self._sense()
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
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> float:
        """Mean reward per minute, effort taken off, without tries.

        Every user's rounds begin anew, which ends the learning.

        Args:
            hold: user steps for which a decision is seen through.
            steps: user steps to play, of each.
            on_progress: called with the share of the steps done, before each of them.
        """
        self._trying[:] = 0
        self.policy.hold.fill_(hold)
        seeds = self._round_seeds(self.step_count, 59)
        reward, effort = reward_per_minute(
            self.simulation, self.policy, seeds, steps, deterministic=True, on_progress=on_progress
        )
        return reward - effort

    def diagnosis(self) -> tuple[float, float]:
        """Share of the decisions that were rewarded, and of what is near that is within reach."""
        scene = self._scene(self._sense())
        flat = scene.places.flatten(2).transpose(1, 2).reshape(-1, 3)
        head = scene.head.repeat_interleave(scene.sight.cells, 0)
        near = flat[(flat - head).norm(dim=1) < _NEAR_M]
        primitives = self.policy.primitives
        within = float(primitives.near(near, _REACHED_M).mean()) if len(near) else 0.0
        known = self._decisions.read("game_reward", np.arange(self._decisions.count))
        return float((known > 0.0).mean()), within

    # --- exact resume ------------------------------------------------------------------------

    _state = (
        *("step_count", "persons", "manner_chosen", "_rewards", "rng", "net", "learner"),
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
        """Return how hands move: what :func:`choose_manner` compares."""
        policy = self.policy
        own = {"vigour": policy.vigour} if isinstance(policy, PersonPolicy) else {}
        return {"lifts": policy.lifts} | own

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        super().load_state_dict(state)
        for name, value in self._manner().items():
            value.copy_(state["manner"][name])
        self._memory = self.policy.begin(self.n)
        self._memory[0].load_state_dict(state["memory"])
        if isinstance(self.policy, PersonPolicy) and self.policy.draws is not None:
            self.policy.draws.bit_generator.state = json.loads(state["draws"])
