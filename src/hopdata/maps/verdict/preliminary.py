"""What landings that give no size say all the same.

A study that is refused a verdict has still seen contact orders, and often enough
landings to tell whether their differences are foretold: both say whether more landings
of this kind are worth while. Nothing here enters a size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray
from hopdata.errors import AnalysisError
from hopdata.feet import with_foot_names
from hopdata.landings.schedules import order_names
from hopdata.maps.verdict.coordinates import (
    rigid_states,
    state_inputs,
    without_units,
)
from hopdata.maps.verdict.inputs import LEAST_CLASS, STATE, least_landings
from hopdata.maps.verdict.linear import left_out_errors, whitened
from hopdata.messages import Message

#: Fewest landings for each coefficient of what foretells the contacts. With fewer, the
#: errors of landings left out say little.
#: Unit: landings. Origin: chosen.
LANDINGS_PER_COEFFICIENT = 2

#: Least variance of the contacts that counts as one, in that of their measured errors.
#: Unit: 1. Origin: chosen.
BEYOND_ERRORS = 2.0


# Why a share cannot be told, see `Preliminary.unknown_because`.
FEW = "few"
ERRORS = "errors"
STATES = "states"

# What is said then.
_SAID = {
    FEW: "maps.so_far_few",
    ERRORS: "maps.so_far_errors",
    STATES: "maps.so_far_states",
}


@dataclass(frozen=True)
class Preliminary:
    """What is known without a size.

    Attributes
    ----------
    orders
        Each contact order that occurs with its number of landings, commonest first.
    least_landings
        Fewest landings of which a verdict is made for this number of feet.
    contacts_r2
        Share of how the contacts vary from landing to landing that the state and the
        feet before the landing foretell; None if it cannot be told.
    unknown_because
        Why it cannot: there are too few landings (``"few"``), their contacts vary
        hardly more than by their errors (``"errors"``), or the states are not those of
        a rigid body that moves (``"states"``). Empty if it can.
    """

    orders: tuple[dict[str, Any], ...]
    least_landings: int
    contacts_r2: float | None
    unknown_because: str

    def said(self) -> Message:
        """Return orders and share in words."""
        told = []
        for one in self.orders:
            told.append(f"{one['order']} ({one['landings']})")
        values = {"orders": ", ".join(told)}
        if self.contacts_r2 is None:
            return Message(_SAID[self.unknown_because], values)
        values["share"] = f"{100 * self.contacts_r2:.0f} %"
        return Message("maps.so_far_foretold", values)

    def needed(self) -> Message:
        """Return what a verdict needs at least."""
        values = {"least": self.least_landings, "least_of_order": LEAST_CLASS}
        return Message("maps.so_far_needs", values)


def preliminary(
    before: FloatArray,
    after: FloatArray,
    instants: FloatArray,
    *,
    instants_se: FloatArray | None = None,
    feet: FloatArray | None = None,
    foot_names: Sequence[str] = (),
) -> Preliminary:
    """Return what landings say that give no size.

    Parameters
    ----------
    before, after
        (n, 6B) states of B markers at the two sections: positions, m, z up, then
        velocities, m/s.
    instants, instants_se
        (n, feet) contact instants, s, and their standard errors, s, if these are known.
    feet
        (n, feet, 3) positions of the feet at the pre section, m, z up, if they are
        known.
    foot_names
        Names of the feet; without them orders have their numbers.
    """
    share = None
    unknown_because = FEW
    if len(before) >= LANDINGS_PER_COEFFICIENT * (1 + STATE):
        try:
            dimensionless = without_units(before, after)
        except AnalysisError:
            unknown_because = STATES
        else:
            pre = rigid_states(dimensionless.before, dimensionless.shape)
            states = state_inputs(pre)
            share = foretold_share(states, instants, instants_se, feet)
            unknown_because = ""
            if share is None:
                unknown_because = ERRORS
    least = least_landings(instants.shape[1])
    return Preliminary(
        _counted_orders(instants, foot_names), least, share, unknown_because
    )


def _counted_orders(
    instants: FloatArray, foot_names: Sequence[str]
) -> tuple[dict[str, Any], ...]:
    """Return the orders of contact instants (n, feet), s, commonest first."""
    each = order_names(np.argsort(instants, axis=1, kind="stable"))
    names, counts = np.unique(each, return_counts=True)
    orders = []
    for k in np.argsort(-counts, kind="stable"):
        order = with_foot_names(str(names[k]), foot_names)
        orders.append({"order": order, "landings": int(counts[k])})
    return tuple(orders)


def foretold_share(
    states: FloatArray,
    instants: FloatArray,
    instants_se: FloatArray | None,
    feet: FloatArray | None,
) -> float | None:
    """Return the share of the contacts' variation that is foretold, left one out.

    What their errors explain belongs to neither side. The usual contact pattern does
    not count: of one order that never changes, nothing is foretold by the state. None
    if contacts vary hardly more than by their errors.

    Parameters
    ----------
    states
        (n, p) coordinates of the state before each landing, n at least twice p + 1.
    instants, instants_se, feet
        As for `preliminary`; `feet` only count where all of them are seen.
    """
    relative = instants - instants.mean(axis=1, keepdims=True)
    candidates = [states]
    if feet is not None and np.isfinite(feet).all():
        candidates.append(np.column_stack([states, feet[:, :, 2]]))
    missed = []
    for inputs in candidates:
        if len(inputs) >= LANDINGS_PER_COEFFICIENT * (1 + inputs.shape[1]):
            design = np.column_stack([np.ones(len(inputs)), whitened(inputs)])
            missed.append(float(np.mean(left_out_errors(design, relative) ** 2)))
    constant = np.ones((len(relative), 1))
    varied = float(np.mean(left_out_errors(constant, relative) ** 2))
    by_errors = 0.0
    if instants_se is not None:
        n_feet = instants.shape[1]
        squares = float(np.mean(np.nan_to_num(instants_se) ** 2))
        by_errors = squares * (1.0 - 1.0 / n_feet)
    if not varied > BEYOND_ERRORS * by_errors:
        return None
    share_missed = (min(missed) - by_errors) / (varied - by_errors)
    return float(np.clip(1.0 - share_missed, 0.0, 1.0))
