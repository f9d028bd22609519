"""What a page answers is checked, whatever its scripts have replaced."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import AppDied, ProtocolError, frame_time_ns
from sim2vr_harness.client.webxr.files import HOST, PageFiles
from sim2vr_harness.client.webxr.replies import BadReply, door_reply, place_in, step_reply
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from webxr_pages import NEEDS_BROWSER, hands, open_page, page_with

GOOD: dict[str, Any] = {
    "haptics": [["left", 0.5, 0.1]],
    "ended": False,
    "failure": None,
    "values": [["x", 1.5], ["y", 0, "is undefined"]],
    "picture": "AAAA",
}


def test_an_answer_is_read() -> None:
    reply = step_reply(GOOD, ("x", "y"), 3)
    assert (reply.values, reply.lacking) == ({"x": 1.5}, {"y": "is undefined"})
    assert reply.picture == bytes(3)
    assert [(one.hand, one.amplitude, one.duration_s) for one in reply.haptics] == [
        ("left", 0.5, 0.1)
    ]


DEEP: list[Any] = []
for _ in range(500):
    DEEP = [DEEP]
ODD = {
    "nothing": None,
    "a text": '{"haptics": []}',
    "a list": [],
    "a key too few": {"ended": False},
    "a key too many": GOOD | {"more": 1},
    "no truth": GOOD | {"ended": "no"},
    "no list of pulses": GOOD | {"haptics": {}},
    "no pulse": GOOD | {"haptics": [None]},
    "a hand that is none": GOOD | {"haptics": [["foot", 0.5, 0.1]]},
    "a hand that is a list": GOOD | {"haptics": [[["left"], 0.5, 0.1]]},
    "an amplitude that is none": GOOD | {"haptics": [["left", None, 0.1]]},
    "an amplitude of NaN": GOOD | {"haptics": [["left", float("nan"), 0.1]]},
    "an amplitude of 2": GOOD | {"haptics": [["left", 2, 0.1]]},
    "an endless pulse": GOOD | {"haptics": [["left", 1, float("inf")]]},
    "a pulse of less than no time": GOOD | {"haptics": [["left", 1, -1]]},
    "a duration beyond all numbers": GOOD | {"haptics": [["left", 1, 10**400]]},
    "a flood of pulses": GOOD | {"haptics": [["left", 0.5, 0.1]] * 10_001},
    "a failure that is a number": GOOD | {"failure": 3},
    "a failure without words": GOOD | {"failure": ["lost", None]},
    "no values": GOOD | {"values": []},
    "values of another name": GOOD | {"values": [["x", 1], ["z", 1]]},
    "values twice": GOOD | {"values": [["x", 1], ["x", 1]]},
    "a name that is a list": GOOD | {"values": [[["x"], 1], ["y", 1]]},
    "a value of NaN": GOOD | {"values": [["x", float("nan")], ["y", 1]]},
    "a place of NaN": GOOD | {"values": [["x", [0, 0, float("nan")]], ["y", 1]]},
    "a place of two": GOOD | {"values": [["x", [0, 0]], ["y", 1]]},
    "a text as a value": GOOD | {"values": [["x", "1"], ["y", 1]]},
    "a value beyond all numbers": GOOD | {"values": [["x", 10**400], ["y", 1]]},
    "a value without end": GOOD | {"values": [["x", DEEP], ["y", 1]]},
    "a picture too small": GOOD | {"picture": "AAA="},
    "a picture in no base64": GOOD | {"picture": "AA\u00e4A"},
    "a picture that is a number": GOOD | {"picture": 7},
}


@pytest.mark.parametrize("what", ODD)
def test_an_answer_that_is_another_thing_is_refused(what: str) -> None:
    with pytest.raises(BadReply, match=r"got .*, expected ") as caught:
        step_reply(ODD[what], ("x", "y"), 3)
    assert len(str(caught.value)) < 300


def test_other_answers_are_checked_too() -> None:
    assert door_reply(["done", ["lost", "lost\nits  context"]]).failure == "lost its context"
    assert place_in("place", [1, 2, 3]) == (1.0, 2.0, 3.0)
    for bad in (7, ["lost"], ["lost", 7]):
        with pytest.raises(BadReply):
            door_reply(["done", bad])
    for bad in (7, [1, 2], [1, 2, float("nan")], [1, 2, True]):
        with pytest.raises(BadReply):
            place_in("place", bad)


@pytest.mark.parametrize("name", ["x" * 300, "d/" * 3000 + "x", "x" * 300 + "/y"])
def test_an_address_too_long_for_a_file_is_not_there(tmp_path: Path, name: str) -> None:
    (tmp_path / "index.html").write_text("<!doctype html>")
    assert PageFiles(str(tmp_path), {}).answer(HOST + name).status == 404


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
    "JSON.stringify": "JSON.stringify = () => '{';",
    "Array toJSON": "Array.prototype.toJSON = () => 'odd';",
    "Object toJSON": "Object.prototype.toJSON = function () { return this.toJSON(); };",
    "push": "Array.prototype.push = () => 0;",
    "map": "Array.prototype.map = () => ['odd'];",
    "filter": "Array.prototype.filter = () => ['odd'];",
    "forEach": "Array.prototype.forEach = () => {};",
    "shift": "Array.prototype.shift = () => {};",
    "includes and every": "Array.prototype.includes = Array.prototype.every = () => false;",
    "Number": "window.Number = () => NaN;",
    "String": "window.String = () => { throw 1; };",
    "isFinite": "Number.isFinite = () => false;",
    "isArray": "Array.isArray = () => true;",
    "keys": "Object.keys = Object.entries = () => { throw 1; };",
    "assign": "Object.assign = Object.freeze = () => { throw 1; };",
    "Math": "Math.max = Math.min = Math.hypot = () => NaN;",
    "maps": "Map.prototype.set = Map.prototype.forEach = () => { throw 1; };",
    "weak maps": "WeakMap.prototype.get = WeakMap.prototype.has = () => { throw 1; };",
    "apply": "Function.prototype.apply = Reflect.apply = () => { throw 1; };",
    "base64": "window.btoa = () => '!'; delete Uint8Array.prototype.toBase64;",
    "ports": "MessagePort.prototype.postMessage = () => {};",
}


@NEEDS_BROWSER
@pytest.mark.parametrize("what", BUILT_INS)
def test_a_page_with_odd_built_ins_is_played(what: str, tmp_path: Path) -> None:
    page = page_with(tmp_path, PLAYS % BUILT_INS[what])
    with open_page(page, values=VALUES, timeout_s=10.0) as app:
        app.reset(1, hands(0))
        for step in (1, 2, 3):
            reply = app.step(frame_time_ns(step, 20), hands(step))
            assert reply.values == {"count": step + 1, "place": (1.0, 2.0, -3.0)}
            assert [(one.hand, one.amplitude) for one in reply.haptics] == [("right", 0.5)]
            assert app.image[..., 2].max() > 0


TAMPERED = {
    "haptics of NaN": "__sim2vr.haptics.push(['left', NaN, 1]);",
    "a third hand": "__sim2vr.haptics.push(['foot', 1, 1]);",
    "no answer": "__sim2vr.step = () => undefined;",
    "a text": "__sim2vr.step = async () => '[['.repeat(100000);",
    "depth": "let a = []; for (let k = 0; k < 900; k++) a = [a]; __sim2vr.step = () => a;",
    "more depth": "let a = []; for (let k = 0; k < 9e4; k++) a = [a]; __sim2vr.step = () => a;",
    "a circle": "const all = []; all[0] = all; __sim2vr.step = () => all;",
    "a throw": "__sim2vr.step = () => { throw null; };",
    "no step": "delete __sim2vr.step;",
    "iterators": "Array.prototype[Symbol.iterator] = () => { throw new Error('odd'); };",
}


@NEEDS_BROWSER
@pytest.mark.parametrize("what", TAMPERED)
def test_a_page_that_answers_another_thing_has_failed(what: str, tmp_path: Path) -> None:
    page = page_with(tmp_path, PLAYS % TAMPERED[what])
    strict = {"script_errors": "fail"}
    with open_page(page, values=VALUES, timeout_s=10.0, options=strict) as app:
        app.reset(1, hands(0))
        with pytest.raises((ProtocolError, AppDied), match=r"page\.html") as caught:
            for step in (1, 2, 3):
                app.step(frame_time_ns(step, 20), hands(step))
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 600


@NEEDS_BROWSER
@pytest.mark.parametrize("value", ["NaN", "Infinity", "[0, NaN, 0]", "{ x: 0, y: 0, z: NaN }"])
def test_a_value_that_is_no_number_any_more_is_the_pages_failure(
    value: str, tmp_path: Path
) -> None:
    page = page_with(tmp_path, PLAYS % f"app.place = {value};")
    with open_page(page, values={"place": "app.place"}) as app:
        app.reset(1, hands(0))
        with pytest.raises(AppDied, match=r"page\.html: has no value of 'app\.place' any more: is"):
            app.step(frame_time_ns(1, 20), hands(1))


@NEEDS_BROWSER
def test_a_page_that_breaks_while_it_loads_has_failed(tmp_path: Path) -> None:
    odd = "document.querySelectorAll = () => { throw new Error('odd'); };"
    with (
        open_page(page_with(tmp_path, PLAYS % "" + odd)) as app,
        pytest.raises((ProtocolError, AppDied), match=r"page\.html: stops .* script: Error: odd"),
    ):
        app.reset(1, hands(0))


@NEEDS_BROWSER
def test_users_go_on_when_a_page_answers_another_thing(tmp_path: Path) -> None:
    page = page_with(tmp_path, PLAYS % "__sim2vr.haptics.push(['foot', NaN, 1]);")
    config = AppConfig(transport="webxr", page=str(page), task={"seconds": 5})
    simulation = Simulation(EnvConfig(app=config, vision=VisionConfig(width=24, height=16)), 1)
    try:
        still = np.zeros((1, simulation.action_space.shape[0]))
        for _ in range(2):
            simulation.reset(seeds=[1])
            batch = simulation.step(still)
            assert batch.truncated.tolist() == [True]
            assert batch.info(0)["termination"] == "app_failed"
            assert "page.html: answered with another thing: haptics" in batch.info(0)["app_error"]
    finally:
        simulation.close()
