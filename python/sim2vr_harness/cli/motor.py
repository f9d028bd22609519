"""``sim2vr-harness users motor``: train and measure motor layers."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.requests import TrustedApp, argument, option
from sim2vr_harness.cli.command import CommandGroup
from sim2vr_harness.cli.options import JsonOutput, TrainedPeople, print_json

if TYPE_CHECKING:
    from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
    from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
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
    seed: int = option("Seed of the random numbers.", 1, least=0)


@dataclass(frozen=True, kw_only=True)
class TrainLayerRequest(LayerRequest, TrainedPeople):
    """What to train."""

    out: Path = option("File to write.", MISSING, metavar="FILE.pt", place="file to write")
    begin: Path | None = option(
        "Continue from this motor policy.",
        metavar="POLICY.pt",
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
        "Measure N virtual participants, 12 unless set (docs/concepts/people.md).",
        metavar="[N]",
        least=1,
        bare=12,
    )

    layer: Path | None = option(
        "The motor policy.", metavar="FILE.pt", shown="the one that ships", place="file to read"
    )
    movements: int = option("Movements of each of nine kinds.", 48, least=12, most=100_000)
    noise: bool = option("With motor noise, which participants always have.", False)


def train_layer(request: TrainLayerRequest) -> int:
    """Train a body's motor policy; a stopped training continues.

    Examples:
        sim2vr-harness users motor train mobl_arms_wrist --out motor.pt
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
    changes = [
        change
        if change.lstrip().startswith("skills.motor_training.")
        else "skills.motor_training." + change
        for change in request.set_
    ]
    config = parse_config(apply_overrides({}, changes)).skills.motor_training
    trainer: Any = _people_trainer(request, config) if persons else _trainer(request, config)
    out = request.out
    begun = out.with_name(out.name + ".part")
    try:
        with sigterm_interrupts():
            practice = trainer
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


def measure(request: MeasureLayerRequest) -> None:
    """Measure aimed movements of a motor policy: Fitts' law, errors, speed profiles.

    Hands reach over three distances in three movement times. With --people, participants reach
    targets of three widths, and end their movements themselves.

    Examples:
        sim2vr-harness users motor measure mobl_arms_wrist
        sim2vr-harness users motor measure mobl_arms_wrist --people
    """
    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.envs.config import NoiseConfig, UserConfig
    from sim2vr_harness.envs.people_preset import as_population
    from sim2vr_harness.policies.hierarchical.motor_store import (
        human_policy_for,
        load_human_policy,
        load_motor_layer,
        motor_layer_for,
    )
    from sim2vr_harness.runs.trust import require_trusted_body
    from sim2vr_harness.training.motor_control.aimed_movements import measure_movements
    from sim2vr_harness.users import load_body

    require_trusted_body(request.body, request.body, trust=request.trust_app)
    user, layer, step_s = UserConfig(model=request.body), request.layer, request.step_s
    policy: HumanMotorPolicy | MotorPolicy
    if request.people is not None:
        user = as_population(user)
        policy = (
            human_policy_for(user, step_s)
            if layer is None
            else load_human_policy(layer, user, step_s)
        )
    else:
        if request.noise:
            white = NoiseConfig(signal_dependent="white", constant="white")
            user = user.model_copy(update={"noise": white})
        body = load_body(request.body)
        policy = (
            motor_layer_for(body, step_s)
            if layer is None
            else load_motor_layer(layer, body, step_s)
        )
    persons = request.people or 12
    with Share("Measuring movements") as share:
        measures = measure_movements(
            policy,
            user,
            persons=persons,
            repeats=-(-request.movements // persons),
            seed=request.seed,
            on_progress=share.show,
        )
    if request.json:
        print_json(measures.summary())
        return
    for row in measures.rows():
        typer.echo(row)
    for name, value in measures.summary().items():
        typer.echo(f"{name:40s} {value:.4g}")


app = CommandGroup(
    """Train and measure motor policies, which move hands to goals (docs/concepts/training.md).

    Examples:
        sim2vr-harness users motor train mobl_arms_wrist --out motor.pt
        sim2vr-harness users motor measure mobl_arms_wrist
    """
)
app.add("train", train_layer)
app.add("measure", measure)
