"""Learning curves of runs, from what their stages have written down."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, naming, read_json
from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.policies.store import TrainedUser, find_user, is_packed
from sim2vr_harness.runs.run_folder import RunFolder, metric_key, read_rows, write_atomically

__all__ = ["curve", "pack_curves", "plot"]

_PANELS = 6
_MOST_DRAWN = 1e100
_CURVES = "curves.json"
"""In the folder of a packed user: what its run had written down."""
_MOST_ROWS = 500
"""Of a packed curve."""

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class _Run:
    """What a run has written down: each stage's rows, empty where there is none."""

    name: str
    facts: GameFacts
    looking: Rows
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


def curve(rows: Rows, key: str) -> tuple[list[float], list[float]]:
    """Return steps and values of one metric; rows without it, or without a step, are left out."""
    pairs = ((row.get("step"), row.get(key)) for row in rows)
    points = [(step, value) for step, value in pairs if _is_number(step) and _is_number(value)]
    return [point[0] for point in points], [point[1] for point in points]


def _is_number(value: Any) -> TypeGuard[float]:
    """Whether this is a number that can be drawn."""
    return isinstance(value, (int, float)) and abs(value) <= _MOST_DRAWN


def plot(runs: Sequence[str | Path], out: Path) -> Path:
    """Draw the learning curves of one or more runs into a PNG file.

    There is a row for looking and trying, of the recipe ``skills``, one for the teacher's imagined
    rollouts and the student, and two for the training from pixels, each if any of the runs has it.

    Args:
        runs: Folders of runs, or packed users (``pretrained:NAME``, or a folder).
        out: The file to write.

    Raises:
        InputError: A folder is not a run's or has no finished iteration, or ``out`` is no PNG.
    """
    if out.suffix.lower() != ".png":
        raise InputError("--out", repr(str(out)), "a file name that ends in .png")
    found = [_read(run) for run in runs]
    for run, each in zip(runs, found, strict=True):
        if not (each.rows or each.looking or each.imagined or each.student):
            raise InputError("RUN", f"{str(run)!r}, which has no metrics yet", "a trained run")
    _draw(found, out)
    return out


def pack_curves(run: Path, place: Path) -> None:
    """Write what a run has written down, thinned, beside a packed user; nothing if it is no run."""
    folder = RunFolder(run)
    if not folder.exists:
        return
    found = _of_folder(folder)
    content = {
        "looking": _thinned(found.looking, None),
        "imagined": _thinned(found.imagined, None),
        "student": _thinned(found.student, ("student/", "rollout/ep_")),
        "rows": _thinned(found.rows, tuple(key for key, _ in _panels(found.facts))),
    }
    write_atomically(place / _CURVES, (json.dumps(content) + "\n").encode())


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
        return _of_packed(find_user(run), run)
    return _of_folder(RunFolder.open(Path(run)))


def _of_packed(user: TrainedUser, run: str | Path) -> _Run:
    file = user.source.with_name(_CURVES)
    if not file.is_file():
        raise InputError(
            "RUN",
            f"{str(run)!r}, which was packed without its learning curves",
            "a run's folder, or a user packed since they are kept (curves.json)",
        )
    expected = "learning curves: a JSON object with lists of rows"
    rows = read_json(file, expected)
    rows.setdefault("looking", [])  # not in older ones
    for key in ("looking", "imagined", "student", "rows"):
        found = rows.get(key)
        if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
            raise InputError(file_name(file), f"{key}: {shown(found, 40)}", expected)
    facts = game_facts(user.config.env.app, ask=False)
    stages = (rows[key] for key in ("looking", "imagined", "student", "rows"))
    return _Run(str(user.card["name"]), facts, *stages)


def _of_folder(folder: RunFolder) -> _Run:
    return _Run(
        name=folder.path.name,
        facts=game_facts(folder.load_config().env.app, ask=False),
        looking=read_rows(folder.path / "looking" / "cycles.jsonl"),
        imagined=_first_rows(
            folder.path / "imagined" / "cycles.jsonl",
            folder.path / "teacher" / "practice.jsonl",  # of runs of version 0.1
        ),
        student=read_rows(folder.path / "student" / "metrics.jsonl"),
        rows=folder.metrics(),
    )


def _first_rows(*files: Path) -> Rows:
    """Rows of the first of these files that has any."""
    return next((rows for rows in map(read_rows, files) if rows), [])


def _draw(runs: Sequence[_Run], out: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    facts = runs[0].facts
    looking = any(run.looking for run in runs)
    stages = any(run.imagined or run.student for run in runs)
    pixels = any(run.rows for run in runs)
    height = looking + stages + 2 * pixels
    figure = Figure(figsize=(12, 3.5 * height), layout="constrained")
    FigureCanvasAgg(figure)
    grid = list(figure.subplots(height, 3).flat)
    left = iter(grid)
    if looking:
        _draw_looking([next(left) for _ in range(3)], runs)
    if stages:
        _draw_stages([next(left) for _ in range(3)], runs, facts)
    for axes, (key, title) in zip(left, _panels(facts), strict=False):
        for run in runs:
            _line(axes, *curve(run.rows, key), label=run.name)
        _dress(axes, f"{title} (from pixels)" if looking or stages else title)
    grid[0].legend(fontsize=8)
    out.parent.mkdir(parents=True, exist_ok=True)
    with naming(out):
        figure.savefig(out, dpi=120)


def _draw_looking(grid: Sequence[Any], runs: Sequence[_Run]) -> None:
    """What is earned while users with a motor layer try what is worth doing."""
    panels = (
        ("reward", "reward per minute"),
        ("explore", "share of random tries"),
        ("loss", "error of the values"),
    )
    for axes, (key, title) in zip(grid, panels, strict=True):
        for run in runs:
            _line(axes, *curve(run.looking, key), label=run.name)
        _dress(axes, f"Trying: {title}")


def _draw_stages(grid: Sequence[Any], runs: Sequence[_Run], facts: GameFacts) -> None:
    """The stages before the training from pixels: imagined rollouts, then imitation."""
    score = next((measure for measure in facts.scalars if measure.name == facts.score), None)
    key_of_score = "rollout/ep_rew_mean" if score is None else f"rollout/{metric_key(score)}"
    label = "return" if score is None else score.heading.lower()
    for number, run in enumerate(runs):
        color = f"C{number % 10}"
        for key, style, where in (("imagined", "--", "imagined"), ("played", "-", "in the app")):
            steps, values = [], []
            for row in run.imagined:
                rates = row.get(key)
                known = (
                    [rate for rate in rates if _is_number(rate)] if isinstance(rates, list) else []
                )
                if known and _is_number(row.get("step")):
                    steps.append(row["step"])
                    values.append(sum(known) / len(known))
            _line(grid[0], steps, values, style, color=color, label=f"{run.name}, {where}")
        for axes, key in (
            (grid[1], "student/imitation_error"),
            (grid[2], key_of_score),
        ):
            _line(axes, *curve(run.student, key), color=color, label=run.name)
    _dress(grid[0], f"Teacher: {label}")
    _dress(grid[1], "Student: difference to the teacher")
    _dress(grid[2], f"Student: {label}")


def _line(
    axes: Any, steps: Sequence[float], values: Sequence[float], style: str = "-", **how: Any
) -> None:
    marker = "o" if len(steps) < 30 else None
    axes.plot([step / 1e6 for step in steps], values, style, marker=marker, ms=3, **how)


def _dress(axes: Any, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel("user steps (million)", fontsize=8)
    axes.grid(alpha=0.3)
    axes.tick_params(labelsize=8)
    axes.ticklabel_format(useOffset=False)
