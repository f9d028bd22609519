"""Published effects beside a user's: signs, sizes, intervals, and files that cannot be used."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.studies import effects
from sim2vr_harness.studies.effects import EffectConfig, EffectResult, EffectsConfig, load_effects
from sim2vr_harness.training.motor_control.aimed_movements import AimedMovements

SHIPPED = Path(__file__).parents[3] / "studies" / "effects"


def _result(value: float, interval: tuple[float, float], **other: Any) -> EffectResult:
    return EffectResult("x", "x", "x", "positive", (1.0, 2.0), value, interval, 12, **other)


@pytest.mark.parametrize(
    ("value", "interval", "sign", "size"),
    [
        (1.5, (0.5, 2.5), "right", "inside"),
        (0.5, (-0.5, 1.5), "unclear", "outside"),
        (-1.0, (-1.5, -0.5), "wrong", "outside"),
    ],
)
def test_a_sign_is_right_where_the_interval_excludes_zero(
    value: float, interval: tuple[float, float], sign: str, size: str
) -> None:
    found = _result(value, interval)
    assert (found.sign_found, found.size_found) == (sign, size)


def test_a_ratio_is_that_of_each_person() -> None:
    file = EffectsConfig(
        name="lag",
        game="pointing",
        study={},
        effects=(
            EffectConfig(
                effect="slower", measure="time", factor="lag", levels=("none", "late"),
                of="ratio", sign="positive", source="x",
            ),
        ),
    )  # fmt: skip
    rows = [("a", "none", 1.0), ("a", "late", 2.0), ("b", "none", 2.0), ("b", "late", 3.0)]
    episodes = pd.DataFrame(rows, columns=["unit", "factor_lag", "time"])
    data: Any = SimpleNamespace(episodes=episodes)
    found = effects._of_study(file, file.effects[0], data)
    # 2 and 1.5: mean 1.75; t of two: 12.706 * .3536 / sqrt 2 = 3.177 to each side.
    assert found.value == pytest.approx(1.75)
    assert found.interval == pytest.approx((1.75 - 3.1766, 1.75 + 3.1766), abs=1e-3)
    assert (found.n, found.sign_found) == (2, "unclear")


def test_reaches_of_drawn_persons_are_theirs() -> None:
    """Two persons, two movements each to each target; the second one is .1 s slower."""
    distance, width = np.array([(d, w) for d in (0.1, 0.2, 0.4) for w in (0.02, 0.04)]).T
    bits = np.log2(distance / width + 1.0)
    time_s = 0.2 + 0.25 * bits[:, None] + np.array([0.0, 0.0, 0.1, 0.1])
    way = distance[:, None, None] * np.ones((4, 1)) * [1.0, 0.0, 0.0]
    profile = np.tile([1.8, 0.4, 0.9, 1.0], (6, 4, 1))
    peak = np.tile(2.0 * distance[:, None], 4)
    measures = AimedMovements(distance, width, time_s, 0 * time_s, 0 * way, way, profile, peak)
    first, second = (measures.of(np.array(rows)).summary() for rows in ((0, 1), (2, 3)))
    assert first["fitts_slope_s_per_bit"] == pytest.approx(0.25)
    assert second["fitts_intercept_s"] - first["fitts_intercept_s"] == pytest.approx(0.1)
    assert first["peak_speed_0.4m_mps"] == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1]", "expected effects in YAML"),
        ("name: x\neffects: [{effect: e, measure: m, source: s}]", "expected one of them"),
        ("name: x\nstudy: {}\neffects: [{effect: e, measure: m, source: s}]", "game"),
    ],
)
def test_a_file_that_cannot_be_used_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_effects(tmp_path)
    assert "bad.yaml" in str(error.value)


def test_the_user_of_another_game_is_not_measured(tmp_path: Path) -> None:
    from sim2vr_harness.cli.main import app

    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "one.yaml").write_text((SHIPPED / "targets.yaml").read_text())
    user, out = "pretrained:whacamole_people", tmp_path / "out"
    told = ["study", str(tmp_path / "effects"), "--user", user, "--out", str(out)]
    found = CliRunner().invoke(app, told)
    assert found.exit_code == 0, found.output
    rows = json.loads((out / "effects.json").read_text())
    assert [row["note"] for row in rows] == ["the user plays whacamole, not pointing"] * 2
    assert [row["value"] for row in rows] == [None, None]
    assert "not pointing" in (out / "effects.html").read_text()
