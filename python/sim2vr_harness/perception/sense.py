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
        """Of the sound, the app's own."""

    @property
    def position_m(self) -> tuple[float, float, float]:
        """Of its source, app frame."""

    @property
    def gain(self) -> float:
        """0 to 1."""


@dataclass
class StepContext:
    """What there is to sense for N users, at the end of a user step or at a pause within it.

    Within a step the bodies are those of that moment, and what comes from the apps is what their
    last reply brought: between two frames nothing changes there.

    Attributes:
        users: the bodies.
        pictures: (N, C, H, W) uint8, the channels of the apps' drawn frames.
        time_feature: (N,) where in the round the games say they are.
        haptics: vibrations of the last replies, of those users who got any, in order.
        sounds: sounds that began in the last replies, of those users who hear any, in order.
        replied_s: (N,) when the last replies came, s since the reset.
        head_poses: returns (N, 7) poses of the heads, app frame.
        inputs: (N, F) values of the inputs that the fingers work.
        gaze_deg: (N, 2) direction of gaze in the head, degrees right and up.
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
    actions: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))


class Sense(Protocol):
    """One entry of the observation dictionary, of N users who do not affect one another.

    A user step ends with :meth:`take`. Only a sense that asks for ``pauses`` is shown moments
    within the step too (:meth:`sample`), the bodies having come to the end of those substeps.
    """

    name: str
    """Key in the observation."""
    space: spaces.Box[Any]
    """Of one user's observation."""
    needs: str | None
    """The capability (client.CAPABILITIES) that an app needs for it to be anything but still."""

    @property
    def pauses(self) -> tuple[int, ...]:
        """Substeps, from 1, at whose ends :meth:`sample` is to be called in every step.

        They may change with a reset.
        """

    @property
    def frame(self) -> int | IntArray:
        """Which of a step's app frames has to be the drawn one, -1 the last.

        (N,) where users differ.
        """

    def reset(self, ids: IntArray, seeds: IntArray) -> None:
        """Forgets the past of these users; what they take next is what has been since ever.

        Args:
            ids: (K,) users.
            seeds: (K,) of their rounds, 32 bits; what is drawn here depends on them alone.
        """

    def sample(self, moment: StepContext, substep: int) -> None:
        """Looks at the end of a substep; nothing is taken in before :meth:`take`."""

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        """Takes in the end of a step or a reset, for these users or, None, for all."""

    def observe(self) -> NDArray[Any]:
        """``(N, *space.shape)`` what the users perceive, a fresh array."""

    def state_dict(self, i: int) -> dict[str, Any]:
        """Copies of everything that user i's future perception depends on."""

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Restores what :meth:`state_dict` returned.

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
        """See :class:`Sense`; there is no past."""

    def sample(self, moment: StepContext, substep: int) -> None:
        """See :class:`Sense`; never requested."""

    def take(self, moment: StepContext, ids: IntArray | None) -> None:
        self._values[rows_of(ids)] = self._look(moment, ids)

    def observe(self) -> NDArray[Any]:
        return self._values.copy()


def rows_of(ids: IntArray | None) -> IntArray | slice:
    """An index of these users' rows; None, all of them, is several times as quick as a list."""
    return slice(None) if ids is None else ids


def float_space(low: float, high: float, size: int) -> spaces.Box[Any]:
    """A box of ``size`` float32 numbers."""
    return spaces.Box(low, high, (size,), np.float32)
