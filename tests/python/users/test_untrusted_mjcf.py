"""An MJCF of somebody else is checked before MuJoCo reads it: bounds, numbers, files."""

import struct
from pathlib import Path
from typing import Any

import mujoco
import pytest

from python.users.bodies import PENDULUM, PENDULUM_DESCRIPTION, write_body
from sim2vr_harness.users import load_body
from sim2vr_harness.users.bodies.described import check_finite

TRIANGLES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def with_parts(root: str = "", world: str = "") -> str:
    """The pendulum with more elements in its root and its world."""
    mjcf = PENDULUM.replace("<worldbody>", f"{root}<worldbody>{world}")
    assert mjcf != PENDULUM
    return mjcf


def refused(folder: Path, mjcf: str, message: str, **changes: Any) -> None:
    file = write_body(folder, mjcf, PENDULUM_DESCRIPTION | changes)
    with pytest.raises(ValueError, match=message) as error:
        load_body(file)
    assert str(error.value).startswith(f"{file}: mjcf: ")


IN_ROOT = r"""
<asset><hfield name="h" nrow="30000" ncol="2" size="1 1 1 1"/></asset> | 'h': nrow: .* at most 4096
<asset><texture name="t" builtin="flat" width="30000" height="9"/></asset> | 't': width: .*8192
<option iterations="2000000000"/> | option: iterations: got '2000000000', expected
<option><flag/></option><size memory="900G"/> | size: memory: got '900G', expected
<compiler><lengthrange timestep="1e-12"/></compiler> | got '1e-12', expected at least 0.0001
<option gravity="0 0 nan"/> | option: gravity: got 'nan', expected finite numbers
<default><geom solref="nan 1"/></default> | geom: solref: got 'nan'
""".strip().splitlines()
IN_WORLD = r"""
<replicate count="1000000"><geom size=".1"/></replicate> | count: got '1000000', .* at most 10000
<replicate count="200"><replicate count="200"><geom size=".1"/></replicate></replicate> | got more
<flexcomp name="f" type="grid" count="3000 3000 1" spacing=".1 .1 .1"/> | count: got '3000 3000 1'
<body name="b"><geom name="g" size=".1" mass="nan(0)"/></body> | geom 'g': mass
<body><inertial pos="0 0 0" mass="1" diaginertia="1 NaN 1"/></body> | diaginertia: got 'NaN'
""".strip().splitlines()


@pytest.mark.parametrize(
    ("place", "line"), [*((0, t) for t in IN_ROOT), *((1, t) for t in IN_WORLD)]
)
def test_what_has_no_bounds_or_is_not_finite_is_refused(
    place: int, line: str, tmp_path: Path
) -> None:
    xml, _, message = line.partition(" | ")
    parts = (xml, "") if place == 0 else ("", xml)
    refused(tmp_path, with_parts(*parts), f"body.xml: .*{message}")


def test_a_compiled_model_with_nan_is_refused() -> None:
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    check_finite(model)
    model.body_mass[1] = float("nan")
    with pytest.raises(ValueError, match=r"got NaN in body_mass\[1\] of the compiled model"):
        check_finite(model)


def test_an_image_without_bounds_is_refused(tmp_path: Path) -> None:
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 30000, 30000)
    (tmp_path / "large.png").write_bytes(head)
    root = '<asset><texture name="t" type="2d" file="large.png"/></asset>'
    refused(tmp_path, with_parts(root), "texture 't': file: got 'large.png' of 30000 x 30000 pixe")


def test_a_model_that_attaches_itself_is_refused(tmp_path: Path) -> None:
    root = '<asset><model name="again" file="body.xml"/></asset>'
    refused(tmp_path, with_parts(root), "model 'again': file: got 'body.xml', which attaches itse")


ELSEWHERE = {
    "mesh": ('<asset><mesh name="m" file="{}"/></asset>', "mesh 'm': file"),
    "texture": ('<asset><texture name="t" type="2d" file="{}"/></asset>', "texture 't': file"),
    "include": ('<include file="{}"/>', "include: file"),
    "folder": (
        '<compiler meshdir="../elsewhere"/><asset><mesh name="m" file="part.obj"/></asset>',
        "mesh 'm': file",
    ),
}


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """A mesh in a folder beside the body's."""
    (tmp_path / "body").mkdir()
    (tmp_path / "elsewhere").mkdir()
    file = tmp_path / "elsewhere" / "part.obj"
    file.write_text(TRIANGLES)
    return file


@pytest.mark.parametrize("kind", ELSEWHERE)
def test_files_outside_the_folder_are_refused(kind: str, elsewhere: Path) -> None:
    root, field = ELSEWHERE[kind]
    message = f"body.xml: {field}: got .*part.obj, outside the folder of the MJCF; .*'folders'"
    folder = elsewhere.parents[1] / "body"
    for name in (str(elsewhere), "../elsewhere/part.obj"):
        refused(folder, with_parts(root.format(name)), message)
    (folder / "part.obj").symlink_to(elsewhere)
    mesh = '<asset><mesh name="m" file="part.obj"/></asset>'
    refused(folder, with_parts(mesh), "mesh 'm': file: got 'part.obj', which is .*elsewhere")


def test_the_description_may_name_the_folder(elsewhere: Path) -> None:
    """As the error says."""
    root, _ = ELSEWHERE["folder"]
    world = '<geom type="mesh" mesh="m"/>'
    description = PENDULUM_DESCRIPTION | {"folders": ["../elsewhere"]}
    folder = elsewhere.parents[1] / "body"
    body = load_body(write_body(folder, with_parts(root, world), description))
    assert body.model.nmesh >= 1


def test_included_files_are_checked(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    part = tmp_path / "parts" / "options.xml"
    part.write_text('<mujoco><option gravity="0 0 -5"/></mujoco>')
    mjcf = with_parts('<include file="parts/options.xml"/>')
    body = load_body(write_body(tmp_path, mjcf, PENDULUM_DESCRIPTION))
    assert body.model.opt.gravity[2] == -5.0
    part.write_text('<mujoco><option gravity="0 0 nan"/></mujoco>')
    refused(tmp_path, mjcf, "options.xml: option: gravity: got 'nan'")
