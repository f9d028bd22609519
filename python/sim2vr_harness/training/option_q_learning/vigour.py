"""Vigour of persons: candidates play, and what earns most is taken."""

from __future__ import annotations

from sim2vr_harness.policies.hierarchical.person_layer import PersonLayer
from sim2vr_harness.training.option_q_learning.q_learning import DECIDE_STEPS, OptionQLearning
from sim2vr_harness.training.run.stage import Callbacks

_CANDIDATES, _PLAY_S = (1.0, 6.0, 36.0), 5.0
"""What persons' weights of effort may be divided by, and seconds of play that compare them."""


def choose_vigour(learner: OptionQLearning, callbacks: Callbacks) -> None:
    """Let persons move as fast as it pays; nothing of it counts as learning.

    People move faster where rewards come more often (Yoon et al. 2018).
    """
    layer, taken, earned = learner.primitives.layer, learner.step_count, {}
    assert isinstance(layer, PersonLayer)
    callbacks.doing("vigour")
    steps = round(_PLAY_S * learner.simulation.config.action_frequency_hz)
    for vigour in _CANDIDATES:
        layer.vigour = vigour
        earned[vigour] = learner.earned(DECIDE_STEPS, steps)
        learner.step_count = taken
    layer.vigour = max(_CANDIDATES, key=lambda each: earned[each])
    learner.begin_rounds(taken, 60)
    found = ", ".join(f"{earned[each]:.2f} for {each:g}" for each in _CANDIDATES)
    callbacks.say(
        f"Reward less effort per minute by vigour: {found}. The persons': {layer.vigour:g}."
    )
