"""Measures of what makes crossings commute: smooth guards, additive forces, one product."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.hybrid.first_order.local import (
    STEP,
    FloatArray,
    Linearisation,
    guards_at,
)
from hopdata.hybrid.first_order.modes import Combination
from hopdata.hybrid.system import System

REFINEMENT = 8.0

Modes = dict[Combination, Linearisation]


def one_sided_gaps(
    system: System, here: Linearisation, guards: Sequence[int], scale: FloatArray
) -> tuple[float, float]:
    """Return how much the guards' slopes from both sides differ, for a step and an eighth of it.

    Relative to the slope. A smooth guard's difference shrinks with the step, that of a kink stays.
    """
    chosen = list(guards)
    coarse, fine = (_gap(system, here, chosen, scale, STEP / r) for r in (1.0, REFINEMENT))
    size = np.abs(here.gradients[chosen]) @ scale
    return tuple(float(np.max(gap / size)) if size.all() else np.inf for gap in (coarse, fine))  # type: ignore[return-value]


def _gap(
    system: System, here: Linearisation, guards: list[int], scale: FloatArray, step: float
) -> FloatArray:
    at = here.instant

    def surfaces(y: FloatArray) -> FloatArray:
        return guards_at(system, at.moved(y, at.t), here.rate)[0][guards]

    bends = [
        surfaces(at.y + shift) - 2 * surfaces(at.y) + surfaces(at.y - shift)
        for shift in np.diag(step * scale)
    ]
    return np.sum(np.abs(bends), axis=0) / step


def rates_agree(system: System, here: Linearisation, guards: Sequence[int]) -> float:
    """Return how far rates that the guards report are from Dh f + dh/dt, relative to their size."""
    chosen = list(guards)
    reported = guards_at(system, here.instant, here.rate)[1][chosen]
    off, size = np.abs(reported - here.guard_rates[chosen]), here.guard_scales[chosen]
    return float(np.max(np.divide(off, size, out=np.zeros_like(off), where=size > 0)))


def increments(modes: Modes) -> tuple[FloatArray, FloatArray]:
    """Return the changes of the field by single guards, (n_guards, n), and the rates' sizes (n,).

    The size of a rate is its largest value in any mode.
    """
    free = modes[()].rate
    single = np.array([modes[c].rate - free for c in modes if len(c) == 1])
    size = np.max([np.abs(view.rate) for view in modes.values()], axis=0)
    return single, size


def additive_residual(modes: Modes) -> float:
    """Return the largest |f_b - f_0 - sum of single changes| over modes b, over rates' sizes."""
    single, size = increments(modes)
    of = {c[0]: change for c, change in zip((c for c in modes if len(c) == 1), single, strict=True)}
    nothing = np.zeros_like(size)
    residuals = [
        np.abs(view.rate - modes[()].rate - sum((of[k] for k in crossed), nothing))
        for crossed, view in modes.items()
    ]
    return largest_relative(np.max(residuals, axis=0), size)


def largest_relative(values: FloatArray, sizes: FloatArray) -> float:
    """Return the largest ratio of values to sizes; 0 where both vanish."""
    ratios = np.divide(values, sizes, out=np.zeros_like(values), where=sizes > 0)
    return float(np.max(ratios, initial=0.0))


def spread(products: Sequence[FloatArray]) -> float:
    """Return the largest distance of two saltation products over the largest effect of one.

    The distance is Frobenius' norm, in units of the coordinates' sizes; the effect that to 1.
    """
    stack = np.array(products)
    effect = np.linalg.norm(stack - np.eye(stack.shape[-1]), axis=(1, 2)).max()
    apart = max(float(np.linalg.norm(stack - one, axis=(1, 2)).max()) for one in stack)
    return apart / float(effect) if effect > 0 else 0.0
