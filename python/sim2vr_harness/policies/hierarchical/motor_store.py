"""Motor layers in files: those that ship with the package, and those of a run."""

import json
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError, UnusableFile
from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy, people_policy
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.runs.checkpoint import DAMAGE, in_words, read_tensors, write_tensors
from sim2vr_harness.users import Body

_FOLDER = Path(__file__).resolve().parents[2] / "motor_layers"


def save_motor_layer(file: Path, layer: MotorPolicy | HumanMotorPolicy, **known: Any) -> None:
    """Write a layer, and what is known of it."""
    header = json.dumps(layer.header() | known)
    write_tensors(file, {"header": header, "weights": dict(layer.weights())})


def shipped_layers() -> list[Path]:
    """Return the files of the layers that ship with the package."""
    return sorted(_FOLDER.glob("*.pt"))


def _header(file: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    state = read_tensors(file, "a motor layer")
    try:
        return dict(json.loads(state["header"])), dict(state["weights"])
    except (*DAMAGE, json.JSONDecodeError) as error:
        raise UnusableFile(file, in_words(error), "a motor layer") from error


def load_motor_layer(file: Path, body: Body, step_s: float) -> MotorPolicy:
    """Read a layer for a body.

    Raises:
        InputError: it is another body's, or for another action frequency.
        UnusableFile: it cannot be read.
    """
    header, weights = _header(file)
    if header.get("people"):
        raise InputError(str(file), "a human motor policy", "a motor layer, or --people")
    layer = MotorPolicy(body, step_s, width=header["width"])
    differs = _difference(header, layer.header())
    if differs:
        raise InputError(str(file), f"a motor layer whose {differs}", "one that was made for it")
    layer.take(weights)
    return layer.requires_grad_(False)


def _difference(header: dict[str, Any], wanted: dict[str, Any]) -> str | None:
    for name in ("joints", "actions", "hands", "step_s"):
        if header.get(name) != wanted[name]:
            return f"{name} differ from the body's" if name != "step_s" else "user steps differ"
    return None


def motor_layer_for(body: Body, step_s: float, *, following: bool = False) -> MotorPolicy:
    """Return the layer that ships for a body.

    Args:
        following: whether it is to follow the hands of others, for which some bodies have a layer
            of their own: it uses less force and strikes on time.

    Raises:
        InputError: there is none.
    """
    fit = []
    for file in shipped_layers():
        header, _ = _header(file)
        if header.get("body") == body.name and not header.get("people"):
            fit.append((bool(header.get("following")) != following, file))
    for _, file in sorted(fit):
        try:
            return load_motor_layer(file, body, step_s)
        except InputError:
            continue
    shipped = ", ".join(file.stem for file in shipped_layers()) or "none"
    raise InputError(
        "motor layer",
        f"none for the body {body.name!r} in steps of {step_s} s",
        f"one of those that ship ({shipped}), or a run with the stage that makes one",
    )


def load_human_policy(file: Path, user: UserConfig, step_s: float) -> HumanMotorPolicy:
    """Read a human motor policy for the persons of a configuration.

    Raises:
        InputError: it is another body's, for another action frequency, or no human motor policy.
        UnusableFile: it cannot be read.
    """
    header, weights = _header(file)
    if not header.get("people"):
        raise InputError(str(file), "a plain motor layer", "a human motor policy")
    policy = people_policy(
        user,
        step_s,
        body_width=header["body_width"],
        perception=header["perception"],
    )
    differs = _difference(header, policy.header())
    if differs:
        raise InputError(str(file), f"a motor layer whose {differs}", "one that was made for it")
    policy.take({name: values.float() for name, values in weights.items()})
    return policy.requires_grad_(False)


def human_policy_for(user: UserConfig, step_s: float) -> HumanMotorPolicy:
    """Return the human motor policy that ships for a configuration's body.

    Raises:
        InputError: there is none.
    """
    for file in shipped_layers():
        header, _ = _header(file)
        if header.get("body") == user.model and header.get("people"):
            return load_human_policy(file, user, step_s)
    raise InputError(
        "human motor policy",
        f"none for the body {user.model!r}",
        "a file (--layer, or skills.motor) of sim2vr-harness users motor train BODY --people",
    )
