"""Trained users: of a run's folder, or packed small enough to ship with the package.

A packed user is a folder with ``card.json`` (description and measured results), ``config.yaml``
(training configuration) and ``policy.pt.xz``, read without pickle: large matrices as bytes with a
scale per row, all other weights as binary16. Users that are too large for the package are fetched
from a given address (:func:`fetch_user`); ``trained_users/more.json`` has the hashes.
"""

import hashlib
import io
import json
import lzma
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property, partial
from http.client import HTTPException
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import torch
from torch import nn

from sim2vr_harness import __version__
from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError, UnusableFile, closest, reason, shown
from sim2vr_harness.base.files import file_name, read_bytes, read_json, write_atomically
from sim2vr_harness.base.finite import first_not_finite
from sim2vr_harness.base.python_classes import load_class
from sim2vr_harness.envs.resolved import ResolvedEnv, contract_hash, differences, worded
from sim2vr_harness.runs.checkpoint import (
    DAMAGE,
    in_words,
    load_policy_weights,
    read_tensors,
)
from sim2vr_harness.runs.config import (
    TrainingConfig,
    load_config,
    parse_config,
    read_mapping,
    to_yaml,
)
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.users.bodies import foreign_package

PREFIX = "pretrained:"
_CARD, _CONFIG, _WEIGHTS = "card.json", "config.yaml", "policy.pt.xz"
_MOST_FETCHED = 2**26
"""Bytes of a file of a packed user."""
_CODE = re.compile(r"\.py:\w+$")
_CARD_EXPECTED = "the card of a packed user, a JSON object with name and steps"


@dataclass(frozen=True)
class TrainedUser:
    """A policy and the settings it was trained with.

    Attributes:
        source: the checkpoint or packed weights.
        config: the configuration of the training.
        card: its description; empty for a run's checkpoint.
        evaluation_dir: default folder for its evaluations.
        load: loads the weights into a network and returns the user steps of the training.
        code: the class of a policy in a Python file; None: a network of this package.
    """

    source: Path
    config: TrainingConfig
    card: Mapping[str, Any]
    evaluation_dir: Path
    load: Callable[[nn.Module], int]
    code: type | None = None

    @cached_property
    def env(self) -> ResolvedEnv:
        """The environment of its training."""
        return ResolvedEnv(self.config.env)


def find_user(run: str | Path, *, code: bool = False) -> TrainedUser:
    """Return the trained user that is meant.

    Args:
        run: ``pretrained:NAME``, the folder of a packed user, a run's folder (its newest
            checkpoint is used), a checkpoint in one, or ``FILE.py:CLASS``, a policy in a Python
            file, which is run. The NAME of a user that ships, where there is no such file.
        code: whether this user has typed ``run``, so that a Python file that it names may run.

    Raises:
        InputError: It is none of them.
    """
    text = str(run)
    if text.startswith(PREFIX):
        return _shipped(text.removeprefix(PREFIX))
    if _CODE.search(text):
        # User that a class of a Python file stands for.
        if not code:
            expected = "--trust-app, if you know where it comes from"
            raise InputError("user", f"{text!r}, Python code that a file names", expected)
        expected = "FILE.py:CLASS, a class with config, begin, restart, act and state_dict"
        made = load_class("RUN", text, expected, lambda found: hasattr(found, "act"))
        source = Path(text.rpartition(":")[0]).expanduser()
        config = getattr(made, "config", None)
        if isinstance(config, str):
            beside = source.parent / config
            settings = load_config(beside if beside.is_file() else config)
        elif isinstance(config, Mapping):
            settings = parse_config(config)
        else:
            got = f"{text!r} with config {shown(config)}"
            wanted = "config: a configuration's name or file, or its keys, for the environment"
            raise InputError("RUN", got, wanted)
        settings = settings.model_copy(update={"name": made.__name__})
        place = Path("evaluation") / made.__name__
        return TrainedUser(source, settings, {}, place, _no_network, code=made)
    path = Path(run)
    if not path.exists():
        names = [*_places(), *more_users()]
        if text in names:
            return _shipped(text)
        if meant := closest(text, names):
            expected = f"the folder of a run, or a user that ships (did you mean {meant!r}?)"
            raise InputError("RUN", f"{text!r}, which does not exist", expected)
    if (path / _CARD).is_file():
        return open_packed(path)
    if path.is_dir() or not path.exists():
        checkpoint_folder = RunFolder.open(path)
        folder, checkpoint = checkpoint_folder, checkpoint_folder.latest_checkpoint()
    else:
        checkpoint_folder = RunFolder(path.resolve().parent.parent)
        if not checkpoint_folder.exists:
            raise InputError(
                "RUN",
                f"the file {str(path)!r}",
                "a run's folder, a file in its checkpoints folder, or pretrained:NAME",
            )
        folder, checkpoint = checkpoint_folder, path
    return TrainedUser(
        source=checkpoint,
        config=folder.load_config(),
        card={},
        evaluation_dir=folder.evaluation_dir / checkpoint.stem,
        load=partial(load_policy_weights, checkpoint),
    )


def _no_network(network: nn.Module) -> int:
    raise InputError("RUN", "a policy of a Python file", "a user whose network is of this package")


def is_packed(run: str | Path) -> bool:
    """Return True if this names a packed user: ``pretrained:NAME``, or the folder of one."""
    return str(run).startswith(PREFIX) or (Path(run) / _CARD).is_file()


def _shipped(name: str) -> TrainedUser:
    places, more = _places(), more_users()
    if name in places and name in more:
        for file, digest in more[name].items():
            _require_digest(file_name(places[name] / file), _raw(places[name] / file), digest)
    if name not in places and name in more:
        expected = f"this first: sim2vr-harness users get {name} --from FOLDER_OR_ADDRESS"
        raise InputError("RUN", f"'{PREFIX}{name}', who is not here yet", expected)
    if name not in places:
        near = closest(name, [*places, *more])
        raise InputError(
            "RUN",
            f"'{PREFIX}{name}'",
            f"one of {', '.join(PREFIX + known for known in places)}"
            + (f" (did you mean {PREFIX + near!r}?)" if near else ""),
        )
    return open_packed(places[name], evaluation_dir=Path("evaluation") / name)


def _places() -> dict[str, Path]:
    """The folders of the users that ship with the package or were fetched, by name."""
    found = {file.parent.name: file.parent for file in paths.trained_users_dir().glob(f"*/{_CARD}")}
    fetched = {name: paths.fetched_users_dir() / name for name in more_users()}
    found |= {name: folder for name, folder in fetched.items() if (folder / _CARD).is_file()}
    return dict(sorted(found.items()))


def list_cards() -> list[dict[str, Any]]:
    """The cards of the users that ship with the package or were fetched, by name."""
    return [read_json(folder / _CARD, _CARD_EXPECTED) for folder in _places().values()]


def more_users() -> dict[str, dict[str, str]]:
    """Users that can be fetched: the SHA-256 of each file by its name."""
    file = paths.trained_users_dir() / "more.json"
    users: dict[str, dict[str, str]] = read_json(file, "hashes of users, a JSON object")
    return users


def fetch_user(name: str, source: str) -> Path:
    """Fetch a user of :func:`more_users`; from then on it is ``pretrained:NAME`` as others are.

    Args:
        name: of the user.
        source: a folder, or an address that begins with ``http://`` or ``https://``, below which
            the user's files are in a folder of its name.

    Returns:
        The folder that the files are in.

    Raises:
        InputError: there is no such user, or a file cannot be read or is another one.
    """
    more = more_users()
    if name not in more:
        raise InputError("NAME", shown(name), f"one of {', '.join(more)}")
    files = {}
    for file, digest in more[name].items():
        place = f"{source.rstrip('/')}/{name}/{file}"
        if source.startswith(("http://", "https://")):
            try:
                with urlopen(place, timeout=60) as answer:
                    content = answer.read(_MOST_FETCHED)
            except (OSError, HTTPException, ValueError) as error:
                raise InputError(place, reason(error), "a file of a packed user") from error
        else:
            content = _raw(Path(place).expanduser())
        _require_digest(place, content, digest)
        files[file] = content
    folder = paths.fetched_users_dir() / name
    for file in sorted(files, key=lambda file: file == _CARD):  # the card last: it makes the user
        write_atomically(folder / file, files[file])
    return folder


def _raw(file: Path) -> bytes:
    return read_bytes(file, "a file of a packed user", most=_MOST_FETCHED, unpack=False)


def _require_digest(place: str, content: bytes, digest: str) -> None:
    found = hashlib.sha256(content).hexdigest()
    if found != digest:
        got = f"a file with SHA-256 {found[:16]}..."
        raise InputError(place, got, f"{digest[:16]}..., of the user of this version")


def open_packed(folder: Path, *, evaluation_dir: Path | None = None) -> TrainedUser:
    """Return a packed user.

    Raises:
        InputError: A file is missing or cannot be read, or the card is not of this configuration.
    """
    card = read_json(folder / _CARD, _CARD_EXPECTED)
    steps = card.get("steps")
    if not isinstance(steps, int) or not isinstance(card.get("name"), str):
        got = f"name {shown(card.get('name'))} and steps {shown(steps)}"
        raise InputError(file_name(folder / _CARD), got, _CARD_EXPECTED)
    try:
        config = parse_config(read_mapping(folder / _CONFIG))
    except InputError as error:
        file = file_name(folder / _CONFIG)
        field = error.field if error.field.startswith(file) else f"{file}: {error.field}"
        raise InputError(field, error.got, error.expected) from error
    user = TrainedUser(
        source=folder / _WEIGHTS,
        config=config,
        card=card,
        evaluation_dir=evaluation_dir or folder / "evaluation",
        load=partial(_load_packed, folder / _WEIGHTS, steps),
    )
    if foreign_package(config.env.user.model) is None:  # else the player asks first
        require_contract(user, user.env)
    return user


def require_contract(user: TrainedUser, env: ResolvedEnv) -> None:
    """Check that a user can play in an environment.

    Raises:
        InputError: Names every term of the contract that differs.
    """
    agreed = user.card.get("contract") or user.env.contract
    found = differences(env.contract, agreed)
    if found:
        have, want = worded(found)
        trained = f", which the user in {user.source.parent.name!r} was trained with"
        raise InputError("environment", have, want + trained)


def _load_packed(file: Path, steps: int, policy: nn.Module) -> int:
    weights = read_tensors(file, "weights of this network")
    try:
        first = _first_names(policy)
        chosen = {
            key: _weight(weights, first[key], value) for key, value in policy.state_dict().items()
        }
        found = first_not_finite(chosen)
        if found is not None:
            raise ValueError(f"{found} is not finite")
        policy.load_state_dict(chosen)
    except DAMAGE as error:
        raise UnusableFile(file, in_words(error), "weights of this network") from error
    return steps


_LARGE = 2**15
"""Entries of a matrix from which on it is packed as bytes; nearly all of a network's memory."""


def _as_bytes(weight: torch.Tensor) -> torch.Tensor | tuple[torch.Tensor, torch.Tensor]:
    """Return a weight as it is packed: binary16, or int8 and the float32 scale of every row."""
    if weight.dim() < 2 or weight.numel() < _LARGE:
        return weight.half()
    rows = weight.flatten(1).abs().amax(1) / 127.0
    scale = rows.clamp_min(torch.finfo(torch.float32).tiny).view(-1, *[1] * (weight.dim() - 1))
    return torch.round(weight / scale).to(torch.int8).contiguous(), scale


def _weight(weights: Mapping[str, Any], name: str, own: torch.Tensor) -> torch.Tensor:
    """Return the network's weight of that name out of a file; ValueError if it is none."""
    packed = weights.get(name)
    if not isinstance(packed, tuple) or len(packed) != 2:
        value = packed
    else:
        levels, scale = packed
        if not (isinstance(levels, torch.Tensor) and isinstance(scale, torch.Tensor)):
            value = packed
        else:
            rows = (len(levels), *[1] * (levels.dim() - 1)) if levels.dim() else ()
            if levels.dtype != torch.int8 or scale.dtype != torch.float32 or scale.shape != rows:
                value = packed
            else:
                value = levels.float() * scale
    wanted = f"expected real numbers of shape {' x '.join(map(str, own.shape)) or '1'}"
    if not isinstance(value, torch.Tensor):
        raise ValueError(f"{name}: got {shown(value, 40)}, {wanted}")
    if value.layout != torch.strided or value.is_meta or not value.is_floating_point():
        raise ValueError(f"{name}: got a tensor of {value.dtype} on {value.device}, {wanted}")
    if value.shape != own.shape:
        raise ValueError(f"{name}: got {' x '.join(map(str, value.shape)) or '1'}, {wanted}")
    return value.float()


def _first_names(policy: nn.Module) -> dict[str, str]:
    """Every weight's name -> the first name of the same memory: actor and critic share some."""
    names: dict[int, str] = {}
    return {
        key: names.setdefault(value.data_ptr(), key) for key, value in policy.state_dict().items()
    }


def pack(
    user: TrainedUser, policy: nn.Module, folder: Path, name: str, details: Mapping[str, Any]
) -> dict[str, Any]:
    """Write a trained user into ``folder``; its weights are rounded, large matrices to bytes.

    Measure what was packed, not what it was packed from: the rounding is small, but it is there.

    Args:
        user: whose settings count.
        policy: the network; its weights are loaded here.
        details: further entries of the card: description, recipe, minutes, machine, seeds, results.

    Returns:
        The card.

    Raises:
        InputError: a weight is too large for binary16.
    """
    steps = user.load(policy)
    state, kept = policy.state_dict(), set(_first_names(policy).values())
    weights = {key: state[key].detach().cpu() for key in state if key in kept}
    too_large = first_not_finite({key: weight.half() for key, weight in weights.items()})
    if too_large is not None:
        raise InputError("RUN", f"{too_large} above 65504", "weights that binary16 can hold")
    terms = user.env.contract
    stream = io.BytesIO()
    torch.save({key: _as_bytes(value) for key, value in weights.items()}, stream)
    packed = lzma.compress(stream.getvalue(), preset=9)
    card = {
        "name": name,
        "steps": steps,
        "weights_sha256": hashlib.sha256(packed).hexdigest(),
        **details,
        "contract": terms,
        "contract_hash": contract_hash(terms),
        "sim2vr_harness": __version__,
        "packed": datetime.now(UTC).date().isoformat(),
    }
    write_atomically(folder / _WEIGHTS, packed)
    write_atomically(folder / _CONFIG, to_yaml(user.config).encode())
    write_atomically(folder / _CARD, (json.dumps(card, indent=2) + "\n").encode())
    return card
