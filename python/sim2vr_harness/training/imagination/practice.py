"""Cycles of playing, learning the body, and practising in the mind."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.training.checkpoint import write_tensors
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.imagination.body import BodyModel, Experience, fit_body, mlp
from sim2vr_harness.training.imagination.whacamole import (
    CONTROLLER,
    FIELDS,
    HammerModel,
    ImaginedWhacAMole,
    Relaxation,
)
from sim2vr_harness.training.teacher_config import ImaginationConfig
from sim2vr_harness.training.teacher_env import OBSERVATION, TeacherSimulation
from sim2vr_harness.training.teacher_policy import TeacherPolicy

__all__ = ["Practice", "PracticeReport"]

STATE_FORMAT = 1
_STATE = "imagination.pt"
_WILD_KEEP = (0.0, 0.6, 0.9)
"""Of the noise from one user step to the next, in the first cycle; by user."""
_WILD_LEAST, _WILD_MOST = 0.05, 0.8
_REST_ACT, _RETURN = 0.15, 0.3
"""Activations drift back to this, by this share a user step."""


Tell = Callable[[str, float], None]
"""Is told what is being done, and which share of the cycle's time is over, more or less."""
_PLAYED, _LEARNED = 0.2, 0.4
"""Shares of a cycle's time that are over after playing, and after learning the body."""


@dataclass(frozen=True)
class PracticeReport:
    """What a cycle was like.

    Attributes:
        cycle: its number, from 1.
        step: user steps taken in the true game so far.
        updates: of the policy in the mind so far.
        played: hit rate in the true game, with noise on its actions, by condition; NaN where
            nothing came up, and in the first cycle, in which it only moves about.
        imagined: hit rate in the mind, by condition.
        worst_cell: the lowest of all cells' rates in the mind.
        place_error_m: how far the model puts the hand from where it goes in one user step.
    """

    cycle: int
    step: int
    updates: int
    played: tuple[float, ...]
    imagined: tuple[float, ...]
    worst_cell: float
    place_error_m: float


class _Critic(nn.Module):
    """What a state is worth, of the relaxed reward."""

    def __init__(self, policy: TeacherPolicy, size: int, width: int) -> None:
        super().__init__()
        self._normalise = [policy.normaliser]  # not a part of this module
        self._net = mlp(size, width, width, 1)

    def forward(self, observation: Tensor) -> Tensor:
        value: Tensor = 10.0 * self._net(self._normalise[0]({OBSERVATION: observation}))[:, 0]
        return value


class Practice:
    """Teaches a policy in the mind what the true game will ask of it.

    Args:
        config: of the practice.
        policy: what learns; its statistics of observations are set here.
        simulation: users in the true game, whose actions are changes of activation.
        seed: of everything drawn here.

    Raises:
        InputError: the policy observes something that the imagined game does not know.
    """

    def __init__(
        self,
        config: ImaginationConfig,
        policy: TeacherPolicy,
        simulation: TeacherSimulation,
        *,
        seed: int,
    ) -> None:
        self.config, self.policy, self.simulation = config, policy, simulation
        self.cycle = self.updates = 0
        self._seed = seed
        self._rng = np.random.default_rng([seed, 91])
        self._torch_seed = int(np.random.SeedSequence([seed, 92]).generate_state(1)[0])
        user = simulation.simulation.body
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._torch_seed)
            self.body = BodyModel(user, CONTROLLER, simulation.step_s, width=config.body_width)
        self.hammer = HammerModel(self.body)
        self._conditions = self._told_conditions()
        self.game = self._new_game(config.users)
        names = list(self.game.names)
        unknown = [name for name in simulation.senses.observed_names if name not in names]
        if unknown:
            raise InputError(
                "teacher.hidden_fields",
                f"patterns that leave {unknown[0]!r} to be observed",
                "only what the imagined game knows, or teacher.imagination.cycles: 0",
            )
        self._columns = [names.index(name) for name in simulation.senses.observed_names]
        size = len(self._columns)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._torch_seed + 1)
            self.critic = _Critic(policy, size, config.critic_width)
        self._slow_critic = copy.deepcopy(self.critic).requires_grad_(False)
        self._actor = [
            *policy.mlp_extractor.policy_net.parameters(),
            *policy.action_net.parameters(),
        ]
        betas = (0.8, 0.97)  # gradients change fast as the body model does
        self._optimizer = torch.optim.Adam(self._actor, lr=config.learning_rate, betas=betas)
        self._critic_optimizer = torch.optim.Adam(
            self.critic.parameters(), lr=config.critic_learning_rate
        )
        self._seen: list[Experience] = []
        self._pool: Experience | None = None
        self._near: dict[tuple[int, int], Tensor] = {}
        self._torch_state: Tensor | None = None
        self._started = False

    @property
    def finished(self) -> bool:
        """Whether all cycles are done."""
        return self.cycle >= self.config.cycles

    # --- a cycle -----------------------------------------------------------------------------

    def step(self, tell: Tell = lambda doing, share: None) -> PracticeReport:
        """Play, learn the body from it, and practise; ``tell`` is told how far it is."""
        config = self.config
        with torch.random.fork_rng(devices=[]):
            if self._torch_state is None:
                torch.manual_seed(self._torch_seed + 2)
            else:
                torch.set_rng_state(self._torch_state)
            first = self.cycle == 0
            steps = config.first_play_steps if first else config.play_steps
            new, played = self._play(steps, first, tell)
            self._seen.append(new)
            if len(self._seen) > 1 + config.kept_cycles:
                del self._seen[1]
            if first:
                self.body.acceleration.scale_by(new)
                self.hammer.calibrate(new)
            fit = fit_body(
                self.body,
                self._to_learn(),
                minibatches=config.first_fit_minibatches if first else config.fit_minibatches,
                learning_rate=4e-3 if first else 1.5e-3,
                tell=lambda share: tell(
                    "learning its body", _PLAYED + share * (_LEARNED - _PLAYED)
                ),
            )
            self._choose_pool()
            if first:
                self._fit_statistics()
                everyone = torch.arange(self.game.n)
                self._restart(everyone)
            self.game.clear_counts()
            for update in range(config.updates):
                tell("practising", _LEARNED + (1.0 - _LEARNED) * update / config.updates)
                self._update()
            imagined, worst = self._rates()
            self._learn_weights()
            self.cycle += 1
            self._torch_state = torch.get_rng_state()
        return PracticeReport(
            cycle=self.cycle,
            step=self.simulation.step_count,
            updates=self.updates,
            played=played,
            imagined=imagined,
            worst_cell=worst,
            place_error_m=fit["place_m"],
        )

    # --- playing -----------------------------------------------------------------------------

    def _play(self, steps: int, wildly: bool, tell: Tell) -> tuple[Experience, tuple[float, ...]]:
        """Let the users of the true game act, and note what happens."""
        sim, rng = self.simulation, self._rng
        users = sim.simulation.users
        joints, dofs = users.body.qpos_independent, users.body.qvel_independent
        wild = np.zeros((sim.n, users.muscle_count))
        keep = rng.choice(_WILD_KEEP, (sim.n, 1))
        size = rng.uniform(_WILD_LEAST, _WILD_MOST, (sim.n, 1))
        if not self._started:
            seeds = np.random.SeedSequence([self._seed, 93]).generate_state(sim.n, np.uint32)
            sim.reset(seeds=[int(seed) for seed in seeds])
            self._started = True
        if wildly:
            sim.explore(self.config.wild_seconds)
        columns = [sim.senses.names.index(name) for name in FIELDS]
        rows: list[tuple[NDArray[Any], ...]] = []
        counts = np.zeros((2, len(self._conditions)))

        def count(user: int, sign: float) -> None:
            log = sim.simulation.logs[user]
            for row, name in enumerate(("Points", "Misses")):
                counts[row, sim.condition_of(user)] += sign * log.get(name, 0.0)

        for user in range(sim.n):  # what was before does not count
            count(user, -1.0)

        def motion() -> tuple[NDArray[Any], ...]:
            return users.qpos[:, joints], users.qvel[:, dofs], users.act

        for step in range(steps):
            tell("playing", _PLAYED * step / steps)
            before = motion()
            if wildly:
                wild = keep * wild + np.sqrt(1.0 - keep**2) * rng.standard_normal(wild.shape)
                actions = size * wild + _RETURN * (_REST_ACT - users.act)
            else:
                mean = self.policy.act(sim.observation(), None)
                actions = mean + self.config.action_noise * rng.standard_normal(mean.shape)
            result = sim.step(actions)
            control = users.ctrl  # what the muscles were told, motor noise included
            ended = result.terminated | result.truncated
            fields = sim.senses.values()[:, columns]
            kept = ~ended & ~users.diverged
            rows.append(tuple(a[kept] for a in (*before, control, *motion(), fields)))
            for user in map(int, np.flatnonzero(ended)):
                count(user, 1.0)
            if ended.any():  # with new logs, which begin with 0
                sim.reset([int(i) for i in np.flatnonzero(ended)])
        for user in range(sim.n):
            count(user, 1.0)
        if wildly:
            sim.explore(None)
            counts[:] = 0.0
        parts = [
            torch.tensor(np.concatenate(column), dtype=torch.float32)
            for column in zip(*rows, strict=True)
        ]
        taken = Experience.of(parts)
        shown = counts.sum(0)
        rates = np.where(shown > 0.0, counts[0] / np.maximum(shown, 1.0), np.nan)
        return taken, tuple(map(float, rates))

    def _to_learn(self) -> Experience:
        """User steps to learn the body from: of the beginning, of all cycles, of the last ones."""
        first, later = self._seen[0], self._seen[1:]
        if not later:
            return first
        rest, last = Experience.joined(later), Experience.joined(later[-3:])
        count = self.config.fit_minibatches * 300
        return Experience.joined([self._some(part, count) for part in (first, rest, last)])

    @staticmethod
    def _some(steps: Experience, count: int) -> Experience:
        return steps.rows(torch.randint(len(steps), (count,)))

    # --- where practice begins ---------------------------------------------------------------

    def _choose_pool(self) -> None:
        """States to begin from: of the last cycles, and of the first, which are everywhere."""
        recent = Experience.joined(self._seen[1:][-8:] or self._seen[:1])
        first = self._some(self._seen[0], len(recent) // 2)
        self._pool = Experience.joined([recent, first])
        condition = self.game.condition_of(self._pool)
        distance, cell = self.game.nearest(self._pool.after.angles, condition)
        close = distance < self.config.near_m
        self._near = {
            (c, k): torch.nonzero(close & (condition == c) & (cell == k)).flatten()
            for c in range(len(self._conditions))
            for k in range(len(self.game.spawn_weights[0]))
        }

    def _restart(self, ids: Tensor) -> None:
        """Let users go on from states of the true game, some of them near a target."""
        assert self._pool is not None
        pool, count = self._pool, len(ids)
        rows = torch.randint(len(pool), (count,))
        cells = torch.full((count,), -1)
        for i in torch.nonzero(torch.rand(count) < self.config.near_starts).flatten().tolist():
            c = int(torch.randint(len(self._conditions), ()))
            k = int(torch.multinomial(self.game.spawn_weights[c], 1))
            there = self._near[c, k]
            if len(there):
                rows[i], cells[i] = there[int(torch.randint(len(there), ()))], k
        begin = pool.rows(rows)
        self.game.start(
            ids,
            begin.after,
            self.game.velocity_of(begin),
            self.game.condition_of(begin),
            cells,
        )

    def _told_conditions(self) -> list[dict[str, float]]:
        """What the game says of each condition, by the true rules."""
        sim = self.simulation
        return [sim.told_of(number) for number in range(len(sim.config.conditions))]

    def _new_game(self, n: int) -> ImaginedWhacAMole:
        users = self.simulation.simulation.users
        return ImaginedWhacAMole(
            users.body,
            self.body,
            self.hammer,
            self._conditions,
            n,
            single=self.config.single_targets,
            seed=self._torch_seed + 3,
            noise=None if users.noise is None else users.noise.settings,
        )

    # --- practice ----------------------------------------------------------------------------

    def _observe(self) -> Tensor:
        return self.game.observe()[:, self._columns]

    def _fit_statistics(self) -> None:
        """Mean and deviation of what is observed in states to begin from."""
        everyone = torch.arange(self.game.n)
        seen = []
        with torch.no_grad():
            for _ in range(8):
                self._restart(everyone)
                seen.append(self._observe())
        values = torch.cat(seen)
        normaliser = self.policy.normaliser
        normaliser.mean.copy_(values.mean(0))
        normaliser.variance.copy_(values.std(0).clamp(min=0.05).square())
        normaliser.count.fill_(float(len(values) * 100))

    def _relaxation(self) -> tuple[Relaxation, float]:
        """What is rewarded now, and the learning rate."""
        config = self.config
        done = self.updates / (config.updates * config.cycles)
        early = max(0.0, 1.0 - 2.0 * done)

        def towards(end: float, start: float) -> float:
            return end + (start - end) * early

        soft = Relaxation(
            overlap_m=towards(0.004, config.overlap_m),
            speed_mps=towards(0.08, config.speed_mps),
            near=towards(0.2, config.near_reward),
            distance=towards(1.0, config.distance_reward),
            effort=config.effort,
            stuck=config.stuck_cost,
        )
        return soft, config.learning_rate * min(1.0, 2.0 * (1.0 - done)) + 2e-5

    def _update(self) -> None:
        """One window of practice, and what is learned from it."""
        config, game, policy = self.config, self.game, self.policy
        soft, rate = self._relaxation()
        for group in self._optimizer.param_groups:
            group["lr"] = rate
        game.cut()
        seen, rewards = [self._observe()], []
        total = torch.zeros(())
        for t in range(config.window_steps):
            mean = policy.action_mean({OBSERVATION: seen[-1]})
            actions = mean + config.action_noise * torch.randn_like(mean)
            reward = game.step(actions, soft, error_share=config.error_share)
            reward = reward - 0.01 * torch.relu(mean.abs() - 1.0).square().sum(1)
            rewards.append(reward)
            seen.append(self._observe())
            total = total + config.gamma**t * reward
        total = total + config.gamma**config.window_steps * self._slow_critic(seen[-1])
        self._optimizer.zero_grad()
        (-total.mean() / config.window_steps).backward()
        norm = nn.utils.clip_grad_norm_(self._actor, 1.0)
        if torch.isfinite(norm) and self.updates >= config.critic_first_updates:
            self._optimizer.step()
        self._learn_values(torch.stack(seen).detach(), torch.stack(rewards).detach())
        game.cut()
        again = (torch.rand(game.n) < config.restart_share) | game.broken()
        self._restart(torch.nonzero(again).flatten())
        self.updates += 1

    def _learn_values(self, seen: Tensor, rewards: Tensor) -> None:
        """Fit the critic to the window's returns (TD(lambda))."""
        config = self.config
        steps, n = rewards.shape
        with torch.no_grad():
            values = self._slow_critic(seen.flatten(0, 1)).reshape(steps + 1, n)
            returns, following = torch.zeros_like(rewards), values[-1]
            for t in reversed(range(steps)):
                mixed = (1.0 - config.lam) * values[t + 1] + config.lam * following
                following = rewards[t] + config.gamma * mixed
                returns[t] = following
        known, worth = seen[:-1].flatten(0, 1), returns.flatten()
        for _ in range(4):
            rows = torch.randint(len(known), (min(2048, len(known)),))
            loss = (self.critic(known[rows]) - worth[rows]).square().mean()
            self._critic_optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.critic.parameters(), 50.0)
            self._critic_optimizer.step()
        with torch.no_grad():
            for slow, fast in zip(
                self._slow_critic.parameters(), self.critic.parameters(), strict=True
            ):
                slow.lerp_(fast, 0.05)

    def _rates(self) -> tuple[tuple[float, ...], float]:
        """Hit rate of every condition, cells alike, and the worst cell's."""
        counts = self.game.counts
        rates = counts[0] / counts.sum(0).clamp(min=1.0)
        return tuple(float(rate) for rate in rates.mean(1)), float(rates.min())

    def _learn_weights(self) -> None:
        """Cells that are missed come up more often, and are worth more."""
        counts, share = self.game.counts, self.config.failing_cells
        total = counts.sum(0)
        fails = torch.where(total > 0, counts[1] / total.clamp(min=1.0), torch.ones(())) + 0.02
        uniform = 1.0 / fails.shape[1]
        weights = (1.0 - share) * uniform + share * fails / fails.sum(1, keepdim=True)
        self.game.spawn_weights.lerp_(weights, 0.5)
        often = fails / fails.mean(1, keepdim=True)
        values = 1.0 + self.config.failing_value * (often.clamp(1.0, 3.0) - 1.0)
        self.game.hit_values.lerp_(values, 0.5)

    # --- exact resume ------------------------------------------------------------------------

    def save(self, folder: Path) -> None:
        """Write everything that the next cycle depends on."""
        header = {
            "format": STATE_FORMAT,
            "cycle": self.cycle,
            "updates": self.updates,
            "rng": self._rng.bit_generator.state,
        }
        write_tensors(
            folder / _STATE,
            {
                "header": json.dumps(header),
                "policy": self.policy.state_dict(),
                "body": self.body.state_dict(),
                "hammer": self.hammer.fixed,
                "critic": self.critic.state_dict(),
                "slow_critic": self._slow_critic.state_dict(),
                "optimizers": [o.state_dict() for o in (self._optimizer, self._critic_optimizer)],
                "torch": self._torch_state,
                "game": self.game.state(),
                "seen": [part.tensors() for part in self._seen],
                "simulation": torch.frombuffer(
                    bytearray(self.simulation.save_state()), dtype=torch.uint8
                ),
            },
        )

    def restore(self, folder: Path) -> bool:
        """Go on from :meth:`save`; False if nothing was saved."""
        file = folder / _STATE
        if not file.is_file():
            return False
        state = torch.load(file, weights_only=True, map_location="cpu")
        header = json.loads(state["header"])
        if header["format"] != STATE_FORMAT:
            raise RuntimeError(f"{file}: got format {header['format']}, expected {STATE_FORMAT}")
        self.cycle, self.updates = header["cycle"], header["updates"]
        self._rng.bit_generator.state = header["rng"]
        self.policy.load_state_dict(state["policy"])
        self.body.load_state_dict(state["body"])
        for parameter in self.body.parameters():
            parameter.requires_grad_(False)
        self.hammer.fixed.copy_(state["hammer"])
        self.critic.load_state_dict(state["critic"])
        self._slow_critic.load_state_dict(state["slow_critic"])
        for optimizer, values in zip(
            (self._optimizer, self._critic_optimizer), state["optimizers"], strict=True
        ):
            optimizer.load_state_dict(values)
        self._torch_state = state["torch"]
        self.game.load_state(state["game"])
        self._seen = [Experience.of(tensors) for tensors in state["seen"]]
        self.simulation.load_state(state["simulation"].numpy().tobytes())
        self._started = True
        return True

    @staticmethod
    def discard(folder: Path) -> None:
        """Delete what :meth:`save` wrote."""
        (folder / _STATE).unlink(missing_ok=True)
