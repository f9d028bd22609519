"""The headset's picture: channels, eyes, and where it is sharp."""

import numpy as np
import pytest
from perception_fakes import SUBSTEPS, World

from sim2vr_harness.perception import Foveation, channel_indices, pick_channels
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


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        (("grene",), "channels: got 'grene', expected some of red, green"),
        ((), r"channels: got \(\), expected each at most once, at least 1"),
        (("red", "red"), "channels: got .* expected each at most once"),
    ],
)
def test_wrong_channels(channels: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        channel_indices(channels)


# --- foveation --------------------------------------------------------------------------------


def test_the_smallest_detail_grows_with_the_eccentricity() -> None:
    # 8 x 8 pixels of 90 degrees: f = 4 pixels, a pixel in the middle is atan(1/4) = 14.04 deg.
    # Pixel (3, 7) is 3.5 right, 0.5 up of the middle: e = atan(sqrt(12.5) / 4) = 41.47 deg, and
    # its own size is cos(e)^1.5 / 4 rad = 9.29 deg. With E2 = 30 deg the detail there is
    # 14.04 (1 + 41.47 / 30) = 33.4 deg = 3.60 pixels: blocks of 2. With E2 = 20 deg it is 4.64
    # pixels: blocks of 4.
    for e2_deg, level in ((30.0, 1), (20.0, 2)):
        levels = Foveation(8, 8, e2_deg=e2_deg).levels(np.array([[0.0, 0.0]]))[0]
        assert levels[3, 7] == level
        assert levels[3:5, 3:5].max() == 0  # e = 10 deg: 1.3 to 1.5 details in 1.03 pixels
        np.testing.assert_array_equal(levels, levels[::-1])
        np.testing.assert_array_equal(levels, levels.T)
    assert Foveation(8, 8, detail_deg=1e-3).levels(np.array([[0.0, 0.0]])).max() == 0


def test_a_pixel_shows_the_mean_of_its_block() -> None:
    fovea = Foveation(8, 8, e2_deg=30.0)
    level = fovea.levels(np.array([[0.0, 0.0]]))[0]
    picture = np.arange(64, dtype=np.uint8).reshape(1, 1, 8, 8)
    seen = fovea.look(picture)[0, 0]
    np.testing.assert_array_equal(seen[level == 0], picture[0, 0][level == 0])
    # Rows 2 and 3, columns 6 and 7: 22, 23, 30, 31, a mean of 26.5, rounded up.
    assert level[3, 7] == 1
    assert seen[3, 7] == 27
    corner = level[0, 0]
    block = picture[0, 0, : 2**corner, : 2**corner]
    assert seen[0, 0] == int(block.mean() + 0.5)


def test_blocks_at_an_odd_edge_have_fewer_pixels() -> None:
    fovea = Foveation(5, 7, detail_deg=180.0)  # blocks of 4, the largest, everywhere
    picture = np.zeros((1, 1, 5, 7), np.uint8)
    picture[..., 4, 6] = 90
    picture[..., 0, 0] = 160
    seen = fovea.look(picture)[0, 0]
    assert fovea.levels(np.array([[0.0, 0.0]])).min() == 2
    assert seen[:4, :4].tolist() == [[10] * 4] * 4  # 160 / 16
    assert seen[4, 4:].tolist() == [30] * 3  # 90 / 3
    assert (seen[4, :4].max(), seen[:4, 4:].max()) == (0, 0)


def test_an_even_picture_stays_as_it_is() -> None:
    picture = np.full((2, 3, 80, 120), 77, np.uint8)
    np.testing.assert_array_equal(Foveation(80, 120).look(picture), picture)


def test_a_persons_acuity_is_finer_than_a_small_picture() -> None:
    ahead = np.array([[0.0, 0.0]])
    # A pixel of 120 x 80 is 1.4 to 0.5 degrees; a person sees 1 / 60 (1 + 61 / 2.3) = 0.46 there.
    assert Foveation(80, 120, detail_deg=1 / 60).levels(ahead).max() == 0
    assert Foveation(800, 1200, detail_deg=1 / 60).levels(ahead).max() == 3  # 0.048 deg


def test_the_gaze_takes_the_sharp_place_along() -> None:
    fovea = Foveation(80, 120)
    gazes = np.array([[0.0, 0.0], [30.0, 20.0], [-30.0, -20.0]])
    levels = fovea.levels(gazes)
    sharp = [np.argwhere(level == 0).mean(axis=0) for level in levels]
    # 40 pixels per unit of tangent: 40 tan 30 = 23.1 right, 40 tan 20 / cos 30 = 16.8 up.
    np.testing.assert_allclose(sharp[0], [39.5, 59.5], atol=0.01)
    np.testing.assert_allclose(sharp[1], [39.5 - 16.8, 59.5 + 23.1], atol=0.6)
    np.testing.assert_allclose(sharp[2], [39.5 + 16.8, 59.5 - 23.1], atol=0.6)
    pictures = np.random.default_rng(1).integers(0, 256, (3, 2, 80, 120), dtype=np.uint8)
    together = fovea.look(pictures, gazes)
    np.testing.assert_array_equal(together[0], fovea.look(pictures[:1])[0])
    for k in range(3):  # alone or beside others: the same bits
        alone = fovea.look(pictures[k : k + 1], gazes[k : k + 1])
        np.testing.assert_array_equal(together[k], alone[0])
