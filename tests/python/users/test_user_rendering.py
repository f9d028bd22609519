from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from sim2vr_harness.users import Body, load_body
from sim2vr_harness.users.rendering import RenderingError, UserRenderer


@pytest.fixture(scope="module")
def user() -> Body:
    return load_body("mobl_arms_wrist")


@pytest.fixture(scope="module")
def renderer(user: Body) -> Iterator[UserRenderer]:
    with UserRenderer(user, 96, 72) as made:
        yield made


def test_pictures(user: Body, renderer: UserRenderer) -> None:
    hanging = renderer.render(np.zeros(21), "side")
    assert hanging.shape == (72, 96, 3)
    assert hanging.dtype == np.uint8
    assert hanging.flags.writeable
    reaching = user.coupled_qpos(np.array([1.2, 1.2, 0, 0.4, 0, 0, 0]))
    picture = renderer.render(reaching, "side")
    assert np.abs(picture.astype(int) - hanging).max() > 50
    np.testing.assert_array_equal(picture, renderer.render(reaching, "side"))
    assert np.abs(picture.astype(int) - renderer.render(reaching, "front")).max() > 50


def test_the_sky_is_on_top(renderer: UserRenderer) -> None:
    picture = renderer.render(np.zeros(21), "side").astype(int)
    sky, floor = picture[2].mean(axis=0), picture[-3].mean(axis=0)
    assert sky[2] - sky[0] > 10 > floor[2] - floor[0]  # the sky is bluish, the floor grey


def test_active_muscles_are_redder(user: Body, renderer: UserRenderer) -> None:
    data = mujoco.MjData(user.model)
    relaxed = renderer.render(data, "arm").astype(int)
    data.act[:] = 1.0
    active = renderer.render(data, "arm").astype(int)
    redness = [(p[..., 0] - p[..., 2]).sum() for p in (relaxed, active)]
    assert redness[1] > redness[0]


def test_errors(user: Body, renderer: UserRenderer) -> None:
    with pytest.raises(ValueError, match=r"camera: got 'sid', .*did you mean 'side'"):
        renderer.render(np.zeros(21), "sid")
    with pytest.raises(ValueError, match=r"qpos: got shape \(7,\), expected \(21,\)"):
        renderer.render(np.zeros(7))
    with pytest.raises(ValueError, match="width: got 5000, expected 1 to 1280 pixels"):
        UserRenderer(user, width=5000)
    with pytest.raises(ValueError, match="body: got appearance=False"):
        UserRenderer(load_body("mobl_arms_wrist", appearance=False))
    closed = UserRenderer(user, 16, 16)
    closed.close()
    closed.close()
    with pytest.raises(RenderingError, match="after close"):
        closed.render(np.zeros(21))
