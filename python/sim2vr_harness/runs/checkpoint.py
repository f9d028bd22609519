"""Read and write checkpoints: zip files of weights, optimiser state and ``resume.npz``.

The parts that ``stable_baselines3.PPO.load`` reads are named as there. ``resume.npz`` holds
everything else that the next iteration depends on. Tensors, arrays and JSON are read without
pickle; the environment's state in ``resume.npz`` is unpickled with NumPy's types only.
"""

import io
import json
import random
import struct
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness import __version__
from sim2vr_harness.base import files
from sim2vr_harness.base.errors import InputError, UnusableFile, reason
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.finite import NotFinite, first_not_finite
from sim2vr_harness.base.signals import interrupts_deferred
from sim2vr_harness.runs.run_folder import checkpoints_in, step_of

FORMAT = 1
EXPECTED = "a checkpoint written by sim2vr-harness train"
RESUME = "resume.npz"
_MEMBERS = ("policy.pth", "policy.optimizer.pth", RESUME)


DAMAGE = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, RuntimeError),
    *(TypeError, ValueError, UnpicklingError, struct.error),
)
"""Exceptions that loading a decodable state of another object may raise."""


def in_words(error: Exception) -> str:
    """Return why a file cannot be used, on one line."""
    return error.got if isinstance(error, InputError) else reason(error)


def write_tensors(path: Path, content: Mapping[str, Any]) -> None:
    """Write tensors so that the file is either complete or not there."""
    stream = io.BytesIO()
    with interrupts_deferred():
        torch.save(dict(content), stream)
    write_atomically(path, stream.getvalue())


def read_tensors(path: Path, expected: str) -> dict[str, Any]:
    """Read a file of :func:`write_tensors` onto the CPU: tensors and plain values only.

    Args:
        path: the file.
        expected: description of the expected content, for error messages.

    Raises:
        UnusableFile: it is something else, or damaged.
    """
    try:
        return files.read_tensors(path, expected)
    except InputError as error:
        raise UnusableFile(path, error.got, expected) from error


def load_policy_weights(path: Path, policy: torch.nn.Module) -> int:
    """Load a checkpoint's weights into a policy and return the checkpoint's step.

    Raises:
        UnusableFile: The file is no checkpoint, is damaged or its network has other shapes.
    """
    weights, _, header, _ = good_parts(path, policy, torch.device("cpu"))
    policy.load_state_dict(weights)
    return int(header["num_timesteps"])


def write_user(path: Path, policy: torch.nn.Module, step: int) -> None:
    """Write a user that is not trained further: a checkpoint with weights and the step only."""
    archive, arrays = io.BytesIO(), io.BytesIO()
    header = {"format": FORMAT, "version": __version__, "num_timesteps": step}
    np.savez(arrays, header=np.frombuffer(json.dumps(header).encode(), dtype=np.uint8))
    contents: tuple[dict[str, Any], ...] = (dict(policy.state_dict()), {})
    with interrupts_deferred(), zipfile.ZipFile(archive, "w") as members:
        for name, content in zip(_MEMBERS, contents, strict=False):
            stream = io.BytesIO()
            torch.save(content, stream)
            members.writestr(name, stream.getvalue())
        members.writestr(RESUME, arrays.getvalue(), zipfile.ZIP_DEFLATED)
    write_atomically(path, archive.getvalue())


def require_readable(path: Path) -> None:
    """Check that a checkpoint can be read, without loading it.

    Raises:
        UnusableFile: It is damaged, or not finite.
    """
    good_parts(path, None, torch.device("cpu"))


def last_good(path: Path, policy: torch.nn.Module | None) -> Path | None:
    """Return the newest checkpoint before this one that can be read, or None.

    Args:
        path: of a checkpoint.
        policy: the network that it must fit; None: any.
    """
    before = [file for file in checkpoints_in(path.parent) if step_of(file) < step_of(path)]
    for file in reversed(before):
        with suppress(UnusableFile):
            _checked(file, policy, torch.device("cpu"))
            return file
    return None


_Parts = tuple[dict[str, torch.Tensor], dict[str, Any], dict[str, Any], dict[str, NDArray]]
"""Weights, optimiser, header and arrays of a checkpoint."""


def good_parts(path: Path, policy: torch.nn.Module | None, device: torch.device) -> _Parts:
    """Read a checkpoint; an error names the problem and the last valid checkpoint before."""
    try:
        return _checked(path, policy, device)
    except UnusableFile as error:
        instead = last_good(path, policy)
        expected = error.expected
        raise UnusableFile(path, error.reason, expected, instead) from error


def take_in(path: Path, what: str, take: Callable[[dict[str, Any]], object]) -> None:
    """Read a state that :func:`write_tensors` wrote, and pass it to ``take``.

    Raises:
        UnusableFile: it cannot be read, belongs to another object, or is not finite.
    """
    state = read_tensors(path, what)
    try:
        take(state)
    except (*DAMAGE, NotFinite) as error:
        raise UnusableFile(path, in_words(error), what) from error


def _checked(path: Path, policy: torch.nn.Module | None, device: torch.device) -> _Parts:
    """Read a checkpoint of this network; see :func:`restore`."""
    if not path.exists():
        raise InputError("RUN", f"{str(path)!r}, which does not exist", EXPECTED)
    try:
        parts = _read(path, device)
        weights, optimizer, header, _ = parts
        if header["format"] != FORMAT:
            raise ValueError(
                f"format {header['format']}, written by sim2vr-harness {header['version']}, "
                f"expected format {FORMAT}"
            )
        found = first_not_finite({"policy": weights, "optimizer": optimizer})
        if found is not None:
            raise ValueError(f"{found} is not finite")
    except DAMAGE as error:
        raise UnusableFile(path, in_words(error), EXPECTED) from error
    difference = None if policy is None else _different_network(weights, policy)
    if difference is not None:
        why = f"whose network differs: {difference}"
        raise UnusableFile(path, why, "the network of config.yaml")
    return parts


def _read(path: Path, device: torch.device) -> _Parts:
    weights, optimizer, resume = _MEMBERS
    members = files.read_members(path, _MEMBERS, EXPECTED)
    arrays = files.parse_arrays(members[resume], resume, EXPECTED)
    header = files.parse_json(arrays.pop("header").tobytes(), resume, EXPECTED)
    return (
        files.parse_tensors(members[weights], weights, EXPECTED, device),
        files.parse_tensors(members[optimizer], optimizer, EXPECTED, device),
        header,
        arrays,
    )


def _different_network(weights: Mapping[str, torch.Tensor], policy: torch.nn.Module) -> str | None:
    """Return the first weight that a network lacks, has in excess or has in another shape."""
    own = policy.state_dict()
    for name in [*own, *(name for name in weights if name not in own)]:
        have, want = weights.get(name), own.get(name)
        if have is None or want is None or have.shape != want.shape:
            shapes = ["none" if part is None else tuple(part.shape) for part in (have, want)]
            return f"{name} of shape {shapes[0]}, expected {shapes[1]}"
    return None


def random_state() -> tuple[dict[str, Any], dict[str, NDArray]]:
    """Return the state of every global random generator: a JSON header and arrays."""
    name, keys, position, has_gauss, gauss = np.random.get_state(legacy=True)  # noqa: NPY002
    python = random.getstate()
    header = {
        "python": [python[0], list(python[1]), python[2]],
        "numpy": [str(name), int(position), int(has_gauss), float(gauss).hex()],
    }
    arrays = {"random.numpy": np.array(keys), "random.torch": torch.get_rng_state().numpy().copy()}
    if torch.cuda.is_available():
        arrays["random.cuda"] = torch.cuda.get_rng_state().numpy().copy()
    return header, arrays


def set_random_state(header: dict[str, Any], arrays: dict[str, NDArray]) -> None:
    """Restore every global random generator from :func:`random_state`."""
    version, internal, gauss_next = header["python"]
    random.setstate((version, tuple(internal), gauss_next))
    name, position, has_gauss, gauss = header["numpy"]
    state = (name, arrays["random.numpy"], position, has_gauss, float.fromhex(gauss))
    np.random.set_state(state)  # noqa: NPY002
    torch.set_rng_state(torch.from_numpy(arrays["random.torch"].copy()))
    if "random.cuda" in arrays and torch.cuda.is_available():
        torch.cuda.set_rng_state(torch.from_numpy(arrays["random.cuda"].copy()))
