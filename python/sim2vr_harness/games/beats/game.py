"""The resident: what the fast recipe asks of Beats."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import describe_game
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.games.beats.game_model import FIELDS, ImaginedBeats
from sim2vr_harness.games.beats.levels import Levels, game_level, made_of
from sim2vr_harness.games.beats.rules import TOLD_MINES
from sim2vr_harness.games.beats.settings import LEVELS, GameModelSettings
from sim2vr_harness.games.imagined import ImaginedCondition


class Beats:
    """Facts of Beats for imagined rollouts: fields, devices, conditions and outcomes."""

    name = "beats"
    settings = GameModelSettings
    devices = ("controller_left", "controller_right", "headset")
    fields = FIELDS
    cells = 1
    conditions = ("first",)
    hidden_fields = ("aid.*", "* qacc", "controller_* ?")
    felt_fields = ("left.*", "right.*", "head.*")
    facts = "*.present"
    on_gpu = False
    attention_targets = ("left0", "right0", "mine0", "left1", "right1", "mine1", "mine2")
    start_fields: tuple[str, str] | None = None
    start_limits: Mapping[str, tuple[float, float]] = {}

    def options(
        self, condition: str, weights: Sequence[float] | None = None
    ) -> dict[str, OptionValue]:
        """Return the condition's options; weighted rounds do not end on a miss.

        The level alone determines which objects appear.
        """
        options = dict(describe_game(self.name).condition(condition).options)
        return options if weights is None else options | {"end_on_miss": False}

    def outcomes(self, log: Mapping[str, float]) -> NDArray[np.float64]:
        """Return (2, 1) the numbers of correct slices, and of missed or wrongly cut boxes."""
        failed = sum(log.get(key, 0.0) for key in ("Misses", "WrongHand", "WrongDirection"))
        return np.array([[log.get("AccumulatedCorrectSlices", 0.0)], [failed]])

    def rounds(
        self,
        n: int,
        conditions: Sequence[ImaginedCondition],
        settings: GameModelSettings,
        *,
        step_s: float,
        frames: int,
        seed: int,
        gamma: float,
    ) -> ImaginedBeats:
        levels: dict[str, Levels] = {}
        for number, condition in enumerate(conditions):
            for k in range(LEVELS):
                level = game_level(condition.options, seed + k)
                levels.setdefault(level["hash"], made_of(level, number))
        known = Levels.joined(list(levels.values()), least=TOLD_MINES)
        return ImaginedBeats(n, known, len(conditions), settings, step_s=step_s, seed=seed)


GAME = Beats()
