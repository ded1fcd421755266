"""The smooth part of a landing map near a simultaneous contact, to third order and beyond.

Terms up to the third order are fitted freely. Terms of the fourth order, and those of the third
that are different on the two sides of a double contact, would leave too little of the kinks to be
seen; they are shrunk, by as much as the data say (see `hopdata.maps.verdict.shrinkage`). They come
in two groups, each with a size of its own: terms that change at a double contact or hold contact
instants only, and products of two contact instants and two inputs.
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from math import comb

import numpy as np
from numpy.typing import NDArray

from hopdata.maps.verdict.kinks import time_differences

#: Landings wanted for each free term.
LANDINGS_PER_TERM = 2.5
_FLAT = 1e-9

Floats = NDArray[np.float64]


def monomials(x: Floats, degrees: tuple[int, ...]) -> Floats:
    """Return all products of columns of `x` (n, p) of the given degrees, (n, terms)."""
    return np.hstack([_products_of(x, degree) for degree in degrees])


def _products_of(x: Floats, degree: int) -> Floats:
    chosen = list(combinations_with_replacement(range(x.shape[1]), degree))
    factors = np.array(chosen, dtype=np.int64).reshape(-1, degree).T
    columns = x[:, factors[0]]
    for factor in factors[1:]:
        columns *= x[:, factor]
    return columns


def number_of_free_terms(n_inputs: int, n_feet: int, degree: int) -> int:
    """Return the number of columns of `free_terms`."""
    return comb(n_inputs + degree, degree) + n_feet * (n_feet - 1)


def affordable_degree(landings: int, n_inputs: int, n_feet: int) -> int:
    """Return the order up to which so many landings can have free terms: 3, 2 or 1."""
    for degree in (3, 2):
        terms = number_of_free_terms(n_inputs, n_feet, degree)
        if landings >= LANDINGS_PER_TERM * terms:
            return degree
    return 1


def free_terms(x: Floats, instants: Floats, degree: int) -> Floats:
    """Return the terms that are fitted freely.

    Parameters
    ----------
    x
        (n, p) standardised inputs.
    instants
        (n, feet) contact instants in units of their spread.
    degree
        3, or 2 where landings are few.
    """
    d = time_differences(instants)
    orders = tuple(range(1, degree + 1))
    steps = [d * np.abs(d), np.abs(d) ** 3]
    return np.column_stack([np.ones(len(x)), monomials(x, orders), *steps])


def shrunk_terms(x: Floats, instants: Floats, degree: int) -> tuple[Floats, Floats]:
    """Return the two groups of terms whose coefficients are shrunk, each with mean square one.

    Parameters
    ----------
    x, instants, degree
        See `free_terms`.
    """
    d = time_differences(instants)
    u = instants[:, :-1] - instants[:, -1:]
    steps = d * np.abs(d)
    blocks = [_products(steps, x), _products(steps, monomials(u, (2,))), monomials(u, (4,))]
    if degree < 3:
        blocks.append(monomials(u, (3,)))
    mixed = _products(monomials(_tilts(instants), (2,)), monomials(x, (2,)))
    return _of_unit_size(np.column_stack(blocks)), _of_unit_size(mixed)


def _tilts(instants: Floats) -> Floats:
    """Return the two combinations of the contact instants that vary most, or the one of two feet.

    The feet of a rigid body on a floor touch down by its tilt, about two axes.
    """
    centred = instants - instants.mean(axis=1, keepdims=True)
    _, values, right = np.linalg.svd(centred, full_matrices=False)
    tilts: Floats = centred @ right[:2][values[:2] > _FLAT * values[0]].T
    return tilts


def _of_unit_size(terms: Floats) -> Floats:
    scale = np.sqrt(np.mean(terms**2, axis=0))
    scaled: Floats = terms[:, scale > 0] / scale[scale > 0]
    return scaled


def _products(a: Floats, b: Floats) -> Floats:
    products: Floats = (a[:, :, None] * b[:, None, :]).reshape(len(a), -1)
    return products
