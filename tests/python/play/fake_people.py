"""The quick stand-in of a simulation, with people."""

from pathlib import Path
from typing import Any

from fake_simulation import FakeSimulation

from sim2vr_harness.users import Population


class FakePeople(FakeSimulation):
    """The quick stand-in, with people who take longer the higher their number."""

    def __init__(self, config: Any = None, n: int = 1, *, log_dir: Path | None = None) -> None:
        super().__init__(config, n, log_dir=log_dir)
        self.people = Population(self.config.user.people)
        self.rounds = 0

    def reset(self, ids=None, seeds=None, options=None, persons=None):  # type: ignore[no-untyped-def]
        started = super().reset(ids, seeds, options)
        if persons is None:
            return started
        found = []
        for i, info, number in zip(ids, started, persons, strict=True):
            if self.log_dir is not None:
                folder = self.log_dir / f"user{i:03d}" / f"{self.rounds:04d}-round"
                folder.mkdir(parents=True)
                (folder / "events.csv").write_text(f"{seeds}")
                self.rounds += 1
            self.length[i] = 6 + number
            found.append(info | {"person": self.people.number(number).as_dict()})
        return found
