"""Interface of senses: each receives simulation states and returns an observation."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sim2vr_harness.base.state import RowState
from sim2vr_harness.users.batch import UserBatch

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]


class Pulse(Protocol):
    """A vibration that the app asked a controller for (client.HapticPulse)."""

    @property
    def hand(self) -> str:
        """Left or right."""

    @property
    def amplitude(self) -> float:
        """0 to 1; 0 stops the vibration."""

    @property
    def frequency_hz(self) -> float:
        """0: the device's own choice."""

    @property
    def duration_s(self) -> float:
        """Below 0: the shortest the device can."""


class Sound(Protocol):
    """A sound that the app began to play (client.SoundEvent)."""

    @property
    def name(self) -> str:
        """Name of the sound in the app."""

    @property
    def position_m(self) -> tuple[float, float, float]:
        """Position of its source, app frame."""

    @property
    def gain(self) -> float:
        """0 to 1."""


@dataclass
class StepContext:
    """Inputs of the senses of N users, at the end of a user step or of a substep within it.

    Within a step the bodies are in their current state, and the apps' data are those of the last
    reply, because nothing changes in an app between two frames.

    Attributes:
        users: the bodies.
        pictures: (N, C, H, W) uint8, the channels of the apps' rendered frames.
        time_feature: (N,) time in the round, as the games report it.
        haptics: user -> vibrations of the last reply, in order; users without any are left out.
        sounds: user -> sounds that began in the last reply, in order; users without any are left
            out.
        replied_s: (N,) times of the last replies, s since the reset.
        head_poses: returns (N, 7) poses of the heads, app frame.
        inputs: (N, F) values of the inputs that the fingers operate.
        gaze_deg: (N, 2) direction of gaze in the head, degrees right and up.
        fovea: (N, h, w, 4) uint8, the pictures around the gaze, and their
        fovea_depth: (N, h, w) depths, m.
        blind: (N,) True during a saccade.
        actions: (N, A) the last user step's actions in [-1, 1], 0 after a reset.
    """

    users: UserBatch
    pictures: NDArray[np.uint8]
    time_feature: NDArray[np.float32]
    head_poses: Callable[[], FloatArray]
    haptics: Mapping[int, Sequence[Pulse]] = field(default_factory=dict)
    sounds: Mapping[int, Sequence[Sound]] = field(default_factory=dict)
    replied_s: FloatArray = field(default_factory=lambda: np.zeros(0))
    inputs: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    gaze_deg: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    fovea: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0, 0, 4), np.uint8))
    fovea_depth: NDArray[np.float32] = field(
        default_factory=lambda: np.zeros((0, 0, 0), np.float32)
    )
    blind: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    actions: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


class Sense(Protocol):
    """One entry of the observation dictionary of N independent users.

    A user step ends with :meth:`take`. A sense with ``pauses`` is also sampled within the step
    (:meth:`sample`), when the bodies are at the end of those substeps.
    """

    name: str
    """Key in the observation."""
    space: spaces.Box[Any]
    """Space of one user's observation."""
    needs: str | None
    """Capability (client.CAPABILITIES) of the app without which the sense is constant."""

    @property
    def pauses(self) -> tuple[int, ...]:
        """Substeps, from 1, at whose ends :meth:`sample` has to be called in every step.

        They may change with a reset.
        """

    @property
    def frame(self) -> int | IntArray:
        """App frame of a step that has to be rendered, -1: the last one; (N,) if users differ."""

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """Clear the past of these users; their next sample fills the whole history.

        Args:
            ids: (K,) users.
            seeds: (K,) seeds of their rounds, 32 bits; random numbers depend on them alone.
        """

    def sample(self, moment: StepContext, substep: int) -> None:
        """Sample at the end of a substep; the observation does not change before :meth:`take`."""

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        """Update the observation at the end of a step or a reset, of these users; None: all."""

    def observe(self) -> NDArray[Any]:
        """Return ``(N, *space.shape)`` the users' observations, a new array."""

    def state_dict(self, i: int) -> dict[str, Any]:
        """Return copies of the complete state of user i."""

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Restore the result of :meth:`state_dict`.

        Raises:
            ValueError: an entry has another shape.
        """


Look = Callable[[StepContext, IntArray | None], NDArray[Any]]


class Sensed(RowState):
    """A :class:`Sense` that is a function of the moment: it keeps the latest values.

    Args:
        name: key in the observation.
        space: of one user's observation.
        n: number of users N.
        look: ``(moment, ids) -> (K, *space.shape)``, what these users, None for all, perceive.
        frame_grid: substeps between the app frames if they are what it shows; 0: it is a function
            of the moment at any substep.
        needs: see :class:`Sense`.
    """

    _state: ClassVar[tuple[str, ...]] = ("_values",)

    pauses: tuple[int, ...] = ()
    frame: int | IntArray = -1

    def __init__(
        self,
        name: str,
        space: spaces.Box[Any],
        n: int,
        look: Look,
        *,
        frame_grid: int = 0,
        needs: str | None = None,
    ) -> None:
        self.name, self.space, self.needs = name, space, needs
        self.n, self.frame_grid = n, frame_grid
        self._look = look
        self._values = np.zeros((n, *space.shape), dtype=space.dtype)

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """Do nothing, because this sense has no history."""

    def sample(self, moment: StepContext, substep: int) -> None:
        """Do nothing, because this sense has no pauses."""

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        self._values[rows_of(ids)] = self._look(moment, ids)

    def observe(self) -> NDArray[Any]:
        return self._values.copy()


def rows_of(ids: IntArray | None) -> IntArray | slice:
    """Return an index of these users' rows; None, for all, is several times faster than a list."""
    return slice(None) if ids is None else ids


def float_space(low: float, high: float, size: int) -> spaces.Box[Any]:
    """A box of ``size`` float32 numbers."""
    return spaces.Box(low, high, (size,), np.float32)
