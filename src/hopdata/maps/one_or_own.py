"""What a map of its own gains for the landings of a contact order, in mm and degrees.

A difference of maps in per cent says little to who watches an animal. Landings are
therefore predicted that were not fitted (cross-validation): by one map of all orders,
and by the same with an affine map of each order beside it. Both have all second-order
terms, so that curvature, which one smooth map has too, is no gain.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.maps.coordinates import (
    monomials,
    rigid_states,
    section_coordinates,
    split_states,
)
from hopdata.maps.verdict.own_maps import LANDINGS_PER_COEFFICIENT
from hopdata.rigid import OUTPUT_NAMES, body_shape

#: Parts of the landings, each of which is predicted from the others.
#: Unit: 1. Origin: convention: fivefold cross-validation.
FOLDS = 5

#: Landings for each fitted term; with fewer nothing is predicted.
#: Unit: landings. Origin: chosen.
LANDINGS_PER_TERM = 2

#: Confidence of the interval of the typical gain.
#: Unit: 1. Origin: convention.
CONFIDENCE = 0.95

# Ending of an outcome's name -> its unit here, and the factor to it.
UNITS = {
    "_rad_s": ("°/s", float(np.degrees(1.0))),
    "_m_s": ("mm/s", 1e3),
    "_rad": ("°", float(np.degrees(1.0))),
    "_m": ("mm", 1e3),
}
COLUMNS = (
    *("outcome", "unit", "happened", "one_map", "own_map"),
    *("apart", "missed_by_one", "missed_by_own", "gain", "gain_low", "gain_high"),
    *("order", "recording", "touchdown", "n_landings", "n_orders"),
)


@one_blas_thread()
def one_or_own(
    x: ArrayLike,
    y: ArrayLike,
    schedule: ArrayLike,
    *,
    recording: ArrayLike | None = None,
    touchdown: ArrayLike | None = None,
) -> pd.DataFrame:
    """Return what one map and the orders' own maps foretell of landings not fitted.

    Parameters
    ----------
    x, y
        (n, 6B) home-frame states at the pre and the post section: positions, m, and
        velocities, m/s, of the markers of a rigid body.
    schedule
        (n,) contact order of each landing.
    recording, touchdown
        (n,) recording of each landing, and its number there; by default one without a
        name, and numbers from 1.

    Returns
    -------
    DataFrame
        One row for each outcome, in ``unit``. Of an example, the landing whose two
        predictions are as far apart as in the median landing, in the median over
        outcomes: ``happened``, ``one_map`` and
        ``own_map``, less the mean of all landings; its ``order``, its
        ``recording`` and its number ``touchdown``. Over all landings: the medians of
        how far the two predictions are ``apart``, of how far each missed, and of the
        ``gain`` (by how much less own maps missed) with its interval. Empty if there
        are too few landings or a single order.

    Raises
    ------
    AnalysisError
        If the shapes of the arrays do not match.
    """
    before = np.asarray(x, float)
    after = np.asarray(y, float)
    orders = np.asarray(schedule, str)
    _require_shapes(before, after, orders)
    _require_of_each("recording", recording, len(orders))
    _require_of_each("touchdown", touchdown, len(orders))
    finite = np.isfinite(np.hstack([before, after])).all(axis=1)
    known = np.flatnonzero(finite & (orders != ""))
    before = before[known]
    after = after[known]
    orders = orders[known]
    if len(before) < 2 or split_states(before)[0].shape[1] < 3:
        return pd.DataFrame(columns=list(COLUMNS))
    shape = body_shape(split_states(before)[0])
    inputs, outcomes = section_coordinates(
        rigid_states(before, shape), rigid_states(after, shape)
    )
    one, own, n_orders = _terms(inputs, orders)
    if n_orders < 2 or len(one) < LANDINGS_PER_TERM * own.shape[1]:
        return pd.DataFrame(columns=list(COLUMNS))
    by_one = _foretold(one, outcomes)
    by_own = _foretold(own, outcomes)
    example = _typical(by_one, by_own)
    place = {
        "order": orders[example],
        "recording": "" if recording is None else np.asarray(recording)[known[example]],
        "touchdown": known[example] + 1,
    }
    if touchdown is not None:
        place["touchdown"] = np.asarray(touchdown)[known[example]]
    sizes = {"n_landings": len(outcomes), "n_orders": n_orders}
    table = _table(outcomes, by_one, by_own, example)
    return table.assign(**place, **sizes)[list(COLUMNS)]


def _require_shapes(before: FloatArray, after: FloatArray, orders: np.ndarray) -> None:
    """Raise an `AnalysisError` unless states and orders are of the same landings."""
    are_tables = before.ndim == 2 and before.shape == after.shape
    if not are_tables or orders.shape != before.shape[:1]:
        expected = "one row per landing, (n, 6B), (n, 6B), (n,)"
        found = f"{before.shape}, {after.shape}, {orders.shape}"
        raise AnalysisError.at("x, y, schedule", expected, found)


def _require_of_each(name: str, values: ArrayLike | None, n_landings: int) -> None:
    """Raise an `AnalysisError` unless there is a value for each landing, or none."""
    if values is not None and np.shape(values) != (n_landings,):
        expected = f"a value for each of {n_landings} landings"
        raise AnalysisError.at(name, expected, np.shape(values))


def _terms(
    inputs: FloatArray, orders: np.ndarray
) -> tuple[FloatArray, FloatArray, int]:
    """Return the terms of one map, of own maps, and of how many orders these are."""
    scale = inputs.std(axis=0).clip(1e-300)
    states = standardised(inputs, inputs.mean(axis=0), scale)
    common = orders_with_own_maps(orders, states.shape[1] + 1)
    one = map_terms(states)
    return one, map_terms(states, orders, common), len(common)


def standardised(inputs: FloatArray, mean: FloatArray, scale: FloatArray) -> FloatArray:
    """Return inputs (n, p) less their mean, in units of their scale."""
    return np.asarray((inputs - mean) / scale)


def orders_with_own_maps(orders: np.ndarray, n_coefficients: int) -> tuple[str, ...]:
    """Return the orders with landings enough for a map of so many coefficients."""
    names, counts = np.unique(orders, return_counts=True)
    least = LANDINGS_PER_COEFFICIENT * n_coefficients
    return tuple(names[counts >= least].tolist())


def map_terms(
    states: FloatArray,
    orders: np.ndarray | None = None,
    common: Sequence[str] = (),
    *,
    curved: bool = True,
) -> FloatArray:
    """Return the terms (n, t) of one map, or of that and own affine maps of orders.

    Parameters
    ----------
    states
        (n, p) standardised inputs.
    orders
        (n,) contact orders; not needed for one map.
    common
        Orders with a map of their own. The first of them keeps the shared map, as do
        all that are not among them.
    curved
        Whether one map has all second-order terms.
    """
    affine = np.column_stack([np.ones(len(states)), states])
    one = affine
    if curved:
        one = np.column_stack([affine, monomials(states, (2,))])
    blocks = []
    for name in common[1:]:
        of_order = np.asarray(orders) == name
        blocks.append(affine * of_order[:, None])
    return np.column_stack([one, *blocks])


def _foretold(terms: FloatArray, outcomes: FloatArray) -> FloatArray:
    """Return the outcomes (n, 11) foretold from the landings of other folds."""
    foretold = np.empty_like(outcomes)
    fold = np.arange(len(terms)) % FOLDS
    for number in range(FOLDS):
        held_out = fold == number
        fitted: BoolArray = ~held_out
        slopes = np.linalg.lstsq(terms[fitted], outcomes[fitted], rcond=None)[0]
        foretold[held_out] = terms[held_out] @ slopes
    return foretold


def _table(
    outcomes: FloatArray,
    by_one: FloatArray,
    by_own: FloatArray,
    example: int,
) -> pd.DataFrame:
    """Return a row for each outcome: the example's, and how far predictions miss."""
    mean = outcomes.mean(axis=0)
    apart = np.abs(by_own - by_one)
    of_one = np.abs(by_one - outcomes)
    of_own = np.abs(by_own - outcomes)
    rows = []
    for k, name in enumerate(OUTPUT_NAMES):
        ending = next(one for one in UNITS if name.endswith(one))
        unit, factor = UNITS[ending]
        gain, low, high = _median(of_one[:, k] - of_own[:, k])
        rows.append(
            {
                "outcome": name.removesuffix(ending).replace("_", " "),
                "unit": unit,
                "happened": factor * (outcomes[example, k] - mean[k]),
                "one_map": factor * (by_one[example, k] - mean[k]),
                "own_map": factor * (by_own[example, k] - mean[k]),
                "apart": factor * float(np.median(apart[:, k])),
                "missed_by_one": factor * float(np.median(of_one[:, k])),
                "missed_by_own": factor * float(np.median(of_own[:, k])),
                "gain": factor * gain,
                "gain_low": factor * low,
                "gain_high": factor * high,
            }
        )
    return pd.DataFrame(rows)


def _typical(by_one: FloatArray, by_own: FloatArray) -> int:
    """Return the landing whose predictions are as far apart as in the median one."""
    apart = np.abs(by_own - by_one)
    # As many outcomes are further apart than in the median landing as are nearer.
    far = np.median(apart / np.median(apart, axis=0).clip(1e-300), axis=1)
    return int(np.argmin(np.abs(far - 1.0)))


def _median(values: FloatArray) -> tuple[float, float, float]:
    """Return the median and its interval, whose ends are two of the values."""
    from scipy.special import ndtri

    n = len(values)
    reach = float(ndtri(0.5 + CONFIDENCE / 2.0)) * np.sqrt(n) / 2.0
    first = max(0, int(np.floor(n / 2.0 - reach)) - 1)
    last = min(n - 1, int(np.ceil(n / 2.0 + reach)))
    ordered = np.sort(values)
    return float(np.median(values)), float(ordered[first]), float(ordered[last])
