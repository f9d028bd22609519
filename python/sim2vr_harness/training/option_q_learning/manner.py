"""Durations of decisions and manners of hands: those that earn most."""

from sim2vr_harness.base.progress import View
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy
from sim2vr_harness.training.option_q_learning.q_learning import DECIDE_STEPS, OptionQLearning
from sim2vr_harness.training.run.stage import Callbacks

_HOLDS, _HOLD_S = (1, 3, 5), 128.0
"""Candidate user steps for which a choice is kept, and seconds of play of all users together that
compare them: 4 to 10 of each."""
_VIGOURS, _MANNER_S = (1.0, 6.0, 36.0), 5.0
"""What persons' weights of effort may be divided by, and seconds of play that compare manners."""


def holds() -> list[int]:
    """Return the candidate user steps for which a choice is kept."""
    return sorted({*_HOLDS, DECIDE_STEPS})


def hold_steps(users: int, steps_per_s: float) -> int:
    """Return user steps of each user that compare durations of decisions: more of few users."""
    return max(1, round(min(max(4.0, _HOLD_S / users), 10.0) * steps_per_s))


def compared_steps(steps_per_s: float, *, persons: bool) -> int:
    """Return user steps of each user that compare manners of hands."""
    return round(_MANNER_S * steps_per_s) * (2 + len(_VIGOURS) * persons)


def best_hold(learner: OptionQLearning, callbacks: Callbacks) -> int:
    """Return for how many user steps it pays to see decisions through."""
    callbacks.doing("durations of decisions")
    taken = learner.step_count
    steps = hold_steps(learner.n, learner.simulation.config.action_frequency_hz)
    tried = holds()
    earned = {}
    for number, hold in enumerate(tried):

        def show(share: float, done: int = number) -> None:
            doing = f"measuring {len(tried)} durations of decisions, {done + 1} of {len(tried)}"
            _show_end(callbacks, taken, doing, (done + share) / len(tried))

        earned[hold] = learner.earned(hold, steps, on_progress=show)
    best = max(tried, key=lambda hold: earned[hold])
    found = ", ".join(f"{earned[hold]:.2f} for {hold}" for hold in tried)
    callbacks.say(
        f"Reward per minute, less effort, by user steps of a decision: {found}. The user's: {best}."
    )
    return best


def choose_manner(learner: OptionQLearning, callbacks: Callbacks) -> None:
    """Let hands lift off before they touch if it pays, and persons move as fast as it pays.

    People move faster where rewards come more often (Yoon et al. 2018). Nothing of this counts as
    learning.
    """
    callbacks.doing("manner of hands")
    policy = learner.policy
    steps = round(_MANNER_S * learner.simulation.config.action_frequency_hz)
    hold = 1 if isinstance(policy, PersonPolicy) else DECIDE_STEPS
    by_lift, by_vigour = {}, {}
    if isinstance(policy, PersonPolicy):
        policy.vigour.fill_(_VIGOURS[1])
    for lifts in (1.0, 0.0):
        policy.lifts.fill_(lifts)
        by_lift[lifts] = learner.earned(hold, steps)
    policy.lifts.fill_(max(by_lift, key=lambda each: by_lift[each]))
    said = f"{by_lift[1.0]:.2f} if hands lift off before they touch, {by_lift[0.0]:.2f} if not"
    if isinstance(policy, PersonPolicy):
        for vigour in _VIGOURS:
            policy.vigour.fill_(vigour)
            by_vigour[vigour] = learner.earned(hold, steps)
        best = max(by_vigour, key=lambda each: by_vigour[each])
        policy.vigour.fill_(best)
        found = ", ".join(f"{by_vigour[each]:.2f} for {each:g}" for each in _VIGOURS)
        said += f"; by vigour: {found}. The persons': {best:g}"
    callbacks.say(f"Reward per minute, less effort: {said}.")
    learner.begin_rounds(learner.step_count, 60)
    learner.manner_chosen = True


def _show_end(callbacks: Callbacks, taken: int, doing: str, share: float) -> None:
    """Show how far the measurement at the end of the stage is, a line at its beginning."""
    callbacks.show(lambda: View(taken, doing), force=share == 0.0)
