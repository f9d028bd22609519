"""Users' motion and transitions as tensors, for fitting a body model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

KEPT_CYCLES = 12
"""Cycles whose transitions are kept, beside the first: older ones come from policies long gone."""


@dataclass(frozen=True)
class Motion:
    """Motion states of B users.

    Attributes:
        angles: (B, J) angles of the independent joints, rad.
        speeds: (B, J) their speeds, rad/s.
        drives: (B, A) drives of the actuators, in [0, 1]; see
            :class:`~.actuator_state.ActuatorState`.
        persons: (B, P) the users' persons; see :class:`~.person_features.ImaginedPersons`.
    """

    angles: Tensor
    speeds: Tensor
    drives: Tensor
    persons: Tensor

    def detach(self) -> Motion:
        """Return the same states without gradient history."""
        return Motion(
            self.angles.detach(), self.speeds.detach(), self.drives.detach(), self.persons
        )

    def rows(self, ids: Tensor) -> Motion:
        """Return the states of some users."""
        return Motion(self.angles[ids], self.speeds[ids], self.drives[ids], self.persons[ids])


@dataclass(frozen=True)
class TransitionStore:
    """User steps that were taken, K of them.

    Attributes:
        before: the motion before a step.
        control: (K, A) controls of the step, as shares of their ranges.
        after: the motion after it.
        fields: (K, F) the game's privileged numbers after it.
    """

    before: Motion
    control: Tensor
    after: Motion
    fields: Tensor

    def __len__(self) -> int:
        return len(self.control)

    def tensors(self) -> list[Tensor]:
        """Everything, in the order that :meth:`of` takes."""
        before, after = self.before, self.after
        return [
            *(before.angles, before.speeds, before.drives, self.control),
            *(after.angles, after.speeds, after.drives, before.persons, self.fields),
        ]

    @staticmethod
    def of(tensors: Sequence[Tensor]) -> TransitionStore:
        """Return a store of the tensors of :meth:`tensors`."""
        q, v, drives, control, after_q, after_v, after_drives, persons, fields = tensors
        before = Motion(q, v, drives, persons)
        return TransitionStore(
            before, control, Motion(after_q, after_v, after_drives, persons), fields
        )

    def rows(self, ids: Tensor) -> TransitionStore:
        """Some of the steps."""
        return TransitionStore.of([values[ids] for values in self.tensors()])

    def to(self, device: torch.device) -> TransitionStore:
        """Return the same transitions on a device."""
        return TransitionStore.of([values.to(device) for values in self.tensors()])

    def drawn(self, count: int) -> TransitionStore:
        """Return a sample of ``count`` transitions with replacement, from torch's generator."""
        return self.rows(torch.randint(len(self), (count,)))

    @staticmethod
    def joined(parts: Sequence[TransitionStore]) -> TransitionStore:
        """Return all transitions of all parts."""
        columns = zip(*(part.tensors() for part in parts), strict=True)
        return TransitionStore.of([torch.cat(column) for column in columns])
