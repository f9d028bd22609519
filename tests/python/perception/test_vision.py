"""The headset's picture: channels, eyes, and where it is sharp."""

import numpy as np
from perception_fakes import SUBSTEPS, World

from sim2vr_harness.perception import channel_indices, pick_channels
from sim2vr_harness.perception.vision import vision


def test_channels_are_picked_in_order() -> None:
    image = np.broadcast_to(np.array([10, 11, 12, 13], np.uint8), (3, 5, 4)).copy()
    image[2, 4, 3] = 200  # depth, last row and column
    seen = pick_channels(image, channel_indices(("green", "depth")))
    assert seen.shape == (2, 3, 5)
    assert (seen[0] == 11).all()
    assert (seen[1, 2, 4], (seen[1] == 13).sum()) == (200, 14)
    # Two eyes: the left one's channels come first.
    both = pick_channels(np.stack([image, image + 100]), channel_indices(("blue", "red")))
    assert both[:, 0, 0].tolist() == [12, 10, 112, 110]


def test_what_is_seen_is_a_copy_of_the_newest_picture() -> None:
    sense = vision("vision", 2, channels=("red",), eyes=2, height=2, width=2, frame_grid=SUBSTEPS)
    assert sense.space.shape == (2, 2, 2)
    assert sense.needs == "two_eyes"
    world = World(2, sense, pictures=(2, 2, 2))
    world.reset([0, 1], level=7)
    first = world.perception.observe()["vision"]
    seen = world.step([1], level=9)["vision"]
    assert first.max() == 7
    assert [seen[0].max(), seen[1].min()] == [7, 9]
    assert not np.shares_memory(seen, world.moment.pictures)
    assert not np.shares_memory(seen, world.perception.observe()["vision"])
