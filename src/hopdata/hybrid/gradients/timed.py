"""Known instants of a run, for the pass backward: how they are told to it.

The pass looks at each end of a step whether the field jumps there, as the driver did
when it ended the step there (`driver.known`), and how this instant moves with the
parameters (`driver.moving_instants`). A stage of a step sees only times between two
such instants.
"""

from typing import NamedTuple

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.hybrid import layout
from hopdata.hybrid.derived import field_of_parameters, why_unsought
from hopdata.hybrid.driver.problem import TIME_ROUNDING
from hopdata.hybrid.known_instants import Instants, instants_of
from hopdata.hybrid.numbers import answers
from hopdata.hybrid.numbers.guards import RangedGuards
from hopdata.hybrid.numbers.switches import field_for_ranges, may_switch
from hopdata.hybrid.system import System

#: How far from a known instant the field is on one side of it.
#: Unit: roundings of the time. Origin: derived: a few times `known.SHORTEST`, to which
#: the driver locates an instant.
MARGIN = 16.0


class Timed(NamedTuple):
    """What the pass needs to know of instants.

    Parameters
    ----------
    code : (1,) array of int
        Address of the field's code for ranges, with the parameters behind the states;
        0 if no instants are sought.
    declared : (k,) array
        Declared instants, increasing.
    margin : (1,) array
        How far from an instant the field is on one side, s.
    rows : (4, n + p) array
        Room for ranges of states and parameters.
    told : (N_SLOTS,) array of int
        Memory of answers.
    moves : (n + p,) array
        How an instant moves with each parameter, behind n numbers.
    held : (1,) array of int
        Number of jumps of which this is not known.
    """

    code: IntArray
    declared: FloatArray
    margin: FloatArray
    rows: FloatArray
    told: IntArray
    moves: FloatArray
    held: IntArray


def ranged_field(system: System) -> RangedGuards:
    """Return the field's code for ranges, with the parameters behind the states."""
    key = "field_of_parameters"
    if key not in system.made:
        system.made[key] = field_for_ranges(field_of_parameters(system))
    found: RangedGuards = system.made[key]
    return found


def _within(known: Instants, start: float, end: float) -> FloatArray:
    """Return all declared instants in a time span."""
    found = [known.singles[0]]
    for first, period in known.periods[0].reshape(-1, 2):
        if period < np.inf:
            least = np.floor((start - first) / period)
            most = np.ceil((end - first) / period)
            found.append(first + np.arange(least, most + 1.0) * period)
    times = np.unique(np.concatenate(found))
    return times[(times >= start) & (times <= end)]


def timed(system: System, params: FloatArray, n: int, t: FloatArray) -> Timed:
    """Return what the pass through a run needs to know of instants.

    Parameters
    ----------
    system : System
        The user's system.
    params : (p,) array
        Parameters, with the memory.
    n : int
        Number of the user's states.
    t : (N,) array
        Times of the run.
    """
    code = 0
    if may_switch(system.field) and not reason_unsought(system):
        code = ranged_field(system).address
    declared = np.empty(0)
    if system.tstops is not None:
        known = instants_of(system, None, params[: len(params) - system.n_memory])
        declared = _within(known, float(t[0]), float(t[-1]))
    size = max(abs(float(t[0])), abs(float(t[-1])))
    width = n + len(params)
    return Timed(
        code=np.array([code]),
        declared=declared,
        margin=np.array([MARGIN * TIME_ROUNDING * size]),
        rows=np.zeros((4, width)),
        told=np.zeros(answers.N_SLOTS, dtype=np.int64),
        moves=np.zeros(width),
        held=np.zeros(1, dtype=np.int64),
    )


def reason_unsought(system: System) -> str:
    """Return why the field's own instants are not sought; "" if they are."""
    if system.sliding and may_switch(system.field):
        return "the gradient of a system that slides does not"
    return why_unsought(system)


def with_instants_told(message: str, unsought: str, held: int) -> str:
    """Return a message with what is not known of instants."""
    lines = [message]
    if unsought:
        lines.append(layout.UNSOUGHT_INSTANTS.format(reason=unsought))
    if held > 0:
        lines.append(layout.HELD_INSTANTS.format(count=held))
    return " ".join(lines)
