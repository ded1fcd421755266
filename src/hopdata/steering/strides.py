"""Recorded strides of any robot that is commanded once a stride.

A stride leads from one stance to the next. It is a state and the commanded inputs at
the first stance, the change of the pose from there to the second, and the state at the
second. What state and inputs are, each robot says by its `StrideAxes`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import BoolArray, FloatArray, IntArray, pd
from hopdata.errors import AnalysisError, RecordingError, counted, require
from hopdata.rigid import relative

TextArray = NDArray[np.str_]

TURN = 2 * np.pi

# Components of a change of pose: x and y, m, and heading, rad, in the frame of the
# first stance.
COMPONENTS = ("dx", "dy", "dtheta")

USED = ""
NO_POSE = "pose missing"
NO_STATE = "state missing"
NO_INPUT = "input missing"
FAR_INPUT = "input beyond its limits"
FALLEN = "fallen or stopped"

#: How far an input may be beyond its limits, as a share of their distance.
#: Unit: 1. Origin: rounding: of limits that were written in a file.
INPUT_MARGIN = 1e-6

#: Strides in a row by which a robot is seen to lie or to stand.
#: Unit: 1. Origin: chosen: inputs drawn at random do not let it rest as often in a row.
RUN = 8
#: Largest motion in such a run, as a share of that in its liveliest run.
#: Unit: 1. Origin: measured: excitations of hoppers stay above 0.37; what is seen of a
#: hopper that lies, with errors of 2 mm, is 0.05.
STILL_SHARE = 0.15
#: Distance from the middle of a robot of the point whose motion is compared.
#: Unit: m. Origin: chosen.
ARM_M = 0.1


def turn_nodes(number: int) -> FloatArray:
    """Return angles evenly spaced over a turn from 0, without its end, rad."""
    return TURN * np.arange(number) / number


@dataclass(frozen=True, kw_only=True)
class Axis:
    """A number on which a stride depends.

    Parameters
    ----------
    name : str
    unit : str
        As in the names of columns: ``m``, ``rad``, ``m_s``; empty for a share.
    """

    name: str
    unit: str = "rad"

    @property
    def column(self) -> str:
        """Name of its column in a table, with the unit."""
        return f"{self.name}_{self.unit}" if self.unit else self.name


@dataclass(frozen=True, kw_only=True)
class State(Axis):
    """A number that a stride changes.

    Parameters
    ----------
    name, unit : str
        See `Axis`.
    moved_by : str
        Name of the input that a stride adds to the state, if there is one.
    set_by : str
        Name of the input whose value is the next state, if there is one.
    """

    moved_by: str = ""
    set_by: str = ""

    def __post_init__(self) -> None:
        is_single = not (self.moved_by and self.set_by)
        wanted = "either moved_by or set_by"
        require(is_single, f"state {self.name}", wanted, "both")

    @property
    def is_known(self) -> bool:
        """Whether its next value follows from itself and the inputs."""
        return bool(self.moved_by or self.set_by)


@dataclass(frozen=True, kw_only=True)
class Input(Axis):
    """A number that is commanded once a stride.

    Parameters
    ----------
    name, unit : str
        See `Axis`.
    lower, upper : float
        Its limits.
    """

    lower: float
    upper: float

    def __post_init__(self) -> None:
        is_sound = bool(np.isfinite([self.lower, self.upper]).all())
        is_sound = is_sound and self.lower < self.upper
        wanted = "two finite numbers, the lower first"
        require(is_sound, f"input {self.name}", wanted, (self.lower, self.upper))


@dataclass(frozen=True, kw_only=True)
class StrideAxes:
    """What the strides of a robot depend on.

    A state is an array (S,), the periodic states first; inputs are an array (U,).

    Parameters
    ----------
    periodic : tuple of State
        Angles, of which a whole turn more makes no difference, rad.
    linear : tuple of State
        All other states.
    inputs : tuple of Input
        At least one.

    Raises
    ------
    ConfigError
        If two have the same name, there is no input, a periodic state is not in rad, or
        a state follows from an input that does not exist.
    """

    periodic: tuple[State, ...] = ()
    linear: tuple[State, ...] = ()
    inputs: tuple[Input, ...]

    def __post_init__(self) -> None:
        require(bool(self.inputs), "inputs", "at least one", "none")
        names = [axis.name for axis in self.axes]
        repeated = [name for name, n in Counter(names).items() if n > 1]
        require(not repeated, "axes", "a name for each", f"twice {repeated}")
        inputs = self.input_names
        for state in self.states:
            source = state.moved_by or state.set_by
            wanted = f"one of the inputs {', '.join(inputs)}"
            is_sound = not source or source in inputs
            require(is_sound, f"state {state.name}", wanted, source)
        for state in self.periodic:
            is_angle = state.unit == "rad"
            require(is_angle, f"state {state.name}", "an angle in rad", state.unit)

    @property
    def states(self) -> tuple[State, ...]:
        """All states, (S,), the periodic ones first."""
        return (*self.periodic, *self.linear)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """All states and inputs, (S + U,)."""
        return (*self.states, *self.inputs)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, (U,)."""
        return tuple(axis.name for axis in self.inputs)

    @property
    def lower(self) -> FloatArray:
        """Lower limits of the inputs, (U,)."""
        return np.array([axis.lower for axis in self.inputs])

    @property
    def upper(self) -> FloatArray:
        """Upper limits of the inputs, (U,)."""
        return np.array([axis.upper for axis in self.inputs])

    @property
    def is_known(self) -> BoolArray:
        """Whether the next value of each state is known, (S,)."""
        return np.array([state.is_known for state in self.states], dtype=bool)

    @property
    def is_periodic(self) -> BoolArray:
        """Whether each state is an angle, (S,)."""
        return np.arange(len(self.states)) < len(self.periodic)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of states and inputs in a table, (S + U,)."""
        return tuple(axis.column for axis in self.axes)

    def has_limits(self, lower: FloatArray, upper: FloatArray) -> bool:
        """Tell whether these (U,) are the limits of the inputs."""
        is_same = np.array_equal(lower, self.lower)
        return is_same and np.array_equal(upper, self.upper)

    def between(self, lower: FloatArray, upper: FloatArray) -> Self:
        """Return the axes with other limits (U,) of the inputs."""
        inputs = [
            replace(axis, lower=low, upper=high)
            for axis, low, high in zip(
                self.inputs, lower.tolist(), upper.tolist(), strict=True
            )
        ]
        return replace(self, inputs=tuple(inputs))

    def as_dict(self) -> dict[str, list[dict[str, Any]]]:
        """Return the axes as what JSON can hold."""
        kinds = ("periodic", "linear", "inputs")
        return {kind: [asdict(one) for one in getattr(self, kind)] for kind in kinds}

    @classmethod
    def of_dict(cls, kinds: Mapping[str, Sequence[Mapping[str, Any]]]) -> Self:
        """Return the axes that `as_dict` wrote.

        Raises
        ------
        KeyError, TypeError, ConfigError
            If it is something else.
        """
        return cls(
            periodic=tuple(State(**one) for one in kinds["periodic"]),
            linear=tuple(State(**one) for one in kinds["linear"]),
            inputs=tuple(Input(**one) for one in kinds["inputs"]),
        )

    def points(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return states and inputs side by side, (n, S + U).

        Parameters
        ----------
        state : (n, S) array
            If there is one state, also (n,). A single state (S,) is for all strides.
        inputs : (n, U) array
            Likewise.

        Raises
        ------
        AnalysisError
            If there are not S states or U inputs, or n differs.
        """
        return side_by_side(state, inputs, len(self.states), len(self.inputs))

    def wrapped(self, state: FloatArray) -> FloatArray:
        """Return states (..., S) with the periodic ones in [0, 2 pi)."""
        n = len(self.periodic)
        return np.concatenate([state[..., :n] % TURN, state[..., n:]], axis=-1)

    def next_state(self, state: ArrayLike, inputs: ArrayLike) -> FloatArray:
        """Return the states (n, S) after strides; NaN where they must be learned.

        Periodic states are in [0, 2 pi). See `points`.
        """
        points = self.points(state, inputs)
        n_states = len(self.states)
        commands = dict(zip(self.input_names, points[:, n_states:].T, strict=True))
        after = np.full((len(points), n_states), np.nan)
        for k, axis in enumerate(self.states):
            if axis.moved_by:
                after[:, k] = points[:, k] + commands[axis.moved_by]
            elif axis.set_by:
                after[:, k] = commands[axis.set_by]
        return self.wrapped(after)


def side_by_side(
    state: ArrayLike, inputs: ArrayLike, n_states: int, n_inputs: int
) -> FloatArray:
    """Return states and inputs side by side; see `StrideAxes.points`."""
    states = _rows(state, n_states, "states")
    commands = _rows(inputs, n_inputs, "inputs")
    sizes = {len(states), len(commands)} - {1}
    if len(sizes) > 1:
        wanted = "states and inputs of one length"
        raise AnalysisError.at("stride", wanted, sorted(sizes))
    n = min(sizes, default=1)
    points = np.empty((n, n_states + n_inputs))
    points[:, :n_states] = states
    points[:, n_states:] = commands
    return points


def _rows(values: ArrayLike, width: int, what: str) -> FloatArray:
    """Return values as rows (n, width); a vector is a row, or a column of width 1."""
    array = np.asarray(values, dtype=float)
    if array.ndim < 2:
        shape = (-1, 1) if width == 1 else (1, -1)
        array = array.reshape(shape)
    if array.ndim != 2 or array.shape[1] != width:
        wanted = f"{what} (n, {width})"
        raise AnalysisError.at("stride", wanted, np.shape(values))
    return array


def at_rest(axes: StrideAxes) -> FloatArray:
    """Return the inputs (U,) of a robot that is not steered: nearest to zero."""
    return np.clip(0.0, axes.lower, axes.upper)


@dataclass(frozen=True, kw_only=True)
class Strides:
    """Strides between stances, one per row.

    Parameters
    ----------
    axes : StrideAxes
    recording : (n,) str array
        Recording that the stride belongs to.
    time_s : (n,) array
        Time of the first stance.
    state : (n, S) array
        State at the first stance.
    inputs : (n, U) array
        What was commanded.
    change : (n, 3) array
        Pose at the second stance in the frame of the first: x m, y m, heading rad.
    next_state : (n, S) array
        State at the second stance.
    reason : (n,) str array
        Why the stride is not used; empty if it is.
    """

    axes: StrideAxes
    recording: TextArray
    time_s: FloatArray
    state: FloatArray
    inputs: FloatArray
    change: FloatArray
    next_state: FloatArray
    reason: TextArray

    def __post_init__(self) -> None:
        n = len(self.time_s)
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(_columns(self), (n,))
        of_state = (n, len(self.axes.states))
        of_inputs = (n, len(self.axes.inputs))
        shapes |= {"state": of_state, "next_state": of_state, "inputs": of_inputs}
        shapes["change"] = (n, 3)
        for name, column in _columns(self).items():
            if column.shape != shapes[name]:
                raise ValueError(
                    f"{name}: expected {shapes[name]}, found {column.shape}"
                )

    def __len__(self) -> int:
        return len(self.time_s)

    def rows(self, chosen: ArrayLike) -> Self:
        """Return some of the strides, chosen by number or by a boolean for each."""
        picked = np.asarray(chosen)
        columns = _columns(self)
        some = {name: column[picked] for name, column in columns.items()}
        return type(self)(axes=self.axes, **some)

    def used(self) -> Self:
        """Return the strides that are used."""
        return self.rows(self.reason == USED)

    def excluded(self) -> dict[str, int]:
        """Return how many strides are not used, by reason."""
        reasons = self.reason[self.reason != USED].tolist()
        return dict(sorted(Counter(reasons).items()))

    @property
    def points(self) -> FloatArray:
        """State and inputs side by side, (n, S + U)."""
        return np.concatenate([self.state, self.inputs], axis=1)

    def fall(self) -> str:
        """Say how many strides are left out after a fall, and what to do; "" if none.

        See `is_still`.
        """
        fallen = np.flatnonzero(self.reason == FALLEN)
        if not len(fallen):
            return ""
        since_s = self.time_s[fallen[0]]
        number = counted(len(fallen), "stride")
        return (
            f"{number} left out, because the robot lies or stands still from "
            f"{since_s:.1f} s on: put it up and excite it again, or, if its inputs "
            "threw it over, with narrower limits"
        )

    def column(self, name: str) -> FloatArray:
        """Return a state or an input (n,) by the name of its axis.

        Raises
        ------
        KeyError
            If there is none of that name.
        """
        by_name = {axis.name: k for k, axis in enumerate(self.axes.axes)}
        return self.points[:, by_name[name]]


def _columns(strides: Strides) -> dict[str, NDArray[Any]]:
    """Return the arrays of strides by name."""
    names = [one.name for one in fields(strides) if one.name != "axes"]
    return {name: getattr(strides, name) for name in names}


AnyStrides = TypeVar("AnyStrides", bound=Strides)


def joined(parts: Iterable[AnyStrides]) -> AnyStrides:
    """Return the strides of several recordings of one robot as one table."""
    tables = list(parts)
    first = tables[0]
    each = [_columns(table) for table in tables]
    columns = {name: np.concatenate([one[name] for one in each]) for name in each[0]}
    return type(first)(axes=first.axes, **columns)


def is_still(change: FloatArray) -> BoolArray:
    """Tell which strides led to a place where a robot lies or stands, or began there.

    A robot that its inputs have thrown over lies still whatever is commanded. This is
    seen by `RUN` strides in a row with hardly any motion. The stride before them, in
    which it fell, counts too.

    Parameters
    ----------
    change : (n, 3) array
        Changes of pose of consecutive strides: x m, y m, heading rad.

    Returns
    -------
    (n,) bool array
    """
    still = np.zeros(len(change), dtype=bool)
    if len(change) < RUN:
        return still
    motion = np.hypot(change[:, 0], change[:, 1]) + ARM_M * np.abs(change[:, 2])
    runs = np.lib.stride_tricks.sliding_window_view(motion, RUN)
    # A median, as the fall itself may be a long way.
    liveliest = np.median(runs, axis=1).max()
    in_run = np.sqrt(np.mean(runs**2, axis=1))
    for first in np.flatnonzero(in_run < STILL_SHARE * liveliest):
        still[max(first - 1, 0) : first + RUN] = True
    return still


def recorded_strides(
    axes: StrideAxes,
    *,
    time_s: FloatArray,
    pose: FloatArray,
    state: FloatArray,
    inputs: FloatArray,
    pairs: IntArray | None = None,
    recording: str = "",
) -> Strides:
    """Collect the strides between stances.

    Parameters
    ----------
    axes : StrideAxes
    time_s : (K,) array
        Time of each stance.
    pose : (K, 3) array
        Pose in it: x m, y m, heading rad; NaN where unknown.
    state : (K, S) array
        State in it; NaN where unknown.
    inputs : (K, U) array
        What was commanded from each stance to the next; NaN where nothing was.
    pairs : (P, 2) array of int, optional
        Pairs of stances that are one stride apart; by default all that are neighbours.
    recording : str
        Name of the recording.

    Returns
    -------
    Strides
        One row for each pair, used or not.
    """
    if pairs is None:
        numbers = np.arange(len(time_s))
        pairs = np.column_stack([numbers[:-1], numbers[1:]])
    first, second = pairs.T
    commanded = inputs[first]
    change = relative(pose[first], pose[second])
    states = np.concatenate([state[first], state[second]], axis=1)
    margin = INPUT_MARGIN * (axes.upper - axes.lower)
    is_far = (commanded < axes.lower - margin) | (commanded > axes.upper + margin)
    # Of several reasons the last one stays.
    reason = np.full(len(first), USED, dtype="<U32")
    reason[is_far.any(axis=1)] = FAR_INPUT
    reason[np.isnan(commanded).any(axis=1)] = NO_INPUT
    reason[np.isnan(states).any(axis=1)] = NO_STATE
    reason[np.isnan(change).any(axis=1)] = NO_POSE
    sound = np.flatnonzero(reason == USED)
    reason[sound[is_still(change[sound])]] = FALLEN
    return Strides(
        axes=axes,
        recording=np.full(len(first), recording),
        time_s=time_s[first],
        state=axes.wrapped(state[first]),
        inputs=commanded,
        change=change,
        next_state=axes.wrapped(state[second]),
        reason=reason,
    )


# Tables of strides: one per row, with the unit in the name of each column.

CHANGE = ["dx_m", "dy_m", "dtheta_rad"]


def columns_of(axes: StrideAxes) -> list[str]:
    """Return the names of the columns of a table of strides.

    Next states that follow from state and inputs have none.
    """
    return ["recording", "time_s", *axes.columns, *CHANGE, *_learned(axes), "reason"]


def _learned(axes: StrideAxes) -> list[str]:
    """Return the columns of the next states that do not follow from anything."""
    return [f"next_{axis.column}" for axis in axes.states if not axis.is_known]


def to_table(strides: Strides) -> pd.DataFrame:
    """Return strides as a table with the unit in each column's name."""
    axes = strides.axes
    columns: dict[str, NDArray[Any]] = {
        "recording": strides.recording,
        "time_s": strides.time_s,
        "reason": strides.reason,
    }
    columns |= zip(axes.columns, strides.points.T, strict=True)
    columns |= zip(CHANGE, strides.change.T, strict=True)
    after = strides.next_state[:, ~axes.is_known]
    columns |= zip(_learned(axes), after.T, strict=True)
    return pd.DataFrame({name: columns[name] for name in columns_of(axes)})


def from_table(table: pd.DataFrame, axes: StrideAxes) -> Strides:
    """Return the strides of a table that `to_table` made.

    Raises
    ------
    RecordingError
        If a column is missing.
    """
    wanted = columns_of(axes)
    missing = ", ".join(name for name in wanted if name not in table)
    if missing:
        expected = f"the columns {', '.join(wanted)}"
        raise RecordingError(f"frame changes: expected {expected}, missing {missing}")

    def numbers(names: Iterable[str]) -> FloatArray:
        return table[list(names)].to_numpy(dtype=float)

    n_states = len(axes.states)
    state = numbers(axes.columns[:n_states])
    inputs = numbers(axes.columns[n_states:])
    after = axes.next_state(state, inputs)
    after[:, ~axes.is_known] = numbers(_learned(axes))
    return Strides(
        axes=axes,
        recording=table["recording"].to_numpy(dtype=str),
        time_s=table["time_s"].to_numpy(dtype=float),
        state=state,
        inputs=inputs,
        change=numbers(CHANGE),
        next_state=after,
        reason=table["reason"].to_numpy(dtype=str),
    )
