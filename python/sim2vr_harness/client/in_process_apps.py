"""The transport of apps in this process."""

from collections.abc import Sequence
from pathlib import Path

from sim2vr_harness.client.base import CAPABILITIES, AppClient
from sim2vr_harness.client.in_process_batch import InProcessBatch
from sim2vr_harness.client.transport import AppsWanted, Transport


def _batch(
    wanted: AppsWanted, log_dir: Path | None, vision_channels: Sequence[int] = ()
) -> InProcessBatch:
    return InProcessBatch(
        wanted.n,
        wanted.game,
        wanted.options,
        width=wanted.width,
        height=wanted.height,
        eyes=wanted.eyes,
        ipd_m=wanted.ipd_m,
        renderer=wanted.renderer,
        log_dirs=None if log_dir is None else [log_dir / f"user{i:03d}" for i in range(wanted.n)],
        threads=wanted.threads,
        vision_channels=vision_channels,
    )


class _Apps:
    """Those of one batch, one by one."""

    def __init__(self, wanted: AppsWanted) -> None:
        self._wanted = wanted
        self._made: InProcessBatch | None = None

    def __call__(self, index: int, log_dir: Path | None) -> AppClient:
        if self._made is None:
            self._made = _batch(self._wanted, log_dir)
        return self._made.app(index)


IN_PROCESS = Transport(
    name="in_process",
    summary="our runtime, in this process",
    apps=_Apps,
    batch=_batch,
    capabilities=frozenset(CAPABILITIES) - {"privileged"},
)
