"""What a page answers is checked, whatever its scripts have replaced."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import AppDied, ProtocolError, WebXRApp, frame_time_ns
from sim2vr_harness.client.answers import BadReply, checked
from sim2vr_harness.client.webxr.app import scene_of
from sim2vr_harness.client.webxr.replies import (
    BOXES,
    DOOR,
    PLACE,
    REPORT,
    SIGNS,
    THINGS,
    Box,
    step_reply,
)
from webxr_pages import NEEDS_BROWSER, hands

GOOD: dict[str, Any] = {
    "haptics": [["left", 0.5, 0.1]],
    "ended": False,
    "failure": None,
    "values": [["x", 1.5], ["y", 0, "is undefined"]],
    "places": [[0.0, 1.0, 0.5], None],
    "picture": "AAAA",
}


def test_an_answer_is_read() -> None:
    reply = step_reply(GOOD, ("x", "y"), 2, 3)
    assert [tuple(one) for one in reply.values] == [("x", 1.5, None), ("y", 0, "is undefined")]
    assert reply.places == ((0.0, 1.0, 0.5), None)
    assert (reply.picture, reply.haptics) == (bytes(3), (("left", 0.5, 0.1),))
    for value, found in ((2, 2), (True, True), (None, None), ([1, 2, 3], (1.0, 2.0, 3.0))):
        (one,) = step_reply(GOOD | {"values": [["x", value]]}, ["x"], 2, 3).values
        assert (one.value, type(one.value)) == (found, type(found))


DEEP: list[Any] = []
for _ in range(500):
    DEEP = [DEEP]
ODD = {
    "a text": '{"haptics": []}',
    "a key too few": {"ended": False},
    "a key too many": GOOD | {"more": 1},
    "no truth": GOOD | {"ended": "no"},
    "a hand that is none": GOOD | {"haptics": [["foot", 0.5, 0.1]]},
    "an amplitude of NaN": GOOD | {"haptics": [["left", float("nan"), 0.1]]},
    "an amplitude of 2": GOOD | {"haptics": [["left", 2, 0.1]]},
    "an amplitude of true": GOOD | {"haptics": [["left", True, 0.1]]},
    "a flood of pulses": GOOD | {"haptics": [["left", 0.5, 0.1]] * 10_001},
    "a failure without words": GOOD | {"failure": ["lost", None]},
    "values of another name": GOOD | {"values": [["x", 1], ["z", 1]]},
    "a value of NaN": GOOD | {"values": [["x", float("nan")], ["y", 1]]},
    "a place of two": GOOD | {"values": [["x", [0, 0]], ["y", 1]]},
    "a value beyond all numbers": GOOD | {"values": [["x", 10**400], ["y", 1]]},
    "a value without end": GOOD | {"values": [["x", DEEP], ["y", 1]]},
    "places of fewer objects": GOOD | {"places": [None]},
    "a place too short": GOOD | {"places": [[0.0, 1.0], None]},
    "a picture too small": GOOD | {"picture": "AAA="},
}


@pytest.mark.parametrize("what", ODD)
def test_an_answer_that_is_another_thing_is_refused(what: str) -> None:
    with pytest.raises(BadReply, match=r"got .*, expected ") as caught:
        step_reply(ODD[what], ("x", "y"), 2, 3)
    assert len(str(caught.value)) < 300


BOX = ["box", [0.0, 1.0, 0.5], [0.0, 0.0, 0.0, 1.0], [0.1, 0.1, 0.1], [1.0, 0.5, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("kind", "answer", "message"),
    [
        (DOOR, {"done": True, "failure": ["lost", 7]}, "it, failure, 1: got 7, expected a text"),
        (REPORT, {"engines": [7]}, "it, engines, 0: got 7, expected a text"),
        (PLACE, [1, 2], "it, 2: got nothing, expected a value"),
        (SIGNS, [{"a": 1}, 0, 0, []], "it, 0, a"),
        (THINGS, [["a"]], "it, 0, 1: got nothing"),
        (THINGS, [["a", "touch", [0, 0], [0, 0, 0], 0, 0]], "it, 0, 2, 2: got nothing"),
        (BOXES, [BOX] * 501, "it: got .* expected at most 500 entries"),
        (BOXES, [BOX[:4]], "it, 0, 4: got nothing"),
    ],
)
def test_other_answers_are_checked_too(kind: Any, answer: object, message: str) -> None:
    with pytest.raises(BadReply, match=f"^{message}"):
        checked("it", kind, answer)


# --- what a page shows --------------------------------------------------------------------------

HEAD = np.array([0.0, 1.2, 0.0])
STRAIGHT = (0.0, 0.0, 0.0, 1.0)
RED = (1.0, 0.0, 0.0, 1.0)


def test_boxes_keep_pose_size_and_colour() -> None:
    rotation = (0.0, 1.0, 0.0, 1.0)  # 90 degrees about y, not normalised
    (one,) = scene_of([Box("shelf", (0.1, 1.0, 0.7), rotation, (0.5, 0.2, 0.1), RED)], HEAD).objects
    half = 0.5**0.5
    assert one.pose == pytest.approx([0.1, 1.0, 0.7, 0.0, half, 0.0, half])
    assert one.color.tolist() == [1.0, 0.0, 0.0, 1.0]
    position, _, scale = one.in_mujoco()
    assert position == pytest.approx([0.7, -0.1, 1.0])  # x forward, y left, z up
    assert sorted(scale) == pytest.approx([0.1, 0.2, 0.5])


EIGHTH = (0.0, np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8))


@pytest.mark.parametrize(
    ("place", "rotation", "size", "shown"),
    [
        ((0.0, 0.7, 0.6), STRAIGHT, (1.0, 0.04, 0.6), True),  # a table
        ((0.0, 0.0, 900.0), STRAIGHT, (1000.0, 1000.0, 1.0), False),  # a sky
        ((0.0, 1.5, 1.0), STRAIGHT, (4.0, 3.0, 4.0), False),  # a room around the head
        ((0.0, 0.0, 0.0), STRAIGHT, (6.0, 0.0, 6.0), False),  # a floor
        # A wall 0.4 m before the head, turned by 45 degrees, 10 cm thick; 80 cm hold the head.
        ((0.0, 1.2, 0.4), EIGHTH, (2.0, 2.0, 0.1), True),
        ((0.0, 1.2, 0.4), EIGHTH, (2.0, 2.0, 0.8), False),
        # Half a metre from its middle along its turned x, (0.71, 0, -0.71): in the wall.
        ((-0.3536, 1.2, 0.3536), EIGHTH, (2.0, 2.0, 0.1), False),
        ((0.3536, 1.2, 0.3536), EIGHTH, (2.0, 2.0, 0.1), True),
    ],
)
def test_rooms_skies_and_floors_are_left_out(
    place: Any, rotation: Any, size: Any, shown: bool
) -> None:
    assert bool(scene_of([Box("it", place, rotation, size, RED)], HEAD).objects) == shown


# --- in a browser -------------------------------------------------------------------------------

PLAYS = """import { Boxes, button } from './boxes.js';
const app = window.app = { count: 0, place: { x: 1, y: 2, z: 3 } };
const boxes = new Boxes();
const odd = () => { %s };
button('Enter VR', () => boxes.enter((time, frame) => {
  if (++app.count === 2) odd();
  const source = boxes.session.inputSources.find?.((one) => one.handedness === 'right');
  (source ?? boxes.session.inputSources[1]).gamepad.hapticActuators[0].pulse(0.5, 100);
}));
"""
VALUES = {"count": "app.count", "place": "app.place"}

BUILT_INS = {
    "lists": """
        Array.prototype.push = () => 0;
        Array.prototype.map = () => ['odd'];
        Array.prototype.filter = () => ['odd'];
        Array.prototype.forEach = () => {};
        Array.prototype.shift = () => {};
        Array.prototype.includes = Array.prototype.every = () => false;
        Array.isArray = () => true;
        """,
    "numbers and texts": """
        window.Number = () => NaN;
        window.String = () => { throw 1; };
        Number.isFinite = () => false;
        Math.max = Math.min = Math.hypot = () => NaN;
        window.btoa = () => '!'; delete Uint8Array.prototype.toBase64;
        """,
    "objects": """
        JSON.stringify = () => '{';
        Array.prototype.toJSON = () => 'odd';
        Object.prototype.toJSON = function () { return this.toJSON(); };
        Object.keys = Object.entries = () => { throw 1; };
        Object.assign = Object.freeze = () => { throw 1; };
        MessagePort.prototype.postMessage = () => {};
        """,
    "functions and maps": """
        Map.prototype.set = Map.prototype.forEach = () => { throw 1; };
        WeakMap.prototype.get = WeakMap.prototype.has = () => { throw 1; };
        Function.prototype.apply = Reflect.apply = () => { throw 1; };
        """,
}


@NEEDS_BROWSER
@pytest.mark.parametrize("what", BUILT_INS)
def test_a_page_with_odd_built_ins_is_played(what: str, shared: Callable[..., WebXRApp]) -> None:
    app = shared(PLAYS % BUILT_INS[what], values=VALUES)
    app.reset(1, hands(0))
    for step in (1, 2, 3):
        reply = app.step(frame_time_ns(step, 20), hands(step))
        assert reply.values == {"count": step + 1, "place": (1.0, 2.0, -3.0)}
        assert [(one.hand, one.amplitude) for one in reply.haptics] == [("right", 0.5)]
        assert app.image[..., 2].max() > 0


NOT_ANY_MORE = r"has no value of 'app\.place' any more: is"
TAMPERED = {
    "haptics of NaN": ("__sim2vr.haptics.push(['left', NaN, 1]);", "answer, haptics, 0, 1: got "),
    "no answer": ("__sim2vr.step = () => undefined;", ""),
    "depth": ("let a = []; for (let k = 0; k < 900; k++) a = [a]; __sim2vr.step = () => a;", ""),
    "a circle": ("const all = []; all[0] = all; __sim2vr.step = () => all;", ""),
    "a throw": ("__sim2vr.step = () => { throw null; };", ""),
    "NaN": ("app.place = NaN;", NOT_ANY_MORE),
    "a vector of NaN": ("app.place = { x: 0, y: 0, z: NaN };", NOT_ANY_MORE),
}


@NEEDS_BROWSER
@pytest.mark.parametrize("what", TAMPERED)
def test_a_page_that_answers_another_thing_has_failed(
    what: str, shared: Callable[..., WebXRApp]
) -> None:
    script, words = TAMPERED[what]
    app = shared(PLAYS % script, values=VALUES, options={"script_errors": "fail"})
    app.reset(1, hands(0))
    with pytest.raises((ProtocolError, AppDied), match=rf"page\.html.*{words}") as caught:
        for step in (1, 2, 3):
            app.step(frame_time_ns(step, 20), hands(step))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600
