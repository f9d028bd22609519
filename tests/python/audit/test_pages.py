"""Interactive things of pages, found and tried; a page's answers."""

import time

import numpy as np
import pytest

from sim2vr_harness.audit import pages
from sim2vr_harness.audit.pages import find_things, things_as_targets
from sim2vr_harness.audit.targets import TargetSettings, located
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.users.kinematics.posture_controller import AIM_RAY
from webxr_pages import CDN, ENGINES, NEEDS_BROWSER, NEEDS_ENGINES, ROOT

# Listed by hand from the pages' sources: name and what is done with it.
THINGS = {
    "buttons": {"low": "touch", "middle": "touch", "high": "touch"},
    "keypad": {f"key {k}": "point" for k in range(1, 10)},
    "drawer": {"handle": "touch"},
    "balls": {"ball": "touch"},
}


def page(name: str) -> EnvConfig:
    folder = ROOT / "docs" / "examples" / "webxr" / name
    return EnvConfig(app=AppConfig(transport="webxr", page=str(folder), map={CDN: str(ENGINES)}))


@NEEDS_BROWSER
@NEEDS_ENGINES
@pytest.mark.parametrize("name", THINGS)
def test_things_of_pages_are_found_and_react(name: str) -> None:
    found = {each.name: each for each in find_things(page(name), 2.0)}
    assert ("drawer" in found) == (name == "drawer")  # which moves with its handle
    found.pop("drawer", None)
    assert {key: each.how for key, each in found.items()} == THINGS[name]
    assert all(each.reacts for each in found.values())
    assert [each.moves for each in found.values()] == [name == "balls"] * len(found)


@NEEDS_BROWSER
@NEEDS_ENGINES
def test_an_object_is_located_and_pointed_at_with_the_pages_own_ray() -> None:
    """A-Frame's laser of laser.html lies along the grip's axis, 60 degrees above WebXR's ray."""
    (target,) = located([TargetSettings(name="top", object="high")], page("buttons"))
    assert target.place_m.tolist() == pytest.approx([0.12, 1.25, 0.42])
    assert target.ray is AIM_RAY
    file = ROOT / "tests" / "data" / "webxr" / "laser.html"
    env = EnvConfig(app=AppConfig(transport="webxr", page=str(file), map={CDN: str(ENGINES)}))
    settings = TargetSettings(name="key", object="target", how="point")
    for each in (*located([settings], env), *things_as_targets(find_things(env, 2.0))):
        np.testing.assert_allclose(each.ray.direction, [1.0, 0.0, 0.0], atol=0.02)


@NEEDS_BROWSER
@NEEDS_ENGINES
def test_a_mouse_on_the_scene_hides_nothing() -> None:
    file = ROOT / "tests" / "data" / "webxr" / "laser.html"
    env = EnvConfig(app=AppConfig(transport="webxr", page=str(file), map={CDN: str(ENGINES)}))
    (target,) = find_things(env, 2.0)
    assert (target.name, target.how, target.reacts) == ("target", "point", True)


@NEEDS_BROWSER
@NEEDS_ENGINES
def test_what_the_page_does_anywhere_is_no_reaction() -> None:
    file = ROOT / "tests" / "data" / "webxr" / "operated.html"
    env = EnvConfig(app=AppConfig(transport="webxr", page=str(file), map={CDN: str(ENGINES)}))
    found = {each.name: each for each in find_things(env, 2.0)}
    assert found["switch"].reacts  # by its own ray, which is 30 degrees beside WebXR's
    assert found["door"].reacts
    assert found["door"].after == "switch"
    assert not found["lamp"].reacts  # which changes wherever the ray points
    assert not found["stone"].reacts
    assert found["switch"].place_m.tolist() == pytest.approx([-0.6, 1.5, 2.0])  # in the rig


@NEEDS_BROWSER
@NEEDS_ENGINES
@pytest.mark.parametrize("options", [{"count": 20_000}, {"more": 10}])
def test_a_page_of_many_objects_ends_in_time_and_says_what_was_left_out(
    options: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pages, "PROGRESS_S", 0.5)
    file = ROOT / "tests" / "data" / "webxr" / "many_objects.html"
    app = AppConfig(transport="webxr", page=str(file), map={CDN: str(ENGINES)}, options=options)
    said: list[str] = []
    began = time.monotonic()
    find_things(EnvConfig(app=app), 1.0, say=said.append, most_s=6.0)
    assert time.monotonic() - began < 40.0  # with the start of the browser and a step under load
    assert any("of at most 6 s ..." in line for line in said)
    assert "things were not operated: at most 160 attempts are made, in 6 s" in said[-1]
