"""``sim2vr-harness plot measures``: measures of several users side by side."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.evaluation import bar_chart as charts
from sim2vr_harness.evaluation.bar_chart import EXERTION, chart


def results(folder: Path, user: str, effort: float, weight: float, **more: Any) -> Path:
    rounds = [{"effort": effort + k, "hand_travel_m": 10.0} for k in (-1.0, 1.0)]
    summary = {
        "user": user,
        "game": "beats",
        "episodes": 2,
        "effort": effort,
        "effort_weight": weight,
        "hand_travel_m": 10.0,
        "correct_slices": 4.0,
        "slice_rate": 1.0,
        "boxes": 4.0,
        "rounds": rounds,
        **more,
    }
    folder.mkdir()
    (folder / "results.json").write_text(json.dumps({"first": summary}))
    return folder


@pytest.fixture
def pair(tmp_path: Path) -> list[Path]:
    return [
        results(tmp_path / "eager", "eager", 3.0, 0.001),
        results(tmp_path / "lazy", "lazy", 50.0, 0.05),
    ]


def test_effort_is_compared_before_its_weight(
    pair: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """3 / 0.001 = 3000 against 50 / 0.05 = 1000: the lazy one costs more, and does less."""
    drawn: list[Any] = []
    monkeypatch.setattr(charts, "_figure", lambda *given: drawn.append(given))
    monkeypatch.setattr(charts, "write_figure", lambda *given: None)
    chart(pair, tmp_path / "a.png", measures=["exertion", "hand_travel_m"])
    ((found, measures, condition),) = drawn
    assert [measure.name for measure in measures] == ["exertion", "hand_travel_m"]
    assert condition == "first"
    assert [one.user for one in found] == ["eager", "lazy"]
    assert [one.value(EXERTION) for one in found] == [3000.0, 1000.0]
    assert found[1].rounds(EXERTION) == [980.0, 1020.0]


def test_a_picture_has_a_panel_per_measure(
    pair: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "chart.png"
    with pytest.raises(SystemExit) as exit_:
        main(["plot", "measures", *map(str, pair), "--out", str(out)])
    assert not exit_.value.code
    assert capsys.readouterr().out == f"Written: {out}\n"
    wide = np.asarray(Image.open(out).convert("RGB"))
    one = chart(pair, tmp_path / "one.png", measures=["exertion"])
    # The headlines of Beats, and exertion: two columns of a paper, 7.2 inches, and one, 3.5.
    assert (wide.shape[1], np.asarray(Image.open(one)).shape[1]) == (1440, 700)
    assert len(np.unique(wide.reshape(-1, 3), axis=0)) > 10


def test_what_cannot_be_drawn(pair: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "a.png"
    with pytest.raises(InputError, match=r"^--out: got '.*a.svg', expected .* .png or .pdf"):
        chart(pair, tmp_path / "a.svg")
    with pytest.raises(InputError, match=r"^RESULTS: got '.*/none', expected results of an ev"):
        chart([*pair, tmp_path / "none"], out)
    with pytest.raises(InputError, match=r"^--condition: got 'frist', expected .*'first'"):
        chart(pair, out, condition="frist")
    with pytest.raises(InputError, match=r"^--measure: got 'hand_travel', .*'hand_travel_m'"):
        chart(pair, out, measures=["hand_travel"])
    with pytest.raises(InputError, match=r"^--measure: got 'mine_rate', of which '.*eager' has"):
        chart(pair, out, measures=["mine_rate"])
    other = results(tmp_path / "other", "mole", 1.0, 0.1, game="whacamole")
    with pytest.raises(InputError, match=r"^RESULTS: got rounds of beats, whacamole, expected"):
        chart([*pair, other], out)
    file = tmp_path / "old" / "results.json"
    results(file.parent, "old", 1.0, 0.1)
    old = json.loads(file.read_text())
    del old["first"]["effort_weight"]
    file.write_text(json.dumps(old))
    with pytest.raises(InputError, match=r"has none, expected a new evaluation"):
        chart([file], out, measures=["exertion"])
    file.write_text('{"first": 3}')
    with pytest.raises(InputError, match=r"results.json: got 'first' of 3, expected results of"):
        chart([file], out)
    assert not out.exists()
