"""What an evaluation tells of Beats, in each of its conditions."""

import numpy as np
import pytest

from sim2vr_harness.client import DevicePoses, InProcessApp, describe_game
from sim2vr_harness.play.round import round_result, summarise

FACTS = describe_game("beats")
TOLD = ("correct_slices", "boxes", "errors", "score", "hand_travel_m", "effort")


@pytest.mark.parametrize(("condition", "boxes"), [("first", 4), ("level", None), ("full", 96)])
def test_every_condition_tells_of_slices_score_travel_and_effort(
    condition: str, boxes: int | None
) -> None:
    """Both hands go 0.1 m to the right in a tenth of a second; nothing has come yet."""
    row = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
    options = dict(FACTS.condition(condition).options)
    with InProcessApp("beats", options, renderer="null") as app:
        for frame in range(3):
            hand = np.add(row, (0.05 * frame, -0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
            poses = DevicePoses(row, hand, hand)
            reply = app.step(50_000_000 * frame, poses) if frame else app.reset(1, poses)
    result = round_result(
        FACTS,
        condition=condition,
        episode=0,
        seed=1,
        steps=2,
        game_return=0.0,
        effort=0.25,
        info={"termination": "finished"},
        log=reply.log,
    )
    told = {key: summarise([result], FACTS)[key] for key in TOLD}
    assert told["hand_travel_m"] == pytest.approx(0.2)
    assert (told["correct_slices"], told["errors"], told["score"]) == (0.0, 0.0, 0.0)
    assert told["effort"] == 0.25
    assert told["boxes"] == boxes if boxes is not None else told["boxes"] > 20
