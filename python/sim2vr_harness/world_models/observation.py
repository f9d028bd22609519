"""Observations of imagined users: past states, delayed like their senses."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.envs.privileged import Layout
from sim2vr_harness.world_models.rollout_env import ImaginedUsers

_ACTION_SPREAD = 0.5
"""Standard deviation that actions are taken to have, in statistics of observations."""


class ImaginedSenses(State):
    """Observations of B imagined users, differentiable by all that happened since :meth:`cut`.

    Args:
        layout: of the true game's observations.
        everything: the names of all numbers of a moment in the true game, which its columns count.
        users: the bodies.
        rounds: an ``ImaginedRounds``.

    Raises:
        KeyError: the layout asks for a number that the imagined game does not know.
    """

    _state = ("_past", "_did")

    def __init__(
        self, layout: Layout, everything: Sequence[str], users: ImaginedUsers, rounds: Any
    ) -> None:
        names = [*users.names, *rounds.names]
        known = {name: column for column, name in enumerate(names)}
        self._layout = dataclasses.replace(
            layout,
            felt=torch.tensor([known[everything[i]] for i in layout.felt], dtype=torch.long),
            seen=torch.tensor([known[everything[i]] for i in layout.seen], dtype=torch.long),
        )
        columns = [*self._layout.felt.tolist(), *self._layout.seen.tolist()]
        self._whole = columns == list(range(len(names)))
        """True if an observation contains all values of a user step, in their order."""
        self._users, self._rounds, self._lag = users, rounds, layout.lag
        actions = users.actions
        self._past = [torch.zeros(users.n, len(names))] * (layout.lag.longest + 1)
        self._did = [torch.zeros(users.n, actions)] * layout.actions
        self.size = len(layout.names)
        """Numbers of an observation."""
        self.warm_up = 0 if layout.lag.none else max(layout.lag.longest, layout.actions)
        """User steps after a start until the history contains only a user's own observations."""

    def be_late(self, share: float) -> None:
        """Set the observation delay to a proportion of its full value, 1 at first."""
        self._layout = dataclasses.replace(self._layout, lag=self._lag.reached(share))

    def _now(self) -> Tensor:
        return torch.cat([self._users.observe(), self._rounds.observe(self._users.place)], 1)

    def start(self, ids: Tensor) -> None:
        """Fill the history of users (K,) with the present observation, without past actions."""
        with torch.no_grad():
            now = self._now()
            self._past = [_replaced(moment, now, ids) for moment in self._past]
            nothing = torch.zeros(self._users.n, self._users.actions)
            self._did = [_replaced(did, nothing, ids) for did in self._did]

    def look(self, actions: Tensor) -> None:
        """Take in the end of a user step, in which these (B, A) were done."""
        self._past = [*self._past[1:], self._now()]
        if self._did:
            self._did = [*self._did[1:], actions.clamp(-1.0, 1.0)]

    def observe(self) -> Tensor:
        """Return (B, size) the policy's observation."""
        lag = self._layout.lag
        return self._assembled(self._back, lag.game if lag.game == lag.body else None)

    def present(self) -> Tensor:
        """Return (B, size) the observation without delays, for a critic."""
        return self._assembled(lambda back: self._past[-1], 0)

    def _back(self, steps: int) -> Tensor:
        return self._past[-1 - steps]

    def _assembled(self, at: Any, moment: int | None) -> Tensor:
        """(B, size) observations; ``moment``: of that one alone, as ``at`` counts, or of two."""
        if self._whole and moment is not None and not self._did:
            return at(moment)
        observed: Tensor = self._layout.assemble(
            at, lambda back: self._did[-back], lambda parts: torch.cat(parts, 1)
        )
        return observed

    def spread(self, deviation: Tensor) -> Tensor:
        """(size,) standard deviations for statistics: those measured, but for the actions."""
        spread = deviation.clone()
        actions = self._layout.actions * self._users.actions
        if actions:
            spread[-actions:] = _ACTION_SPREAD
        return spread

    def cut(self) -> None:
        """Forget what led to the present: gradients end here."""
        self._past = [moment.detach() for moment in self._past]
        self._did = [did.detach() for did in self._did]


def _replaced(values: Tensor, new: Tensor, ids: Tensor) -> Tensor:
    changed = values.clone()
    changed[ids] = new[ids]
    return changed
