"""Is the flow through a state C1? The first column of table 1.1, and what decides.

The table's first column is event-selection. Whether the crossings commute is computed: the flow has
a Jacobian at the state if all orders that occur around it have one matrix. (The second column,
forces that add and guards of position alone, suffices for that, and is not needed.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.linearise import Linearisation
from hopdata.hybrid.first_order.saltation import BouligandDerivative, NotTransversalError
from hopdata.hybrid.first_order.selection import Finding, check_event_selected
from hopdata.hybrid.system import System

# Measures of smooth guards, and of crossings that commute.

REFINEMENT = 8.0


def one_sided_gaps(
    system: System, here: Linearisation, guards: list[int], scale: FloatArray
) -> tuple[float, float]:
    """Return how much the guards' slopes from both sides differ, for a step and an eighth of it.

    Relative to the slope. A smooth guard's difference shrinks with the step, that of a kink stays.
    """
    coarse, fine = (_gap(system, here, guards, scale, local.STEP / r) for r in (1.0, REFINEMENT))
    size = np.abs(here.gradients[guards]) @ scale
    return tuple(float(np.max(gap / size)) if size.all() else np.inf for gap in (coarse, fine))  # type: ignore[return-value]


def _gap(
    system: System, here: Linearisation, guards: list[int], scale: FloatArray, step: float
) -> FloatArray:
    at = here.instant

    def surfaces(y: FloatArray) -> FloatArray:
        return local.guards_at(system, at.moved(y, at.t), here.rate)[0][guards]

    bends = [
        surfaces(at.y + shift) - 2 * surfaces(at.y) + surfaces(at.y - shift)
        for shift in np.diag(step * scale)
    ]
    return np.sum(np.abs(bends), axis=0) / step


def rates_agree(system: System, here: Linearisation, guards: list[int]) -> float:
    """Return how far rates that the guards report are from Dh f + dh/dt, relative to their size."""
    reported = local.guards_at(system, here.instant, here.rate)[1][guards]
    off, size = np.abs(reported - here.guard_rates[guards]), here.guard_scales[guards]
    return float(np.max(np.divide(off, size, out=np.zeros_like(off), where=size > 0)))


def spread(products: Sequence[FloatArray]) -> float:
    """Return the largest distance of two saltation products over the largest effect of one.

    The distance is Frobenius' norm, in units of the coordinates' sizes; the effect that to 1.
    """
    stack = np.array(products)
    effect = np.linalg.norm(stack - np.eye(stack.shape[-1]), axis=(1, 2)).max()
    apart = max(float(np.linalg.norm(stack - one, axis=(1, 2)).max()) for one in stack)
    return apart / float(effect) if effect > 0 else 0.0


EQUAL = 1e-8
ONE_PRODUCT = "all orders have one saltation product"
NOT_SELECTED, SELECTED, C1 = "not event-selected", "event-selected, not C1", "C1"


def smooth_guards(
    system: System, here: Linearisation, active: list[int], scale: FloatArray, tolerance: float
) -> tuple[Finding, ...]:
    """Guards have one slope from both sides, and report rates that agree with it."""
    coarse, fine = one_sided_gaps(system, here, active, scale)
    return (
        Finding.at_most(
            "guards are smooth surfaces", fine, max(0.5 * coarse, tolerance),
            "difference of slopes from both sides; needed: half of that at 8 times the step",
        ),
        Finding.at_most(
            "guards report their rates", rates_agree(system, here, active), tolerance,
            "difference of hdot and Dh f + dh/dt",
        ),
    )  # fmt: skip


def one_product(flow: BouligandDerivative, seed: int, tolerance: float) -> Finding:
    """Return whether the orders that occur agree in their saltation product."""
    scale = flow.scale
    try:
        orders = flow.pieces(seed=seed)
    except NotTransversalError as error:
        return Finding(ONE_PRODUCT, False, np.nan, f"<= {tolerance:g}", str(error))
    matrices = [order.matrix * scale / scale[:, None] for order in orders]
    detail = f"largest distance of two of {len(orders)} products, over that of one from 1"
    ends, start = np.array([order.state for order in orders]), flow.node(()).here.instant.y
    if (ends != start).any():
        apart = max(float(np.linalg.norm((ends - end) / scale, axis=1).max()) for end in ends)
        detail += f"; the states after them differ by {apart:.3g}"
    return Finding.at_most(ONE_PRODUCT, spread(matrices), tolerance, detail)


@dataclass(frozen=True)
class SmoothnessReport:
    """What `check_c1` found.

    Parameters
    ----------
    guards : tuple of str
        The active guards.
    selection : tuple of Finding
        First column of table 1.1: what makes the system event-selected.
    products : Finding
        Whether all orders of crossing that occur have one saltation product; the value is the
        largest distance of two of them over the largest distance of one from 1.
    """

    guards: tuple[str, ...]
    selection: tuple[Finding, ...]
    products: Finding

    @property
    def verdict(self) -> str:
        """One of "C1", "event-selected, not C1", "not event-selected"."""
        if not all(finding.passed for finding in self.selection):
            return NOT_SELECTED
        return C1 if self.products.passed else SELECTED

    @property
    def reasons(self) -> tuple[str, ...]:
        """The conditions that do not hold."""
        return tuple(f.condition for f in (*self.selection, self.products) if not f.passed)

    def __str__(self) -> str:
        why = f" (does not hold: {'; '.join(self.reasons)})" if self.reasons else ""
        head, *rows = Finding.table((*self.selection, self.products)).split("\n")
        return "\n".join([
            f"{self.verdict}{why}", f"guards {', '.join(self.guards)}", head,
            "event-selected if", *rows[:-1], "C1 if moreover", rows[-1],
        ])  # fmt: skip


def check_c1(
    system: System,
    state: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
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
    sizes = local.state_scale(system, scale)
    start = local.instant(system, state, params=params, mode=mode, t=t)
    here = local.linearise(system, start, sizes)
    active = local.active_guards(system, here, guards, sizes)
    selected = check_event_selected(
        system, start.y, params=params, mode=mode, t=t, guards=active,
        radius=radius, n_samples=n_samples, seed=seed, scale=sizes,
    )  # fmt: skip
    continuous, *others = selected.findings
    smooth = smooth_guards(system, here, list(active), sizes, tolerance)
    products = one_product(BouligandDerivative(system, start, active, sizes), seed, tolerance)
    return SmoothnessReport(selected.guards, (continuous, *smooth, *others), products)
