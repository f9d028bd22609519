"""tools/bench: states of scenes, by hashes."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[3] / "tools" / "bench"


def test_rows_of_scenes_have_hashes_that_threads_do_not_change(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(TOOLS))
    spec = importlib.util.spec_from_file_location("bench", TOOLS / "bench.py")
    assert spec is not None and spec.loader is not None
    bench = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "bench", bench)  # its dataclasses look themselves up
    spec.loader.exec_module(bench)
    sizes = ["--set", "env.vision.width=32", "--set", "env.vision.height=24"]
    amounts = ["--n", "1,2", "--threads", "1,2", "--seconds", "0.05"]
    monkeypatch.setattr("measure.scene.WARM_UP_STEPS", 5)
    assert bench.main(["--scene", "physics,render,env", *sizes, *amounts, "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(rows) == 3 * 2 * 2
    hashes: dict[tuple[str, int], set[str]] = {}
    for each in rows:
        assert each["rate_per_s"] > 0.0
        assert len(each["state_hash"]) == 16
        hashes.setdefault((each["scene"], each["n"]), set()).add(each["state_hash"])
    assert {len(found) for found in hashes.values()} == {1}
    assert len(set.union(*hashes.values())) == 6
    assert bench.main(["--scene", "physic"]) == 2
    assert "--scene: got 'physic', expected one of all, physics," in capsys.readouterr().err
