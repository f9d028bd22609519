"""Game models place things as the app does: right is x, up is y, away from the player is z."""

import numpy as np
import torch

from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.games.app_axes import head_of, to_app


def test_vectors_are_the_app_s() -> None:
    forward_left_up = [1.0, 2.0, 3.0]
    assert to_app(torch.tensor(forward_left_up)).tolist() == [-2.0, 3.0, 1.0]
    np.testing.assert_allclose(position_to_app(np.array([forward_left_up])), [[-2.0, 3.0, 1.0]])


def test_the_head_is_the_last_device() -> None:
    places = torch.eye(4).repeat(1, 2, 1, 1)
    places[0, 1, :3, 3] = torch.tensor([0.1, 0.2, 1.5])
    torch.testing.assert_close(head_of(places), torch.tensor([[-0.2, 1.5, 0.1]]))
