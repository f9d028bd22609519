"""Tables of a game that the package does not know, and their report."""

from pathlib import Path
from typing import Any

import pytest
import strange_game
from fake_people import FakePeople
from fake_simulation import FakeSimulation

from sim2vr_harness.evaluation.evaluate import evaluate
from sim2vr_harness.studies import worker as work
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


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Plays with the stand-in; returns what was played."""
    played: list[str] = []

    def play(user: str, request: Any) -> Any:
        played.append(request.conditions[0])
        fake = FakePeople if request.people else FakeSimulation
        return evaluate(user, request, simulation=fake)

    monkeypatch.setattr(work, "evaluate", play)
    return played


@pytest.fixture
def trainings(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, Path]]:
    """Trains and plays with the stand-in; returns configurations and folders of trainings."""
    begun: list[tuple[Any, Path]] = []
    real = work.trainer.train

    def train(config: Any, out: Path, **how: Any) -> Any:
        begun.append((config, out))
        return real(config, out, **how, simulation=lambda c: FakeSimulation(c.env, c.ppo.n_envs))

    def play(user: str, request: Any) -> Any:
        return evaluate(user, request, simulation=FakeSimulation)

    monkeypatch.setattr(work.trainer, "train", train)
    monkeypatch.setattr(work, "evaluate", play)
    return begun
