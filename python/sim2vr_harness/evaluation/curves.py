"""Learning curves of runs, from the logs of their stages."""

import json
import lzma
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_json, write_atomically
from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.figures.figure import Figure, Layer, Line, Panel, Points, colour_of
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.policies.store import find_user, is_packed
from sim2vr_harness.runs.run_folder import RunFolder, metric_key, read_rows

_PANELS = 6
_MOST_DRAWN = 1e100
_CURVES = "curves.json.xz"
"""File with the logged rows of a packed user's run, in the user's folder."""
_MOST_ROWS = 500
"""Of a packed curve."""

_FEW = 30
"""Points of a curve that are marked one by one."""

Rows = list[dict[str, Any]]
_Curve = tuple[list[float], list[float]]


@dataclass(frozen=True)
class _Run:
    """Logged rows of a run: those of each stage, empty if there is none."""

    name: str
    facts: GameFacts
    q_learning: Rows
    imagined: Rows
    student: Rows
    rows: Rows


def _panels(facts: GameFacts) -> tuple[tuple[str, str], ...]:
    """(key of metrics.jsonl, title) of six panels: the return, two of the game, the learner's."""
    game = [(f"rollout/{metric_key(m)}", f"{m.heading} per round") for m in facts.headlines[::-1]]
    if len(game) > 2:
        game = [game[0], game[-1]]
    others = [
        ("rollout/ep_effort_cost_mean", "Effort cost per round (reward)"),
        ("train/std", "Standard deviation of actions"),
        ("train/approx_kl", "Change of the policy per update (KL divergence)"),
        ("time/steps_per_second", "User steps per second"),
        ("rollout/ep_len_mean", "User steps per round"),
    ]
    return (("rollout/ep_rew_mean", "Return per round"), *game, *others)[:_PANELS]


def curve(rows: Rows, key: str) -> _Curve:
    """Return steps and values of one metric; rows without it, or without a step, are left out."""
    pairs = ((row.get("step"), row.get(key)) for row in rows)
    points = [(step, value) for step, value in pairs if _is_number(step) and _is_number(value)]
    return [point[0] for point in points], [point[1] for point in points]


def _is_number(value: Any) -> TypeGuard[float]:
    """Return whether a value is a number that can be drawn."""
    return isinstance(value, (int, float)) and abs(value) <= _MOST_DRAWN


def plot(runs: Sequence[str | Path], out: Path) -> Path:
    """Draw the learning curves of one or more runs: PNG or PDF.

    There is a row for the value learning of the recipe ``skills``, one for the teacher's imagined
    rollouts and the student, and two for the training from pixels, each if any of the runs has it.

    Args:
        runs: Folders of runs, or packed users (``pretrained:NAME``, or a folder).
        out: The file to write.

    Raises:
        InputError: A folder is not a run's or has no finished iteration, or ``out`` is neither
            PNG nor PDF.
    """
    found = [_read(run) for run in runs]
    if len({each.name for each in found}) < len(found):
        found = [replace(each, name=str(run)) for run, each in zip(runs, found, strict=True)]
    for run, each in zip(runs, found, strict=True):
        if not (each.rows or each.q_learning or each.imagined or each.student):
            raise InputError("RUN", f"{str(run)!r}, which has no metrics yet", "a trained run")
    facts = found[0].facts
    learned = any(run.q_learning for run in found)
    stages = any(run.imagined or run.student for run in found)
    panels = [
        *(_q_learning_panels(found) if learned else ()),
        *(_stage_panels(found) if stages else ()),
    ]
    told = " (from pixels)" if panels else ""
    if any(run.rows for run in found):
        for key, title in _panels(facts):
            panels.append(_panel(title + told, [curve(run.rows, key) for run in found], found))
    figure = Figure("curves", f"Training on {facts.name}", "", panels, columns=3)
    return write_figure(figure, out)


def pack_curves(run: Path, place: Path) -> None:
    """Write the thinned logs of a run into a packed user's folder; do nothing if it is no run."""
    folder = RunFolder(run)
    if not folder.exists:
        return
    found = _of_folder(folder)
    content = {
        "q_learning": _thinned(found.q_learning, None),
        "imagined": _thinned(found.imagined, None),
        "student": _thinned(found.student, ("student/", "rollout/ep_")),
        "rows": _thinned(found.rows, tuple(key for key, _ in _panels(found.facts))),
    }
    write_atomically(place / _CURVES, lzma.compress(json.dumps(content).encode(), preset=9))


def _thinned(rows: Rows, prefixes: tuple[str, ...] | None) -> Rows:
    every = -(-len(rows) // _MOST_ROWS) or 1
    return [
        {
            key: value
            for key, value in row.items()
            if key == "step" or prefixes is None or key.startswith(prefixes)
        }
        for row in rows[::every]
    ]


def _read(run: str | Path) -> _Run:
    if is_packed(run):
        user = find_user(run)
        file = user.source.with_name(_CURVES)
        if not file.is_file():
            raise InputError(
                "RUN",
                f"{str(run)!r}, which was packed without its learning curves",
                "a run's folder, or a user packed since they are kept (curves.json.xz)",
            )
        expected = "learning curves: a JSON object with lists of rows"
        rows = read_json(file, expected)
        for key in ("q_learning", "imagined", "student", "rows"):
            found = rows.get(key)
            if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
                raise InputError(file_name(file), f"{key}: {shown(found, 40)}", expected)
        facts = user.env.facts_unasked
        stages = (rows[key] for key in ("q_learning", "imagined", "student", "rows"))
        return _Run(str(user.card["name"]), facts, *stages)
    return _of_folder(RunFolder.open(Path(run)))


def _of_folder(folder: RunFolder) -> _Run:
    return _Run(
        name=folder.path.name,
        facts=ResolvedEnv(folder.load_config().env).facts_unasked,
        q_learning=read_rows(folder.path / "q_learning" / "cycles.jsonl"),
        imagined=read_rows(folder.path / "imagined" / "cycles.jsonl"),
        student=read_rows(folder.path / "student" / "metrics.jsonl"),
        rows=folder.metrics(),
    )


def _q_learning_panels(runs: Sequence[_Run]) -> list[Panel]:
    """Value learning of users with a motor layer."""
    titles = {
        "reward": "reward per minute",
        "explore": "proportion of exploratory actions",
        "loss": "loss",
    }
    return [
        _panel(f"Value learning: {title}", [curve(run.q_learning, key) for run in runs], runs)
        for key, title in titles.items()
    ]


def _stage_panels(runs: Sequence[_Run]) -> list[Panel]:
    """Return panels of the stages before training from pixels: imagined rollouts, imitation."""
    facts = runs[0].facts
    score = next((measure for measure in facts.scalars if measure.name == facts.score), None)
    key_of_score = "rollout/ep_rew_mean" if score is None else f"rollout/{metric_key(score)}"
    label = "return" if score is None else score.heading.lower()
    imagined, played = (
        [_curve_of_means(run.imagined, key) for run in runs] for key in ("imagined", "played")
    )
    teacher = _panel(f"Teacher: {label} (dashed: imagined)", imagined, runs, dashed=True)
    teacher = replace(teacher, layers=[*teacher.layers, *_lines(played, runs)])
    return [teacher] + [
        _panel(f"Student: {what}", [curve(run.student, key) for run in runs], runs)
        for key, what in (
            ("student/imitation_error", "difference to the teacher"),
            (key_of_score, label),
        )
    ]


def _curve_of_means(rows: Rows, key: str) -> _Curve:
    """Return steps and the means of lists of rates."""
    means = []
    for row in rows:
        rates = row.get(key)
        known = [rate for rate in rates if _is_number(rate)] if isinstance(rates, list) else []
        means.append({"step": row.get("step"), key: sum(known) / len(known) if known else None})
    return curve(means, key)


def _panel(
    title: str, curves: Sequence[_Curve], runs: Sequence[_Run], *, dashed: bool = False
) -> Panel:
    lines = _lines(curves, runs, dashed=dashed)
    return Panel(title, lines, "user steps (million)", legend=True)


def _lines(curves: Sequence[_Curve], runs: Sequence[_Run], *, dashed: bool = False) -> list[Layer]:
    """Return one line per run; the points of short ones are marked."""
    layers: list[Layer] = []
    for number, ((steps, values), run) in enumerate(zip(curves, runs, strict=True)):
        millions = [step / 1e6 for step in steps]
        if len(steps) < _FEW:
            layers.append(Points(run.name, millions, values, colour_of(number)))
        layers.append(Line(run.name, millions, values, colour_of(number), dashed=dashed))
    return layers
