"""The body with a trunk and a neck that move gets past every kind of wall that levels have."""

from contextlib import closing

import numpy as np

from sim2vr_harness.client import describe_level
from sim2vr_harness.envs.config import AppConfig, EffortConfig, EnvConfig, UserConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.users import ResetOptions

USERS = 6
LEVEL = {"level": "generated", "level_seconds": 10.0, "walls_per_minute": 15.0}
MOTORS = ("trunk_flexion_motor", "trunk_bending_motor", "neck_flexion_motor")
# Shares of the motors' ranges, None: as at the start. The neck keeps looking ahead as far as it
# goes, which costs a third of how low the eyes come.
DODGES = {"under": (1.0, None, 0.0), "right": (None, 1.0, None), "left": (None, 0.0, None)}
BEFORE_S, AFTER_S = 0.6, 0.1

Plan = list[tuple[float, float, str]]


def dodges(seed: int) -> Plan:
    """(from, to, how) of the walls of a level, s; a wall has an item per row that it covers."""
    found = set()
    for wall in describe_level("beats", LEVEL, seed).items:
        if wall.kind == "wall":
            half = "right" if wall.lane % 4 == 0 else "left"
            how = "under" if wall.lanes == 4 else half
            found.add((wall.time_s - BEFORE_S, wall.time_s + wall.duration_s + AFTER_S, how))
    return sorted(found)


def wanted(time_s: float, plan: Plan, upright: np.ndarray) -> np.ndarray:
    """(3,) where the motors should be."""
    for start_s, end_s, how in plan:
        if start_s <= time_s <= end_s:
            shares = zip(DODGES[how], upright, strict=True)
            return np.array([usual if share is None else share for share, usual in shares])
    return upright


def play(*, dodging: bool) -> tuple[list[dict[str, float]], set[str]]:
    """Logs of everybody at the end, and the ways of dodging that there was need for."""
    user = UserConfig(
        model="mobl_arms_bimanual_motor",
        torso=True,
        skull_rotation_deg=0.0,
        reset=ResetOptions(posture="ready", hold=True),
        effort=EffortConfig(model="neural"),
    )
    app = AppConfig(game="beats", options={**LEVEL, "end_on_miss": False}, renderer="null")
    with closing(Simulation(EnvConfig(app=app, user=user, cores=1), USERS)) as simulation:
        started = simulation.reset(seeds=list(range(USERS)))
        plans = [dodges(info["seed"]) for info in started]
        users = simulation.users
        motors = [users.body.action_names.index(name) for name in MOTORS]
        upright = users.motor[:, motors].copy()
        for frame in range(199):
            actions = np.zeros((USERS, simulation.action_space.shape[0]))
            for i, plan in enumerate(plans if dodging else ()):
                target = wanted((frame + 1) / 20.0, plan, upright[i])
                actions[i, motors] = target - users.motor[i, motors]
            simulation.step(actions)
        logs = [dict(log) for log in simulation.logs]
    return logs, {how for plan in plans for _, _, how in plan}


def test_every_kind_of_wall_can_be_dodged_from_the_trunk() -> None:
    """A wall of rows 2 and up asks the head to go 0.205 m down; eyes that keep looking ahead come
    down by 0.3 m in 0.4 s. Who sits still is in every wall."""
    logs, ways = play(dodging=True)
    assert ways == {"under", "right", "left"}
    assert sum(log["WallsAvoided"] for log in logs) == 2 * USERS
    assert sum(log["WallHits"] for log in logs) == 0.0
    still, _ = play(dodging=False)
    assert sum(log["WallHits"] for log in still) == 2 * USERS
