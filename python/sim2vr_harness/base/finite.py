"""Finiteness check of checkpoints: a diverged training stops and names the bad number."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch


class NotFinite(RuntimeError):
    """Error: the weights are no longer finite numbers; none of them were saved."""


def first_not_finite(content: Any, name: str = "") -> str | None:
    """Return the dotted name of the first number that is NaN or infinite, None without any.

    Args:
        content: tensors and plain values, in mappings and lists of any depth.
        name: of the content.
    """
    if isinstance(content, torch.Tensor):
        fine = not content.is_floating_point() or bool(torch.isfinite(content).all())
        return None if fine else name
    if isinstance(content, float):
        return None if math.isfinite(content) else name
    parts: Sequence[tuple[Any, Any]] = ()
    if isinstance(content, Mapping):
        parts = list(content.items())
    elif isinstance(content, (list, tuple)):
        parts = list(enumerate(content))
    for key, part in parts:
        found = first_not_finite(part, f"{name}.{key}" if name else str(key))
        if found is not None:
            return found
    return None


def require_finite(content: Mapping[str, Any], moment: str, last_good: Path | None) -> None:
    """Refuse what must not be saved.

    Args:
        content: what was learned, by names that people know: policy, optimizer, body model.
        moment: when that was: ``after 180 user steps``.
        last_good: the file that a resumed training goes on from; None if there is none.

    Raises:
        NotFinite: names the first number that is NaN or infinite, and the file.
    """
    found = first_not_finite(content)
    if found is not None:
        raise NotFinite(
            f"training: {found} is not finite {moment}, and none of it was saved; "
            + (
                "nothing was saved before"
                if last_good is None
                else f"the last good one is {last_good}"
            )
        )
