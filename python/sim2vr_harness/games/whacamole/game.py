"""The resident: what the fast recipe asks of Whac-A-Mole."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.games.imagined import ImaginedCondition
from sim2vr_harness.games.whacamole.game_model import FIELDS, ImaginedWhacAMole
from sim2vr_harness.games.whacamole.rules import CELLS
from sim2vr_harness.games.whacamole.settings import GameModelSettings


class WhacAMole:
    """See :class:`~sim2vr_harness.games.imagined.ImaginedGame`."""

    name = "whacamole"
    settings = GameModelSettings
    devices = ("controller_right", "headset")
    fields = FIELDS
    cells = CELLS
    conditions = ("low-medium", "medium", "high-medium")
    hidden_fields = (
        *("aid.*", "round.elapsed_s", "cell*.?_m", "*.overlap", "nearest.*", "hammer.v?_mps"),
        *("* qacc", "fingertip *"),
    )
    felt_fields = ("hammer.*",)
    facts = "cell*.present"
    on_gpu = True
    attention_targets: tuple[str, ...] = ()
    start_fields: tuple[str, str] | None = ("aid.start_distance_m", "aid.start_cell")
    start_limits: Mapping[str, tuple[float, float]] = {"elbow_flexion": (0.5, 1.9)}

    def options(
        self, condition: str, weights: Sequence[float] | None = None
    ) -> dict[str, OptionValue]:
        """See the protocol."""
        options: dict[str, OptionValue] = {"condition": condition}
        return options if weights is None else options | {"spawn_weights": list(weights)}

    def outcomes(self, log: Mapping[str, float]) -> NDArray[np.float64]:
        """See the protocol."""
        return np.array(
            [
                [log.get(f"{kind}Target{cell}", 0.0) for cell in range(CELLS)]
                for kind in ("hits", "misses")
            ]
        )

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
    ) -> ImaginedWhacAMole:
        """See the protocol."""
        starts = [condition.start for condition in conditions]
        options = [condition.options for condition in conditions]
        return ImaginedWhacAMole(
            n,
            starts,
            settings,
            step_s=step_s,
            frames=frames,
            seed=seed,
            options=options,
            gamma=gamma,
        )


GAME = WhacAMole()
