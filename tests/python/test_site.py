"""The documentation's site builds without a warning: no dead link, no page without a section."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
needs_sphinx = pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("sphinx", "myst_parser", "furo")),
    reason="needs the extra docs",
)


def build(docs: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html"]
    return subprocess.run([*command, docs, out], capture_output=True, text=True, timeout=600)


@needs_sphinx
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = build(ROOT / "docs", tmp_path / "site")
    assert done.stderr == ""
    assert done.returncode == 0
    index = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    for page in ("reference/settings.html", "reference/api.html", "guide/train.html"):
        assert page in index


@needs_sphinx
def test_a_dead_link_and_a_page_without_a_section_are_errors(tmp_path: Path) -> None:
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "conf.py").write_text((ROOT / "docs/conf.py").read_text(encoding="utf-8"))
    (docs / "index.md").write_text("# Site\n\n[Dead](gone.md) and [folder](.).\n")
    (docs / "tools.md").write_text("# Tools\n")
    (docs / "stray.md").write_text("# Stray\n")
    done = build(docs, tmp_path / "site")
    assert done.returncode != 0
    assert "gone.md" in done.stderr
    assert "stray.md" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 2


def test_the_page_of_the_interface_names_every_lazy_export() -> None:
    """Packages that import their names late list them on the page; Sphinx finds the others."""
    page = (ROOT / "docs/reference/api.md").read_text(encoding="utf-8")
    for name in ("sim2vr_harness", "sim2vr_harness.training"):
        exports = import_module(name).__all__
        assert [each for each in exports if each[0] != "_" and each not in page] == []
    for name in ("envs", "client", "perception", "users"):
        assert f"automodule:: sim2vr_harness.{name}\n" in page
