"""A trained user for programs: its policy, and the environment that it plays in."""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.gym_env import RenderMode, Sim2VREnv
from sim2vr_harness.evaluation.evaluate import Evaluation
from sim2vr_harness.evaluation.evaluate import evaluate as measure
from sim2vr_harness.evaluation.request import Request
from sim2vr_harness.play.environment import evaluation_env
from sim2vr_harness.policies.protocol import require_observation
from sim2vr_harness.policies.registry import load_policy
from sim2vr_harness.policies.store import find_user, require_contract


class UserPolicy:
    """Policy of a trained user, which computes actions from observations on the CPU.

    Args:
        run: ``pretrained:NAME`` or the NAME of a shipped user, the folder of a packed user, a
            run's folder, or one of its checkpoints.
        trust_app: True: the app that the run names may be started, even if you never started it
            before.

    Raises:
        InputError: ``run`` is none of them, or names an app that you have never started.
    """

    def __init__(self, run: str | Path, *, trust_app: bool = False) -> None:
        self._user = find_user(run, code=True)
        self.env = evaluation_env(self._user.config, source=run, trust_app=trust_app)
        """The environment that it was trained in, ready for an evaluation."""
        self.config: EnvConfig = self.env.config
        self.observation_space = self.env.observation_space
        self._policy, self.steps = load_policy(self._user, self.observation_space)
        self._rng = np.random.default_rng()
        self._run = run

    def __repr__(self) -> str:
        """Return the name, the game, the body and the user steps of the training."""
        plays = f"{self.config.app.game}, {self.config.user.model}"
        return f"UserPolicy({str(self._run)!r}: {plays}, {self.steps:,} user steps)"

    def make_env(
        self,
        condition: str | None = None,
        render_mode: RenderMode | None = None,
        config: EnvConfig | None = None,
    ) -> Sim2VREnv:
        """Return a Gymnasium environment in which the user can play.

        Args:
            condition: A condition of the game; None leaves the training's.
            render_mode: As of the environment.
            config: Another environment than its own.

        Raises:
            InputError: The user cannot play in that environment; names every difference.
        """
        env = self.env if config is None else self.env.sharing(config)
        require_contract(self._user, env)
        return Sim2VREnv(condition, env, render_mode)

    def seed(self, seed: int) -> None:
        """Fix the random numbers of the actions that follow."""
        self._rng = np.random.default_rng([seed, 1])

    def predict(
        self,
        observation: Mapping[str, NDArray[Any]],
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool | None = None,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the action for an observation, as Stable-Baselines3's models do.

        Args:
            observation: Of one user, or of N in a vector environment.
            state: The policy's state as last returned; None: rounds begin.
            episode_start: (N,) True if the round begins, which resets the state.
            deterministic: True: the mean of the policy instead of a sample; None: as in its own
                ``evaluation.deterministic``.

        Returns:
            The action in [-1, 1], (A,) or (N, A) float32, and the state; None for policies without
            a state.
        """
        if deterministic is None:
            deterministic = self._user.config.evaluation.deterministic
        rng = None if deterministic else self._rng
        wanted = {key: box.shape or () for key, box in self.observation_space.spaces.items()}
        given = {key: np.asarray(value) for key, value in observation.items()}
        alone = all(key in given and given[key].shape == wanted[key] for key in wanted)
        if not alone and any(
            key not in given or given[key].shape[1:] != wanted[key] for key in wanted
        ):
            require_observation(wanted, given)
        one = {key: given[key] for key in wanted}
        if alone:
            one = {key: value[None] for key, value in one.items()}
        count = len(next(iter(one.values())))
        memory = self._policy.begin(count) if state is None else copy.deepcopy(state)
        if state is not None and episode_start is not None:
            starts = np.asarray(episode_start, bool).reshape(-1)[:count]
            self._policy.restart(memory, np.flatnonzero(starts).tolist())
        actions = self._policy.act(one, memory, [rng] * count)
        return (actions[0] if alone else actions), memory


def load_user_policy(run: str | Path, *, trust_app: bool = False) -> UserPolicy:
    """Load a trained user: ``load_user_policy("whacamole_constrained")``.

    Args:
        run: As of :class:`UserPolicy`.
        trust_app: As of :class:`UserPolicy`.

    Raises:
        InputError: There is no such user.
    """
    return UserPolicy(run, trust_app=trust_app)


def evaluate(run: str | Path, **what: Any) -> Evaluation:
    """Play rounds with a trained user and measure it.

    For example: ``evaluate("whacamole_constrained", episodes=2)``.

    Args:
        run: As of :class:`UserPolicy`.
        what: Fields of :class:`~sim2vr_harness.evaluation.request.Request`, such as
            ``conditions``, ``episodes`` and ``out``.

    Raises:
        InputError: There is no such user, or a value cannot be used.
    """
    return measure(run, Request(**what))
