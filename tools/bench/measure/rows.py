"""Results as JSON rows, with what is needed to compare them with those of another day."""

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from measure.turns import spread
from sim2vr_harness import __version__
from sim2vr_harness.base.files import naming
from sim2vr_harness.client import gl_renderer
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import git_commit, versions


@dataclass(frozen=True)
class BenchRow:
    """One scene with one number of users and threads.

    Attributes:
        scene: its name.
        transport: where the apps ran; None where there are none.
        n: number of users.
        threads: of physics and apps.
        variant: what differs from the configuration, such as ``sense=sound``; or empty.
        unit: of the rates.
        rates: of the turns, in order; empty where no time was measured.
        cpu_us: processor time per user step (or frame) in the turns, us, all threads and
            processes; other programs disturb it less than they disturb the rate.
        state_hash: of all users and apps after the warm-up, 16 hexadecimal digits: the same for
            any number of threads, any transport, any machine.
        observation_hash: of what the users then saw; pictures depend on the GL driver, too.
        parts: medians of further rates, by name.
        ratios: this rate divided by another scene's of the same run, by that scene's name; and
            the inverse ratio of the processor times under the name with ``, cpu``.
        memory_mb: peak of the resident memory; of this process with all scenes of the run, in
            ``memory`` rows of a process that held these users alone.
        extra: numbers that only this scene has.
    """

    scene: str
    transport: str | None
    n: int
    threads: int
    variant: str = ""
    unit: str = "user steps/s"
    rates: list[float] = field(default_factory=list)
    cpu_us: list[float] = field(default_factory=list)
    state_hash: str | None = None
    observation_hash: str | None = None
    parts: Mapping[str, float] = field(default_factory=dict)
    ratios: Mapping[str, float] = field(default_factory=dict)
    memory_mb: float | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def rate_per_s(self) -> float | None:
        """Median over the turns."""
        return float(np.median(self.rates)) if self.rates else None

    @property
    def name(self) -> str:
        """Names the row within its run."""
        parts = (self.scene, self.transport, f"N={self.n}", f"{self.threads} threads")
        return ", ".join(part for part in (*parts, self.variant) if part)

    def as_json(self, common: Mapping[str, Any]) -> dict[str, Any]:
        """The row's JSON object, circumstances of the run included."""
        values = asdict(self)
        rates, cpu_us = values.pop("rates"), values.pop("cpu_us")
        return {
            "scene": values.pop("scene"),
            "rate_per_s": None if self.rate_per_s is None else round(self.rate_per_s, 1),
            "spread": round(spread(rates), 3) if rates else None,
            "turns": [round(rate, 1) for rate in rates],
            "cpu_us_per_step": round(float(np.median(cpu_us)), 2) if cpu_us else None,
            **{key: _rounded(value) for key, value in values.items()},
            **common,
        }


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4)
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    return value


def circumstances(config: TrainingConfig, seconds: float, *, drawing: bool) -> dict[str, Any]:
    """What all rows of a run share: code, machine and settings.

    Args:
        config: what was measured.
        seconds: of measurement per scene.
        drawing: whether anything is drawn: then the GL renderer is named.
    """
    import torch

    commit = git_commit()
    vision = config.env.vision
    return {
        "run": f"{datetime.now(UTC).isoformat(timespec='seconds')} {os.getpid()}",
        "version": __version__,
        "commit": None if commit is None else commit.removesuffix("-dirty"),
        "dirty": None if commit is None else commit.endswith("-dirty"),
        "renderer": gl_renderer(config.env.app.renderer) if drawing else None,
        "cpu": _cpu_model(),
        "cores": len(os.sched_getaffinity(0)),
        "memory_total_mb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**20),
        "load_average": [round(load, 2) for load in os.getloadavg()],
        "system": platform.platform(),
        "image": [vision.width, vision.height],
        "channels": list(vision.channels),
        "game": config.env.app.game,
        "options": dict(config.env.app.options),
        "effort": config.env.user.effort.model,
        "physics_steps_per_user_step": 500 // config.env.action_frequency_hz,
        "frames_per_step": config.env.frames_per_step,
        "torch_threads": torch.get_num_threads(),
        "device": config.device,
        "gpu": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "seconds": seconds,
        "versions": versions(),
    }


def _cpu_model() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def append_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Adds rows to a file of one JSON object per line; makes its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with naming(path), path.open("a", encoding="utf-8") as stream:
        stream.writelines(json.dumps(row) + "\n" for row in rows)
