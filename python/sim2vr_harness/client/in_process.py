"""One app inside this process."""

from collections.abc import Mapping
from pathlib import Path

from sim2vr_harness.client.base import ClockSettings, OptionValue
from sim2vr_harness.client.in_process_batch import InProcessBatch, InProcessBatchApp


class InProcessApp(InProcessBatchApp):
    """One app by itself: a batch of one, which draws with the renderer that the process shares.

    Args:
        game: name of the game (:func:`list_games`).
        options: the game's options.
        width: of an eye's headset image, pixels.
        height: of an eye's headset image, pixels.
        eyes: 1, or 2 for a picture of each eye.
        ipd_m: distance between the pupils, metres.
        renderer: ``automatic``, ``egl``, ``osmesa`` or ``null``.
        log_dir: folder for ``states.csv`` and ``events.csv`` of every round, or None.
        clock: fixed step and tolerances of the app's clock.

    Raises:
        ValueError: unknown game or option, unusable size; names the field, got and expected.
        RuntimeError: no renderer can be started.
    """

    def __init__(
        self,
        game: str,
        options: Mapping[str, OptionValue] | None = None,
        *,
        width: int = 120,
        height: int = 80,
        eyes: int = 1,
        ipd_m: float = 0.064,
        renderer: str = "automatic",
        log_dir: Path | None = None,
        clock: ClockSettings | None = None,
    ) -> None:
        batch = InProcessBatch(
            1,
            game,
            options,
            width=width,
            height=height,
            eyes=eyes,
            ipd_m=ipd_m,
            renderer=renderer,
            share_renderer=True,
            log_dirs=None if log_dir is None else [log_dir],
            clock=clock,
        )
        super().__init__(batch, 0)
