"""``sim2vr-harness users endurance``: how long a user can hold a posture."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING

import typer

from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.options import ChangedEnvironment, JsonOutput, TrustedApp, print_json

if TYPE_CHECKING:
    from sim2vr_harness.tools.endurance import Held


@dataclass(frozen=True, kw_only=True)
class EnduranceRequest(ChangedEnvironment, JsonOutput, TrustedApp):
    """Which posture to hold, and who holds it."""

    user: str = argument("USER", "A body or its YAML file, a configuration, or a trained user.")
    pose: str = option(
        "The posture; other joints stay where episodes start. A joint without _r or _l is that of "
        "both arms.",
        MISSING,
        metavar="JOINT=DEGREES,...",
    )
    load: float = option("Mass in each hand, kg, beside the controller.", 0.0)
    people: int | None = option(
        "Let so many persons of the user's population hold it, 1 to 200.", metavar="N"
    )


def endurance(request: EnduranceRequest) -> None:
    """Say how long a posture can be held, by three models of exertion.

    Examples:
        sim2vr-harness users endurance mobl_arms_wrist --pose shoulder_elv=60
        sim2vr-harness users endurance whacamole_people --pose elv_angle=45
    """
    from dataclasses import asdict

    from sim2vr_harness.tools.endurance import hold, who_hold
    from sim2vr_harness.tools.users import environment_of

    user, pose, load = request.user, request.pose, request.load
    environment = environment_of(user, overrides=request.set_, trust_app=request.trust_app)
    held = [hold(who, pose, load, own) for who, own in who_hold(environment.user, request.people)]
    if request.json:
        persons = [[_plain(asdict(arm)) for arm in person] for person in held]
        print_json({"user": user, "pose": pose, "load_kg": load, "persons": persons})
        return
    for arms in zip(*held, strict=True):
        _tell(arms, load)


def _plain(values: dict[str, object]) -> dict[str, object]:
    """Endless endurance is null: JSON has no infinity."""
    times = values["endurance_s"]
    assert isinstance(times, dict)
    finite_times = {name: time if time < float("inf") else None for name, time in times.items()}
    return {**values, "endurance_s": finite_times}


def _tell(arms: tuple[Held, ...], load: float) -> None:
    first = arms[0]
    many = f", {len(arms)} persons: median (least to most)" if len(arms) > 1 else ""
    typer.echo(
        f"{first.side.capitalize()} arm, shoulder {first.shoulder_deg:.0f}, elbow "
        f"{first.elbow_deg:.0f} degrees, {load:g} kg in the hand{many}"
    )
    shares = [float("inf") if arm.share is None else arm.share for arm in arms]
    rows = {
        "torque at the shoulder (Nm)": _spread([arm.torque_nm for arm in arms], 1),
        "share of maximum at the shoulder": _spread(shares, 2, "too weak"),
        "share of published strength": _spread([arm.strength_share for arm in arms], 2),
    }
    for name in first.endurance_s:
        times = [arm.endurance_s[name] for arm in arms]
        rows[f"exhausted by {name} (s)"] = _spread(times, 0, "endless")
    for label, text in rows.items():
        typer.echo(f"  {label:40} {text}")
    if len(arms) == 1 and first.activations:
        most = sorted(first.activations.items(), key=lambda item: -item[1])[:4]
        typer.echo("  most active: " + ", ".join(f"{name} {value:.2f}" for name, value in most))


def _spread(values: list[float], digits: int, infinite: str = "") -> str:
    """The median, with the extremes of several."""

    def text(value: float) -> str:
        return infinite if value == float("inf") else f"{value:.{digits}f}"

    ordered = sorted(values)
    middle, even = divmod(len(ordered), 2)
    median = ordered[middle] if even else (ordered[middle - 1] + ordered[middle]) / 2.0
    if len(ordered) == 1:
        return text(median)
    return f"{text(median)} ({text(ordered[0])} to {text(ordered[-1])})"
