"""Is the flow through a state C1? Table 1.1 of the dissertation, computed.

The first column of the table is event-selection. The second (force-position additive: positions
and velocities, guards of position, additive accelerations) suffices for the crossings to commute.
Whether they do is computed as well, and decides: the flow has a Jacobian at the state if all orders
that occur around it have one matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from hopdata.hybrid.first_order.conditions import Conditions
from hopdata.hybrid.first_order.findings import Finding, findings_table
from hopdata.hybrid.first_order.local import active_guards, instant, linearise, state_scale
from hopdata.hybrid.first_order.selection import EventSelection, check_event_selected
from hopdata.hybrid.first_order.split import Indices
from hopdata.hybrid.system import System

EQUAL = 1e-8
NOT_SELECTED, SELECTED, C1 = "not event-selected", "event-selected, not C1", "C1"


@dataclass(frozen=True)
class SmoothnessReport:
    """What `check_c1` found.

    Parameters
    ----------
    guards : tuple of str
        The active guards.
    selection : tuple of Finding
        First column of table 1.1: what makes the system event-selected.
    additivity : tuple of Finding
        Second column: what makes it force-position additive, and so C1.
    products : Finding
        Whether all orders of crossing that occur have one saltation product; the value is the
        largest distance of two of them over the largest distance of one from 1.
    positions, velocities : tuple of int or None
        The split of the state, given or inferred; None if there is none.
    """

    guards: tuple[str, ...]
    selection: tuple[Finding, ...]
    additivity: tuple[Finding, ...]
    products: Finding
    positions: Indices | None
    velocities: Indices | None

    @property
    def verdict(self) -> str:
        """One of "C1", "event-selected, not C1", "not event-selected"."""
        if not all(finding.passed for finding in self.selection):
            return NOT_SELECTED
        return C1 if self.products.passed else SELECTED

    @property
    def reasons(self) -> tuple[str, ...]:
        """The conditions that do not hold."""
        every = (*self.selection, *self.additivity, self.products)
        return tuple(finding.condition for finding in every if not finding.passed)

    def __str__(self) -> str:
        why = f" (does not hold: {'; '.join(self.reasons)})" if self.reasons else ""
        table = findings_table((*self.selection, *self.additivity, self.products)).split("\n")
        middle = 1 + len(self.selection)
        lines = [
            f"{self.verdict}{why}",
            f"guards {', '.join(self.guards)}; positions {_listed(self.positions)}, "
            f"velocities {_listed(self.velocities)}",
            table[0],
            "event-selected if",
            *table[1:middle],
            "force-position additive, so C1, if moreover",
            *table[middle:],
        ]
        return "\n".join(lines)


def _listed(indices: Indices | None) -> str:
    return "none" if indices is None else " ".join(map(str, indices))


def check_c1(
    system: System,
    state: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
    positions: Sequence[int] | None = None,
    velocities: Sequence[int] | None = None,
    scale: ArrayLike | None = None,
    radius: float = 1e-3,
    n_samples: int = 16,
    seed: int = 0,
    tolerance: float = EQUAL,
) -> SmoothnessReport:
    """Check whether the flow through a state on the surfaces of guards is C1.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    state : (n,) array_like
        State at which the guards meet.
    params, mode, t
        As for `solve`; `mode` is that before the crossings, with all locks set.
    guards : sequence of int or str, optional
        The guards that are crossed. By default those on whose surface the state lies.
    positions, velocities : sequence of int, optional
        Split of the state. By default inferred; if one is given the other is the rest.
    scale : (n,) array_like, optional
        Size of each coordinate: unit of differences, samples and norms. By default 1.
    radius, n_samples, seed
        Liveness is looked at on so many states more, in a ball of this radius in units of `scale`.
    tolerance : float
        Up to which two numbers are taken as equal, relative to their size.

    Returns
    -------
    SmoothnessReport
        Print it for the table.
    """
    sizes = state_scale(system, scale)
    start = instant(system, state, params=params, mode=mode, t=t)
    active = active_guards(system, linearise(system, start, sizes), guards, sizes)
    selection = check_event_selected(
        system, start.y, params=params, mode=mode, t=t, guards=active,
        radius=radius, n_samples=n_samples, seed=seed, scale=sizes,
    )  # fmt: skip
    local = Conditions(system, start, active, sizes, seed, tolerance)
    split = local.split(positions, velocities)
    return SmoothnessReport(
        selection.guards,
        _selection_findings(selection, local),
        local.additivity(selection.passed, split),
        local.products(),
        *(split or (None, None)),
    )


def _selection_findings(selection: EventSelection, local: Conditions) -> tuple[Finding, ...]:
    continuous, *others = selection.findings
    return (continuous, *local.smooth_guards(), *others)
