"""What an app keeps in every transport, of pages: the same input, the same bits; true geometry."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import (
    INPUT_COUNT,
    AppRefused,
    AppUnsupported,
    DevicePoses,
    HapticPulse,
    WebXRApp,
    frame_time_ns,
    input_named,
)
from webxr_pages import (
    CDN,
    ENGINES,
    HEAD,
    NEEDS_BROWSER,
    NEEDS_ENGINES,
    PAGES,
    ROOT,
    hands,
    open_page,
)

pytestmark = NEEDS_BROWSER
STEPS = 12
CAPABILITIES = {
    *("frames", "inputs", "left_controller", "haptics", "two_eyes", "scene", "observers")
}
VALUES = {
    "score": "app.score",
    "ticks": "app.ticks",
    "clock_ms": "app.clock",
    "target": "app.target",
    "trigger": "app.trigger ?? 0",
}


@pytest.fixture(scope="module")
def touch() -> Iterator[WebXRApp]:
    with open_page(PAGES / "touch.html", values=VALUES, page_reset="app.restart()") as app:
        yield app


def played(app: WebXRApp, seed: int = 7, steps: int = STEPS) -> list[Any]:
    rows = []
    for step in range(steps):
        poses = hands(step)
        reply = app.step(frame_time_ns(step, 20), poses) if step else app.reset(seed, poses)
        rows.append((reply, hashlib.sha256(app.image.tobytes()).hexdigest()))
    return rows


@pytest.mark.parametrize("page", ["touch.html", "late.html"])
def test_the_same_input_gives_the_same_bits_across_reloads_and_processes(page: str) -> None:
    values = VALUES if page == "touch.html" else {"loaded": "app.loaded", "missing": "app.missing"}
    with (
        open_page(PAGES / page, values=values) as one,
        open_page(PAGES / page, values=values) as two,
    ):
        first = played(one)
        assert played(two) == first
        assert played(one) == first
        if page == "touch.html":
            assert played(one, seed=8) != first
        else:
            assert first[-1][0].values == {"loaded": 4, "missing": 404}


def test_late_loads_come_in_the_frame_that_asks_for_them() -> None:
    with open_page(PAGES / "late.html", values={"loaded": "app.loaded"}) as app:
        found = [reply.values["loaded"] for reply, _ in played(app, steps=6)]
    # Asked for 30 ms after the third frame: all are there in the frame after that.
    assert found == [0, 0, 0, 4, 4, 4]


@NEEDS_ENGINES
@pytest.mark.parametrize("page", ["buttons", "drawer", "balls"])
def test_engines_give_the_same_bits(page: str) -> None:
    with open_page(page) as one, open_page(page) as two:
        first = played(one)
        assert played(two) == first
        assert played(one) == first
        image = one.image
    assert all(int(np.ptp(image[..., channel])) > 0 for channel in range(4))


@NEEDS_ENGINES
@pytest.mark.parametrize(
    ("page", "name", "place", "point", "depth_m"),
    [
        # The panel's front, left of the buttons; the cabinet's, above the drawer; the wall's.
        ("buttons", "low", (0.12, 0.85, 0.42), (-0.05, 1.2), 0.46),
        ("drawer", "handle", (0.12, 1.0, 0.5), (0.3, 1.25), 0.55),
        ("balls", "wall", (0.0, 1.2, 2.0), (-0.9, 0.6), 1.95),
    ],
)
def test_engines_put_things_where_they_say(
    page: str, name: str, place: Any, point: tuple[float, float], depth_m: float
) -> None:
    with open_page(page) as app:
        app.reset(7, DevicePoses(HEAD))
        assert app.locate(name) == pytest.approx(place, abs=1e-6)
        with pytest.raises(AppRefused, match=rf'no object "{name}s"; objects with names: .*{name}'):
            app.locate(f"{name}s")
        column, row = 60 + 40 * point[0] / depth_m, 40 - 40 * (point[1] - 1.2) / depth_m
        assert abs(int(app.image[int(row), int(column), 3]) - depth_m * 25.5) <= 1.0


def test_depth_and_place_are_those_of_the_scene(touch: WebXRApp) -> None:
    reply = touch.reset(7, DevicePoses(HEAD))
    image = touch.image
    # The wall's front is 2.9 m away, in units of 10 m / 255, all over the picture's corner.
    assert abs(int(image[5, 60, 3]) - 2.9 / 10.0 * 255.0) <= 1.0
    x, y, z = reply.values["target"]
    assert z > 0.0  # the app's frame: forward
    # 90 degrees from top to bottom: the focal length is half the height, 40 pixels.
    front = z - 0.08
    column, row = 60 + 40 * x / front, 40 - 40 * (y - 1.2) / front
    red, green, _, depth = (int(value) for value in image[int(row), int(column)])
    assert red > 3 * green
    assert abs(depth - front / 10.0 * 255.0) <= 1.0


def test_what_a_page_shows_is_told_as_boxes() -> None:
    """The block of keypad.html: 8 cm, 40 cm ahead."""
    with open_page(PAGES / "keypad.html") as app:
        app.reset(7, DevicePoses(HEAD))
        before = app.image.copy()
        (box,) = app.scene().named("block")
        assert box.pose == pytest.approx([0.25, 0.95, 0.4, 0.0, 0.0, 0.0, 1.0], abs=1e-6)
        assert box.scale == pytest.approx([0.08, 0.08, 0.08])
        assert box.color == pytest.approx([0.9, 0.5, 0.1, 1.0], abs=1 / 255)
        np.testing.assert_array_equal(app.image, before)


@NEEDS_ENGINES
@pytest.mark.parametrize(
    ("page", "name", "place", "size"),
    [
        ("buttons", "low", (0.12, 0.85, 0.42), (0.12, 0.12, 0.12)),
        ("balls", "wall", (0.0, 1.2, 2.0), (3.0, 2.0, 0.1)),
    ],
)
def test_engines_show_boxes(page: str, name: str, place: Any, size: Any) -> None:
    with open_page(page) as app:
        app.reset(7, DevicePoses(HEAD))
        (box, *_) = app.scene().named(name)
        assert box.pose[:3] == pytest.approx(place, abs=1e-6)
        assert box.scale == pytest.approx(size, abs=1e-3)


@NEEDS_ENGINES
def test_a_bundled_engine_is_known(tmp_path: Path) -> None:
    """Babylon.js as a bundle has it: no global, as its module is the script's own."""
    page = (ROOT / "docs" / "examples" / "webxr" / "balls" / "index.html").read_text()
    engine = '<script src="https://cdn.jsdelivr.net/npm/babylonjs@9.34.0/babylon.js"></script>'
    assert engine in page
    before = "<script>var exports = {}, module = { exports };</script>"
    after = "<script>delete window.BABYLON; const BABYLON = exports;</script>"
    bundled = page.replace(engine, before + engine + after)
    (tmp_path / "index.html").write_text(bundled)
    values = {"global": "+('BABYLON' in window)"}
    with open_page(tmp_path, map={CDN: str(ENGINES)}, values=values) as app:
        assert app.reset(7, DevicePoses(HEAD)).values == {"global": 0.0}
        assert app.locate("wall") == pytest.approx((0.0, 1.2, 2.0), abs=1e-6)
        (wall, *_) = app.scene().named("wall")
        assert wall.scale == pytest.approx((3.0, 2.0, 0.1), abs=1e-3)
        assert {"ball", "wall"} <= {thing.name for thing in app.things()}
        assert app.report().engines == ("Babylon.js 9.34.0",)


def test_time_is_the_harness_s(touch: WebXRApp) -> None:
    first = touch.reset(7, hands(0)).values
    later = [touch.step(frame_time_ns(step, 20), hands(0)).values for step in range(1, 21)]
    assert [v["clock_ms"] - first["clock_ms"] for v in later] == pytest.approx(
        [frame_time_ns(step, 20) / 1e6 for step in range(1, 21)], abs=1e-6
    )
    # An interval of 100 ms within a second, wherever it stood at the start.
    assert later[-1]["ticks"] - first["ticks"] in (9, 10)


def test_inputs_there_and_vibrations_back(touch: WebXRApp) -> None:
    start = touch.reset(7, hands(0)).values["target"]
    inputs = np.zeros(INPUT_COUNT)
    inputs[input_named("right.trigger").column] = 0.75
    at_target = np.array([*start, 0.0, 0.0, 0.0, 1.0])
    reply = touch.step(frame_time_ns(1, 20), DevicePoses(HEAD, at_target, None, inputs))
    assert reply.haptics == (HapticPulse("right", 0.7, 0.0, 0.04),)
    assert reply.values["score"] == 1
    assert reply.values["trigger"] == 0.75
    touch.step(frame_time_ns(2, 20), hands(2))
    events = touch._page._evaluate("app.events.join()")
    assert events == "right selectstart,right select,right selectend"


def test_several_frames_of_a_step_are_as_many_steps_of_one(touch: WebXRApp) -> None:
    def stacked(frames: list[int]) -> DevicePoses:
        return DevicePoses.stack([hands(frame) for frame in frames])

    touch._playing = False  # loads the page, here and below
    touch.reset(7, hands(0))
    singles, pictures = [], []
    for frame in (1, 2, 3):
        singles.append(touch.step(frame_time_ns(frame, 60), hands(frame)))
        pictures.append(touch.image.copy())
    times = np.array([frame_time_ns(frame, 60) for frame in (1, 2, 3)])
    for drawn in (0, 1, 2, -1):
        touch._playing = False
        touch.reset(7, hands(0))
        reply = touch.step_frames(times, stacked([1, 2, 3]), drawn)
        assert reply.values == singles[-1].values
        np.testing.assert_array_equal(touch.image, pictures[drawn])


def test_the_page_s_own_reset(touch: WebXRApp) -> None:
    first = touch.reset(7, hands(0)).values
    touch.step(frame_time_ns(40, 20), hands(3))
    again = touch.reset(7, hands(0)).values
    assert again["ticks"] == 0
    assert again["clock_ms"] > first["clock_ms"]  # the page was not loaded anew
    other = touch.reset(9, hands(0)).values
    assert other["target"] != again["target"]
    assert touch.reset(7, hands(0)).values["target"] == again["target"]


def test_two_eyes_see_from_two_places() -> None:
    ipd_m = 0.1
    with open_page(PAGES / "touch.html", eyes=2, ipd_m=ipd_m, values=VALUES) as app:
        place = app.reset(7, DevicePoses(HEAD)).values["target"]
        assert app.image.shape == (2, 80, 120, 4)
        front = place[2] - 0.08
        middles = []
        for image in app.image.astype(int):
            ahead = np.abs(image[..., 3] - front * 25.5) <= 0.5  # of the target its front alone
            middles.append(np.argwhere(ahead & (image[..., 0] > 2 * image[..., 1]))[:, 1].mean())
    assert middles[0] - middles[1] == pytest.approx(40.0 * ipd_m / front, abs=1.0)


def test_controllers_that_come_and_go(touch: WebXRApp) -> None:
    touch.reset(7, hands(0))
    names = "[...__sim2vr.session.inputSources].map((one) => one.handedness).join()"
    assert touch._page._evaluate(names) == "left,right"
    touch.step(frame_time_ns(1, 20), DevicePoses(HEAD, hands(1).right_controller))
    assert touch._page._evaluate(names) == "right"


def test_bad_input_names_the_field_and_leaves_the_round_as_it_was(touch: WebXRApp) -> None:
    touch.reset(7, hands(0))
    good = hands(1)
    nan = DevicePoses(good.head, np.full(7, np.nan))
    long = DevicePoses(good.head * [1, 1, 1, 2, 2, 2, 2], good.right_controller)
    with pytest.raises(ValueError, match=r"right_controller: got .*expected finite"):
        touch.step(frame_time_ns(1, 20), nan)
    with pytest.raises(ValueError, match=r"head\.rotation: got .*expected a quaternion"):
        touch.step(frame_time_ns(1, 20), long)
    touch.step(frame_time_ns(5, 20), good)
    with pytest.raises(AppRefused, match=r"time_ns: got .*expected no step backwards"):
        touch.step(frame_time_ns(4, 20), good)
    touch.step(frame_time_ns(6, 20), good)


def test_what_a_page_cannot_do_is_said_by_capability(touch: WebXRApp) -> None:
    assert touch.capabilities == CAPABILITIES
    touch.reset(7, hands(0))
    for name, call in {
        "save": touch.save,
        "views": lambda: touch.render_third_person(64, 48),
    }.items():
        with pytest.raises(AppUnsupported, match=rf"^{name}: "):
            call()
    np.testing.assert_array_equal(touch.render_headset(120, 80), touch.image)
    assert "SwiftShader" in touch.renderer_description
