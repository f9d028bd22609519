"""tools/bench: two runs side by side, and the tables of the performance page."""

import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import pytest

TOOLS = Path(__file__).resolve().parents[3] / "tools" / "bench"


def tool(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(f"bench_{name}", TOOLS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


compare, tables = tool("compare"), tool("tables")


def row(scene: str, rate: float | None, **values: Any) -> dict[str, Any]:
    return {
        "scene": scene, "variant": "", "transport": "in_process", "n": 64, "threads": 2,
        "unit": "user steps/s", "rate_per_s": rate, "cpu_us_per_step": 900.0, "spread": 0.05,
        "state_hash": "0123", "observation_hash": "89ab", "parts": {}, "ratios": {},
        "memory_mb": 500.0, "extra": {}, "cpu": "Z80", "cores": 2, "renderer": "llvmpipe",
        "load_average": [0.1], "commit": "c0ffee", "dirty": False, "run": "2026-01-01T00:00 1",
        "version": "1", "image": [120, 80], **values,
    }  # fmt: skip


def write(path: Path, *rows: dict[str, Any]) -> str:
    path.write_text("".join(json.dumps(one) + "\n" for one in rows))
    return str(path)


def test_numbers_side_by_side(tmp_path: Path, capsys: Any) -> None:
    a = write(tmp_path / "a", row("env", 1000.0), row("physics", 2000.0, transport=None))
    b = write(
        tmp_path / "b",
        row("env", 1.0),  # an earlier run of the same file
        row("physics", 1900.0, transport=None),
        row("env", 1250.0, observation_hash="ffff"),
    )
    assert compare.main([a, b]) == 0
    lines = capsys.readouterr().out.splitlines()
    env, physics = (line.split() for line in lines if line.startswith(("env", "physics")))
    assert env == ["env", "N=64", "threads=2", "1,000.0", "1,250.0", "1.250", "equal", "DIFFER"]
    assert physics[-3:] == ["0.950", "equal", "equal"]
    assert not [line for line in lines if line.startswith("warning")]


def test_a_slower_scene_fails(tmp_path: Path, capsys: Any) -> None:
    a = write(tmp_path / "a", row("env", 1000.0), row("game", 1000.0))
    b = write(tmp_path / "b", row("env", 899.0), row("game", 900.0))
    assert compare.main([a, b, "--fail-below", "0.9"]) == 1
    assert capsys.readouterr().err == ("FAILED: env N=64 threads=2: ratio 0.899 is below 0.9\n")
    assert compare.main([a, b, "--fail-below", "0.89"]) == 0


def test_rows_of_scenes_have_hashes_that_threads_do_not_change(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(TOOLS))
    bench = tool("bench")
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
