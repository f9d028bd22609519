"""``sim2vr-harness users motor``: train and measure motor layers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.command import CommandGroup
from sim2vr_harness.cli.options import JsonOutput, TrainedPeople, TrustedApp, print_json

if TYPE_CHECKING:
    from sim2vr_harness.runs.option_config import MotorTrainingConfig
    from sim2vr_harness.training.motor_control.goal_task import MotorTrainer
    from sim2vr_harness.training.motor_control.people_training import PeopleTrainer


@dataclass(frozen=True, kw_only=True)
class LayerRequest(TrustedApp):
    """A body, and who has it."""

    body: str = argument("BODY", "A body, or its YAML file.")
    step_s: float = option(
        "Duration of a user step.", 0.05, name="--step", metavar="S", least=0.001, most=1.0
    )
    seed: int = option("Of what is drawn.", 1, least=0)


@dataclass(frozen=True, kw_only=True)
class TrainLayerRequest(LayerRequest, TrainedPeople):
    """What to train."""

    out: Path = option("The layer's file.", MISSING, metavar="FILE.pt", place="file to write")
    begin: Path | None = option(
        "Go on from this layer, such as one that ships.",
        metavar="LAYER.pt",
        place="file to read",
    )
    set_: tuple[str, ...] = option(
        "Change the training: --set skills.motor_training.cycles=36, or cycles=36; may be "
        "repeated.",
        (),
        metavar="KEY=VALUE",
    )


@dataclass(frozen=True, kw_only=True)
class MeasureLayerRequest(LayerRequest, JsonOutput):
    """What to measure."""

    people: int | None = option(
        "N persons of a simulated population, 12 unless set (docs/concepts/people.md).",
        metavar="[N]",
        least=1,
        bare=12,
    )

    layer: Path | None = option(
        "The layer.", metavar="FILE.pt", shown="the one that ships", place="file to read"
    )
    movements: int = option("Of each kind (27 kinds).", 256, least=16, most=100_000)
    noise: bool = option("With a person's motor noise.", False)
    out: Path | None = option("Draw it into this file.", metavar="FILE.png", place="file to write")


def train_layer(request: TrainLayerRequest) -> int:
    """Train a body's motor layer; a stopped training continues.

    Examples:
        sim2vr-harness users motor train mobl_arms_wrist --out layer.pt
        sim2vr-harness users motor train mobl_arms_wrist --people --out people.pt
    """
    from sim2vr_harness.base.signals import sigterm_interrupts
    from sim2vr_harness.policies.hierarchical.motor_store import save_motor_layer
    from sim2vr_harness.runs.config import apply_overrides, parse_config
    from sim2vr_harness.runs.trust import require_trusted_body

    persons = request.people is not None
    if persons and request.begin is not None:
        raise InputError("--begin", "it together with --people", "one of them")
    require_trusted_body(request.body, request.body, trust=request.trust_app)
    config = parse_config(apply_overrides({}, _changes(request.set_))).skills.motor_training
    trainer: Any = _people_trainer(request, config) if persons else _trainer(request, config)
    out = request.out
    begun = out.with_name(out.name + ".part")
    try:
        with sigterm_interrupts():
            known = _cycles(trainer, begun)
    except KeyboardInterrupt:
        typer.echo(f"Stopped after cycle {trainer.cycle}; the same command goes on.", err=True)
        return 130
    if not persons and config.strikes:
        known["following"] = True
    policy = trainer.policy if persons else trainer.task.policy
    save_motor_layer(out, policy, body=policy.body.name, **known)
    begun.unlink(missing_ok=True)
    typer.echo(f"Written: {out}")
    return 0


def _trainer(request: TrainLayerRequest, config: MotorTrainingConfig) -> MotorTrainer:
    from sim2vr_harness.policies.hierarchical.motor_store import load_motor_layer
    from sim2vr_harness.training.motor_control.goal_task import motor_trainer
    from sim2vr_harness.users import load_body

    body, first = load_body(request.body), None
    if request.begin is not None:
        first = load_motor_layer(request.begin, body, request.step_s)
        config = config.model_copy(update={"width": first.width})
    return motor_trainer(config, body, request.step_s, seed=request.seed, begin=first)


def _people_trainer(request: TrainLayerRequest, given: MotorTrainingConfig) -> PeopleTrainer:
    from sim2vr_harness.envs.config import UserConfig
    from sim2vr_harness.envs.people_preset import as_population
    from sim2vr_harness.runs.option_config import PeopleTraining
    from sim2vr_harness.training.motor_control.people_training import PeopleTrainer

    set_here = {name: getattr(given, name) for name in given.model_fields_set}
    for name in set_here.keys() - {"cycles", "bodies"}:
        raise InputError(f"--set {name}", "it with --people", "cycles or bodies")
    user = as_population(UserConfig(model=request.body), request.count())
    return PeopleTrainer(PeopleTraining(**set_here), user, request.step_s, seed=request.seed)


def _changes(given: Sequence[str], below: str = "skills.motor_training.") -> list[str]:
    """Return overrides with whole keys; ``cycles=36`` may be short for that of the training."""
    return [change if change.lstrip().startswith(below) else below + change for change in given]


def _cycles(practice: MotorTrainer | PeopleTrainer, begun: Path) -> dict[str, Any]:
    from dataclasses import asdict

    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.runs.checkpoint import take_in, write_tensors
    from sim2vr_harness.training.motor_control.goal_task import MOTOR_STATE

    if begun.is_file():
        take_in(begun, MOTOR_STATE, practice.load_state_dict)
        typer.echo(f"Continuing after cycle {practice.cycle}.", err=True)
    known: dict[str, Any] = {}
    while not practice.finished:
        with Share(f"cycle {practice.cycle + 1} of {practice.config.cycles}") as share:
            report = practice.step(lambda doing, done: share.show(done))
        known = asdict(report)
        write_tensors(begun, practice.state_dict())
        typer.echo(report.in_words(practice.config.cycles), err=True)
    return known


def measure(request: MeasureLayerRequest) -> None:
    """Measure a motor layer: end points, speeds, effort and Fitts' law.

    With --people, a population reaches and turns rays at nine indices of difficulty each, and
    pushes.

    Examples:
        sim2vr-harness users motor measure mobl_arms_wrist
        sim2vr-harness users motor measure mobl_arms_wrist --people
    """
    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.policies.hierarchical.motor_store import load_motor_layer, motor_layer_for
    from sim2vr_harness.runs.trust import require_trusted_body
    from sim2vr_harness.training.motor_control.benchmark import measure_layer
    from sim2vr_harness.training.motor_control.benchmark_figure import draw_measures
    from sim2vr_harness.users import load_body
    from sim2vr_harness.users.noise import MotorNoiseSettings

    require_trusted_body(request.body, request.body, trust=request.trust_app)
    if request.people is not None:
        _measure_people(request)
        return
    body, file, out = load_body(request.body), request.layer, request.out
    layer = (
        motor_layer_for(body, request.step_s)
        if file is None
        else load_motor_layer(file, body, request.step_s)
    )
    noise = None
    if request.noise:
        noise = MotorNoiseSettings(signal_dependent="white", constant="white")
    with Share("Measuring movements") as share:
        measures = measure_layer(
            layer,
            noise=noise,
            bodies=request.movements,
            seed=request.seed,
            on_progress=share.show,
        )
    numbers = measures.summary()
    if out is not None:
        draw_measures(measures, f"Motor layer of {body.name}", out)
    if request.json:
        print_json(numbers)
        return
    for name, value in numbers.items():
        typer.echo(f"{name:40s} {value:.4g}")
    if out is not None:
        typer.echo(f"Written: {out}")


def _measure_people(request: MeasureLayerRequest) -> None:
    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.envs.config import UserConfig
    from sim2vr_harness.envs.people_preset import as_population
    from sim2vr_harness.policies.hierarchical.motor_store import (
        human_policy_for,
        load_human_policy,
    )
    from sim2vr_harness.training.motor_control.human_benchmark import measure_people
    from sim2vr_harness.training.motor_control.ray_benchmark import measure_rays
    from sim2vr_harness.training.motor_control.strike_benchmark import measure_strikes

    user, layer, step_s = (
        as_population(UserConfig(model=request.body)),
        request.layer,
        request.step_s,
    )
    policy = (
        human_policy_for(user, step_s) if layer is None else load_human_policy(layer, user, step_s)
    )
    kinds: dict[str, Any] = {
        "reaches": measure_people,
        "rays": measure_rays,
        "pushes": measure_strikes,
    }
    found: dict[str, float] = {}
    rows: list[str] = []
    for kind, measured in kinds.items():
        with Share(f"Measuring {kind}") as share:
            measures = measured(
                policy, user, persons=request.people, seed=request.seed, on_progress=share.show
            )
        found |= measures.summary()
        rows += measures.rows()
    if request.json:
        print_json(found)
        return
    for row in rows:
        typer.echo(row)
    for name, value in found.items():
        typer.echo(f"{name:40s} {value:.4g}")


app = CommandGroup(
    """Train and measure motor layers, which move hands to goals.

    docs/concepts/training.md explains them.

    Examples:
        sim2vr-harness users motor train mobl_arms_wrist --out layer.pt
        sim2vr-harness users motor measure mobl_arms_wrist
    """
)
app.add("train", train_layer)
app.add("measure", measure)
