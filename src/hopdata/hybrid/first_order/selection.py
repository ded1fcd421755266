"""Is a system event-selected around a state? Liveness in every mode, and continuity.

Definitions 1.2.1 and 1.2.2 of the dissertation: near the state every active guard is approached at
a rate that is bounded away from zero, whichever of the others have been crossed, and the state does
not jump. Then every trajectory crosses each of them exactly once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.hybrid.first_order.findings import Finding, above, at_most, findings_table
from hopdata.hybrid.first_order.liveness import Liveness, draw_around
from hopdata.hybrid.first_order.local import (
    FloatArray,
    active_guards,
    instant,
    linearise,
    state_scale,
)
from hopdata.hybrid.system import System

LIVE = 1e-6
UNCHANGED = 1e-12


@dataclass(frozen=True)
class EventSelection:
    """What `check_event_selected` found.

    Parameters
    ----------
    guards : tuple of str
        The active guards.
    n_samples, n_modes : int
        Number of states, and of combinations of locks at each.
    margins : (n_guards,) array
        For each guard the smallest rate at which it is crossed over samples and modes, in its own
        direction, over the sum |Dh_i f_i| + |dh/dt|: 1 if all terms pull together, negative if it
        runs back. Does not change with the units of state, guard or time.
    rates : (n_guards,) array
        The smallest rates themselves, in the guard's unit per second.
    kept : (n_guards,) array
        Smallest ratio of a guard's rate after its own crossing to that before.
    jump : float
        Largest change of a state coordinate by a handler, over its size or `scale`.
    wrong_way : float
        Largest step by which a handler moves the state, or a surface, back over a guard that has
        been crossed, or over one that has not, in units of the guard's scale.
    findings : tuple of Finding
        The conditions with their bounds.
    """

    guards: tuple[str, ...]
    n_samples: int
    n_modes: int
    margins: FloatArray
    rates: FloatArray
    kept: FloatArray
    jump: float
    wrong_way: float
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> bool:
        """Whether all conditions hold."""
        return all(finding.passed for finding in self.findings)

    def __str__(self) -> str:
        verdict = "event-selected" if self.passed else "not event-selected"
        where = f"{self.n_samples} states, {self.n_modes} modes, guards {', '.join(self.guards)}"
        return f"{verdict}: {where}\n{findings_table(self.findings)}"


def check_event_selected(
    system: System,
    states: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
    radius: float = 0.0,
    n_samples: int = 0,
    seed: int = 0,
    scale: ArrayLike | None = None,
    margin: float = LIVE,
) -> EventSelection:
    """Check on samples that a system is event-selected.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    states : (n,) or (m, n) array_like
        States to look at.
    params, mode, t
        As for `solve`; `mode` is that before the crossings, with all locks set.
    guards : sequence of int or str, optional
        The active guards. By default those on whose surface the first state lies.
    radius, n_samples, seed
        Add so many states, drawn around each from a ball of this radius in units of `scale`.
    scale : (n,) array_like, optional
        Size of each coordinate. By default 1.
    margin : float
        Bound that the margins have to exceed.

    Returns
    -------
    EventSelection
        Over all 2^n combinations of locks up to n = 8 active guards, over 256 beyond.
    """
    sizes = state_scale(system, scale)
    given = np.atleast_2d(np.asarray(states, dtype=np.float64))
    places = draw_around(given, radius * sizes, n_samples, seed)
    starts = [instant(system, y, params=params, mode=mode, t=t) for y in places]
    active = active_guards(system, linearise(system, starts[0], sizes), guards, sizes)
    if not active:
        raise ValueError("guards: expected at least one, the state lies on no surface")
    views = [Liveness(system, start, active, sizes, seed) for start in starts]
    margins, rates, kept = (
        np.min([getattr(view, name) for view in views], axis=0)
        for name in ("margins", "rates", "kept")
    )
    jump, wrong_way = (max(getattr(view, name) for view in views) for name in ("jump", "wrong_way"))
    return EventSelection(
        tuple(system.guard_names[k] for k in active),
        len(views),
        len(views[0].modes),
        margins,
        rates,
        kept,
        jump,
        wrong_way,
        _findings(margins, rates, kept, jump, wrong_way, margin),
    )


def _findings(
    margins: FloatArray,
    rates: FloatArray,
    kept: FloatArray,
    jump: float,
    wrong_way: float,
    margin: float,
) -> tuple[Finding, ...]:
    worst = int(np.argmin(margins))
    slowest = f"smallest normalised rate of a guard in any mode (it is {rates[worst]:.3g} a second)"
    return (
        at_most("trajectories are continuous", jump, UNCHANGED, "largest jump of a coordinate"),
        above("each guard is crossed", float(margins.min()), margin, slowest),
        at_most(
            "each guard is crossed only once", wrong_way, UNCHANGED,
            "largest step of a handler against a lock",
        ),
        above(
            "contact keeps penetration velocity", float(kept.min()), margin,
            "smallest ratio of a guard's rate after its crossing to that before",
        ),
    )  # fmt: skip
