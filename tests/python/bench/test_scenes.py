"""The benchmark's scenes: what they play depends on neither threads, transport nor company."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.bench import scene as shared
from sim2vr_harness.bench.bodies import body_variants
from sim2vr_harness.bench.plan import BenchPlan, specs, transports
from sim2vr_harness.bench.scene import Spec
from sim2vr_harness.bench.scenes import EnvScene, PhysicsScene, open_scene, short_iteration
from sim2vr_harness.bench.senses import sense_variants
from sim2vr_harness.envs import AppConfig
from sim2vr_harness.perception import SENSES, WRAPPERS
from sim2vr_harness.runs.config import TrainingConfig, parse_config
from webxr_pages import NEEDS_BROWSER, PAGES

PACKAGE = "sim2vr_harness.bench"
MORE_ACTIONS = ("sense=fingers", "sense=gaze")


@pytest.fixture(autouse=True)
def short_warm_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared, "WARM_UP_STEPS", 12)


@pytest.fixture(scope="module")
def config() -> TrainingConfig:
    return parse_config({"env": {"vision": {"width": 32, "height": 24}}})


def hashes(spec: Spec) -> tuple[str | None, str | None]:
    with closing(open_scene(spec)) as scene:
        return scene.state_hash, scene.observation_hash


@pytest.mark.parametrize("name", ["physics", "render", "env"])
def test_threads_do_not_matter(config: TrainingConfig, name: Any) -> None:
    found = {hashes(Spec(name, config, 3, threads)) for threads in (1, 2)}
    assert len(found) == 1
    ((state, observation),) = found
    assert state is not None
    assert len(state) == 16
    assert (observation is not None) == (name in ("render", "env"))


@pytest.mark.parametrize("name", ["render", "env"])
def test_transports_do_not_matter(config: TrainingConfig, name: Any) -> None:
    found = {hashes(Spec(name, config, 2, 1, kind)) for kind in transports()}
    assert len(found) == 1


@NEEDS_BROWSER
def test_a_page_is_the_same_twice(config: TrainingConfig) -> None:
    app = AppConfig(transport="webxr", page=str(PAGES / "touch.html"))
    page = config.model_copy(update={"env": config.env.model_copy(update={"app": app})})
    assert BenchPlan(page, ["render"]).transports == ["webxr"]
    found = {hashes(Spec("render", page, 1, 1, "webxr")) for _ in range(2)}
    assert len(found) == 1


def states(config: TrainingConfig, n: int) -> Iterator[bytes]:
    with closing(EnvScene(Spec("env", config, n, 2))) as scene:
        simulation: Any = scene.env.simulation
        yield from [shared.user_state(simulation, i) for i in range(n)]


def test_company_does_not_matter(config: TrainingConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    # User 1 has short rounds of 0.3 s in both, so that an autoreset is part of the comparison.
    monkeypatch.setattr(shared, "SHORT_ROUND_EVERY", 3)
    monkeypatch.setattr(shared, "SHORT_ROUND_SECONDS", 0.3)
    assert list(states(config, 2)) == list(states(config, 5))[:2]


def test_a_change_of_the_game_changes_the_hash(config: TrainingConfig) -> None:
    app = config.env.app.model_copy(update={"options": {"condition": "easy"}})
    easy = config.model_copy(update={"env": config.env.model_copy(update={"app": app})})
    assert hashes(Spec("render", config, 2, 1))[0] != hashes(Spec("render", easy, 2, 1))[0]


def test_short_rounds_are_one_in_thirty(config: TrainingConfig) -> None:
    assert shared.short_rounds(config.env, 14) == []
    assert shared.short_rounds(config.env, 64) == [15, 45]
    timed = parse_config({"env": {"app": {"options": {"round_seconds": 9.0}}}})
    assert shared.short_rounds(timed.env, 64) == []


def test_other_games_and_apps_that_draw_nothing(
    config: TrainingConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared, "SHORT_ROUND_EVERY", 2)
    app = {"game": "sample", "options": {}, "renderer": "null"}
    sample = parse_config({"env": {"app": app}})
    for name in ("render", "env"):
        state, pictures = hashes(Spec(name, sample, 2, 1))
        assert state is not None
        assert state != hashes(Spec(name, config, 2, 1))[0]
        assert (pictures is None) == (name == "render")


def test_bodies_with_motors(config: TrainingConfig) -> None:
    """The floor drives motors and muscles by the body's own rules."""
    user = {"model": "mobl_arms_bimanual", "torso": True, "effort": {"model": "neural"}}
    env = config.env.model_validate({"user": user, "app": {"game": "sample", "renderer": "null"}})
    motors = config.model_copy(update={"env": env})
    assert len({hashes(Spec("physics", motors, 2, threads)) for threads in (1, 2)}) == 1
    with closing(PhysicsScene(Spec("physics", motors, 1, 1))) as floor:
        before = floor._motor.copy()
        action = np.clip(np.random.default_rng([7, 0]).standard_normal((32, 70)), -1.0, 1.0)
        floor.step()  # m <- 0.1 m + 0.9 clip(m + a, 0, 1), with the step's actions
        moved = 0.1 * before + 0.9 * np.clip(before + action[12, :6].astype(np.float32), 0.0, 1.0)
        np.testing.assert_allclose(floor._motor, moved, atol=1e-12)
        assert (floor._ctrl[0, -6:] > 1.0).any() or (floor._ctrl[0, -6:] < 0.0).any()  # angles


def test_bodies_of_beats(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those with a controller in either hand; rounds of a level are as long as the level."""
    monkeypatch.setattr(shared, "SHORT_ROUND_EVERY", 2)
    app = {"game": "beats", "renderer": "null"}
    beats = parse_config({"env": {"app": app, "vision": {"width": 32, "height": 24}}})
    variants = dict(body_variants(beats))
    both = ("mobl_arms_bimanual", "mobl_arms_bimanual_motor")
    assert list(variants) == [name + torso for name in both for torso in ("", "+torso")]
    chosen = variants["mobl_arms_bimanual_motor+torso"]
    assert chosen.env.user.torso
    state, _ = hashes(Spec("env", chosen, 2, 1))
    assert state is not None
    assert state != hashes(Spec("env", variants["mobl_arms_bimanual_motor"], 2, 1))[0]
    specs_made = specs(BenchPlan(beats, ["bodies"], n="4", threads="1"))
    assert [(spec.scene, spec.variant) for spec in specs_made] == [
        (scene, variant) for variant in variants for scene in ("physics", "env")
    ]


def test_actions_are_those_of_the_user() -> None:
    few, many = shared.actions(2, 5), shared.actions(4, 5)
    assert few.shape == (shared.ACTIONS, 2, 5)
    assert np.array_equal(few, many[:, :2])
    assert not np.array_equal(many[:, 2], many[:, 3])
    assert np.abs(many).max() == 1.0


def test_a_digest_keeps_the_parts_apart() -> None:
    assert shared.digest([b"ab", b"c"]) != shared.digest([b"a", b"bc"])


def test_training_measures_whole_minibatches(config: TrainingConfig) -> None:
    # 64 users: 1,000 steps are 16 each, 1,024 in one minibatch; 4,000 are 63 each, in 4
    # minibatches 64 each, 4,096.
    one = short_iteration(config, 64, 1000).ppo
    assert (one.n_envs, one.n_steps, one.batch_size) == (64, 16, 1024)
    four = short_iteration(config, 64, 4000).ppo
    assert (four.n_envs, four.n_steps, four.batch_size) == (64, 64, 1024)


def test_every_sense_and_wrapper_has_a_variant(config: TrainingConfig) -> None:
    variants = dict(sense_variants(config))
    had = {"vision", "proprioception", "time"}
    assert {name for name in variants if name.startswith("sense=")} == {
        f"sense={name}" for name in set(SENSES) - had
    }
    wrapped = [name for name in variants if name.startswith("vision ") and "=" in name]
    assert {name.split()[1].partition("=")[0] for name in wrapped} == {*WRAPPERS, "eyes"}
    plain = hashes(Spec("env", config, 2, 1))
    for name, changed in variants.items():
        with closing(open_scene(Spec("env", changed, 2, 1, variant=name))) as scene:
            assert scene.observation_hash != plain[1], name
            # Users move as they do without the sense, but for further actions and a moving head.
            same = name not in (*MORE_ACTIONS, "sense=head")
            assert (scene.state_hash == plain[0]) == same, name


def test_the_player_looks_where_the_app_wishes() -> None:
    from sim2vr_harness.bench.scenes import _looking_up

    up = _looking_up(np.array([0.0, -90.0]))
    assert up == pytest.approx(np.array([[0, 0, 0, 1], [0.5**0.5, 0, 0, 0.5**0.5]]))


def test_nothing_in_bench_imports_in_a_circle() -> None:
    folder = Path(shared.__file__).parent
    imports = {file.stem: imported_siblings(file) for file in folder.glob("*.py")}
    assert "scene" in imports["scenes"]
    # Modules that import only what is left out already leave, again and again: a circle stays.
    while leaves := [name for name, needed in imports.items() if not needed & set(imports)]:
        for name in leaves:
            del imports[name]
    assert imports == {}


def imported_siblings(file: Path) -> set[str]:
    """Modules of bench that a module of it imports, within functions as well."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
            rest = (node.module or "").removeprefix(PACKAGE).lstrip(".")
            found |= {rest} if rest else {alias.name for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {x.name.removeprefix(f"{PACKAGE}.") for x in node.names}
    return found


def test_an_app_that_cannot_say_its_state_is_measured_by_its_user_s_body() -> None:
    def simulation(capabilities: frozenset[str]) -> SimpleNamespace:
        app = SimpleNamespace(capabilities=capabilities, state_hash=lambda: 7)
        row = np.ones((1, 2))
        return SimpleNamespace(apps=[app], users=SimpleNamespace(qpos=row, qvel=row, act=row))

    body = shared.user_state(simulation(frozenset()), 0)
    assert shared.user_state(simulation(frozenset({"save"})), 0) == body + bytes([7] + [0] * 7)
