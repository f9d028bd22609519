"""A quick stand-in for the simulation, with its interface and none of its physics."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from gymnasium import spaces

from sim2vr_harness.envs.resolved import ResolvedEnv


class FakeLogs(list):
    def total(self, name: str) -> float:
        return sum(log[name] for log in self)


@dataclass
class FakeStep:
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    game_reward: np.ndarray
    effort_cost: np.ndarray
    logs: FakeLogs
    infos: list[dict[str, Any]]

    @property
    def over(self) -> np.ndarray:
        return self.terminated | self.truncated

    def info(self, i: int) -> dict[str, Any]:
        return dict(self.infos[i])


class FakeApp:
    capabilities = frozenset({"save", "views"})

    def __init__(self, index: int) -> None:
        self.index = index

    def render_headset(self, width: int, height: int) -> np.ndarray:
        return np.full((height, width, 4), 40 + self.index, np.uint8)

    def render_third_person(self, width: int, height: int, view: str = "spectator") -> np.ndarray:
        return np.full((height, width, 4), 90 if view == "spectator" else 91, np.uint8)


class FakeSimulation:
    """N points that are rewarded for being pushed to a random place; episodes of 6 to 8 steps."""

    def __init__(self, config: Any = None, n: int = 1, *, log_dir: Path | None = None) -> None:
        self.n, self.log_dir = n, log_dir
        self.resolved = None if config is None else ResolvedEnv.of(config)
        self.config = None if self.resolved is None else self.resolved.config
        self.observation_space = spaces.Dict(
            {
                "vision": spaces.Box(0, 255, (2, 16, 24), np.uint8),
                "proprioception": spaces.Box(-np.inf, np.inf, (5,), np.float32),
                "stateful_information": spaces.Box(-1, 1, (1,), np.float32),
            }
        )
        self.action_space = spaces.Box(-1, 1, (3,), np.float32)
        self.apps = [FakeApp(i) for i in range(n)]
        self.body = SimpleNamespace(name="fake")
        self.users = SimpleNamespace(qpos=np.zeros((n, 4)), act=np.zeros((n, 3)))
        self.renderer_description = "fake"
        self.rngs = [np.random.default_rng() for _ in range(n)]
        self.place = np.zeros((n, 3))
        self.goal = np.zeros((n, 3))
        self.steps = np.zeros(n, np.int64)
        self.length = np.zeros(n, np.int64)
        self.hits = np.zeros(n)
        self.conditions = ["medium"] * n
        self.images = np.zeros((n, 2, 16, 24), np.uint8)
        self.fail_at: int | None = None
        self.total_steps = 0
        self.closed = False
        self.max_steps = 8

    def reset(self, ids=None, seeds=None, options=None):
        rows = list(range(self.n)) if ids is None else list(ids)
        for k, i in enumerate(rows):
            if seeds is not None and seeds[k] is not None:
                self.rngs[i] = np.random.default_rng(seeds[k])
            if options and "condition" in options:
                if options["condition"] not in ("easy", "medium", "hard"):
                    raise ValueError(
                        f"condition: got '{options['condition']}', expected easy, medium or hard"
                    )
                self.conditions[i] = options["condition"]
            self.place[i] = self.rngs[i].uniform(-1, 1, 3)
            self.goal[i] = self.rngs[i].uniform(-1, 1, 3)
            self.length[i] = self.rngs[i].integers(6, 9)
            self.steps[i] = self.hits[i] = 0
            self._see(i)
        return [{"seed": 0, "log": self._log(i)} for i in rows]

    def _see(self, i: int) -> None:
        self.images[i] = self.rngs[i].integers(0, 256, (2, 16, 24), dtype=np.uint8)

    def _log(self, i: int) -> dict[str, float]:
        hits = float(self.hits[i])
        return {"Points": hits, "Misses": float(self.steps[i]) - hits, "Contacts": 1.0}

    def observation(self):
        proprioception = np.concatenate([self.place, self.steps[:, None], self.hits[:, None]], 1)
        return {
            "vision": self.images.copy(),
            "proprioception": proprioception.astype(np.float32),
            "stateful_information": (self.steps[:, None] / 8).astype(np.float32),
        }

    def step(self, actions, resting=()):
        actions = np.asarray(actions)
        assert actions.shape == (self.n, 3)
        assert np.abs(actions).max() <= 1.0
        self.total_steps += 1
        if self.fail_at is not None and self.total_steps == self.fail_at:
            raise KeyboardInterrupt
        self.place += 0.1 * actions
        distance = np.linalg.norm(self.place - self.goal, axis=1)
        self.hits += distance < 1.0
        self.steps += 1
        effort = 0.01 * np.abs(actions).sum(axis=1)
        over = self.steps >= self.length
        truncated = over & (self.length == 8)
        infos = []
        for i in range(self.n):
            self._see(i)
            info = {"game_reward": -distance[i], "effort_cost": effort[i], "log": self._log(i)}
            if over[i]:
                info |= {"termination": "finished", "max_fatigued": 0.25}
            infos.append(info)
        logs = FakeLogs(self._log(i) for i in range(self.n))
        over_only = over & ~truncated
        return FakeStep(-distance - effort, over_only, truncated, -distance, effort, logs, infos)

    _ARRAYS = ("place", "goal", "steps", "length", "hits", "images")

    def state_dict(self) -> dict[str, Any]:
        state = {name: getattr(self, name).tolist() for name in self._ARRAYS}
        state["rngs"] = [rng.bit_generator.state for rng in self.rngs]
        return {"simulation": np.frombuffer(json.dumps(state).encode(), np.uint8)}

    def load_state_dict(self, saved: Mapping[str, Any]) -> list[int]:
        state = json.loads(np.asarray(saved["simulation"]).tobytes())
        for name in self._ARRAYS:
            getattr(self, name)[...] = state[name]
        for rng, saved in zip(self.rngs, state["rngs"], strict=True):
            rng.bit_generator.state = saved
        return []

    def close(self) -> None:
        self.closed = True


def played_by(monkeypatch: Any, simulation: Any) -> None:
    """Let every command play on this in the place of the simulation, whoever imported it first."""
    import sim2vr_harness.envs.shards
    import sim2vr_harness.envs.simulation

    for module in (sim2vr_harness.envs.simulation, sim2vr_harness.envs.shards):
        monkeypatch.setattr(module, "Simulation", simulation)
