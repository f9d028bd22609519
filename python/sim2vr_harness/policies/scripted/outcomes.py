"""Outcomes of scripted steps, in words and for JSON."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sim2vr_harness.policies.scripted.hand import By

_SAME_DEG = 1.0
"""An app's own ray that is nearer to the controller's aim ray is the same."""


@dataclass
class StepOutcome:
    """Result of a step.

    Attributes:
        step: As written.
        done: Whether the hand arrived at every place and operated its inputs.
        by: ``touch`` or ``ray``.
        arrived_s: Seconds until the hand or its ray was on the place and stayed there.
        gap_m: Of a touch: distance from the place on arrival, or the least one without arrival.
        angle_deg: By ray: angle between the ray and the place, in the same way.
        time_s: Seconds until the inputs were operated, or until the arrival; for a participant from
            the previous press, which may have spawned the target, else from the start of the step.
        missed: Whether hand or ray were beside the object at that time, by more than half its
            width, and a touched one did not react.
        head_deg: At that time: how far the head is bent forward and turned aside, and the angle
            between where it faces and the object, which the eyes bridge.
        ray_off_deg: By ray: angle between the app's own ray and the controller's aim ray.
        inputs: Inputs that were operated.
        moved_s: As ``arrived_s``, of the second place of ``grab``.
        moved_gap_m: As ``gap_m``, of the second place of ``grab``.
        object_moved_m: Largest distance of the object of ``grab`` from its first place.
        changed: Value -> before and after, of those that changed.
        watched: Values that could have changed.
        problem: The reason why the step is not done; empty otherwise.
    """

    step: str
    by: By = "touch"
    hand: str = "right"
    done: bool = False
    arrived_s: float | None = None
    gap_m: float | None = None
    angle_deg: float | None = None
    time_s: float | None = None
    missed: bool = False
    head_deg: tuple[float, float, float] | None = None
    ray_off_deg: float | None = None
    inputs: tuple[str, ...] = ()
    moved_s: float | None = None
    moved_gap_m: float | None = None
    object_moved_m: float | None = None
    changed: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    watched: tuple[str, ...] = ()
    problem: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        changed = {name: list(pair) for name, pair in self.changed.items()}
        rest = {"inputs": list(self.inputs), "watched": list(self.watched)}
        return {**vars(self), **rest, "changed": changed}

    @property
    def words(self) -> str:
        """Return a line for people."""
        parts = [f"{self.hand} {'ray' if self.by == 'ray' else 'hand'} {self._arrival}"]
        if self.inputs:
            parts.append(f"{' and '.join(self.inputs)} pressed")
        if self.moved_gap_m is not None:
            after = "" if self.moved_s is None else f" after {self.moved_s:.1f} s"
            parts.append(f"moved to within {100 * self.moved_gap_m:.1f} cm{after}")
        if self.object_moved_m is not None:
            parts.append(f"the object moved by {100 * self.object_moved_m:.1f} cm")
        text = f"{self.step}: " + ("" if self.arrived_s is None else ", ".join(parts))
        if self.problem:
            text += ("; " if self.arrived_s is not None else "") + self.problem
        return f"{text}; {self._reaction}" if self.done or self.inputs else text

    @property
    def _arrival(self) -> str:
        after = "" if self.arrived_s is None else f" after {self.arrived_s:.1f} s"
        if self.by == "ray":
            near = f"within {self.angle_deg or 0.0:.1f} degrees{after}"
            if (self.ray_off_deg or 0.0) < _SAME_DEG:
                return near
            return f"{near} (the page's own ray, {self.ray_off_deg:.0f} degrees from WebXR's)"
        return f"within {100 * (self.gap_m or 0.0):.1f} cm{after}"

    @property
    def _reaction(self) -> str:
        if self.changed:
            pairs = self.changed.items()
            return ", ".join(f"{name} {old:.4g} -> {new:.4g}" for name, (old, new) in pairs)
        if not self.watched:
            return "no values to compare (name some in the task)"
        return f"nothing changed ({', '.join(self.watched)})"
