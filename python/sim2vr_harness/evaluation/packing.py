"""Pack a trained user and measure the packed user."""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.progress import progress_of_part
from sim2vr_harness.client import GameFacts, Measure
from sim2vr_harness.evaluation.curves import pack_curves
from sim2vr_harness.evaluation.evaluate import evaluate
from sim2vr_harness.evaluation.request import Request
from sim2vr_harness.play.round import measures_of
from sim2vr_harness.policies.registry import new_network
from sim2vr_harness.policies.store import TrainedUser, find_user, pack
from sim2vr_harness.runs.config import first_difference
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.runs.trust import require_trust


def pack_measured(
    run: str | Path,
    name: str,
    folder: Path,
    *,
    conditions: Sequence[str] | None,
    episodes: int,
    details: Mapping[str, Any],
    other_seeds: Sequence[str | Path] = (),
    trust_app: bool = False,
    on_progress: Callable[[float], None] = lambda share: None,
) -> dict[str, Any]:
    """Write the user of a run into ``folder``; return its card, with measured results.

    With runs of other seeds, all are measured and the median one (of an even number the lower of
    the two) is packed, by the conditions' mean score: the measure that the game names, or the
    return.

    Args:
        run: as of :func:`~sim2vr_harness.policies.store.find_user`.
        name: name of the packed user.
        folder: folder to write.
        conditions: to measure; None: the run's.
        episodes: rounds per condition.
        details: further entries of the card; information from the run need not be given.
        other_seeds: runs that differ from ``run`` in their seed alone.
        trust_app: True: the app that they name may be started, even if this user never started it
            before.
        on_progress: called with the proportion of the rounds done.

    Raises:
        InputError: A run or a number cannot be used, or runs differ in more than their seed.
    """
    users = [find_user(each) for each in (run, *other_seeds)]
    _check_seeds(users)
    for each, user in zip((run, *other_seeds), users, strict=True):
        require_trust(user.config.env, each, trust=trust_app)
    request = Request(conditions=conditions or (), episodes=episodes, steps=False, trust_app=True)
    with TemporaryDirectory() as scratch:
        cards, facts = _cards(users, Path(scratch), name, details, request, on_progress)
        seeds = sorted(cards, key=lambda seed: _mean_score(cards[seed], facts.score or "return"))
        middle = seeds[(len(seeds) - 1) // 2]
        card = cards[middle]
        if other_seeds:
            card |= {"seed": middle, "seeds": sorted(cards), "seed_results": _by_seed(cards, facts)}
        text = json.dumps(card, indent=2) + "\n"
        write_atomically(Path(scratch) / str(middle) / "card.json", text.encode())
        shutil.copytree(Path(scratch) / str(middle), folder, dirs_exist_ok=True)
    return card


def _cards(
    users: Sequence[TrainedUser],
    scratch: Path,
    name: str,
    details: Mapping[str, Any],
    request: Request,
    on_progress: Callable[[float], None],
) -> tuple[dict[int, dict[str, Any]], GameFacts]:
    """Pack users into folders named after their seeds; return seed -> card, and the game."""
    cards, facts = {}, GameFacts("")
    for number, user in enumerate(users):
        advance = progress_of_part(on_progress, number, len(users))
        cards[user.config.seed], facts = _packed(user, scratch, name, details, request, advance)
    return cards, facts


def _packed(
    user: TrainedUser,
    scratch: Path,
    name: str,
    details: Mapping[str, Any],
    request: Request,
    on_progress: Callable[[float], None],
) -> tuple[dict[str, Any], GameFacts]:
    """Pack a user into a folder named after its seed; return its measured card and the game."""
    seed = user.config.seed
    place = scratch / str(seed)
    network = new_network(user, user.env.observation_space)
    card = pack(user, network, place, name, {**_of_the_run(user), **details})
    pack_curves(user.source.parent.parent, place)
    measured = replace(request, out=scratch / f"measured_{seed}")
    found = evaluate(place, measured, on_progress=on_progress)
    results = {
        condition: {key: _rounded(summary.get(key)) for key in measured_keys(found.facts)}
        for condition, summary in found.summaries.items()
    }
    return card | {"results": results}, found.facts


def _by_seed(cards: Mapping[int, Mapping[str, Any]], facts: GameFacts) -> dict[str, Any]:
    """Return seed -> condition -> measure -> value of the cards, by :func:`seed_keys`."""
    return {
        str(seed): {
            condition: {key: row[key] for key in seed_keys(facts)}
            for condition, row in card["results"].items()
        }
        for seed, card in sorted(cards.items())
    }


def _check_seeds(users: Sequence[TrainedUser]) -> None:
    first = users[0].config
    known = {first.seed}
    for user in users[1:]:
        option, seed = f"--other-seed {user.source}", user.config.seed
        difference = first_difference(first, user.config, ignore=("seed",))
        if difference is not None:
            key, ours, theirs = difference
            raise InputError(option, f"{key}: {theirs}", f"{key}: {ours}")
        if seed in known:
            raise InputError(option, f"seed {seed} twice", "another seed")
        known.add(seed)


def measured_keys(facts: GameFacts) -> tuple[str, ...]:
    """Return the keys of an evaluation's summary that the card lists."""
    measures = (measure.name for measure in measures_of(facts))
    grids = (measure.name for measure in facts.grids)
    return ("episodes", *measures, "seed", "return_terms", *grids)


def seed_keys(facts: GameFacts) -> tuple[str, ...]:
    """Return the keys that the card lists for every seed: its measures, and its grids by cell."""
    measures = (*card_measures(facts), *facts.grids)
    return tuple(dict.fromkeys(measure.name for measure in measures))


def card_measures(facts: GameFacts) -> tuple[Measure, ...]:
    """Return the measures in a list of users: the score and the first counter of the game."""
    score = facts.score or "return"
    chosen = tuple(measure for measure in measures_of(facts) if measure.name == score)
    return (*chosen, *(measure for measure in facts.counters[:1] if measure.name != score))


def _mean_score(card: Mapping[str, Any], score: str) -> float:
    scores = [row[score] or 0.0 for row in card["results"].values()]
    return sum(scores) / len(scores)


def _of_the_run(user: TrainedUser) -> dict[str, Any]:
    """Return training information from a run's folder; empty for a packed user."""
    folder = RunFolder(user.source.parent.parent)
    if not folder.exists:
        return {}
    config, known = user.config, folder.metadata()
    sessions = [session for session in known["sessions"] if "ended" in session]
    stages = {stage: seconds / 60.0 for stage, seconds in known.get("stage_seconds", {}).items()}
    if "ppo" in stages:
        stages["from pixels"] = stages.pop("ppo")
    details: dict[str, Any] = {
        "recipe": config.recipe,
        "seeds": [config.seed],
        "minutes": round(sum(stages.values()), 1),
        "stage_minutes": {stage: round(minutes, 1) for stage, minutes in stages.items()},
    }
    if config.recipe == "distill":
        imagined = config.teacher.imagined
        plays = imagined.first_play_steps + (imagined.cycles - 1) * imagined.play_steps
        details["teacher_steps"] = plays * imagined.n_envs
        details["student_frames"] = config.student.frames
    if sessions:
        details["machine"] = (
            f"{sessions[-1]['cores']} processor cores, {sessions[-1].get('device', 'cpu')}"
        )
    return details


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return round(value, 4) if isinstance(value, float) else value
