"""Profile of a training: time of its stages and of their parts."""

from __future__ import annotations

from sim2vr_harness.runs.run_folder import RunFolder

__all__ = ["stage_lines"]


def stage_lines(run: RunFolder) -> list[str]:
    """Return a table of the wall time and the processor time of a run's stages and their parts."""
    known = run.metadata()
    seconds, parts = known.get("stage_seconds", {}), known.get("stage_parts", {})
    lines = [f"{'stage':28}{'wall':>10}{'processor':>12}{'cores':>8}"]
    for stage, whole in seconds.items():
        of_stage = parts.get(stage, {})
        cpu = sum(part["cpu_seconds"] for part in of_stage.values())
        lines.append(_line(stage, whole, cpu))
        lines += [
            _line(f"  {name}", part["seconds"], part["cpu_seconds"])
            for name, part in of_stage.items()
        ]
    return lines


def _line(name: str, seconds: float, cpu_seconds: float) -> str:
    cores = cpu_seconds / seconds if seconds else 0.0
    return f"{name:28}{seconds:8.1f} s{cpu_seconds:10.1f} s{cores:8.2f}"
