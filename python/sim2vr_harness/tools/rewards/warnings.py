"""Warnings about the proportions of a reward's terms."""

from __future__ import annotations

from itertools import pairwise

from sim2vr_harness.tools.rewards.contributions import APPROACHES, Contributions

_DROWNED = 0.02
"""A term below this share of the largest one is not heard."""
_FLAT = 0.01
"""A term whose slope at the start is below this share of its steepest says nothing there."""


def warnings_of(found: Contributions) -> list[str]:
    """Return a sentence with numbers for everything that looks out of proportion."""
    return [
        *_drowned(found),
        *_flat(found),
        *_unpaid(found),
        *_effort(found),
        *_lingering(found),
    ]


def _size(found: Contributions, term: str) -> float:
    """The most that a term makes a difference between approaches."""
    sums = [found.total(approach, term) for approach in APPROACHES]
    return max(sums) - min(sums)


def _drowned(found: Contributions) -> list[str]:
    sizes = {term.name: _size(found, term.name) for term in found.reward.terms}
    largest = max(sizes, key=lambda name: sizes[name])
    words = []
    for name, size in sizes.items():
        if size == 0.0:
            words.append(f"'{name}' vanishes: it is the same for every approach.")
        elif size < _DROWNED * sizes[largest]:
            share = 100.0 * size / sizes[largest]
            words.append(
                f"'{name}' drowns: between approaches it differs by {size:.3g}, {share:.1f} % of "
                f"what '{largest}' does ({sizes[largest]:.3g})."
            )
    return words


def _flat(found: Contributions) -> list[str]:
    """Terms of each step that do not tell a start from a step nearer."""
    reward, words = found.reward, []
    dt = float(found.times_s[0])
    for term in reward.terms:
        if term.when != "step":
            continue
        step_m = reward.start_m / 100.0
        values = [term.value(x=k * step_m, v=0.0, t=dt, dt=dt) for k in range(101)]
        slopes = [abs(b - a) / step_m for a, b in pairwise(values)]
        if max(slopes) > 0.0 and slopes[-1] < _FLAT * max(slopes):
            near = next(k for k in range(100) if slopes[k] < _FLAT * max(slopes)) * step_m
            words.append(
                f"'{term.name}' vanishes beyond {near:.2f} m: at the start, {reward.start_m:g} m "
                f"away, a centimetre nearer is worth {0.01 * slopes[-1]:.2g} a step, near the "
                f"target up to {0.01 * max(slopes):.2g}."
            )
    return words


def _unpaid(found: Contributions) -> list[str]:
    words = []
    worst = found.total("worst")
    for approach in ("linear", "quadratic"):
        gain = found.total(approach) - worst
        if gain <= 0.0:
            words.append(
                f"A {approach} approach earns {found.total(approach):.3g}, no more than staying "
                f"away ({worst:.3g})."
            )
    arrivals = [term.name for term in found.reward.terms if term.when == "arrival"]
    for name in arrivals:
        paid = [approach for approach in APPROACHES if found.total(approach, name)]
        if paid == ["best"]:
            words.append(
                f"'{name}' is paid to neither a linear nor a quadratic approach, which arrive too "
                "slowly."
            )
    return words


def _effort(found: Contributions) -> list[str]:
    if found.effort_weight == 0.0 or found.effort_name == "zero":
        return ["Effort costs nothing."]
    gain = max(found.total("linear"), found.total("quadratic")) - found.total("worst")
    random, full = found.cost("random"), found.cost("full")
    if gain > 0.0 and full < _DROWNED * gain:
        return [
            f"Effort drowns: even full activation all the time costs {full:.3g}, "
            f"{100 * full / gain:.1f} % of what the better approach gains ({gain:.3g})."
        ]
    idle = found.total("worst") - found.cost("none")
    moved = max(found.total("linear"), found.total("quadratic")) - random
    if moved <= idle:
        return [
            f"Doing nothing pays: staying away without effort comes to {idle:.3g}, the better "
            f"approach with random activations to {moved:.3g} (effort {random:.3g})."
        ]
    return []


def _lingering(found: Contributions) -> list[str]:
    """A bonus must be worth more than what the steps give that it ends."""
    if found.reward.stays:
        return []
    dt, count = float(found.times_s[0]), len(found.times_s)
    at_goal = sum(
        term.value(x=found.reward.reached_m, v=0.0, t=dt, dt=dt)
        for term in found.reward.terms
        if term.when == "step"
    )
    bonus = max(
        sum(found.total(approach, t.name) for t in found.reward.terms if t.when == "arrival")
        for approach in APPROACHES
    )
    if at_goal > 0.0 and bonus < at_goal * (count - 1):
        return [
            f"Lingering pays: to stay beside the target gives {at_goal * (count - 1):.3g} in the "
            f"{found.reward.seconds:g} s, to reach it {bonus:.3g} once."
        ]
    return []
