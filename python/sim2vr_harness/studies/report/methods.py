"""The paragraph for a paper's methods section, and its citations."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from sim2vr_harness.base.errors import InputError, counted
from sim2vr_harness.base.files import read_bytes
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import contract_hash
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.studies.report.body import trained_users_of
from sim2vr_harness.studies.report.sentences import warnings_of
from sim2vr_harness.studies.report.source import ReportSource, changes_of
from sim2vr_harness.users import effort_weight

_OWN = "sim2vr-harness"
_RECORDING = {
    "python": "Python",
    "mujoco": "MuJoCo",
    "torch": "PyTorch",
    "stable-baselines3": "Stable-Baselines3",
}
"""Package -> name: what decides the numbers of a round."""
_TRAITS = {
    "stature_m": "size",
    "upper_arm_factor": "arm proportions",
    "forearm_factor": "arm proportions",
    "strength": "strength",
    "visual_delay_s": "visual delay",
    "proprioceptive_delay_s": "proprioceptive delay",
    "motor_noise": "motor noise",
    "effort_weight": "cost of effort",
    "head_movement": "head movement",
}
"""Trait -> its name in a paper."""
_ANALYSIS = {"scipy": "SciPy", "statsmodels": "statsmodels"}
"""Packages of the statistical analysis."""

BIBTEX = """@inproceedings{Fischer2024SIM2VR,
  author    = {Fischer, Florian and Ikkala, Aleksi and Klar, Markus and Fleig, Arthur and
               Bachinski, Miroslav and Murray-Smith, Roderick and
               H{\\"a}m{\\"a}l{\\"a}inen, Perttu and Oulasvirta, Antti and M{\\"u}ller, J{\\"o}rg},
  title     = {{SIM2VR}: Towards Automated Biomechanical Testing in {VR}},
  booktitle = {Proceedings of the 37th Annual ACM Symposium on User Interface Software and
               Technology (UIST '24)},
  year      = {2024},
  doi       = {10.1145/3654777.3676452}
}

@inproceedings{Ikkala2022Breathing,
  author    = {Ikkala, Aleksi and Fischer, Florian and Klar, Markus and Bachinski, Miroslav and
               Fleig, Arthur and Howes, Andrew and H{\\"a}m{\\"a}l{\\"a}inen, Perttu and
               M{\\"u}ller, J{\\"o}rg and Murray-Smith, Roderick and Oulasvirta, Antti},
  title     = {Breathing Life Into Biomechanical User Models},
  booktitle = {Proceedings of the 35th Annual ACM Symposium on User Interface Software and
               Technology (UIST '22)},
  year      = {2022},
  doi       = {10.1145/3526113.3545689}
}

@inproceedings{Todorov2012MuJoCo,
  author    = {Todorov, Emanuel and Erez, Tom and Tassa, Yuval},
  title     = {{MuJoCo}: A physics engine for model-based control},
  booktitle = {IEEE/RSJ International Conference on Intelligent Robots and Systems},
  year      = {2012},
  pages     = {5026--5033},
  doi       = {10.1109/IROS.2012.6386109}
}
"""
"""Of the method, of what it is built on, and of the simulator."""


@dataclass(frozen=True)
class PlayedBy:
    """A trained user that played.

    Attributes:
        name: As the tables have it.
        steps: User steps that it was trained for; None: the tables do not say.
        body: Name of the body.
        muscles: How many it has.
        effort: Model and weight, in words.
        contract: Hash of what the policy relies on.
        weights: First 16 digits of the SHA-256 of its weights.
        deterministic: Whether its own configuration evaluates the policy's mean; None: not known.
        differs: What participants differ in, of a population; None: not known.
    """

    name: str
    steps: int | None
    body: str = ""
    muscles: int = 0
    effort: str = ""
    contract: str = ""
    weights: str = ""
    deterministic: bool | None = None
    differs: tuple[str, ...] | None = None


def played_by(source: ReportSource) -> list[PlayedBy]:
    """Return who played; of users that cannot be found any more only what the tables say."""
    found = []
    known = {name: (user, body) for name, user, body in trained_users_of(source)}
    for name in source.users:
        rows = [group.episodes for group in source.groups if group.user == name]
        steps = rows[0]["trained_steps"].dropna()
        trained = int(steps.iloc[0]) if len(steps) else None
        if name not in known:
            found.append(PlayedBy(name, trained))
            continue
        user, body = known[name]
        env = user.config.env
        try:
            weights = hashlib.sha256(read_bytes(user.source, "weights")).hexdigest()[:16]
        except InputError:
            weights = ""
        found.append(
            PlayedBy(
                name,
                trained,
                body.name,
                len(body.muscles),
                _effort(env),
                contract_hash(user.env.contract),
                weights,
                user.config.evaluation.deterministic,
                varied_in(_played_in(source, name, env)) if source.unit == "person" else None,
            )
        )
    return found


def _actions(source: ReportSource, users: list[PlayedBy]) -> str:
    """Return how actions were chosen, and of which users that is not the usual way."""
    words = {True: "the policies' means", False: "samples of the policies"}
    used = {bool(value) for group in source.groups for value in group.episodes["deterministic"]}
    chosen = " in some groups and ".join(words[value] for value in sorted(used))
    chosen += " in others" if len(used) > 1 else ""
    other = [
        user.name
        for user in users
        if user.deterministic is not None and used != {user.deterministic}
    ]
    if other:
        chosen += f" (other than the configuration of {', '.join(other)} says)"
    return chosen


def _effort(env: EnvConfig) -> str:
    model, weight = env.user.effort.model, env.user.effort.weight
    return f"{model}, its own weight" if weight is None else f"{model}, weight {weight:g}"


def _played_in(source: ReportSource, user: str, env: EnvConfig) -> EnvConfig:
    """Return the environment of a user's first group: the training's, with its changes."""
    group = next(group for group in source.groups if group.user == user)
    changes = [change for change in changes_of(group) if not change.startswith("env.app.")]
    tree = apply_overrides({"env": env.model_dump()}, changes)["env"]
    tree["user"]["people"] = tree["user"]["people"] or {}
    return EnvConfig.model_validate(tree)


def varied_in(env: EnvConfig) -> tuple[str, ...]:
    """Return what participants of a population differ in: traits that vary and have an effect."""
    people, noise, effort = env.user.people, env.user.noise, env.user.effort
    if people is None or people.spread == 0.0:
        return ()
    late = {sense.sense for sense in env.senses if sense.delay_ms == "person"}
    acts = {
        "stature_m": True,
        "upper_arm_factor": True,
        "forearm_factor": True,
        "strength": True,
        "visual_delay_s": bool(late - {"proprioception"}),
        "proprioceptive_delay_s": "proprioception" in late,
        "motor_noise": bool(noise.signal_dependent or noise.constant),
        "effort_weight": effort_weight(effort.model, effort.weight) > 0.0,
        "head_movement": env.user.head == "reflex",
    }
    return tuple(
        dict.fromkeys(_TRAITS[name] for name in acts if acts[name] and name in people.vary)
    )


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def methods_of(source: ReportSource, users: list[PlayedBy]) -> str:
    """Return the paragraph, ready to paste."""
    groups = source.groups
    rounds = sorted({len(group.episodes) for group in groups})
    per = f"{rounds[0]} to {counted(rounds[-1], 'round')}"
    per = counted(rounds[0], "round") if len(rounds) == 1 else per
    first = groups[0].episodes
    frequency = (first["steps"] / first["duration_s"]).round(3).median()
    seeds = sorted({int(seed) for group in groups for seed in group.episodes["seed"]})
    paired = all(
        sorted(group.episodes["seed"]) == sorted(first["seed"]) for group in groups
    ) and len(groups) > 1  # fmt: skip
    conditions = list(dict.fromkeys(group.condition for group in groups))
    parts = [
        f"{_count(len(users), 'simulated user')} ({'; '.join(map(_user, users))}) played "
        f"{source.facts.name} ({', '.join(conditions)}) in {_own(source)}, in lockstep at "
        f"{frequency:g} user steps a second, {per} per group.",
        f"Round seeds were {_seeds(seeds)}{', the same in all groups' if paired else ''}; actions "
        f"were {_actions(source, users)}.",
    ]
    if source.unit == "person":
        n = len(source.units)
        told = [
            f"differ in {_and(user.differs)}" if user.differs else "do not differ"
            for user in users
            if user.differs is not None
        ]
        if not told:
            population = f"Users were virtual participants (n = {n})."
        else:
            differ = " or ".join(dict.fromkeys(told))
            population = f"Users were virtual participants (n = {n}); they {differ}."
        parts.append(population)
    parts += [f"{line[0].upper()}{line[1:]}" for line in warnings_of(source)]
    if source.search is not None:
        count = len(source.search.trials)
        parts.append(
            f"Parameters were chosen by {source.search.sampler} in {count} trials; numbers here "
            "are of the best of them."
        )
    changes = list(dict.fromkeys(c for group in groups for c in changes_of(group)))
    if changes:
        parts.append(f"Unlike in their training: {', '.join(changes)}.")
    ended = {str(end) for group in groups for end in group.episodes["ended"]} - {"finished"}
    if ended:
        parts.append(f"Some rounds ended otherwise than by the game: {', '.join(sorted(ended))}.")
    parts.append(
        f"n counts {_unit(source.unit)} (n = {len(source.units)}); a unit's value is the mean of "
        "its rounds."
    )
    if source.comparisons:
        parts.append(_tests(source))
    software = [
        *_versions(_RECORDING, source.recorded_with),
        *_versions(_ANALYSIS, [source.analysed_with]),
    ]
    if software:
        parts.append(f"Software: {', '.join(software)}.")
    return " ".join(parts)


def _tests(source: ReportSource) -> str:
    names = {
        "paired-t": "paired t tests",
        "welch-t": "Welch's t tests",
        "wilcoxon": "Wilcoxon's signed-rank test",
        "friedman": "Friedman's test",
        "mann-whitney": "Mann and Whitney's test",
        "kruskal-wallis": "Kruskal and Wallis' test",
        "mixed": "mixed models with an intercept and slopes per unit, fitted to units' means",
    }
    used = dict.fromkeys(str(r["test"]) for r in source.comparisons if r.get("refused") is None)
    if not used:
        return "No test was made: n is too small for a p value."
    text = f"Groups were compared by {', '.join(names.get(name, name) for name in used)}"
    if any(result.get("p_holm") is not None for result in source.comparisons):
        text += ", p corrected after Holm over all measures of a comparison"
    text = f"{text}; 95 % intervals of differences invert these tests, those of means are t."
    if any(result.get("unit") == "round" for result in source.comparisons):
        text += " Where it is said, units are rounds of one policy instead, no sample of people."
    return text


def _user(user: PlayedBy) -> str:
    parts = [user.name]
    if user.body:
        muscles = f", {user.muscles} muscles" if user.muscles else ""
        parts.append(f"body {user.body}{muscles}")
    if user.effort:
        parts.append(f"effort {user.effort}")
    if user.steps is not None:
        parts.append(f"trained for {user.steps:,} user steps")
    if user.contract:
        parts.append(f"contract {user.contract}")
    if user.weights:
        parts.append(f"weights {user.weights}")
    return ", ".join(parts)


def _unit(unit: str) -> str:
    words = {"person": "virtual participants", "user": "trained users"}
    return words.get(unit, f"levels of {unit}")


def _count(n: int, what: str) -> str:
    return f"One {what}" if n == 1 else f"{n} {what}s"


def _seeds(seeds: list[int]) -> str:
    if len(seeds) > 1 and seeds == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    text = ", ".join(map(str, seeds[:8]))
    return text if len(seeds) <= 8 else f"{text} and {len(seeds) - 8} more"


def _own(source: ReportSource) -> str:
    return next(_versions({_OWN: "sim2vr"}, source.recorded_with), "sim2vr")


def _versions(names: Mapping[str, str], known: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Of packages as they were then; several, where rounds were recorded with several."""
    for package, name in names.items():
        found = dict.fromkeys(versions[package] for versions in known if package in versions)
        if found:
            yield f"{name} {' and '.join(found)}"
