"""Effort of imagined users: differentiable by what their actuators do."""

from collections.abc import Callable

import torch
from torch import Tensor

from sim2vr_harness.users import Body
from sim2vr_harness.users.bodies.body import muscle_peak_force
from sim2vr_harness.users.effort import EffortModel, MuscleState, Neural, Zero
from sim2vr_harness.world_models.actuator_state import ActuatorState
from sim2vr_harness.world_models.columns import Columns

Effort = Callable[[Tensor, Tensor], Tensor]
"""(B,) cost of a user step by the drives after it and its controls, (B, A) each, in [0, 1]."""


def volume_shares(body: Body) -> Tensor:
    """(M,) volumes of the muscles, peak force times optimal length, beside their mean.

    Specific tension is taken to be the same in all of them.
    """
    model = body.physics_model
    volumes = []
    for name in body.muscles:
        i = model.actuator(name).id
        low, high = model.actuator_gainprm[i, :2]
        shortest, longest = model.actuator_lengthrange[i]
        volumes.append(muscle_peak_force(model, i) * (longest - shortest) / (high - low))
    volume = torch.tensor(volumes, dtype=torch.float32)
    return volume / volume.mean()


def imagined_effort(
    model: EffortModel, drives: ActuatorState, otherwise: float, shares: Tensor | None = None
) -> Effort:
    """Return a user's own cost of effort, exactly if it is a function of the present alone.

    Args:
        model: the users' in the true game.
        drives: of their body.
        otherwise: cost of the mean square of activations, for a model that remembers or looks at
            forces.
        shares: (M,) what muscles count in that mean; None: alike.
    """
    muscles, weight = Columns(drives.muscles, drives.count), model.weight
    low = torch.tensor(drives.low, dtype=torch.float32)
    span = torch.tensor(drives.span, dtype=torch.float32)

    def neural(after: Tensor, control: Tensor) -> Tensor:
        return weight * (low + control * span).square().sum(1)

    def muscle_state(after: Tensor, control: Tensor) -> Tensor:
        return weight * muscles(after).square().sum(1)

    def nothing(after: Tensor, control: Tensor) -> Tensor:
        return torch.zeros(len(after))

    def activations(after: Tensor, control: Tensor) -> Tensor:
        squares = muscles(after).square()
        return otherwise * (squares if shares is None else shares * squares).mean(1)

    if isinstance(model, Zero) or (not isinstance(model, Neural) and not len(muscles)):
        return nothing
    if isinstance(model, Neural):
        return neural
    return muscle_state if isinstance(model, MuscleState) else activations
