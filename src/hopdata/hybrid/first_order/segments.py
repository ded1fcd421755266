"""The flow's derivative with the events left out: what a method that ignores them sees.

`solve(..., jacobian=True)` carries the derivative through each event by its saltation
matrix. Here it is carried from event to event only, as if each came at a fixed time and
changed nothing. That is what differentiating the field along a trajectory gives, mode
by mode. It is wrong wherever a neighbour meets an event at another time and the field
changes there, and it is of use to see by how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.hybrid.solution import Solution
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System

#: Time by which a piece ends before the event that ends it, which then is not met.
#: Unit: 1, of the span of the integration. Origin: chosen.
BEFORE_EVENT = 1e-9


def derivative_without_saltation(
    system: System,
    t_span: tuple[float, float],
    y0: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int] | None = None,
    jacobian: bool | str = True,
    **options: Any,
) -> tuple[Solution, FloatArray, FloatArray | None]:
    """Return the solution, and its derivative as it would be if events changed nothing.

    Parameters
    ----------
    system, t_span, y0, params, mode
        As for `solve`; time runs forward.
    jacobian : True or "params"
        With "params", the derivative with respect to the parameters is included.
    **options
        Further options of `solve`.

    Returns
    -------
    solution : Solution
        The trajectory with its events.
    of_state : (n, n) array
        Product of the derivatives of the pieces between the events.
    of_params : (n, p) array or None
        The same for the parameters, if requested.
    """
    whole = solve(system, t_span, y0, params=params, mode=mode, **options)
    events = whole.events
    # Of several events at one instant, the last has the state that goes on.
    last = np.flatnonzero(np.diff(events.time, append=np.inf) > 0)
    last = last[events.time[last] < whole.t_end]
    between = events.time[last]
    starts = [t_span[0], *between]
    ends = [*between, whole.t_end]
    states = [np.asarray(y0, dtype=np.float64), *events.after[last]]
    modes = [mode, *events.mode[last].tolist()]
    pause = BEFORE_EVENT * (whole.t_end - t_span[0])
    of_state = np.eye(len(states[0]))
    of_params = None
    for start, end, state, its_mode in zip(starts, ends, states, modes, strict=True):
        if end - pause <= start:
            # Two events nearly coincide: hardly anything changes between them.
            continue
        piece = solve(
            system,
            (start, end - pause),
            state,
            params=params,
            mode=its_mode,
            jacobian=jacobian,
            **options,
        )
        assert piece.jacobian is not None
        of_state = piece.jacobian @ of_state
        if piece.sensitivity is not None:
            # The chain rule: what came before is carried on, and this piece adds.
            before = np.zeros_like(piece.sensitivity)
            if of_params is not None:
                before = of_params
            of_params = piece.jacobian @ before + piece.sensitivity
    return whole, of_state, of_params
