"""Systems whose functions fail, and systems whose solution cannot continue."""

from __future__ import annotations

from functools import cache

import numpy as np
from stress_systems import selected

from hopdata.hybrid import System, field, guards, on_event

NOWHERE, IN_FIELD, IN_GUARD, IN_HANDLER = range(4)
IS_NAN, IS_INFINITE, RAISES = range(3)

# params: place (one of the four above), kind, position from which it fails, lock in
# which it fails (0: in both), position of the guard


@field
def faulty_field(t, y, mode, params, dy):
    dy[0], dy[1] = 1.0, 0.5 if mode[0] > 0 else 0.25
    in_mode = params[3] == 0.0 or params[3] * mode[0] > 0.0
    if params[0] == IN_FIELD and in_mode and y[0] > params[2]:
        if params[1] == RAISES:
            raise ValueError("no field here")
        dy[1] = np.nan if params[1] == IS_NAN else np.inf


@guards
def faulty_guards(t, y, dy, mode, params, h, hdot):
    h[0], hdot[0] = y[0] - params[4], dy[0]
    h[1], hdot[1] = y[0] - 100.0, dy[0]
    in_mode = params[3] == 0.0 or params[3] * mode[0] > 0.0
    if params[0] == IN_GUARD and in_mode and y[0] > params[2]:
        if params[1] == RAISES:
            raise ValueError("no guard here")
        h[1] = np.nan if params[1] == IS_NAN else np.inf


@on_event
def faulty_handler(t, y, mode, params, guard, direction):
    if params[0] == IN_HANDLER:
        if params[1] == RAISES:
            raise ValueError("no handler here")
        y[1] = np.nan if params[1] == IS_NAN else np.inf
    return 0


@cache
def faulty() -> System:
    """Return x' = 1 and a guard; something fails beyond a position."""
    return System(
        faulty_field,
        faulty_guards,
        faulty_handler,
        n_states=2,
        guard_names=("gate", "far"),
    )


@field
def still_field(t, y, mode, params, dy):
    dy[0] = 1.0


@guards
def seesaw_guards(t, y, dy, mode, params, h, hdot):
    # Each guard's surface depends on the other's lock: a flip of one makes the other
    # due.
    h[0], hdot[0] = (
        (y[0] - 1.0 if mode[2] == 0 else mode[3]),
        dy[0] if mode[2] == 0 else 0.0,
    )
    h[1], hdot[1] = (-1.0 if mode[2] == 0 else mode[3]), 0.0


@on_event
def seesaw_event(t, y, mode, params, guard, direction):
    mode[2] = 1
    mode[3] = -direction
    return 0


@cache
def seesaw() -> System:
    """Return guards that push each other back and forth endlessly at one instant."""
    return System(
        still_field, seesaw_guards, seesaw_event, n_states=1, guard_names=("left", "right"),
        n_extra_modes=2,
    )  # fmt: skip


def spiral() -> tuple[System, np.ndarray]:
    """Return four constant fields that wind into the origin: a Zeno sequence of live crossings.

    x' = -sgn y - 0.3 sgn x, y' = sgn x - 0.3 sgn y. From (r, 0) a quarter turn takes r
    / 1.3 and leaves 0.7 r / 1.3, so all quarter turns together take r / 0.6.
    """
    signs = [(1 if row & 1 else -1, 1 if row & 2 else -1) for row in range(4)]
    fields = np.array([(-b - 0.3 * a, a - 0.3 * b) for a, b in signs])
    params = np.concatenate([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0], fields.ravel()])
    return selected(2, 2), params
