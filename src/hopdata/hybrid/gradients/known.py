"""Instants at which the field jumps: how they are told to the pass backward.

The pass looks at each end of a step whether the field jumps there, as the driver did
when it ended the step there (`driver.known`), and how this instant moves with the
parameters (`driver.moving_instants`). A stage of a step sees only times between two
such instants. What the pass does there stands in `jump`; here is what is made ready in
Python, before the pass, and what is told to the user after it.
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


class Known(NamedTuple):
    """What the pass needs to know of instants at which the field jumps.

    Parameters
    ----------
    code : (1,) array of int
        Address of the field's code for ranges, with the parameters behind the states;
        0 if no instants are sought.
    declared : (k,) array
        Declared instants, increasing.
    margin : (1,) array
        How far from an instant the field is on one side, s.
    ranges : (4, n + p) array
        Room for ranges of states and parameters.
    answers : (N_SLOTS,) array of int
        Memory of what the field's code tells.
    moves : (n + p,) array
        How an instant moves with each parameter, behind n numbers.
    n_held : (1,) array of int
        Number of jumps that were held fixed, as it is not known how they move.
    """

    code: IntArray
    declared: FloatArray
    margin: FloatArray
    ranges: FloatArray
    answers: IntArray
    moves: FloatArray
    n_held: IntArray


def ranged_field(system: System) -> RangedGuards:
    """Return the field's code for ranges, with the parameters behind the states."""
    key = "field_of_parameters"
    if key not in system.made:
        system.made[key] = field_for_ranges(field_of_parameters(system))
    found: RangedGuards = system.made[key]
    return found


def _within(instants: Instants, start: float, end: float) -> FloatArray:
    """Return all declared instants in a time span."""
    found = [instants.singles[0]]
    for first, period in instants.periods[0].reshape(-1, 2):
        if period < np.inf:
            least = np.floor((start - first) / period)
            most = np.ceil((end - first) / period)
            found.append(first + np.arange(least, most + 1.0) * period)
    times = np.unique(np.concatenate(found))
    return times[(times >= start) & (times <= end)]


def known_of(
    system: System, params: FloatArray, n_given: int, n: int, t: FloatArray
) -> Known:
    """Return what the pass through a run needs to know of its instants.

    Parameters
    ----------
    system : System
        The user's system.
    params : (p,) array
        Parameters, with the memory.
    n_given : int
        Number of the user's own parameters, which are the first.
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
        instants = instants_of(system, None, params[:n_given])
        declared = _within(instants, float(t[0]), float(t[-1]))
    size = max(abs(float(t[0])), abs(float(t[-1])))
    width = n + len(params)
    return Known(
        code=np.array([code]),
        declared=declared,
        margin=np.array([MARGIN * TIME_ROUNDING * size]),
        ranges=np.zeros((4, width)),
        answers=np.zeros(answers.N_SLOTS, dtype=np.int64),
        moves=np.zeros(width),
        n_held=np.zeros(1, dtype=np.int64),
    )


def reason_unsought(system: System) -> str:
    """Return why the field's own instants are not sought; "" if they are."""
    if system.sliding and may_switch(system.field):
        return "the gradient of a system that slides does not seek them"
    return why_unsought(system)


def with_instants_told(message: str, unsought: str, n_held: int) -> str:
    """Return a message that also says what is not known of instants.

    Parameters
    ----------
    message : str
        How the solution ended.
    unsought : str
        Why the field's own instants were not sought; "" if they were.
    n_held : int
        Number of jumps that were held fixed.
    """
    lines = [message]
    if unsought:
        lines.append(layout.UNSOUGHT_INSTANTS.format(reason=unsought))
    if n_held > 0:
        lines.append(layout.HELD_INSTANTS.format(count=n_held))
    return " ".join(lines)
