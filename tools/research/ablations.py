"""What each mechanism of a simulated person does: it plays again without one of them.

The persons are those of a run of ``train APP --people``. Their action values stay as they were
learned; a mechanism is taken away while they play. Persons and seeds are the same in every row.

    python tools/research/ablations.py RUN --people 6 --measures points
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

from sim2vr_harness.evaluation.evaluate import evaluate
from sim2vr_harness.evaluation.request import Request
from sim2vr_harness.policies.hierarchical import human_motor, person_policy


@dataclass(frozen=True)
class Ablation:
    """What is different.

    Attributes:
        settings: of the environment.
        constants: of ``person_policy``, by name.
        perceives: whether distances are misjudged.
        time_cost: factor on the cost of time with which movements are planned.
    """

    settings: tuple[str, ...] = ()
    constants: Mapping[str, float] = field(default_factory=dict)
    perceives: bool = True
    time_cost: float = 1.0


_NOISE = "env.user.noise"
ABLATIONS = {
    "all mechanisms": Ablation(),
    "no visual delay": Ablation(settings=("env.user.people.visual_delay_s=0",)),
    "no recognition latency": Ablation(constants={"RECOGNITION_S": 0.0}),
    "no refractory period": Ablation(constants={"REFRACTORY_S": 0.0}),
    "no motor noise": Ablation(
        settings=(f"{_NOISE}.signal_dependent=null", f"{_NOISE}.constant=null")
    ),
    "no misjudged distance": Ablation(perceives=False),
    "half the cost of time": Ablation(time_cost=0.5),
    "twice the cost of time": Ablation(time_cost=2.0),
}


@contextmanager
def _without(ablation: Ablation) -> Iterator[None]:
    """Take mechanisms away from all persons who begin a round meanwhile."""
    begin = person_policy.PersonPolicy.begin

    def begun(self: Any, n: int) -> Any:
        if not ablation.perceives:
            self.human._misjudged = {}
        return begin(self, n)

    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(person_policy.PersonPolicy, "begin", begun))
        plan = dataclasses.replace(
            human_motor.PLAN, time=ablation.time_cost * human_motor.PLAN.time
        )
        stack.enter_context(mock.patch.object(human_motor, "PLAN", plan))
        for name, value in ablation.constants.items():
            stack.enter_context(mock.patch.object(person_policy, name, value))
        yield


def main() -> None:
    """Print a row of measures for each ablation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--people", type=int, default=6)
    parser.add_argument("--seed", type=int, default=7, help="of the persons and rounds")
    parser.add_argument("--condition", help="of the game")
    parser.add_argument("--measures", nargs="+", required=True)
    parser.add_argument("--set", nargs="*", default=[], help="settings of all rows")
    parser.add_argument("--only", nargs="*", choices=list(ABLATIONS), default=list(ABLATIONS))
    given = parser.parse_args()
    print("| ablation | " + " | ".join(given.measures) + " |")
    print("|---" * (1 + len(given.measures)) + "|")
    for name in given.only:
        ablation = ABLATIONS[name]
        with tempfile.TemporaryDirectory() as folder, _without(ablation):
            request = Request(
                conditions=[given.condition] if given.condition else [],
                episodes=1,
                seed=given.seed,
                people=given.people,
                steps=False,
                out=Path(folder) / "out",
                batch=given.people,
                overrides=[*given.set, *ablation.settings],
            )
            summary = next(iter(evaluate(given.run, request).summaries.values()))
        cells = [_cell(summary, measure) for measure in given.measures]
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def _cell(summary: Mapping[str, Any], measure: str) -> str:
    """Mean and standard deviation over persons."""
    mean, sd = summary[measure], summary.get(f"{measure}_sd")
    return f"{mean:.3g}" if sd is None else f"{mean:.3g} ± {sd:.2g}"


if __name__ == "__main__":
    main()
