"""Contributions of reward terms and effort over four ways to a target.

After SIM2VR's reward-scaling tool: worst (never nearer), linear, quadratic (1 - (1 - t)^2 of the
way) and best (there all the time), against effort of no, light, random and full activation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.config import EffortConfig
from sim2vr_harness.games.rewards import RewardTerms, Term
from sim2vr_harness.users import Body, EffortModel, make_effort

FloatArray = NDArray[np.float64]

APPROACHES = ("worst", "linear", "quadratic", "best")
EFFORTS = ("none", "light", "random", "full")
"""Activation of every muscle: 0, 0.1, drawn evenly from 0 to 1 in each step, 1."""

_LIGHT = 0.1
_BEST_MPS = 2.0
"""Speed of who is there at once: of a brisk stroke."""


@dataclass(frozen=True)
class Contributions:
    """What they come to, step by step.

    Attributes:
        reward: whose terms.
        times_s: (N,) ends of the user steps.
        distances_m: approach -> (N,) distance to the target.
        terms: approach -> term -> (N,) its part of the reward.
        efforts: kind -> (N,) cost.
        effort_name: the model.
        effort_weight: its weight.
    """

    reward: RewardTerms
    times_s: FloatArray
    distances_m: Mapping[str, FloatArray]
    terms: Mapping[str, Mapping[str, FloatArray]]
    efforts: Mapping[str, FloatArray]
    effort_name: str
    effort_weight: float

    def total(self, approach: str, term: str | None = None) -> float:
        """Sum of a term, or of all of them, over an approach."""
        parts = self.terms[approach]
        chosen = parts.values() if term is None else [parts[term]]
        return float(sum(part.sum() for part in chosen))

    def cost(self, effort: str) -> float:
        """Sum of the effort's cost."""
        return float(self.efforts[effort].sum())


def contributions(
    reward: RewardTerms,
    effort: EffortConfig,
    body: Body,
    *,
    frequency_hz: float = 20.0,
    seed: int = 1,
) -> Contributions:
    """Work them out.

    Args:
        reward: The terms.
        effort: The effort model and its weight.
        body: Whose muscles or motors it is about.
        frequency_hz: User steps per second.
        seed: Of the random activations.

    Raises:
        ValueError: The effort model has nothing to go by in this body.
        InputError: A formula has no value.
    """
    dt = 1.0 / frequency_hz
    times: FloatArray = dt * np.arange(1.0, max(2, round(reward.seconds * frequency_hz)) + 1.0)
    left = 1.0 - times / times[-1]
    shares = {"worst": np.ones(len(times)), "linear": left, "quadratic": left**2}
    distances = {name: reward.start_m * share for name, share in shares.items()}
    distances["best"] = np.zeros(len(times))
    speeds = {name: -np.diff(x, prepend=reward.start_m) / dt for name, x in distances.items()}
    speeds["best"] = np.full(len(times), _BEST_MPS)
    terms = {
        name: {
            term.name: _part(term, reward, distances[name], speeds[name], times, dt)
            for term in reward.terms
        }
        for name in APPROACHES
    }
    model = make_effort(effort.model, 1, body, dt=dt, **effort.options())
    efforts = {kind: _effort(model, body, kind, len(times), seed) for kind in EFFORTS}
    return Contributions(reward, times, distances, terms, efforts, effort.model, model.weight)


def _part(
    term: Term, reward: RewardTerms, x: FloatArray, v: FloatArray, t: FloatArray, dt: float
) -> FloatArray:
    """(N,) what a term gives in each step; who is near enough is there from that step on."""
    there = np.flatnonzero(x <= reward.reached_m + 1e-12)
    arrival = int(there[0]) if len(there) else None
    part = np.zeros(len(t))
    if term.when == "step":
        end = len(t) if reward.stays or arrival is None else arrival
        for i in range(end):
            part[i] = term.value(x=float(x[i]), v=float(v[i]), t=float(t[i]), dt=dt)
    elif term.when == "arrival" and arrival is not None:
        i = arrival
        part[i] = term.value(x=float(x[i]), v=float(v[i]), t=float(t[i]), dt=dt)
    elif term.when == "absence" and arrival is None:
        part[-1] = term.value(x=float(x[-1]), v=float(v[-1]), t=float(t[-1]), dt=dt)
    return part


def _effort(model: EffortModel, body: Body, kind: str, steps: int, seed: int) -> FloatArray:
    """(N,) cost of activations of a kind; forces are their shares of the peak forces."""
    rng = np.random.default_rng(seed)
    loads = len(body.muscles) + len(body.effort_inputs.loads)
    peaks = np.nan_to_num(body.peak_forces)
    levels = {"none": 0.0, "light": _LIGHT, "full": 1.0}
    model.reset(slice(None))
    costs = np.zeros(steps)
    for i in range(steps):
        shares = rng.random(body.action_size) if kind == "random" else levels[kind]
        ctrl = np.broadcast_to(shares, (1, body.action_size)).astype(np.float64)
        act = np.resize(ctrl, (1, loads)) if loads else np.zeros((1, 0))
        costs[i] = model.update(act, ctrl, force=ctrl * peaks)[0]
    return costs
