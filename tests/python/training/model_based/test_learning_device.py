"""Imagined rollouts on a GPU: what is captured reads no values, and runs as it does eagerly."""

from typing import Any

import pytest
import torch
from tiny_game_training import new_rollouts, short_teacher
from torch.utils._python_dispatch import TorchDispatchMode

from parts import needs


class _Recorder(TorchDispatchMode):
    """Notes operations that a captured graph cannot have: they wait for values, or bring some."""

    FORBIDDEN = ("_local_scalar_dense", "nonzero", "masked_select", "lift_fresh")

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()
        self.count = 0

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Any = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        self.count += 1
        self.found |= {name for name in self.FORBIDDEN if name in str(func)}
        indices = args[1] if "index" in str(func) and len(args) > 1 else ()
        if isinstance(indices, (list, tuple)):
            masks = (each for each in indices if isinstance(each, torch.Tensor))
            self.found |= {"a mask" for each in masks if each.dtype == torch.bool}
        return func(*args, **(kwargs or {}))


def test_a_window_reads_no_values() -> None:
    with short_teacher():
        made = new_rollouts()
        made.step()
    with _Recorder() as recorder:
        made._imagined_window()
        torch.zeros(3)[torch.tensor([True, False, True])]
        assert recorder.found == {"lift_fresh", "a mask"}  # the recorder sees what it shall see
        recorder.found.clear()
        made._imagined_window()
    assert recorder.found == set()
    assert recorder.count > 10_000
    made.task.simulation.close()


@pytest.mark.gpu
@needs("gpu", torch.cuda.is_available(), "torch finds no GPU")
def test_a_captured_window_is_as_the_eager_one() -> None:
    with short_teacher(updates=4):
        made = new_rollouts(device="cuda")
        made.step()
    device = made._device
    with device.seeded(made._random_state), device.active(made.task.policy):
        before = [part.state_dict() for part in (made.users, *made.task.parts)]
        made._window.forget()
        made._window()  # captures, and runs
        captured = made.users.motion.angles.clone()
        for part, state in zip((made.users, *made.task.parts), before, strict=True):
            part.load_state_dict(state)
        made._imagined_window()
        eager = made.users.motion.angles
        # Noise on actions and motion is drawn anew: alike on average.
        torch.testing.assert_close(captured.mean(0), eager.mean(0), atol=0.2, rtol=0.0)
        assert torch.isfinite(captured).all()
    with short_teacher():
        made.step()
    assert made.task.policy.device.type == "cpu"
    made.task.simulation.close()
