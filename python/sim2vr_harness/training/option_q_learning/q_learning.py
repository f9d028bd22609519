"""Learning what is worth doing with what is seen, by trying: Q-learning over places in the picture.

A decision is a move of each hand and a place in the picture to do it with (Zeng et al. 2018,
"Learning Synergies between Pushing and Grasping", call such values action maps). What the hands
decide adds up to what the user gets (Sunehag et al. 2018, value decomposition). Random tries go to
rare colours more often than to common ones, and are seen through.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.state import State
from sim2vr_harness.policies.hierarchical.action_selection import ActionSelector, OptionScene
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.frame_history import FrameHistory
from sim2vr_harness.policies.hierarchical.person_layer import PersonLayer
from sim2vr_harness.policies.hierarchical.primitives import OptionChoice, PrimitiveController
from sim2vr_harness.runs.option_config import QLearningConfig
from sim2vr_harness.training.option_q_learning.exploration import Exploration
from sim2vr_harness.training.option_q_learning.value_learner import (
    LEARNING_RATE,
    PARTS,
    SCENE,
    ValueLearner,
)
from sim2vr_harness.training.replay import ReplayStore

__all__ = ["OptionQLearning", "OptionScene", "QLearningReport"]

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
        reward: mean reward of the app per minute, over the last ones.
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
        primitives: turns moves into goals.
        pictures: the file that what is seen goes to; made or reused.
        seed: of everything drawn here.
        late_steps: user steps by which pictures are seen late.
        for_persons: whether persons will use what is learned.
    """

    def __init__(
        self,
        config: QLearningConfig,
        simulation: Any,
        primitives: PrimitiveController,
        pictures: Path,
        *,
        seed: int,
        late_steps: int = 0,
        for_persons: bool = False,
    ) -> None:
        self.config, self._late_steps, self._seed = config, late_steps, seed
        self.updates = _UPDATES_FOR_PERSONS if for_persons else _UPDATES
        """Updates of the Q-network per decision of all users."""
        self.n: int = simulation.n
        self.hands = len(primitives.tool)
        vision = simulation.config.vision
        self.rng = np.random.default_rng([seed, 55])
        self._take_up(simulation, primitives)
        self.persons = False
        """Whether the present users are persons, whose effort counts."""
        self.manner_chosen = False
        """Whether the manner of hands has been compared (see ``manner.py``)."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.net = ActionValueMap(self._selector.sight, self.hands, primitives.options)
        self.step_count = 0
        n, hands = self.n, self.hands
        shapes: dict[str, tuple[tuple[int, ...], Any]] = {
            "pictures": ((n, vision.height, vision.width, 8), np.uint8),
            "head": ((n, 3), np.float32),
            "turned": ((n, 9), np.float32),
            "tips": ((n, hands, 3), np.float32),
            "velocities": ((n, hands, 3), np.float32),
            "chosen": ((n, hands), np.int64),
            "reward": ((n,), np.float32),
            "over": ((n,), np.bool_),
            "cut": ((n,), np.bool_),
        }
        length = -(-config.user_steps // (self.n * DECIDE_STEPS)) + 1
        self._memory = ReplayStore(pictures, length, shapes)
        """Decisions of all users, and what came of them."""
        inputs = OptionChoice.KEPT_INPUTS if primitives.options.inputs else ()
        self._kept = (*OptionChoice.KEPT, *inputs)
        self._rewards: deque[float] = deque(maxlen=200)
        self.learner = ValueLearner(self.net, self._selector, self._memory, self.rng, self.n)

    def _take_up(self, simulation: Any, primitives: PrimitiveController) -> None:
        """Let these users play from now on, in rounds that begin."""
        self.simulation, self.primitives = simulation, primitives
        past = FrameHistory(simulation, self._late_steps)
        self._selector = ActionSelector(simulation, primitives, past)
        self.begin_rounds(self._seed, 56)
        self._trying = np.zeros((self.n, self.hands), np.int64)
        """User steps for which a random try is still seen through."""
        self._tried = np.zeros((self.n, self.hands), np.int64)
        self._exploration = Exploration(self._selector, self.rng)

    def begin_rounds(self, *seed: int) -> None:
        """Let every user's rounds begin anew."""
        seeds = np.random.SeedSequence(seed).generate_state(self.n, np.uint32)
        self.simulation.reset(seeds=[int(value) for value in seeds])
        self._choice = OptionChoice(self.n, self.hands)

    def continue_with_persons(self, simulation: Any, primitives: PrimitiveController) -> None:
        """Go on learning the same values with persons, from their own decisions.

        Args:
            simulation: N persons in the same app; owned by the caller.
            primitives: of their hands, with the same tool and options.
        """
        self._take_up(simulation, primitives)
        self.learner.selector, self.learner.since = self._selector, self._memory.count
        self.persons = True
        self._rewards.clear()

    # --- deciding ----------------------------------------------------------------------------

    def _decide(self, scene: OptionScene, explore: float) -> NDArray[np.int64]:
        """(N, H) what every user chooses; cells and moves in one number, the last one rests."""
        places = self._selector.places(scene)
        with torch.inference_mode():
            values = self._selector.values(self.net, scene, places)
            chosen = self._selector.committed(values, scene, self._choice, places).numpy()
        still = self._trying > 0  # the place stays the one that was tried
        changed = ~still
        chosen[still] = self._tried[still]
        anew = changed & (self.rng.random((self.n, self.hands)) < explore)
        users = np.flatnonzero(anew.any(1))
        self._exploration.note_colours(scene)
        weights = self._exploration.curiosity(scene, places, users)
        for i, near, far in zip(users, *weights, strict=True):
            for hand in np.flatnonzero(anew[i]):
                chosen[i, hand] = self._tried[i, hand] = self._exploration.draw(near, far)
                self._trying[i, hand] = self._exploration.steps(int(chosen[i, hand]))
        self._trying -= DECIDE_STEPS
        self._selector.choose(self._choice, chosen, scene, places, changed)
        return chosen

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
        explore = self.explore
        scene = self._selector.scene()
        chosen = self._decide(scene, explore)
        seen = {name: getattr(scene, name)[None] for name in SCENE}
        seen["pictures"] = seen["pictures"].transpose(0, 1, 3, 4, 2)
        self._memory.append({**seen, "chosen": chosen[None]})
        updates = 0
        if self.step_count >= self.config.try_steps:
            self.learner.settle_scale()
            updates = self.updates
        (reward, over, cut), loss = self._play_and_learn(updates, doing)
        self._memory.amend({"reward": reward[None], "over": over[None], "cut": cut[None]})
        step_s = 1.0 / self.simulation.config.action_frequency_hz
        self._rewards.append(float(reward.mean()) * 60.0 / (DECIDE_STEPS * step_s))
        return QLearningReport(self.step_count, float(np.mean(self._rewards)), loss, explore)

    def _play_and_learn(
        self, updates: int, doing: Callable[[str], None]
    ) -> tuple[tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]], float]:
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
            return self.play(DECIDE_STEPS), loss
        doing("playing and learning")
        with ThreadPoolExecutor(PARTS) as parts, ThreadPoolExecutor(1) as beside:
            learning = beside.submit(self.learner.learn, updates, rate, parts.map)
            played = self.play(DECIDE_STEPS)
            return played, learning.result()

    def play(self, steps: int) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
        """See the present choice through.

        Returns:
            (N,) rewards, whose episodes ended, and whose of these were only cut off.
        """
        reward = np.zeros(self.n, np.float32)
        over, cut = np.zeros((2, self.n), bool)
        for _ in range(steps):
            actions = self._selector.actions(self._choice)
            result = self.simulation.step(actions)
            self.step_count += self.n
            worth = result.reward if self.persons else result.game_reward
            reward += np.where(over, 0.0, worth).astype(np.float32)
            again = self.simulation.renew(result)
            self._choice.forget(again)
            self._trying[again] = 0
            cut |= result.truncated & ~result.terminated & ~over
            over |= result.over
        return reward, over, cut

    def earned(
        self,
        hold: int,
        steps: int,
        *,
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> float:
        """Mean reward per minute, without tries.

        Every user's rounds begin anew, which ends the learning.

        Args:
            hold: user steps for which a decision is seen through.
            steps: user steps to play, of each.
            on_progress: called with the share of the steps done, before each of them.
        """
        self.begin_rounds(self.step_count, 59)
        self._trying[:] = 0
        total = 0.0
        for step in range(steps):
            on_progress(step / steps)
            if step % hold == 0:
                self._selector.choose_best(self.net, self._choice, hold)
            total += float(self.play(1)[0].mean())
        return total * 60.0 * self.simulation.config.action_frequency_hz / steps

    def diagnosis(self) -> tuple[float, float]:
        """Share of the decisions that were rewarded, and of what is near that is within reach."""
        scene = self._selector.scene()
        places = self._selector.places(scene)
        flat = places.flatten(2).transpose(1, 2).reshape(-1, 3)
        head = torch.from_numpy(scene.head).repeat_interleave(self._selector.sight.cells, 0)
        near = flat[(flat - head).norm(dim=1) < _NEAR_M]
        within = float(self.primitives.near(near, _REACHED_M).mean()) if len(near) else 0.0
        known = self._memory.read("reward", np.arange(self._memory.count))
        return float((known > 0.0).mean()), within

    # --- exact resume ------------------------------------------------------------------------

    _state = (
        *("step_count", "persons", "manner_chosen", "_rewards", "rng", "net", "learner"),
        *("_memory", "_trying", "_tried", "_exploration.colours", "primitives.lifts"),
        "simulation",
    )

    def state_dict(self) -> dict[str, Any]:
        """Copy everything that the next decision depends on; pictures stay in their file."""
        layer = self.primitives.layer
        return super().state_dict() | {
            "choice": {name: getattr(self._choice, name).clone() for name in self._kept},
            "layer": layer.state_dict() if isinstance(layer, PersonLayer) else {},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        super().load_state_dict(state)
        for name in self._kept:
            setattr(self._choice, name, state["choice"][name].clone())
        if isinstance(self.primitives.layer, PersonLayer):
            self.primitives.layer.load_state_dict(state["layer"])
