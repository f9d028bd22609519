"""Tables of a game that the package does not know, and their report."""

from __future__ import annotations

from pathlib import Path

import pytest
import strange_game

from sim2vr_harness.studies.report import write_report
from sim2vr_harness.studies.report.source import ReportSource, read_source


@pytest.fixture(scope="module")
def strange_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return strange_game.write_tables(tmp_path_factory.mktemp("strange"))


@pytest.fixture(scope="module")
def source(strange_folder: Path) -> ReportSource:
    return read_source(strange_folder)


@pytest.fixture(scope="module")
def page(strange_folder: Path) -> str:
    return write_report(strange_folder).page.read_text(encoding="utf-8")
