"""Whether contact orders explain what a model of the frame change leaves over.

The dissertation states two things of the frame change (Sec. 3.4.1): it does not depend
on the mode schedule (*agnostic*), and it depends on boom angle and swing alone
(*zero-order*). An order that explains nothing of the residual given boom angle and
swing speaks for both. One that does may still be only a sign of the motion left over
from the last hop, which decides both the order and the hop. If so, it explains nothing
more once that motion, the state at the apex, is given. The two answers therefore stand
side by side.

The share that an order explains is measured as in an analysis of covariance. Its
probability by chance comes from permuted residuals (Freedman and Lane 1983), its
interval from a bootstrap of the hops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.steering.models.learning import IN_UNITS, UNITS
from hopdata.steering.strides import COMPONENTS, Strides
from hopdata.steering.true_hops import VELOCITY, TrueHops

#: Harmonics of the boom angle in the model of a hop by its inputs.
#: Unit: 1. Origin: chosen.
HARMONICS = 4
#: Degree of the polynomial of the swing in that model.
#: Unit: 1. Origin: chosen.
DEGREE = 4
#: Fewest hops for each coefficient of a model.
#: Unit: 1. Origin: chosen.
HOPS_PER_COEFFICIENT = 3
#: Fewest hops of an order that is told apart; rarer orders are one class.
#: Unit: 1. Origin: chosen.
LEAST_HOPS = 10
#: Singular values of columns of length 1 below this are taken for zero.
#: Unit: 1. Origin: rounding: far above it, far below any column that is its own.
RANK_SHARE = 1e-8
#: Coordinates of the apex that do not vary: their spread is below this.
#: Unit: m, rad, m/s, rad/s. Origin: rounding.
LEAST_SPREAD = 1e-9

INPUTS = "inputs"
STATE = "inputs and state"
ORDERS = ("landing", "lift-off")


@dataclass(frozen=True)
class Explained:
    """What classes explain of the residual of each of c responses.

    Parameters
    ----------
    share : (c,) array
        Explained share of the residual's variance, adjusted for the number of
        coefficients: 0 on average if the classes do not matter.
    low, high : (c,) arrays
        Its 95 % interval.
    p : (c,) array
        Probability of so large a share by chance.
    residual_sd : (c,) array
        Standard deviation of the residual without the classes, in the response's unit.
    given_share : (c,) array
        Share of the response's variance that the model without the classes explains.
    n_hops, n_classes : int
        Number of hops, and of classes told apart.
    """

    share: FloatArray
    low: FloatArray
    high: FloatArray
    p: FloatArray
    residual_sd: FloatArray
    given_share: FloatArray
    n_hops: int
    n_classes: int

    @property
    def effect(self) -> FloatArray:
        """Rms of what the classes add to the prediction, in the response's unit."""
        return np.asarray(self.residual_sd * np.sqrt(np.maximum(self.share, 0.0)))


@one_blas_thread()
def explained_by(
    classes: ArrayLike,
    response: FloatArray,
    given: FloatArray,
    *,
    slopes: FloatArray | None = None,
    seed: int = 0,
    permutations: int = 999,
    resamples: int = 200,
) -> Explained:
    """Return what classes of hops explain of a response, given other features.

    Parameters
    ----------
    classes : (n,) array
        Class of each hop, such as its contact order.
    response : (n, c) array
    given : (n, p) array
        Features that are known, a column of ones among them.
    slopes : (n, q) array, optional
        Features whose coefficients may differ from class to class. By default only an
        offset may.
    seed : int
        Seed of permutations and bootstrap.
    permutations, resamples : int
        Number of permutations of the residuals, and of bootstrap samples of the hops;
        without any, `p` is 1 and the interval unknown.

    Raises
    ------
    AnalysisError
        If there are fewer than `HOPS_PER_COEFFICIENT` hops for each coefficient.
    """
    contrasts = class_contrasts(classes)
    n_classes = contrasts.shape[1] + 1
    if slopes is not None:
        of_slopes = contrasts[:, :, None] * slopes[:, None, :]
        contrasts = np.column_stack([contrasts, of_slopes.reshape(len(slopes), -1)])
    n_hops = len(response)
    least = HOPS_PER_COEFFICIENT * (given.shape[1] + contrasts.shape[1])
    if n_hops < least:
        raise AnalysisError.at("contact orders", f"at least {least} hops", n_hops)

    known = orthonormal(given)
    residual = response - known @ (known.T @ response)
    added = orthonormal(contrasts, beside=known)
    free = n_hops - known.shape[1]
    share = adjusted(_raw_share(added, residual), added.shape[1], free)

    rng = np.random.default_rng(seed)
    by_chance = _by_chance(rng, residual, known, added, permutations)
    at_least = (by_chance >= share).sum(axis=0)
    low, high = _interval(rng, residual, added, free, resamples)
    spread = response - response.mean(axis=0)
    left = (residual**2).sum(axis=0) / free
    return Explained(
        share=share,
        low=share + low,
        high=share + high,
        p=(1 + at_least) / (1 + permutations),
        residual_sd=np.sqrt(left),
        given_share=1 - left / (spread**2).mean(axis=0),
        n_hops=n_hops,
        n_classes=n_classes,
    )


def _by_chance(
    rng: np.random.Generator,
    residual: FloatArray,
    known: FloatArray,
    added: FloatArray,
    permutations: int,
) -> FloatArray:
    """Return the shares (permutations, c) that permuted residuals have explained.

    `known` and `added` are orthonormal bases, (n, r), of what is given and of what the
    classes add to it.
    """
    n_hops, n_responses = residual.shape
    free = n_hops - known.shape[1]
    shares = np.empty((permutations, n_responses))
    for k in range(permutations):
        permuted = residual[rng.permutation(n_hops)]
        # A permuted residual is no residual: what is given explains some of it.
        permuted = permuted - known @ (known.T @ permuted)
        shares[k] = adjusted(_raw_share(added, permuted), added.shape[1], free)
    return shares


def _interval(
    rng: np.random.Generator,
    residual: FloatArray,
    added: FloatArray,
    free: int,
    resamples: int,
) -> tuple[FloatArray, FloatArray]:
    """Return the ends (c,) of the 95 % interval about the share; NaN without resamples.

    Hops are drawn with replacement.
    """
    n_hops, n_responses = residual.shape
    if not resamples:
        unknown = np.full(n_responses, np.nan)
        return unknown, unknown
    shares = np.empty((resamples, n_responses))
    for k in range(resamples):
        drawn = rng.integers(n_hops, size=n_hops)
        raw = _raw_share(orthonormal(added[drawn]), residual[drawn])
        shares[k] = adjusted(raw, added.shape[1], free)
    # What each resample adds by its own chance is taken off again.
    about_mean = shares - shares.mean(axis=0)
    low, high = np.quantile(about_mean, [0.025, 0.975], axis=0)
    return low, high


def class_contrasts(classes: ArrayLike) -> FloatArray:
    """Return a column for each class but the first, (n, k - 1), with ones for its own.

    Classes of fewer than `LEAST_HOPS` hops are one class.
    """
    names, number, counts = np.unique(
        np.asarray(classes), return_inverse=True, return_counts=True
    )
    is_rare = counts < LEAST_HOPS
    # All rare classes get the number that follows the last.
    number = np.where(is_rare[number], len(names), number)
    present = np.unique(number)
    return np.asarray(number[:, None] == present[None, 1:], dtype=float)


def orthonormal(columns: FloatArray, beside: FloatArray | None = None) -> FloatArray:
    """Return an orthonormal basis (n, r) of the span of columns (n, p).

    With a basis `beside`, that of what the columns span besides it.
    """
    norms = np.linalg.norm(columns, axis=0)
    unit = columns[:, norms > 0] / norms[norms > 0]
    if beside is not None:
        unit = unit - beside @ (beside.T @ unit)
    if not unit.shape[1]:
        return np.asarray(unit)
    left, spread, _ = np.linalg.svd(unit, full_matrices=False)
    return np.asarray(left[:, spread > RANK_SHARE])


def adjusted(raw: FloatArray, coefficients: int, free: int) -> FloatArray:
    """Return the share adjusted for its coefficients, of `free` degrees of freedom."""
    return np.asarray(1 - (1 - raw) * free / (free - coefficients))


def _raw_share(basis: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the share (c,) of the squared residual that lies in the basis."""
    inside = ((basis.T @ residual) ** 2).sum(axis=0)
    return np.asarray(inside / (residual**2).sum(axis=0))


# Features of a hop: its inputs, and the state at its apex.


def input_features(
    strides: Strides, *, harmonics: int = HARMONICS, degree: int = DEGREE
) -> FloatArray:
    """Return features of what is known of a stride, (n, p), ones first.

    They are the products of a Fourier series of each periodic state and a polynomial of
    each linear state and input over its spread: for the hopper, of boom angle and
    swing.
    """
    order = np.arange(1, harmonics + 1)
    powers = np.arange(degree + 1)
    n_periodic = len(strides.axes.periodic)
    features = np.ones((len(strides), 1))
    for k, column in enumerate(strides.points.T):
        if k < n_periodic:
            waves = order * column[:, None]
            series = np.column_stack(
                [np.ones(len(column)), np.cos(waves), np.sin(waves)]
            )
        else:
            spread = float(column.std())
            scaled = column / spread if spread > LEAST_SPREAD else column
            series = np.asarray(scaled[:, None] ** powers, dtype=float)
        features = _products(features, series)
    return features


def _products(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return each column (n, p) times each of other columns (n, q), as (n, p q)."""
    products = first[:, :, None] * second[:, None]
    return np.asarray(products.reshape(len(first), -1))


def _squares(columns: FloatArray) -> FloatArray:
    """Return the products of columns (n, p) with themselves and each other, once."""
    first, second = np.triu_indices(columns.shape[1])
    return np.asarray(columns[:, first] * columns[:, second])


def standardised(states: FloatArray) -> FloatArray:
    """Return the varying columns of states, centred, over their spread."""
    spread = states.std(axis=0)
    varies = spread > LEAST_SPREAD
    centred = states[:, varies] - states[:, varies].mean(axis=0)
    return np.asarray(centred / spread[varies])


def state_features(states: FloatArray, strides: Strides) -> FloatArray:
    """Return features (n, p) of the states at the apex, to second order.

    They are the state's coordinates, their products, and their products with the
    stride's `input_features` to first order. All vanish at the mean state.
    """
    state = standardised(states)
    inputs = input_features(strides, harmonics=1, degree=1)
    # A column of the inputs is ones, so that the state alone is among the products.
    with_inputs = _products(state, inputs)
    return np.column_stack([with_inputs, _squares(state)])


# The question as the dissertation puts it.


def order_effects(
    hops: TrueHops,
    *,
    seed: int = 0,
    permutations: int = 999,
    resamples: int = 200,
    orders: Sequence[str] = ORDERS,
) -> pd.DataFrame:
    """Return what each contact order explains, without and with the hidden state.

    Parameters
    ----------
    hops : TrueHops
    seed : int
        Seed of permutations and bootstrap.
    permutations, resamples : int
        See `explained_by`.
    orders : sequence of {"landing", "lift-off"}

    Returns
    -------
    DataFrame
        One row for each ``order``, what is ``given`` (`INPUTS`, `STATE`) and
        ``component``, with its ``unit``: ``share``, ``low, high``, ``p`` of
        `Explained`; ``effect`` and ``residual_sd`` in mm or degrees; ``given_share``;
        ``hops``. Given the state, the slope of the map may differ by order too, which
        a flow that is not continuously differentiable needs.

    Raises
    ------
    AnalysisError
        If there are too few hops.
    """
    changes = hops.changes
    inputs = input_features(changes)
    of_state = state_features(hops.apex, changes)
    slopes = standardised(hops.apex)
    known: dict[str, tuple[FloatArray, FloatArray | None]] = {
        INPUTS: (inputs, None),
        STATE: (np.column_stack([inputs, of_state]), slopes),
    }
    classes = {"landing": hops.landing, "lift-off": hops.lift_off}
    tables = []
    for order in orders:
        for name, (given, own_slopes) in known.items():
            found = explained_by(
                classes[order],
                changes.change,
                given,
                slopes=own_slopes,
                seed=seed,
                permutations=permutations,
                resamples=resamples,
            )
            table = _table(found).assign(order=order, given=name)
            tables.append(table)
    columns = ["order", "given", "component", "unit"]
    joined = pd.concat(tables, ignore_index=True)
    return joined[columns + [c for c in joined if c not in columns]]


def _table(found: Explained) -> pd.DataFrame:
    """Return one row for each component of the frame change."""
    return pd.DataFrame(
        {
            "component": COMPONENTS,
            "unit": UNITS,
            "share": found.share,
            "low": found.low,
            "high": found.high,
            "p": found.p,
            "effect": found.effect * IN_UNITS,
            "residual_sd": found.residual_sd * IN_UNITS,
            "given_share": found.given_share,
            "hops": found.n_hops,
        }
    )


# How far inputs, history and state decide a hop.

BY_INPUTS = "boom angle and swing"
BY_HISTORY = "and the swing before"
BY_MOMENTUM = "and the velocity at the apex"
BY_STATE = "and the whole state at the apex"


@one_blas_thread()
def decided_by(hops: TrueHops) -> pd.DataFrame:
    """Return which share of the frame change is decided by what is known of a hop.

    A zero-order frame change is decided by boom angle and swing (Sec. 3.4.1, footnote
    3).

    Returns
    -------
    DataFrame
        One row for each ``known`` (`BY_INPUTS`, `BY_HISTORY`, `BY_MOMENTUM`,
        `BY_STATE`) and ``component``: the ``share`` of its variance, adjusted for the
        number of coefficients.

    Raises
    ------
    AnalysisError
        If there are too few hops.
    """
    changes = hops.changes
    inputs = input_features(changes)
    # What else is known is also multiplied with these.
    low = input_features(changes, harmonics=2, degree=2)

    swing_unit = max(float(changes.swing_rad.std()), LEAST_SPREAD)
    before = hops.previous_swing_rad / swing_unit
    of_history = _products(low, np.column_stack([before, before**2]))
    velocity = standardised(hops.apex[:, VELOCITY])
    of_velocity = _products(low, velocity)
    of_state = state_features(hops.apex, changes)
    known = {
        BY_INPUTS: inputs,
        BY_HISTORY: np.column_stack([inputs, of_history]),
        BY_MOMENTUM: np.column_stack([inputs, of_velocity, _squares(velocity)]),
        BY_STATE: np.column_stack([inputs, of_state]),
    }
    tables = []
    for name, features in known.items():
        least = HOPS_PER_COEFFICIENT * features.shape[1]
        if len(hops) < least:
            raise AnalysisError.at("history", f"at least {least} hops", len(hops))
        basis = orthonormal(features)
        left = changes.change - basis @ (basis.T @ changes.change)
        variance = (left**2).sum(axis=0) / (len(hops) - basis.shape[1])
        share = 1 - variance / changes.change.var(axis=0)
        table = pd.DataFrame({"component": COMPONENTS, "share": share})
        tables.append(table.assign(known=name))
    return pd.concat(tables, ignore_index=True)


# Whether the order matters to first order, or only to second.


def order_gain(hops: TrueHops) -> tuple[FloatArray, FloatArray]:
    """Return what the landing order adds to a linear map of the state, and its spread.

    In a landing that is continuously differentiable, the maps of all orders are the
    same to first order. What an order adds then falls as the square of the deviations
    from a common hop; otherwise it falls as they do.

    Parameters
    ----------
    hops : TrueHops
        With the same boom angle and swing in each, or nearly so.

    Returns
    -------
    effect : (3,) array
        Rms of what the order adds to the prediction, m, m, rad.
    spread : (3,) array
        Standard deviation of the frame change.
    """
    states = standardised(hops.apex)
    given = np.column_stack([np.ones(len(states)), states])
    change = hops.changes.change
    found = explained_by(
        hops.landing, change, given, slopes=states, permutations=0, resamples=0
    )
    return found.effect, change.std(axis=0)
