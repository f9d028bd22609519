"""What a page shows, as boxes: validation, and the scene that pictures from outside draw."""

import numpy as np
import pytest

from sim2vr_harness.client.webxr.app import scene_of
from sim2vr_harness.client.webxr.replies import BadReply, Box, boxes_reply

HEAD = np.array([0.0, 1.2, 0.0])
STRAIGHT = (0.0, 0.0, 0.0, 1.0)
RED = (1.0, 0.0, 0.0, 1.0)


def names(*boxes: Box) -> list[str]:
    return [one.path for one in scene_of(boxes, HEAD).objects]


def test_boxes_keep_pose_size_and_colour() -> None:
    rotation = (0.0, 1.0, 0.0, 1.0)  # 90 degrees about y, not normalised
    (one,) = scene_of([Box("shelf", (0.1, 1.0, 0.7), rotation, (0.5, 0.2, 0.1), RED)], HEAD).objects
    half = 0.5**0.5
    assert one.pose == pytest.approx([0.1, 1.0, 0.7, 0.0, half, 0.0, half])
    assert one.scale == pytest.approx([0.5, 0.2, 0.1])
    assert one.color.tolist() == [1.0, 0.0, 0.0, 1.0]
    position, _, scale = one.in_mujoco()
    assert position == pytest.approx([0.7, -0.1, 1.0])  # x forward, y left, z up
    assert sorted(scale) == pytest.approx([0.1, 0.2, 0.5])


def test_rooms_skies_and_floors_are_left_out() -> None:
    sky = Box("sky", (0.0, 0.0, 900.0), STRAIGHT, (1000.0, 1000.0, 1.0), RED)
    room = Box("room", (0.0, 1.5, 1.0), STRAIGHT, (4.0, 3.0, 4.0), RED)
    floor = Box("floor", (0.0, 0.0, 0.0), STRAIGHT, (6.0, 0.0, 6.0), RED)
    table = Box("table", (0.0, 0.7, 0.6), STRAIGHT, (1.0, 0.04, 0.6), RED)
    assert names(sky, room, floor, table) == ["table"]


def test_the_head_is_looked_for_in_the_axes_of_the_box() -> None:
    """A wall 2 m wide and 10 cm thick, turned by 45 degrees, 0.4 m before the head."""
    eighth = (0.0, np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8))
    wall = Box("wall", (0.0, 1.2, 0.4), eighth, (2.0, 2.0, 0.1), RED)
    assert names(wall) == ["wall"]
    assert names(Box("wall", (0.0, 1.2, 0.4), eighth, (2.0, 2.0, 0.8), RED)) == []


def test_sides_of_the_box_face_outwards() -> None:
    (mesh,) = scene_of([], HEAD).meshes
    vertices, triangles = mesh.in_mujoco()
    assert len(triangles) == 12
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1)) > 0.0).all()
    # Two triangles of half a square metre on each of six sides.
    assert np.abs(normals).sum(axis=0) == pytest.approx([4.0, 4.0, 4.0])


GOOD = ["box", [0.0, 1.0, 0.5], [0.0, 0.0, 0.0, 1.0], [0.1, 0.1, 0.1], [1.0, 0.5, 0.0, 1.0]]


def test_a_good_reply() -> None:
    assert boxes_reply([GOOD]) == (
        Box("box", (0.0, 1.0, 0.5), STRAIGHT, (0.1,) * 3, (1.0, 0.5, 0.0, 1.0)),
    )


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (3, "boxes: got 3"),
        ([GOOD] * 501, "boxes"),
        ([GOOD[:4]], "boxes: got .*expected name, place, rotation, size, colour"),
        ([[*GOOD[:2], [0.0, 0.0, 1.0], *GOOD[3:]]], "boxes, rotation: got .*four finite numbers"),
        ([[GOOD[0], [0.0, None, 0.5], *GOOD[2:]]], "boxes, place"),
    ],
)
def test_bad_replies_are_named(answer: object, message: str) -> None:
    with pytest.raises(BadReply, match=message):
        boxes_reply(answer)
