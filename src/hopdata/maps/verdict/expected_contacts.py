"""The contact instants, and their orders, that the state before a landing leads one to expect."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.kinks import Feet
from hopdata.maps.verdict.smooth import affordable_degree, monomials

_OUTLYING = 5.0

Floats = NDArray[np.float64]


def expected_contacts(x: Floats, instants: Floats) -> Floats:
    """Return the contact instants (N, feet) that the inputs lead one to expect, mean removed.

    A polynomial of the inputs fitted to the measured instants, so that errors of these, which the
    outputs may share, move no landing across a kink. Its degree is the one that predicts best with
    each landing left out; landings whose instants lie far off take no part.
    """
    t = instants - instants.mean(axis=1, keepdims=True)
    highest = affordable_degree(len(x), x.shape[1], t.shape[1])
    fitted, best, least = np.median(t, axis=0), t, np.inf
    for degree in range(1, highest + 1):  # a few terms first: wrong instants stand out more
        miss = np.abs(t - fitted).max(axis=1)
        good = miss <= _OUTLYING * 1.4826 * np.median(miss)
        design = np.column_stack([np.ones(len(x)), monomials(x, tuple(range(1, degree + 1)))])
        if good.sum() <= design.shape[1]:  # of so few landings none can be told to lie off
            good = np.ones(len(x), dtype=bool)
        basis, root = np.linalg.qr(design[good])
        fitted = design @ np.linalg.solve(root, basis.T @ t[good])
        slack = np.maximum(1.0 - np.sum(basis**2, axis=1), 1e-3)
        error = np.mean(((t - fitted)[good] / slack[:, None]) ** 2)
        if error < least:
            best, least = fitted, error
    expected: Floats = best - best.mean(axis=1, keepdims=True)
    return expected


def contact_orders(instants: Floats, least: int) -> tuple[Feet, ...]:
    """Return the orders, each as its feet from 0, that `least` landings (N, feet) or more have."""
    order = np.argsort(instants, axis=1, kind="stable")
    orders, counts = np.unique(order, axis=0, return_counts=True)
    return tuple(tuple(feet) for feet in orders[counts >= least].tolist())
