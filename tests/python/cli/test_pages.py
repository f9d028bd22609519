"""WebXR pages on the command line: baselines, and what cannot be."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from python.cli.calls import call
from sim2vr_harness.audit import auditing
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.envs import EnvConfig
from sim2vr_harness.play.environment import as_overrides
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.runs.trust import require_trust
from webxr_pages import NEEDS_BROWSER, PAGES

TOUCH = str(PAGES / "touch.html")


@pytest.fixture
def rules(tmp_path: Path) -> str:
    file = tmp_path / "task.yaml"
    file.write_text("seconds: 0.5\nreward: {expression: app.score, name: hits, weight: 10}\n")
    return str(file)


@NEEDS_BROWSER
def test_a_baseline_on_a_page(capsys: Any, tmp_path: Path, rules: str) -> None:
    out = tmp_path / "look"
    status, _, err = call(
        capsys, "evaluate", "--page", TOUCH, "--task", rules, "--user", "random",
        "--episodes", "1", "--out", str(out), "--json",
    )  # fmt: skip
    assert status == 0, err
    found = json.loads((out / "results.json").read_text())["standard"]
    assert (found["user"], found["episodes"], found["game"]) == ("random", 1, "touch")
    assert found["rounds"][0]["log"]["hits"] == found["hits"]
    assert found["rounds"][0]["steps"] == 10


@NEEDS_BROWSER
def test_what_the_user_sees_of_a_page(capsys: Any, tmp_path: Path) -> None:
    out = tmp_path / "seen"
    status, _, err = call(
        capsys, "render", "snapshot", "--page", TOUCH, "--seconds", "0.2", "--size", "240x160",
        "--out", str(out),
    )  # fmt: skip
    assert status == 0, err
    assert sorted(file.name for file in out.iterdir()) == [
        "body.png", "headset.png", "observation.png", "overview.png",
    ]  # fmt: skip
    small = np.asarray(Image.open(out / "observation.png"))[:, :120].astype(int)
    large = np.asarray(Image.open(out / "headset.png")).astype(int)
    assert large.shape == (160, 240, 3)
    # The same moment, at twice the size: but for edges the same colours.
    assert (np.abs(large[::2, ::2] - small).max(axis=2) <= 8).mean() > 0.9


def test_files_beside_a_configuration(tmp_path: Path) -> None:
    for name in ("page.html", "task.py", "rules.yaml"):
        (tmp_path / name).write_text("")
    app = {"transport": "webxr", "page": "page.html", "map": {"https://c.de/": "."}}
    for task, found in (("task.py:T", "task.py:T"), ("rules.yaml", "rules.yaml")):
        file = tmp_path / "config.yaml"
        file.write_text(yaml.safe_dump({"env": {"app": {**app, "task": task}}}))
        config = load_config(str(file)).env.app
        assert config.page == str(tmp_path / "page.html")
        assert config.map == {"https://c.de/": str(tmp_path)}
        assert config.task == f"{tmp_path}/{found}"


def test_pages_and_code_of_others_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr("sim2vr_harness.runs.trust._told", [])
    page = {"transport": "webxr", "page": TOUCH}
    seen = EnvConfig(app={**page, "task": {"seconds": 5}})
    with pytest.raises(InputError, match=r"env\.app\.page: got .*not opened before, expected --tr"):
        require_trust(seen, "runs/x")
    coded = EnvConfig(app={**page, "task": "task.py:T"})
    with pytest.raises(InputError, match=r"env\.app\.task: got 'task\.py:T' .*code that you have"):
        require_trust(coded, "runs/x", named={"page"})
    require_trust(coded, "runs/x", named={"page", "task"})
    require_trust(seen, "runs/x", trust=True)
    require_trust(seen, "runs/y")  # remembered
    with pytest.raises(InputError, match="code that you have not run"):
        require_trust(coded, "runs/x")
    mapped = {**page, "map": {"https://c.de/": str(tmp_path)}, "task": {"seconds": 5}}
    elsewhere = EnvConfig(app=mapped)
    with pytest.raises(InputError, match="not opened before"):
        require_trust(elsewhere, "runs/x")


def test_options_in_the_address_of_a_page_are_the_apps_options(tmp_path: Path) -> None:
    settings = AppOptions(page=f"{TOUCH}?size=0.03&level=2&name=a+b&far=1e-2").remote()
    assert settings["page"] == TOUCH
    assert settings["game"] == "touch"
    expected = {"size": 0.03, "level": 2, "name": "a b", "far": "1e-2"}
    assert settings["options"] == expected
    config = load_config("webxr", ["env.app.options.hue=1", *as_overrides(settings)])
    assert config.env.app.options == {"hue": 1, **expected}
    odd = tmp_path / "what?.html"
    odd.touch()
    assert AppOptions(page=str(odd)).remote()["page"] == str(odd)
    for wrong in ("?", "?size", "?a=1&a=2"):
        with pytest.raises(InputError, match=r"--page: got .* expected PAGE\?NAME=VALUE"):
            AppOptions(page=TOUCH + wrong).remote()


@pytest.mark.parametrize("more", [["?size=0.03"], ["", "--set", "env.app.options.size=0.03"]])
def test_an_audit_takes_options_of_its_page(
    capsys: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, more: list[str]
) -> None:
    """By its address and by ``--set``, as an evaluation does."""
    asked: list[EnvConfig] = []

    def find(env: EnvConfig, *_: object, **__: object) -> list[object]:
        asked.append(env)
        return []

    monkeypatch.setattr(auditing, "find_things", find)
    call(capsys, "audit", "--page", TOUCH + more[0], *more[1:], "--out", str(tmp_path / "audit"))
    assert (asked[0].app.page, asked[0].app.options) == (TOUCH, {"size": 0.03})


@pytest.mark.parametrize("written", ["1.50", "0x10", "true", "'1'", "[1, 2]", "1e-2", "a b"])
def test_options_in_an_address_are_read_as_set_reads_them(written: str) -> None:
    page = AppOptions(page=f"{TOUCH}?it={written}").remote()
    by_address = load_config("webxr", as_overrides(page))
    plain = AppOptions(page=TOUCH).remote()
    by_set = load_config("webxr", [*as_overrides(plain), f"env.app.options.it={written}"])
    assert by_address.env.app.options == by_set.env.app.options
