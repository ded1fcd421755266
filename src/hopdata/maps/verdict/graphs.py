"""Constraint subspaces of the schedules at the rank where signal ends, from disjoint halves.

A linear map is the subspace of its pairs (input, outcome). With inputs made white and outcomes in
units of their noise, the directions that carry signal stand out from the noise by a gap, at 8 for
a rigid body on a section where the printed analysis takes 17. Halves of one schedule share no
landing, so distances within and across schedules are on one footing. What the distances would be
with one map for all is known from outcomes rebuilt with the rest shuffled (see `specialised`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.maps.verdict.inputs import large_classes
from hopdata.maps.verdict.leading import leading_spaces
from hopdata.maps.verdict.residuals import Residuals, shuffled

HALVINGS = 4
_AT_ONCE = 50  # shuffled data sets in memory
Half = tuple[IntArray, FloatArray]


@dataclass(frozen=True)
class SubspaceTest:
    """Distances across schedules against those within.

    Attributes
    ----------
    rank
        Dimension k of the subspaces: where the gap between singular values is largest.
    within_rad, across_rad
        Mean arc lengths between disjoint halves of one schedule and of two.
    excess_rad, null_high_rad
        Their difference, and the one that 95 % of the shuffled data sets stay below.
    p_value
        Share of the shuffled data sets with a difference as large, the data's own included.
    n_schedules
        Schedules with landings enough.
    """

    rank: int
    within_rad: float
    across_rad: float
    excess_rad: float
    null_high_rad: float
    p_value: float
    n_schedules: int


def compare_subspaces(
    residuals: Residuals,
    weights: FloatArray,
    input_noise: FloatArray,
    *,
    generator: np.random.Generator,
    permutations: int = 199,
) -> SubspaceTest | None:
    """Compare the constraint subspaces of the schedules; None if fewer than two can have any.

    Parameters
    ----------
    residuals
        Landings of the window; see `hopdata.maps.verdict.residuals.smooth_residuals`.
    weights
        (n, schedules) membership of each landing; each counts where it weighs most.
    input_noise
        (p,) standard deviation of the inputs' measurement noise over that of the inputs.
    generator
        Source of halvings and permutations.
    permutations
        Number of shuffled data sets.
    """
    classes = large_classes(weights, residuals.inputs.shape[1])
    if len(classes) < 2:
        return None
    halvings = [_halving(classes, residuals.inputs, generator) for _ in range(HALVINGS)]
    linear = residuals.inputs @ residuals.linear
    scale = signal_to_noise(input_noise)
    rank = rank_gap(np.column_stack([residuals.inputs * scale, linear + residuals.values]))
    found = _distances(halvings, scale, (linear + residuals.values)[None], rank)[0]
    orders = shuffled(residuals.strata, permutations, generator)
    null = np.empty(permutations)
    for first in range(0, permutations, _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        drawn = _distances(halvings, scale, linear + residuals.values[orders[some]], rank)
        null[some] = drawn[:, 1] - drawn[:, 0]
    excess = float(found[1] - found[0])
    p_value = (1 + int(np.sum(null >= excess))) / (1 + permutations)
    high = float(np.quantile(null, 0.95))
    return SubspaceTest(rank, float(found[0]), float(found[1]), excess, high, p_value, len(classes))


def signal_to_noise(input_noise: FloatArray) -> FloatArray:
    """Return the spread of the inputs in units of their noise, at least 1, (p,)."""
    return np.maximum(1.0 / np.maximum(input_noise, 1e-3), 1.0)


def rank_gap(pairs: FloatArray) -> int:
    """Return after how many singular values of the centred pairs (n, D) the largest drop comes."""
    values = np.linalg.svd(pairs - pairs.mean(axis=0), compute_uv=False)
    values = values[values > 1e-10 * values[0]]
    if len(values) < 2:
        return 1
    return int(np.argmax(values[:-1] / values[1:])) + 1


def _halving(
    classes: list[IntArray], inputs: FloatArray, generator: np.random.Generator
) -> list[Half]:
    """Return rows and whitened inputs of the first halves of all classes, then of the second."""
    mixed = [generator.permutation(rows) for rows in classes]
    firsts = [rows[: len(rows) // 2] for rows in mixed]
    seconds = [rows[len(rows) // 2 :] for rows in mixed]
    return [(rows, _white(inputs[rows])) for rows in (*firsts, *seconds)]


def _white(x: FloatArray) -> FloatArray:
    """Return centred inputs (m, p) with unit covariance."""
    centred = x - x.mean(axis=0)
    left, _, right = np.linalg.svd(centred, full_matrices=False)
    white: FloatArray = np.sqrt(len(x)) * left @ right
    return white


def _distances(
    halvings: list[list[Half]], scale: FloatArray, outcomes: FloatArray, rank: int
) -> FloatArray:
    """Return the mean arc lengths within and across schedules, (P, 2), of outcomes (P, n, q)."""
    distances = np.empty((len(halvings), len(outcomes), 2))
    for number, halves in enumerate(halvings):
        first, second = np.split(_graphs(halves, scale, outcomes, rank), 2)
        lengths = _arc_lengths(first[:, np.newaxis], second)
        same = np.eye(len(first), dtype=bool)
        distances[number, :, 0] = lengths[same].mean(axis=0)
        distances[number, :, 1] = lengths[~same].mean(axis=0)
    mean: FloatArray = distances.mean(axis=0)
    return mean


def _graphs(halves: list[Half], scale: FloatArray, outcomes: FloatArray, rank: int) -> FloatArray:
    """Return the leading directions (halves, P, D, k) of the pairs of each half."""
    covariances = [_covariances(white * scale, outcomes[:, rows]) for rows, white in halves]
    return leading_spaces(np.stack(covariances), rank)


def _arc_lengths(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the distances (...) of spaces with orthonormal bases (..., D, k).

    Squared cosines of their angles are right to rounding; a length is right to 1e-8, also where an
    angle is 0 or a right one, and the better the farther all of them are from both.
    """
    cosines = np.swapaxes(first, -1, -2) @ second
    squared = np.linalg.eigvalsh(np.swapaxes(cosines, -1, -2) @ cosines)
    angles = np.arccos(np.sqrt(squared.clip(0.0, 1.0)))
    lengths: FloatArray = np.sqrt(np.sum(angles**2, axis=-1))
    return lengths


def _covariances(inputs: FloatArray, outcomes: FloatArray) -> FloatArray:
    """Return scatter matrices (P, p + q, p + q) of centred inputs (m, p), outcomes (P, m, q)."""
    centred = outcomes - outcomes.mean(axis=1, keepdims=True)
    turned = np.swapaxes(centred, 1, 2)
    p = inputs.shape[1]
    scatter = np.empty((len(outcomes), p + centred.shape[2], p + centred.shape[2]))
    scatter[:, :p, :p] = inputs.T @ inputs
    scatter[:, p:, :p] = turned @ inputs
    scatter[:, :p, p:] = np.swapaxes(scatter[:, p:, :p], 1, 2)
    scatter[:, p:, p:] = turned @ centred
    return scatter
