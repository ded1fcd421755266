"""Random event-selected systems: several plane guards, a different field for each set of locks.

Every guard is live in every mode, Dh f >= LIVE, so each is crossed once, upwards. Some
of them pass within a small gap of one point of the trajectory and are crossed nearly at
once. The systems are drawn with sums, products and roots alone, which all processors
round alike.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from stress_case import EPS, Case, Expected
from stress_reference import (
    Piecewise,
    along,
    amplification,
    constant_answer,
    mode_row,
    velocity,
)
from stress_series import affine_events
from stress_systems import selected, selected_params

LIVE = 0.25
PUSH = (
    3.0  # least n b of affine systems: what is more than LIVE is left to the matrices
)
GAPS = (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3)
END = 1.0
GROWTH = 1.65  # of a state until END, at most: exp(0.5)
TERMS = 22  # of the series: 0.5^22 / 22! is below 1e-27
RTOLS, ATOL_OVER_RTOL = (1e-3, 1e-6, 1e-9, 1e-12), 1e-3
STEPS_PER_PIECE = 1  # errors of single steps rarely come near the tolerance


def length(vectors: np.ndarray) -> np.ndarray:
    """Return the Euclidean norms along the last axis."""
    return np.sqrt(along(vectors, vectors))


def draw_planes(
    rng: np.random.Generator, n: int, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return a direction (n,) and unit normals (K, n) within 60 degrees of it."""
    ahead = rng.normal(size=n)
    ahead /= length(ahead)
    aside = rng.normal(size=(count, n))
    aside -= along(aside, ahead)[:, None] * ahead
    aside /= length(aside)[:, None]
    cosine = rng.uniform(0.5, 1.0, size=count)[:, None]
    return ahead, cosine * ahead + np.sqrt(1.0 - cosine * cosine) * aside


def draw_constants(
    rng: np.random.Generator, ahead: np.ndarray, normals: np.ndarray, least: float
) -> np.ndarray:
    """Return fields (2^K, n) with n f >= least for all normals."""
    fields = rng.normal(size=(1 << len(normals), len(ahead)))
    lacking = (least - along(fields[:, None], normals)) / along(normals, ahead)
    return fields + np.maximum(lacking.max(axis=1), 0.0)[:, None] * ahead


def draw_matrices(
    rng: np.random.Generator, constants: np.ndarray, y0: np.ndarray
) -> np.ndarray:
    """Return matrices (2^K, n, n), so small that n (A y + b) >= LIVE for all y reached by END."""
    drawn = rng.normal(size=(*constants.shape, constants.shape[1]))
    farthest = GROWTH * (length(y0) + length(constants).max())
    spare = min((PUSH - LIVE) / farthest, 0.5)
    return spare * drawn / length(drawn.reshape(len(drawn), -1))[:, None, None]


def drift(
    system: Piecewise, locks: list[int], y: np.ndarray, span: float
) -> np.ndarray:
    """Return the state after `span` in one mode, in floats."""
    term = velocity(system, locks, y) * span
    end = y + term
    if system.matrices is not None:
        for order in range(2, 25):
            term = along(system.matrices[mode_row(locks)], term) * (span / order)
            end = end + term
    return end


def place_planes(
    rng: np.random.Generator, system: Piecewise, y0: np.ndarray, gap: float
) -> Piecewise:
    """Place the planes on the trajectory; about half of them share the point of the one before."""
    count, offsets, y, now = system.shape[1], system.offsets.copy(), y0, 0.0
    locks = [-1] * count
    for k, instant in enumerate(np.sort(rng.uniform(0.02, 0.98, size=count)) * END):
        near = k > 0 and rng.random() < 0.5
        if not near:
            y, now = drift(system, locks, y, instant - now), instant
        offsets[k] = along(system.normals[k], y) + (
            gap * rng.uniform(-1, 1) if near else 0.0
        )
        locks[k] = 1
    return Piecewise(offsets, system.normals, system.constants, system.matrices)


def random_system(seed: int, *, affine: bool) -> tuple[Piecewise, np.ndarray, float]:
    """Return a random system, its initial state, and the gap between its near coincidences."""
    rng = np.random.default_rng([seed, affine])
    n, count = int(rng.integers(2, 7)), int(rng.integers(1, 9))
    ahead, normals = draw_planes(rng, n, count)
    y0 = rng.normal(size=n)
    constants = draw_constants(rng, ahead, normals, PUSH if affine else LIVE)
    matrices = draw_matrices(rng, constants, y0) if affine else None
    gap = GAPS[int(rng.integers(len(GAPS)))]
    blank = Piecewise(np.zeros(count), normals, constants, matrices)
    return place_planes(rng, blank, y0, gap), y0, gap


def affine_answer(system: Piecewise, y0: np.ndarray, rtol: float) -> Expected:
    """Return the right answer, with tolerances for the sum of local errors."""
    run = affine_events(system, y0.tolist(), END, TERMS)
    states = np.array([y0, run.y_end, *run.points])
    local = np.sqrt(len(y0)) * rtol * (np.abs(states).max() + ATOL_OVER_RTOL)
    steps = STEPS_PER_PIECE * (len(run.events) + 1)
    growth, back = (amplification(system, run, END, back=b) for b in (False, True))
    allowed = steps * local * growth
    return Expected(
        tuple(run.events), run.y_end, allowed / LIVE + 32 * EPS, allowed, mode=tuple(run.end),
        back=max(back / growth, 1.0),
    )  # fmt: skip


@cache
def random_case(seed: int, *, affine: bool) -> Case:
    """Return the case of a seed."""
    system, y0, gap = random_system(seed, affine=affine)
    rtol = RTOLS[seed % len(RTOLS)]
    if affine:
        answer = affine_answer(system, y0, rtol)
    else:
        answer = constant_answer(system, y0.tolist(), (0.0, END))
    params = selected_params(
        system.offsets, system.normals, system.constants, system.matrices
    )
    kind = "affine" if affine else "constant"
    return Case(
        f"random_{kind}", f"seed {seed}, gap {gap:g}, rtol {rtol:g}", selected(*system.shape),
        (0.0, END), y0, (answer,), {"params": params, "rtol": rtol, "atol": rtol * ATOL_OVER_RTOL},
    )  # fmt: skip
