"""Muscular effort: how tiring the user's movement is, per environment step.

Every model is vectorised over N users, M muscles and A actuators (muscles and motors) in float64.
The cost is subtracted from the task reward, and `weight` scales it. Formulas follow the SIM2VR
paper and its User-in-the-Box reference.
"""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.exertion import consumed_endurance_time

FloatArray = NDArray[np.float64]
Ids = Sequence[int] | NDArray[np.integer] | slice

EffortName = Literal[
    "cumulative_fatigue_3ccr", "neural", "muscle_state", "consumed_endurance", "zero"
]
"""Names of the effort models in configurations and `make_effort`."""

FatiguePreset = Literal["reference", "shoulder"]
FATIGUE_PRESETS: Mapping[FatiguePreset, Mapping[str, float]] = {
    "reference": {"r": 7.5, "fatigue": 0.0146, "recovery": 0.0022},
    "shoulder": {"r": 15.0, "fatigue": 0.0182, "recovery": 0.00168},
}
"""Rates of 3CC-r. `reference`: the SIM2VR paper's. `shoulder`: F and R of Frey-Law, Looft and
Heitsman (2012), fitted to people's endurance at the shoulder; r of Looft and Frey-Law (2020)."""

_REFERENCE = FATIGUE_PRESETS["reference"]


class EffortModel(ABC):
    """Base of the effort models: N users in parallel, none of which affects another.

    Args:
        n: number of users.
        muscle_count: number of muscles M, with motors whose torques tire as muscles do.
        actuator_count: number of actuators A; None if there are only muscles.
        weight: factor on the cost; None takes the model's `default_weight`.
        dt: duration of one environment step in s.
    """

    default_weight: ClassVar[float]
    reads: ClassVar[Literal["act", "ctrl", "force"]] = "act"
    """The argument of :meth:`update` that the cost depends on."""

    def __init__(
        self,
        n: int,
        muscle_count: int,
        *,
        actuator_count: int | None = None,
        weight: float | None = None,
        dt: float = 0.05,
    ) -> None:
        if n < 1:
            raise ValueError(f"n: got {n}, expected at least 1 user")
        self.actuator_count = muscle_count if actuator_count is None else actuator_count
        self.weight = _not_negative("weight", self.default_weight if weight is None else weight)
        if not (np.isfinite(dt) and dt > 0):
            raise ValueError(f"dt: got {dt}, expected a finite number above 0")
        self.dt, self.n, self.muscle_count = float(dt), n, muscle_count

    def reset(self, ids: Ids) -> None:  # noqa: B027 (most models have no past)
        """Forgets the past of these users: a new episode begins."""

    def update(
        self,
        act: FloatArray,
        ctrl: FloatArray,
        force: FloatArray | None = None,
        ids: Ids = slice(None),
    ) -> FloatArray:
        """Advances one environment step.

        Args:
            act: (K, M) muscle activations in [0, 1] at the end of the step, and torques of
                motors as shares of their capacity (`EffortInputs.loads`).
            ctrl: (K, A) controls of the step, raw: in [0, 1] of muscles, targets of motors.
            force: (K, A) actuator forces in N; only consumed endurance needs them.
            ids: the K users that the rows belong to; all N by default.

        Returns:
            (K,) weighted cost, at least 0.

        Raises:
            ValueError: the array that the model reads has another shape, or is missing.
        """
        given = {"act": act, "ctrl": ctrl, "force": force}[self.reads]
        rows = len(np.arange(self.n)[ids if isinstance(ids, slice) else np.asarray(ids, int)])
        columns = self.muscle_count if self.reads == "act" else self.actuator_count
        if given is None or np.shape(given) != (rows, columns):
            got = "None" if given is None else f"shape {np.shape(given)}"
            raise ValueError(f"{self.reads}: got {got}, expected shape ({rows}, {columns})")
        return self.weight * self._cost(np.asarray(given, dtype=np.float64), ids)

    @abstractmethod
    def _cost(self, values: FloatArray, ids: Ids) -> FloatArray:
        """(K,) cost of a step before its weight; ``values`` are what the model reads."""

    def state_dict(self) -> dict[str, FloatArray]:
        """Returns copies of what the model remembers; the first axis is the user."""
        return {name: values.copy() for name, values in self._arrays().items()}

    def load_state_dict(
        self, state: Mapping[str, NDArray[np.floating]], ids: Ids = slice(None)
    ) -> None:
        """Restores what `state_dict` returned, for all users or for `ids`.

        Raises:
            ValueError: a missing, unknown or wrongly shaped entry.
        """
        arrays = self._arrays()
        if set(state) != set(arrays):
            raise ValueError(f"effort state: got {sorted(state)}, expected {sorted(arrays)}")
        for name, values in arrays.items():
            given, shape = np.asarray(state[name]), values[ids].shape
            if given.shape != shape:
                raise ValueError(f"effort state {name}: got shape {given.shape}, expected {shape}")
        for name, values in arrays.items():
            values[ids] = state[name]

    def max_fatigued(self) -> FloatArray:
        """(N,) mean over muscles of the most fatigued share seen in the episode; NaN if unknown."""
        return np.full(self.n, np.nan)

    def _arrays(self) -> dict[str, FloatArray]:
        """The live arrays that make up the state; none for a model without memory."""
        return {}


class Zero(EffortModel):
    """Effort does not matter: cost 0."""

    default_weight = 0.0

    def _cost(self, values: FloatArray, ids: Ids) -> FloatArray:
        return np.zeros(len(values))


class _SumOfSquares(EffortModel):
    """w * the sum of squares of what the model reads."""

    default_weight = 1e-4

    def _cost(self, values: FloatArray, ids: Ids) -> FloatArray:
        cost: FloatArray = (values * values).sum(axis=1)
        return cost


class Neural(_SumOfSquares):
    """Squared controls: w * sum ctrl^2 (Neural effort, User-in-the-Box reference).

    Motors count with their raw control, as in the reference: the angle that they aim at.
    """

    reads = "ctrl"


class MuscleState(_SumOfSquares):
    """Squared muscle activations: w * sum act^2 (User-in-the-Box reference)."""

    reads = "act"


class CumulativeFatigue3CCr(EffortModel):
    """Three-compartment fatigue model with augmented recovery, 3CC-r (SIM2VR paper).

    Each muscle's motor units are active (MA), resting (MR) or fatigued (MF), which add up to 1.
    The activation is the target load TL; a controller moves units between rest and activity, and
    the cost is the load that the active units cannot meet: w * ||MA - TL||_2 over the muscles.

    The default weight 0.1 is the one of the SIM2VR paper's Whac-A-Mole user; the reference class
    itself defaults to 0.01.

    Args:
        n, muscle_count, actuator_count, weight, dt: as in `EffortModel`.
        r: how many times faster units recover while the load is met.
        fatigue: F, rate at which active units tire, 1/s.
        recovery: R, rate at which tired units recover, 1/s.
        development: LD, gain with which force is built up, 1/s.
        relaxation: LR, gain with which force is released, 1/s.
    """

    default_weight = 0.1

    def __init__(
        self,
        n: int,
        muscle_count: int,
        *,
        actuator_count: int | None = None,
        weight: float | None = None,
        dt: float = 0.05,
        r: float = _REFERENCE["r"],
        fatigue: float = _REFERENCE["fatigue"],
        recovery: float = _REFERENCE["recovery"],
        development: float = 10.0,
        relaxation: float = 10.0,
    ) -> None:
        super().__init__(n, muscle_count, actuator_count=actuator_count, weight=weight, dt=dt)
        self.r = _not_negative("r", r)
        self.fatigue = _not_negative("fatigue", fatigue)
        self.recovery = _not_negative("recovery", recovery)
        self.development = _not_negative("development", development)
        self.relaxation = _not_negative("relaxation", relaxation)
        self._ma, self._mr, self._mf, self._max_mf = np.zeros((4, n, muscle_count))
        self.reset(slice(None))

    def reset(self, ids: Ids) -> None:
        """All motor units of these users are rested."""
        self._ma[ids] = 0.0
        self._mr[ids] = 1.0
        self._mf[ids] = 0.0
        self._max_mf[ids] = 0.0

    def _cost(self, values: FloatArray, ids: Ids) -> FloatArray:
        load, dt = values, self.dt
        ma, mr, mf = self._ma[ids], self._mr[ids], self._mf[ids]
        lacking = load - ma
        met = ma >= load
        drive = np.where(met, self.relaxation * lacking, self.development * np.minimum(lacking, mr))
        tiring = self.fatigue * ma
        recovering = np.where(met, self.r * self.recovery, self.recovery) * mf
        # Bounds on the drive that keep every compartment within [0, 1] after this step.
        lowest = np.maximum(-ma / dt + tiring, (mr - 1.0) / dt + recovering)
        highest = np.minimum((1.0 - ma) / dt + tiring, mr / dt + recovering)
        drive = np.minimum(np.maximum(drive, lowest), highest)
        self._ma[ids] = ma = ma + (drive - tiring) * dt
        self._mr[ids] = mr + (recovering - drive) * dt
        self._mf[ids] = mf = mf + (tiring - recovering) * dt
        self._max_mf[ids] = np.maximum(self._max_mf[ids], mf)
        missed = ma - load
        return np.sqrt((missed * missed).sum(axis=1))

    def max_fatigued(self) -> FloatArray:
        """(N,) the SIM2VR paper's "maximum fatigued motor units": mean over muscles of max MF."""
        worst: FloatArray = self._max_mf.mean(axis=1)
        return worst

    def _arrays(self) -> dict[str, FloatArray]:
        return {"MA": self._ma, "MR": self._mr, "MF": self._mf, "max_MF": self._max_mf}


class ConsumedEndurance(EffortModel):
    """Share of the remaining endurance time that one step uses up (SIM2VR paper).

    The strength ``s = |force| / F0`` of the most loaded lifting muscle gives the endurance time
    E = 1236.5 / (100 s - 15)^0.618 - 72.5 in s, endless up to s = 0.15; cost = w * 100 dt / E.

    Args:
        n, muscle_count, actuator_count, weight, dt: as in `EffortModel`.
        peak_forces: (A,) peak forces F0 of the actuators in N (torques of motors in Nm).
        lifting: indices of the actuators to look at, at least one.
    """

    default_weight = 0.01
    reads = "force"

    def __init__(
        self,
        n: int,
        muscle_count: int,
        *,
        actuator_count: int | None = None,
        weight: float | None = None,
        dt: float = 0.05,
        peak_forces: FloatArray,
        lifting: Sequence[int],
    ) -> None:
        super().__init__(n, muscle_count, actuator_count=actuator_count, weight=weight, dt=dt)
        if len(lifting) == 0:
            raise ValueError("lifting: got no actuators, expected those that hold the arm up")
        self._lifting = np.asarray(lifting, dtype=np.int64)
        self._peak = np.asarray(peak_forces, dtype=np.float64)[self._lifting]

    def _cost(self, values: FloatArray, ids: Ids) -> FloatArray:
        strength = np.clip(np.abs(values[:, self._lifting]) / self._peak, 0.0, 1.0)
        # Endurance falls with strength, so the most loaded muscle has the least of it.
        return 100.0 * self.dt / consumed_endurance_time(strength.max(axis=1))


_MODELS: dict[str, type[EffortModel]] = {
    "cumulative_fatigue_3ccr": CumulativeFatigue3CCr,
    "neural": Neural,
    "muscle_state": MuscleState,
    "consumed_endurance": ConsumedEndurance,
    "zero": Zero,
}
_OF_THE_BODY = ("n", "muscle_count", "actuator_count", "dt", "peak_forces", "lifting", "self")


def list_efforts() -> tuple[str, ...]:
    """Returns the names that `make_effort` and the configuration's `env.user.effort.model` take."""
    return get_args(EffortName)


def _model(name: str) -> type[EffortModel]:
    if name not in _MODELS:
        raise unknown_name("effort", name, list_efforts())
    return _MODELS[name]


def effort_options(name: str) -> tuple[str, ...]:
    """Returns the parameters of a model that a configuration can set, `weight` first.

    Raises:
        ValueError: unknown name.
    """
    if name == "zero":
        return ()
    names = inspect.signature(_model(name)).parameters
    return tuple(option for option in names if option not in _OF_THE_BODY)


def effort_weight(name: str, weight: float | None = None) -> float:
    """Returns the factor on a model's cost: the given one, or the model's default.

    Raises:
        ValueError: unknown name.
    """
    return _model(name).default_weight if weight is None else weight


def make_effort(
    name: str, n: int, body: Body, *, weight: float | None = None, **params: Any
) -> EffortModel:
    """Makes an effort model by name for `n` copies of `body`.

    Args:
        name: one of `list_efforts()`.
        n: number of users.
        body: whose muscles and motors it is about.
        weight: factor on the cost; None takes the model's default.
        **params: parameters of the model's class, e.g. `dt` (s), or `r` for 3CC-r.

    Raises:
        ValueError: unknown name or parameter, a value out of range, or a body that does not have
            what the model looks at.
    """
    model = _model(name)
    if model in (CumulativeFatigue3CCr, MuscleState) and not body.muscles:
        raise ValueError(
            f"effort: got {name!r} for body {body.name!r}, which has no muscles; expected "
            "'neural' (its controls), 'consumed_endurance' or 'zero'"
        )
    if model is ConsumedEndurance:
        params = {**_endurance_inputs(body), **params}
    try:
        return model(
            n,
            len(body.muscles) + len(body.effort_inputs.loads),
            actuator_count=body.action_size,
            weight=weight,
            **params,
        )
    except TypeError as error:
        raise ValueError(f"effort {name}: got parameters {sorted(params)}; {error}") from error


def effort_for(
    effort: str | EffortModel,
    n: int,
    body: Body,
    dt: float,
    weight: float | None,
    params: Mapping[str, Any] | None,
) -> EffortModel:
    """Return the effort model of a name, or a ready one that is of `n` copies of `body`.

    Raises:
        ValueError: as :func:`make_effort`; or a weight or parameters beside a ready model, or one
            of other users.
    """
    if isinstance(effort, str):
        given = {"dt": dt, **(params or {})} | ({} if weight is None else {"weight": weight})
        return make_effort(effort, n, body, **given)
    if weight is not None or params:
        raise ValueError(
            "effort_weight, effort_params: got values next to a ready effort model, expected "
            "None; give them to the model instead"
        )
    loads = len(body.muscles) + len(body.effort_inputs.loads)
    if (effort.n, effort.muscle_count, effort.actuator_count) != (n, loads, body.action_size):
        raise ValueError(
            f"effort: got a model of {effort.n} users with {effort.muscle_count} muscles of "
            f"{effort.actuator_count} actuators, expected {n} users with {loads} of "
            f"{body.action_size}"
        )
    return effort


def _endurance_inputs(body: Body) -> dict[str, Any]:
    """Peak forces and lifting actuators, or why there are none."""
    lifting = body.effort_inputs.lifting
    if not lifting:
        raise ValueError(
            f"effort: got 'consumed_endurance' for body {body.name!r}, which names no actuators "
            "that lift the arm; expected some in its effort inputs (effort: {lifting: [...]})"
        )
    names = body.action_names
    unused = [name for name in lifting if name not in names]
    if unused:
        raise unknown_name("effort lifting", unused[0], names)
    indices = [names.index(name) for name in lifting]
    unknown = [names[i] for i in indices if not body.peak_forces[i] > 0.0]
    if unknown:
        raise ValueError(
            f"effort: got 'consumed_endurance' for body {body.name!r}, whose actuator "
            f"{unknown[0]!r} has no known peak force; expected one in its effort inputs "
            "(effort: {peak_forces: {...}})"
        )
    return {"peak_forces": body.peak_forces, "lifting": indices}


def _not_negative(field: str, value: float) -> float:
    if not (np.isfinite(value) and value >= 0):
        raise ValueError(f"{field}: got {value}, expected a finite number, at least 0")
    return float(value)
