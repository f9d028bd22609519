"""The resident: what the fast recipe asks of pointing."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import describe_game
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.games.imagined import ImaginedCondition
from sim2vr_harness.games.pointing.game_model import FIELDS, ImaginedPointing
from sim2vr_harness.games.pointing.settings import GameModelSettings


class Pointing:
    """See :class:`~sim2vr_harness.games.imagined.ImaginedGame`."""

    name = "pointing"
    settings = GameModelSettings
    devices = ("controller_right", "headset")
    fields = FIELDS
    cells = 1
    conditions = ("mid",)
    hidden_fields = (
        *("aid.*", "shown.*", "round.progress", "tip.v?_mps"),
        *("target.start", "target.age_s", "next.present", "* qacc", "fingertip *"),
    )
    felt_fields = ("tip.*",)
    facts = "shown.*"
    on_gpu = False
    attention_targets: tuple[str, ...] = ()
    start_fields: tuple[str, str] | None = ("aid.start_distance_m", "aid.start_cell")
    start_limits: Mapping[str, tuple[float, float]] = {"elbow_flexion": (0.5, 1.9)}

    def options(
        self, condition: str, weights: Sequence[float] | None = None
    ) -> dict[str, OptionValue]:
        """See the protocol: blocks come in the round's own order, whatever fails."""
        return dict(describe_game(self.name).condition(condition).options)

    def outcomes(self, log: Mapping[str, float]) -> NDArray[np.float64]:
        """See the protocol: hits, and targets that were missed or went away."""
        return np.array([[log.get("Points", 0.0)], [log.get("Failures", 0.0)]])

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
    ) -> ImaginedPointing:
        """See the protocol."""
        return ImaginedPointing(
            n, conditions, settings, frame_s=step_s / frames, frames=frames, seed=seed
        )


GAME = Pointing()
