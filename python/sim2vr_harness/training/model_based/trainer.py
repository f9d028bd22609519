"""Cycles of playing the true game, fitting the body model, and learning from imagined rollouts."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.policies.state_actor_critic import TeacherPolicy
from sim2vr_harness.runs.teacher_config import ImaginedConfig
from sim2vr_harness.training.model_based.collector import Collector
from sim2vr_harness.training.teacher.env import TeacherSimulation
from sim2vr_harness.world_models.body_dynamics import BodyModel, fit_body
from sim2vr_harness.world_models.effort import imagined_effort, volume_shares
from sim2vr_harness.world_models.gradient_clipping import limited
from sim2vr_harness.world_models.learning_device import LearningDevice
from sim2vr_harness.world_models.observation import ImaginedSenses
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import KEPT_CYCLES, TransitionStore
from sim2vr_harness.world_models.value_function import ValueFunction
from sim2vr_harness.world_models.weight_average import WeightAverage

__all__ = ["CycleReport", "ImaginedRollouts"]

STATE_FORMAT = 8
_ON_DEVICE = ("users", "game", "senses", "seen")
"""Parts of the state that are tensors of the device that learns."""
_PLAYED, _FITTED = 0.2, 0.4
"""Shares of a cycle's time that are over after playing, and after fitting the body model."""
_CRITIC_LEARNING_RATE, _LAMBDA = 1e-3, 0.9
"""Of the critic, and TD(lambda); as in the training of motor policies."""
_ERROR_SHARE = 0.3
"""Noise on the imagined motion, in units of the body model's error, so that its errors do not
count as knowledge."""
_NEAR_M = 0.12
"""Farthest that a near start is from a good start of an action."""
_BEYOND_COST = 0.01
"""Of means beyond the actions' range, squared."""

OnProgress = Callable[[str, float], None]
"""Called with what is being done, and which share of the cycle's time is over, more or less."""


@dataclass(frozen=True)
class CycleReport:
    """What a cycle was like.

    Attributes:
        cycle: its number, from 1.
        step: user steps taken in the true game so far.
        updates: of the policy so far.
        played: rate of successes in the true game, with noise on the actions, by condition; NaN
            where nothing came up, and in the first cycle, in which users move at random.
        imagined: the same in imagined rollouts.
        worst_cell: the lowest of all cells' rates in imagined rollouts.
        place_error_m: body model error: mean distance of the devices from where they go in one
            user step.
    """

    cycle: int
    step: int
    updates: int
    played: tuple[float, ...]
    imagined: tuple[float, ...]
    worst_cell: float
    place_error_m: float


class ImaginedRollouts:
    """Teaches a policy by gradients through a body model and a game's twin.

    Args:
        config: of the imagined rollouts.
        policy: what learns; its statistics of observations are set here.
        simulation: users in the true game.
        seed: of everything drawn here.
        device: that the body model and the policy learn on; the true game is played on the CPU.

    Raises:
        InputError: the policy observes something that the game's twin does not know, or the twin
            cannot be used with this user.
    """

    def __init__(
        self,
        config: ImaginedConfig,
        policy: TeacherPolicy,
        simulation: TeacherSimulation,
        *,
        seed: int,
        device: str | torch.device = "cpu",
    ) -> None:
        self.config, self.policy, self.simulation = config, policy, simulation
        self.cycle = self.updates = 0
        self._persons = ImaginedPersons(simulation.simulation)
        self._collector = Collector(config, policy, simulation, self._persons, seed=seed)
        self._torch_seed = int(np.random.SeedSequence([seed, 92]).generate_state(1)[0])
        self._device = LearningDevice(device)
        with self._device.seeded(self._torch_seed), self._device.active():
            self.body = BodyModel(
                simulation.simulation.body,
                simulation.game.devices,
                simulation.step_s,
                width=config.body_width,
                persons=self._persons,
            )
        self._conditions = [simulation.describe(k) for k in range(len(simulation.conditions))]
        with self._device.active():
            self.users, self.game = self.imagine(config.users)
            self.senses = self.imagined_senses(self.users, self.game)
        with self._device.seeded(self._torch_seed + 1), self._device.active():
            self._critic = ValueFunction(
                self.senses.size,
                config.critic_width,
                lambda observation: policy.normaliser({OBSERVATION: observation}),
                learning_rate=_CRITIC_LEARNING_RATE,
                gamma=config.gamma,
                lam=_LAMBDA,
            )
        self._actor = [
            *policy.mlp_extractor.policy_net.parameters(),
            *policy.action_net.parameters(),
        ]
        betas = (0.8, 0.97)  # gradients change fast as the body model does
        self._optimizer = torch.optim.Adam(
            self._actor, lr=config.learning_rate, betas=betas, fused=self._device.is_gpu or None
        )
        self._window = self._device.window(
            self._imagined_window, [self.users, self.game, self.senses]
        )
        self._critic_first_updates = config.critic_first_updates
        with self._device.active(policy):
            self._average = WeightAverage(self._actor, config.average_updates)
        self._seen: list[TransitionStore] = []
        self._pool: TransitionStore | None = None
        self._near: dict[tuple[int, int], Tensor] = {}
        self._random_state: list[Tensor] | None = None
        self._best: tuple[float, dict[str, Tensor]] | None = None
        """The highest rate played so far, and the weights that played it."""

    def imagine(self, n: int) -> tuple[ImaginedUsers, Any]:
        """Return N imagined users, and their rounds, an ``ImaginedRounds``."""
        users = self.simulation.simulation.users
        noise = None if users.noise is None else users.noise.settings
        game, config = self.simulation.game, self.config
        try:
            rounds = game.rounds(
                n,
                self._conditions,
                game.settings.model_validate(config.game),
                step_s=self.simulation.step_s,
                frames=self.simulation.config.frames_per_step,
                seed=self._torch_seed + 3,
                gamma=config.gamma,
            )
        except ValueError as error:
            raise InputError("teacher.imagined", str(error), "a setting that the twin knows") from (
                error
            )
        shares = volume_shares(users.body) if self.config.effort_by == "volume" else None
        effort = imagined_effort(users.effort, self.body.drives, self.config.effort, shares)
        imagined = ImaginedUsers(
            users.body,
            self.body,
            n,
            effort=effort,
            noise=noise,
            persons=self._persons,
            actuator_range_cost=self.config.actuator_range_cost,
            activation_cost=self.config.activation_cost,
            action_rate_cost=self.config.action_rate_cost,
            movement_cost=self.config.movement_cost,
        )
        return imagined, rounds

    def imagined_senses(self, users: ImaginedUsers, rounds: Any) -> ImaginedSenses:
        """Return what a policy observes of imagined users; they start when it is told so."""
        senses = self.simulation.senses
        try:
            return ImaginedSenses(senses.layout, senses.everything, users, rounds)
        except KeyError as error:
            raise InputError(
                "teacher.hidden_fields",
                f"patterns that leave {error.args[0]!r} to be observed",
                "only what the game's twin knows, or teacher.imagined.cycles: 0",
            ) from None

    @property
    def device(self) -> torch.device:
        """What learns on."""
        return self._device.device

    @property
    def finished(self) -> bool:
        """Whether all cycles are done."""
        return self.cycle >= self.config.cycles

    # --- a cycle -----------------------------------------------------------------------------

    def step(self, on_progress: OnProgress = lambda doing, share: None) -> CycleReport:
        """Play, fit the body model to it, and learn from imagined rollouts."""
        config = self.config
        with self._device.seeded(self._random_state or self._torch_seed + 2):
            first = self.cycle == 0
            self._grow()
            with self._average.in_place():
                new, played = self._collector.play(
                    config.first_play_steps if first else config.play_steps,
                    wildly=first,
                    on_progress=lambda share: on_progress("playing", _PLAYED * share),
                )
                self._keep_best(played)
            with self._device.active(self.policy):
                fit, imagined, worst = self._learn(new.to(self._device.device), on_progress)
            self.cycle += 1
            if self.finished:
                self._settle()
            self._random_state = self._device.random_state()
        return CycleReport(
            cycle=self.cycle,
            step=self.simulation.step_count,
            updates=self.updates,
            played=played,
            imagined=imagined,
            worst_cell=worst,
            place_error_m=fit["place_m"],
        )

    def _learn(
        self, new: TransitionStore, on_progress: OnProgress
    ) -> tuple[dict[str, float], tuple[float, ...], float]:
        """Fit the body model, also to new user steps, and learn from imagined rollouts.

        Returns:
            The body model's errors, and success rates as :meth:`_rates` has them.
        """
        config, first = self.config, self.cycle == 0
        self._seen.append(new)
        if len(self._seen) > 1 + KEPT_CYCLES:
            del self._seen[1]
        if first:
            self.body.scale_by(new)
            self.users.rest_as(self._seen[0].before.drives)
            self.game.calibrate(self._place(new), new.fields)
        fit = fit_body(
            self.body,
            self._to_learn(),
            minibatches=config.first_fit_minibatches if first else config.fit_minibatches,
            learning_rate=4e-3 if first else 1.5e-3,
            device=self._device,
            on_progress=lambda share: on_progress(
                "fitting the body model", _PLAYED + share * (_FITTED - _PLAYED)
            ),
        )
        self._choose_pool()
        if first:
            self._fit_statistics()
            self._restart(torch.arange(self.users.n))
        self.game.clear_counts()
        self._window.forget()  # delays, noise and costs are those of the next cycle
        for update in range(config.updates):
            share = update / config.updates
            on_progress("imagined rollouts", _FITTED + (1.0 - _FITTED) * share)
            self._update()
        rates = self._rates()
        self.game.adapt()
        return fit, *rates

    def _settle(self) -> None:
        """Let the policy be the mean of the last updates', or the one that played best."""
        self._average.settle()
        if not self.config.keep_best:
            return
        _, last = self._collector.play(
            self.config.play_steps, wildly=False, on_progress=lambda share: None
        )
        self._keep_best(last)
        if self._best is not None:
            self.policy.load_state_dict(self._best[1])

    def _keep_best(self, played: tuple[float, ...]) -> None:
        """Take note of the weights that have just been played with, if none played better.

        Rates of cycles that were easier, not as late, noisy or dear yet, say nothing of what comes.
        """
        known = [rate for rate in played if rate == rate]
        easier = self.cycle < self.config.easier_cycles
        if not self.config.keep_best or not known or easier:
            return
        rate = sum(known) / len(known)
        if self._best is None or rate > self._best[0]:
            weights = {name: value.clone() for name, value in self.policy.state_dict().items()}
            self._best = (rate, weights)

    def _grow(self) -> None:
        """Let senses be as late, imagined muscles as noisy and ways as dear as in this cycle."""
        config = self.config
        share = self._grown(config.delay_ramp_cycles, after=config.undelayed_cycles)
        self.senses.be_late(share)
        self.simulation.senses.be_late(share)
        self.users.noise_share = self._grown(config.noise_ramp_cycles)
        self.users.cost_share = self._grown(config.cost_ramp_cycles)

    def _grown(self, cycles: int, *, after: int = 0) -> float:
        """How much of what grows over so many cycles there is in this one, from 0 to 1."""
        since = self.cycle - after
        if since < 0:
            return 0.0
        return 1.0 if cycles == 0 else min(1.0, since / cycles)

    def _to_learn(self) -> TransitionStore:
        """User steps to fit the body to: of the beginning, of all cycles, of the last ones."""
        first, later = self._seen[0], self._seen[1:]
        if not later:
            return first
        rest, last = TransitionStore.joined(later), TransitionStore.joined(later[-3:])
        count = self.config.fit_minibatches * 300
        return TransitionStore.joined([self._some(part, count) for part in (first, rest, last)])

    @staticmethod
    def _some(steps: TransitionStore, count: int) -> TransitionStore:
        return steps.rows(torch.randint(len(steps), (count,)))

    # --- where imagined rollouts begin -------------------------------------------------------

    def _place(self, steps: TransitionStore) -> Tensor:
        """(K, D, 4, 4) where the devices were after user steps."""
        with torch.no_grad():
            place: Tensor = self.body.places(steps.after.angles, steps.after.persons)
        return place

    def _choose_pool(self) -> None:
        """States to begin from: of the last cycles, and of the first, which are everywhere."""
        recent = TransitionStore.joined(self._seen[1:][-8:] or self._seen[:1])
        first = self._some(self._seen[0], len(recent) // 2)
        self._pool = TransitionStore.joined([recent, first])
        condition = self.game.condition_of(self._pool.fields)
        distance, cell = self.game.nearest(self._place(self._pool), condition)
        close = distance < _NEAR_M
        self._near = {
            (c, k): torch.nonzero(close & (condition == c) & (cell == k)).flatten().cpu()
            for c in range(len(self._conditions))
            for k in range(self.simulation.game.cells)
        }

    def _restart(self, ids: Tensor) -> None:
        """Let users go on from states of the true game, some of them near a target."""
        assert self._pool is not None
        pool, count = self._pool, len(ids)
        weights = self.game.spawn_weights.cpu()
        with torch.device("cpu"):  # one number after the other
            rows = torch.randint(len(pool), (count,))
            cells = torch.full((count,), -1)
            near = torch.rand(count) < self.config.near_starts
            for i in torch.nonzero(near).flatten().tolist():
                c = int(torch.randint(len(self._conditions), ()))
                k = int(torch.multinomial(weights[c], 1))
                there = self._near[c, k]
                if len(there):
                    rows[i], cells[i] = there[int(torch.randint(len(there), ()))], k
        rows, cells = rows.to(ids.device), cells.to(ids.device)
        begin = pool.rows(rows)
        self.users.start(ids, begin.after)
        self.game.start(ids, self._place(begin), begin.fields, cells)
        self.senses.start(ids)

    # --- learning ----------------------------------------------------------------------------

    def _fit_statistics(self) -> None:
        """Mean and deviation of what is observed in states to begin from."""
        everyone = torch.arange(self.users.n)
        seen = []
        with torch.no_grad():
            for _ in range(8):
                self._restart(everyone)
                seen.append(self.senses.observe())
        values = torch.cat(seen)
        normaliser = self.policy.normaliser
        normaliser.mean.copy_(values.mean(0))
        spread = self.senses.spread(values.std(0).clamp(min=0.05))
        normaliser.variance.copy_(spread.square())
        normaliser.count.fill_(float(len(values) * 100))

    def advance(self, actions: Tensor, done: float, *, error_share: float) -> Tensor:
        """(B,) rewards of a user step of everybody; ``done`` as in ``ImaginedRounds.step``."""
        self.users.step(actions, error_share=error_share)
        reward: Tensor = self.game.step(self.users.places(self.game.frames), done)
        self.senses.look(actions)
        effort, beyond, wild = self.users.costs()
        return self.config.reward_scale * (reward - effort) - beyond - wild

    def _cut(self) -> None:
        self.users.cut()
        self.game.cut()
        self.senses.cut()

    def _act(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """(B, A) means, and actions with noise."""
        mean = self.policy.action_mean({OBSERVATION: observation})
        return mean, mean + self.config.action_noise * torch.randn_like(mean)

    def _warm_up(self, done: float) -> None:
        """Let users who have just started have a past of their own."""
        with torch.no_grad():
            for _ in range(self.senses.warm_up):
                _, actions = self._act(self.senses.observe())
                self.advance(actions, done, error_share=_ERROR_SHARE)

    def _update(self) -> None:
        """One window of imagined user steps, and what is learned from it."""
        config = self.config
        done = self._done()
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * min(1.0, 2.0 * (1.0 - done)) + 2e-5
        norm, seen, rewards = self._window()
        if torch.isfinite(norm) and self.updates >= self._critic_first_updates:
            self._optimizer.step()
            self._average.add()
        self._critic.learn(seen, rewards)
        again = (torch.rand(self.users.n, device="cpu") < config.restart_share).to(norm.device)
        self._restart(torch.nonzero(again | self.users.broken()).flatten())
        self.updates += 1

    def _done(self) -> float:
        """Share of the updates that are over."""
        return self.updates / (self.config.updates * self.config.cycles)

    def _imagined_window(self) -> tuple[Tensor, Tensor, Tensor]:
        """Imagine a window of user steps, and set the policy's gradients, clipped to length 1.

        Returns:
            Their length before that; (T + 1, B, size) what was observed; (T, B) rewards.
        """
        config, done = self.config, self._done()
        limit = config.gradient_limit
        if limit is not None:  # the loss is a mean
            limit /= config.window_steps * self.users.n
        self.users.gradient_limit = limit
        self._warm_up(done)
        self._cut()
        seen, rewards = [self.senses.present()], []
        total = torch.zeros(())
        for t in range(config.window_steps):
            mean, actions = self._act(self.senses.observe())
            if limit is not None:
                actions = limited(actions, limit)
            reward = self.advance(actions, done, error_share=_ERROR_SHARE)
            reward = reward - _BEYOND_COST * torch.relu(mean.abs() - 1.0).square().sum(1)
            rewards.append(reward)
            seen.append(self.senses.present())
            total = total + config.gamma**t * reward
        total = total + config.gamma**config.window_steps * self._critic(seen[-1])
        self._optimizer.zero_grad()
        (-total.mean() / config.window_steps).backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(self._actor, 1.0)
        self._cut()
        return norm, torch.stack(seen).detach(), torch.stack(rewards).detach()

    def _rates(self) -> tuple[tuple[float, ...], float]:
        """Rate of successes of every condition, cells alike, and the worst cell's."""
        counts = self.game.counts
        rates = counts[0] / counts.sum(0).clamp(min=1.0)
        return tuple(float(rate) for rate in rates.mean(1)), float(rates.min())

    # --- exact resume ------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Everything that the next cycle depends on; it shares weights: write it before that."""
        header = {
            "format": STATE_FORMAT,
            "cycle": self.cycle,
            "updates": self.updates,
            "rng": self._collector.rng.bit_generator.state,
        }
        return {
            "header": json.dumps(header),
            "policy": self.policy.state_dict(),
            "body": self.body.state_dict(),
            "critic": self._critic.state(),
            "optimizer": self._optimizer.state_dict(),
            "average": self._average.state(),
            "torch": self._random_state,
            "users": self.users.state(),
            "game": self.game.state(),
            "senses": self.senses.state(),
            "seen": [part.tensors() for part in self._seen],
            "best": None if self._best is None else list(self._best),
            "simulation": torch.frombuffer(
                bytearray(self.simulation.save_state()), dtype=torch.uint8
            ),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state`.

        Raises:
            ValueError: it is of another format.
        """
        header = json.loads(state["header"])
        if header["format"] != STATE_FORMAT:
            raise ValueError(f"got format {header['format']}, expected {STATE_FORMAT}")
        self.cycle, self.updates = header["cycle"], header["updates"]
        self._collector.rng.bit_generator.state = header["rng"]
        self._collector.started = True
        tensors = {name: self._device.moved(state[name]) for name in _ON_DEVICE}
        with self._device.active(self.policy):
            self.policy.load_state_dict(state["policy"])
            self.body.load_state_dict(state["body"])
            for parameter in self.body.parameters():
                parameter.requires_grad_(False)
            self._critic.load_state(state["critic"])
            self._optimizer.load_state_dict(state["optimizer"])
            self._average.load_state(state["average"])
            self.users.load_state(tensors["users"])
            self.game.load_state(tensors["game"])
            self.senses.load_state(tensors["senses"])
            self._seen = [TransitionStore.of(parts) for parts in tensors["seen"]]
            self.users.rest_as(self._seen[0].before.drives)
        random = state["torch"]
        self._random_state = [random] if isinstance(random, Tensor) else random
        self._best = None if state["best"] is None else (state["best"][0], state["best"][1])
        self.simulation.load_state(state["simulation"].numpy().tobytes())
