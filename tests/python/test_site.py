"""The documentation's site builds without a warning: no dead link, no page without a section."""

import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def build(docs: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    return subprocess.run([*command, docs, out], capture_output=True, text=True, timeout=600)


def exports() -> list[str]:
    """Functions and classes that the packages of docs/reference/api.md export."""
    found = []
    for package in ("", ".training", ".envs", ".client", ".users", ".perception"):
        module = import_module(f"sim2vr_harness{package}")
        values = {name: getattr(module, name) for name in module.__all__}
        found += [
            f"{module.__name__}.{name}"
            for name, value in values.items()
            if (inspect.isclass(value) or inspect.isfunction(value))
            and (package, name) not in {(".perception", "SenseConfig"), ("", "EnvConfig")}  # envs
        ]
    assert len(found) > 100
    return found


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = build(ROOT / "docs", tmp_path / "site")  # warnings are errors; packages may log, too
    assert "WARNING" not in done.stderr
    assert done.returncode == 0, done.stderr
    index = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    for page in ("reference/settings.html", "reference/api.html", "guide/train.html"):
        assert page in index
    api = (tmp_path / "site/reference/api.html").read_text(encoding="utf-8")
    assert [name for name in exports() if f'id="{name}"' not in api] == []
