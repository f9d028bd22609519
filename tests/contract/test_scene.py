"""Every game tells what its scene holds; the same in process and over protocol 2."""

import numpy as np
import players
import pytest
import transports

from sim2vr_harness.client import AppClient, AppScene, frame_time_ns, list_games

ALONE = next(iter(transports.TRANSPORTS.values()))
HAND = "XR Rig/RightHand Controller"
STEPS = 30


def played(app: AppClient) -> AppScene:
    app.reset(3, players.wander(0))
    for frame in range(1, STEPS):
        app.step(frame_time_ns(frame, 20), players.wander(frame))
    return app.scene()


@pytest.mark.parametrize("game", list_games())
def test_a_game_s_scene_has_the_hand_and_something_to_play_with(game: str) -> None:
    with ALONE(game) as app:
        with pytest.raises(RuntimeError, match="call reset first"):
            app.scene()
        scene = played(app)
    (hand,) = [one for one in scene.objects if one.path == HAND]
    np.testing.assert_allclose(hand.pose, players.wander(STEPS - 1).right_controller, atol=1e-6)
    drawn = list(scene.drawn())
    assert [one for one in drawn if not one.path.startswith("XR Rig/")]
    assert {one.path for one in scene.drawn(player=True)} > {one.path for one in drawn}
    assert scene.named("RightHand*") == [hand]
    for mesh in scene.meshes:
        assert np.isfinite(mesh.vertices).all()
        assert mesh.triangles.max() < len(mesh.vertices)


def test_scenes_are_the_same_over_protocol_2() -> None:
    with ALONE("beats") as near, transports.TRANSPORTS["protocol2"]("beats") as far:
        expected, found = played(near), played(far)
        again = far.scene()
    assert len(expected.objects) == len(found.objects) > 10
    for one, other in zip(expected.objects, found.objects, strict=True):
        assert (one.id, one.path, one.layer, one.mesh, one.unlit) == (
            other.id, other.path, other.layer, other.mesh, other.unlit,
        )  # fmt: skip
        for name in ("pose", "scale", "color"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for mesh, other_mesh in zip(expected.meshes, found.meshes, strict=True):
        assert mesh.name == other_mesh.name
        np.testing.assert_array_equal(mesh.vertices, other_mesh.vertices)
        np.testing.assert_array_equal(mesh.triangles, other_mesh.triangles)
    assert all(a is b for a, b in zip(found.meshes, again.meshes, strict=True)), "sent once"
