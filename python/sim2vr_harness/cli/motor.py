"""``sim2vr-harness users motor``: train and measure motor layers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.command import CommandGroup
from sim2vr_harness.cli.options import (
    JsonOption,
    TrustOption,
    print_json,
    readable_file,
    writable_file,
)

if TYPE_CHECKING:
    from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
    from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
    from sim2vr_harness.training.motor_control.goal_task import MotorTrainer
    from sim2vr_harness.training.motor_control.people_training import PeopleTrainer
    from sim2vr_harness.users import Body

BodyArgument = Annotated[str, typer.Argument(metavar="BODY", help="A body, or its YAML file.")]
StepOption = Annotated[
    float, typer.Option("--step", metavar="S", help="Duration of a user step.", min=0.001, max=1.0)
]
_Begin = Annotated[
    Path | None,
    typer.Option(
        metavar="LAYER.pt",
        help="Go on from this layer, such as one that ships.",
        callback=readable_file,
    ),
]
_MotorSet = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change the training: --set skills.motor_training.cycles=36, or cycles=36; may "
        "be repeated.",
    ),
]
_People = Annotated[
    bool,
    typer.Option("--people", help="Of a simulated population (docs/concepts/people.md)."),
]


def train_layer(
    body: BodyArgument,
    out: Annotated[
        Path, typer.Option(metavar="FILE.pt", help="The layer's file.", callback=writable_file)
    ],
    begin: _Begin = None,
    step_s: StepOption = 0.05,
    seed: Annotated[int, typer.Option(help="Of what is drawn.", min=0)] = 1,
    set_: _MotorSet = None,
    people: _People = False,
    trust_app: TrustOption = False,
) -> int:
    """Train a body's motor layer; a stopped training continues.

    Examples:
        sim2vr-harness users motor train mobl_arms_wrist --out layer.pt
        sim2vr-harness users motor train mobl_arms_wrist --people --out people.pt
    """
    from sim2vr_harness.base.errors import InputError

    if people:
        if begin is not None:
            raise InputError("--begin", "it together with --people", "one of them")
        return _train_people(body, out, step_s, seed, set_ or (), trust_app)
    from sim2vr_harness.base.signals import sigterm_interrupts
    from sim2vr_harness.policies.hierarchical.motor_store import load_motor_layer, save_motor_layer
    from sim2vr_harness.runs.config import apply_overrides, parse_config
    from sim2vr_harness.training.motor_control.goal_task import motor_trainer

    config = parse_config(apply_overrides({}, _changes(set_ or ()))).skills.motor_training
    of, first = _body(body, trust_app), None
    if begin is not None:
        first = load_motor_layer(begin, of, step_s)
        config = config.model_copy(update={"width": first.width})
    practice = motor_trainer(config, of, step_s, seed=seed, begin=first)
    begun = out.with_name(out.name + ".part")
    try:
        with sigterm_interrupts():
            known = _cycles(practice, begun)
    except KeyboardInterrupt:
        typer.echo(f"Stopped after cycle {practice.cycle}; the same command goes on.", err=True)
        return 130
    if config.strikes:
        known["following"] = True
    save_motor_layer(out, practice.task.policy, body=of.name, **known)
    begun.unlink(missing_ok=True)
    typer.echo(f"Written: {out}")
    return 0


def _train_people(
    body: str,
    out: Path,
    step_s: float,
    seed: int,
    changes: Sequence[str],
    trust_app: bool,
) -> int:
    """Train a human motor policy."""
    from sim2vr_harness.base.signals import sigterm_interrupts
    from sim2vr_harness.envs.config import UserConfig
    from sim2vr_harness.envs.people_preset import as_population
    from sim2vr_harness.policies.hierarchical.motor_store import save_motor_layer
    from sim2vr_harness.runs.config import apply_overrides, parse_config
    from sim2vr_harness.runs.option_config import PeopleTraining
    from sim2vr_harness.runs.trust import require_trusted_body
    from sim2vr_harness.training.motor_control.people_training import PeopleTrainer

    require_trusted_body(body, body, trust=trust_app)
    given = parse_config(apply_overrides({}, _changes(changes))).skills.motor_training
    set_here = {name: getattr(given, name) for name in given.model_fields_set}
    for name in set_here.keys() - {"cycles", "bodies"}:
        raise InputError(f"--set {name}", "it with --people", "cycles or bodies")
    config = PeopleTraining(**set_here)
    trainer = PeopleTrainer(config, as_population(UserConfig(model=body)), step_s, seed=seed)
    begun = out.with_name(out.name + ".part")
    try:
        with sigterm_interrupts():
            known = _cycles(trainer, begun)
    except KeyboardInterrupt:
        typer.echo(f"Stopped after cycle {trainer.cycle}; the same command goes on.", err=True)
        return 130
    save_motor_layer(out, trainer.policy, body=trainer.policy.body.name, **known)
    begun.unlink(missing_ok=True)
    typer.echo(f"Written: {out}")
    return 0


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


_Layer = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.pt",
        help="The layer.",
        show_default="the one that ships",
        callback=readable_file,
    ),
]


def measure(
    body: BodyArgument,
    layer: _Layer = None,
    movements: Annotated[
        int, typer.Option(help="Of each kind (9 kinds).", min=12, max=100_000)
    ] = 48,
    noise: Annotated[
        bool, typer.Option("--noise", help="With a person's motor noise; persons always have it.")
    ] = False,
    step_s: StepOption = 0.05,
    seed: Annotated[int, typer.Option(help="Of what is drawn.", min=0)] = 1,
    json: JsonOption = False,
    people: _People = False,
    trust_app: TrustOption = False,
) -> None:
    """Measure aimed movements of a motor layer: Fitts' law, errors, speed profiles.

    Hands reach over three distances in three movement times. With --people, twelve persons reach
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
    from sim2vr_harness.training.motor_control.aimed_movements import measure_movements

    found, user = _body(body, trust_app), UserConfig(model=body)
    policy: HumanMotorPolicy | MotorPolicy
    if people:
        user = as_population(user)
        policy = (
            human_policy_for(user, step_s)
            if layer is None
            else load_human_policy(layer, user, step_s)
        )
    else:
        if noise:
            white = NoiseConfig(signal_dependent="white", constant="white")
            user = user.model_copy(update={"noise": white})
        policy = (
            motor_layer_for(found, step_s)
            if layer is None
            else load_motor_layer(layer, found, step_s)
        )
    with Share("Measuring movements") as share:
        measures = measure_movements(
            policy, user, repeats=-(-movements // 12), seed=seed, on_progress=share.show
        )
    if json:
        print_json(measures.summary())
        return
    for row in measures.rows():
        typer.echo(row)
    for name, value in measures.summary().items():
        typer.echo(f"{name:40s} {value:.4g}")


def _body(name: str, trust_app: bool) -> Body:
    from sim2vr_harness.runs.trust import require_trusted_body
    from sim2vr_harness.users import load_body

    require_trusted_body(name, name, trust=trust_app)
    return load_body(name)


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
