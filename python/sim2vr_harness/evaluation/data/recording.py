"""From the rounds of an evaluation to its tables."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.evaluation.data.episodes import episode_columns, episode_rows
from sim2vr_harness.evaluation.data.folder import FOLDER, DataFolder
from sim2vr_harness.evaluation.data.frames import frame_table
from sim2vr_harness.evaluation.data.items import events_of_episode, item_columns
from sim2vr_harness.evaluation.data.steps import StepRecorder
from sim2vr_harness.play.player import Watcher
from sim2vr_harness.play.round import Round


class DataRecorder:
    """Writes the tables of an evaluation into its folder ``data``.

    Args:
        out: Folder of the evaluation.
        facts: What the game publishes.
        env: What is played in.
        moments: Whether to write steps and frames, too.
    """

    def __init__(self, out: Path, facts: GameFacts, env: EnvConfig, *, moments: bool) -> None:
        self.root = out / FOLDER
        self._out, self._facts, self._env, self._keep = out, facts, env, moments
        self._folder = DataFolder(self.root)
        self._events: list[dict[str, Any]] = []
        self.unread: list[str] = []
        """Logs of apps with a format of their own, and why they are not in the tables."""

    @property
    def watchers(self) -> list[Watcher]:
        """Who is to look on while rounds are played."""
        return [StepRecorder(self._facts, self._write_steps)] if self._keep else []

    def clear(self) -> None:
        """Remove the tables of earlier evaluations."""
        self._folder.clear()

    def _write_steps(self, result: Round, table: Callable[[str], Any]) -> None:
        self._folder.write_moments("steps", result.key, table(result.key))

    def take_logs(self, rounds: Sequence[Round]) -> None:
        """Read the app's logs of the rounds, before they go.

        What cannot be read is left out: rounds were played, and other apps log as they like.

        Args:
            rounds: With their ``log_folder``.
        """
        for result in rounds:
            if result.log_folder is not None:
                folder = self._out / result.log_folder
                try:
                    self._events += events_of_episode(result.key, folder, self._facts)
                except InputError as error:
                    self.unread.append(str(error))
                if self._keep:
                    self._take_frames(result, self._out / result.log_folder)

    def _take_frames(self, result: Round, folder: Path) -> None:
        try:
            frames = frame_table(result.key, folder, 1.0 / self._env.action_frequency_hz)
        except InputError as error:
            self.unread.append(str(error))
            return
        if frames is not None:
            self._folder.write_moments("frames", result.key, frames)

    def finish(
        self, rounds: Sequence[Round], settings: Mapping[str, Any], effort_weight: float
    ) -> None:
        """Write the tables of episodes and events, and the data dictionary.

        Raises:
            InputError: A table that is there cannot be read.
        """
        rows = episode_rows(rounds, settings, self._facts, self._env, effort_weight)
        self._folder.add(
            {
                "episodes": (rows, episode_columns(rows, self._facts)),
                "events": (self._events, item_columns(self._events)),
            }
        )
