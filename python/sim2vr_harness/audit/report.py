"""The report of an audit: who is excluded from what and why, and what would include them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.audit.judging import MODELS
from sim2vr_harness.audit.population import FEWEST
from sim2vr_harness.audit.remedies import GOAL
from sim2vr_harness.audit.summary import EVERYONE, Audit, plain
from sim2vr_harness.figures.figure import GREY, Bars, Figure, Panel
from sim2vr_harness.figures.figure import Path as Places
from sim2vr_harness.figures.html import save_page, table
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.runs.run_folder import write_atomically

__all__ = ["LIMITS", "findings", "headline", "write"]

LIMITS = (
    "The trunk leans and turns, but persons do not stand up, step, turn their feet or shift on a "
    "seat: who would do so reaches further.",
    "Joint limits are independent of each other, and the arm may pass through trunk, head and "
    "objects: some postures are not possible for people.",
    "Postures are the easiest of those found, held without motion; contacts do not support the "
    "arm. Forces of pressing and grip are not modelled.",
    "Muscles are a man's arm, scaled by body size and strength; raised arms are too weak in this "
    "model, so that activations are for comparison. Age, endurance and skill do not vary.",
    "Persons with limitations are the sampled persons with narrower joint limits, weaker muscles "
    "or one hand, not patients.",
)
"""What the model leaves out."""

_CLASSES = (
    (GOAL, "95 % or more can use it", "#009e73"),
    (0.8, "80 to 95 %", "#e69f00"),
    (0.5, "50 to 80 %", "#d55e00"),
    (0.0, "fewer than 50 %", "#b3201f"),
)


def write(audit: Audit, out: Path) -> list[Path]:
    """Write ``audit.json``, ``report.html`` and ``targets.png`` into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    values = plain(audit)
    file = out / "audit.json"
    text = json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomically(file, text.encode() + b"\n")
    figure = Figure("targets", "Targets", _CAPTION, (_space(audit),))
    page = save_page(out / "report.html", f"Who can use {audit.title}?", _parts(audit, values))
    return [page, file, write_figure(figure, out / "targets.png")]


def headline(values: Mapping[str, Any]) -> str:
    """Return the answer in a sentence."""
    every, targets = values["groups"][0], values["targets"]
    missed = sum(each["remedy"] is not None for each in targets)
    first = (
        f"{_percent(every['reach_every_target'])} of {values['people']} {values['stance']} persons "
        "see and reach every target."
    )
    held = f"{_percent(every['every_target'])} can also hold each long enough (*)."
    if not missed:
        return f"{first} {held} Each of the {len(targets)} targets includes at least 95 %."
    return f"{first} {held} {missed} of {len(targets)} targets exclude more than 5 %."


def findings(values: Mapping[str, Any]) -> list[str]:
    """Return a sentence per target that excludes more than 5 %, worst first."""
    missed = [each for each in values["targets"] if each["remedy"] is not None]
    missed.sort(key=lambda each: (each["usable"]["share"] or 0.0, each["name"]))
    return [_finding(each) for each in missed]


def _finding(target: Mapping[str, Any]) -> str:
    n = target["usable"]["n"]
    why = ", ".join(f"{cause}: {count} of {n}" for cause, count in target["causes"].items())
    return f"{target['name']}: {_percent(target['usable'])} can use it ({why}). {_advice(target)}"


def _advice(target: Mapping[str, Any]) -> str:
    fix = target["remedy"]
    offers = []
    if fix["reach_shift"] not in (None, fix["shift"]):
        offers.append(f"move it {fix['reach_shift']} to be seen and reached")
    if fix["shift"] is not None:
        offers.append(f"move it {fix['shift']} so that {100 * fix['share_after']:.0f} % can use it")
    if fix["load_kg"] is not None:
        offers.append(f"make it no heavier than {fix['load_kg']:g} kg")
    if fix["hold_s"] is not None:
        offers.append(f"let it be held no longer than {fix['hold_s']:g} s")
    if fix["one_hand"] is not None:
        offers.append(f"let one hand do it ({100 * fix['one_hand']:.0f} % can)")
    if fix["by_ray"] is not None:
        offers.append(f"let a ray reach it ({100 * fix['by_ray']:.0f} % can)")
    if not offers:
        return "No shift of up to 1.5 m includes 95 %."
    return f"To include 95 %: {', or '.join(offers)}."


def _percent(share: Mapping[str, Any]) -> str:
    """A proportion with its interval, in per cent."""
    if share["share"] is None:
        return f"too few persons ({share['n']})"
    low, high = 100.0 * share["low"], 100.0 * share["high"]
    return f"{100.0 * share['share']:.0f} % [{low:.0f}, {high:.0f}]"


def _parts(audit: Audit, values: Mapping[str, Any]) -> list[str | Panel]:
    parts: list[str | Panel] = [f"<p><b>{escape(headline(values))}</b></p>"]
    found = [*findings(values), *_of_groups(values)]
    if found:
        parts.append("<ul>" + "".join(f"<li>{escape(text)}</li>" for text in found) + "</ul>")
    limits = "".join(f"<li>{escape(text)}</li>" for text in LIMITS)
    parts.append(f'<div class="warn">Limits of the model:<ul>{limits}</ul></div>')
    parts += ["<h2>Where the targets are</h2>", _space(audit), f"<p>{escape(_CAPTION)}</p>"]
    parts += ["<h2>By target</h2>", _target_table(values)]
    parts += ["<h2>By group</h2>", _group_table(values), f"<p>{escape(_GROUPS)}</p>"]
    parts += ["<h2>Exertion by target</h2>", _exertion_table(values), f"<p>{escape(_EXERTION)}</p>"]
    parts += [_exertion_panel(values), "<h2>Sources</h2>", _sources(values)]
    return parts


_CAPTION = (
    "Targets for a person of median stature, coloured by the share of people who can use them. "
    "Grey: eyes and shoulders."
)
_GROUPS = (
    "Share who can use a target, with Wilson's 95 % interval. Groups of fewer than "
    f"{FEWEST} persons are not judged. Groups with a source that was not read are marked * and are "
    "not in the answer above."
)
_EXERTION = (
    "Median (5 % to 95 %) of the persons who reach the target. Activation: least largest "
    "activation of the shoulder's muscles that holds the posture; above 1 they are too weak. "
    "Minutes: until exhaustion if the posture is held without a break. "
    "NICER's published strength (*) decides who "
    "holds a target; it was not verified. The trunk's strength (*) was read second-hand."
)


def _of_groups(values: Mapping[str, Any]) -> list[str]:
    """A sentence per group that is excluded from more targets than everyone."""
    goal, sentences = GOAL, []
    every = values["groups"][0]["targets"]
    for group in values["groups"][1:]:
        if not group["verified"] or group["n"] < FEWEST:
            continue
        worse = [
            f"{name} {_percent(share)}, {next(iter(group['causes'][name]))}"
            for name, share in group["targets"].items()
            if share["share"] < goal and share["share"] < every[name]["share"] - 0.05
        ]
        if worse:
            more = f" and {len(worse) - _MOST} more" if len(worse) > _MOST else ""
            sentences.append(f"{group['name']}: {'; '.join(worse[:_MOST])}{more}.")
    return sentences


_MOST = 4
"""Targets that a sentence names."""


def _target_table(values: Mapping[str, Any]) -> str:
    header = ["target", "how", "can use *", "seen", "reached", "held *", "must lean", "excluded by"]
    rows, bad = [], []
    for number, each in enumerate(values["targets"]):
        why = ", ".join(f"{cause} {count}" for cause, count in each["causes"].items())
        how = each["how"] + (", both hands" if each["hand"] == "both" else "")
        parts = [_percent(each[part]) for part in ("usable", "seen", "reached", "held", "leans")]
        rows.append([each["name"], how, *parts, why])
        if each["remedy"] is not None:
            bad.append(number)
    return table(header, rows, bad)


def _group_table(values: Mapping[str, Any]) -> str:
    names = [each["name"] for each in values["targets"]]
    header = ["group", "persons", "every target", *names]
    rows = []
    for group in values["groups"]:
        mark = "" if group["verified"] else " *"
        shares = [_percent(group["targets"][name]) for name in names]
        rows.append(
            [group["name"] + mark, str(group["n"]), _percent(group["every_target"]), *shares]
        )
    return table(header, rows)


def _exertion_table(values: Mapping[str, Any]) -> str:
    keys = {
        "activation": "share_of_activation",
        "of published strength *": "share_of_published_strength",
        "of trunk strength *": "share_of_trunk_strength",
        **{f"minutes, {model}": f"minutes, {model}" for model in MODELS},
    }
    rows = [
        [each["name"], *(_spread(each["exertion"][key], key) for key in keys.values())]
        for each in values["targets"]
    ]
    return table(["target", *keys], rows)


def _spread(quantiles: Sequence[float | None], key: str) -> str:
    if quantiles == [None] * 3 and key.startswith("share"):
        return "too weak"
    missing = "endless" if key.startswith("minutes") else "too weak"
    low, middle, high = (missing if x is None else f"{x:.2f}" for x in quantiles)
    return f"{middle} ({low} to {high})"


def _exertion_panel(values: Mapping[str, Any]) -> Panel:
    names = [each["name"] for each in values["targets"]]
    medians = [each["exertion"]["share_of_activation"][1] for each in values["targets"]]
    bars = Bars("activation", names, medians, "#0072b2")
    return Panel("Median activation of the shoulder's muscles", (bars,), y_label="share of maximum")


def _space(audit: Audit) -> Panel:
    """The targets, the eyes and the shoulders of the person of median stature."""
    usable = audit.judged.usable.mean(axis=0)
    places = audit.judged.places_m[audit.middle]
    layers = [_places("eyes and shoulders", audit.landmarks_m, GREY)]
    for number, (least, name, colour) in enumerate(_CLASSES):
        most = np.inf if number == 0 else _CLASSES[number - 1][0]
        chosen = (usable >= least) & (usable < most)
        if chosen.any():
            layers.append(_places(name, places[chosen], colour))
    return Panel(
        "Share of people who can use each target",
        tuple(layers),
        legend=True,
        square=True,
        wide=True,
    )


def _places(name: str, places: np.ndarray[Any, np.dtype[np.float64]], colour: str) -> Places:
    right, up, ahead = np.reshape(places, (-1, 3)).T
    return Places(name, right, ahead, up, colour, places=True)


def _sources(values: Mapping[str, Any]) -> str:
    rows = [
        [group["name"], group["source"], "yes" if group["verified"] else "no"]
        for group in values["groups"]
        if group["source"] != "sampled"
    ]
    rows = [
        [EVERYONE, "stature, segments, strength, handedness: docs/concepts/people.md", "yes"],
        ["field of view, neck", "90 degrees; Apti, Colak and Akcay 2023", "yes"],
        *rows,
    ]
    return table(["group", "source", "verified"], rows)
