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


def test_the_serial_share_is_that_of_amdahls_law(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(TOOLS))
    from measure.scaling import scaling_lines

    rows = [
        {
            "n": n,
            "threads": c,
            "variant": f"shards={k}",
            "ratios": {"physics": 0.8 / (1 + s * (c - 1))},
        }
        for n in (1, 64)
        for c, k, s in ((1, 1, 0.0), (2, 1, 0.05), (2, 2, 0.01), (4, 1, 0.05), (4, 4, 0.01))
    ]
    # 0.8 / 1.75, and 0.8 / (1.15 * 1.03)
    assert scaling_lines(rows)[0].endswith("0.050 among threads, 0.010 among processes")
    assert "0.46 x physics in one process, 0.68 in 4" in scaling_lines(rows)[2]
