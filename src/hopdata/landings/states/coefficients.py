"""Coefficients of polynomials fitted to marker tracks, with their covariance.

There are two ways to fit. One fits each landing by itself, by least squares. The other
fits all landings together: position and velocity of every marker are free, but the
coefficients from the acceleration on are drawn from a population that is learned
(random coefficients, Laird and Ware 1982). What the landings share is then known well,
and what they do not share is fitted. A power that no landing needs gets no variance, so
the evidence chooses the order of the polynomials.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.states.tracks import LOOK_AT, Moments, evenly

FREE = 2  # number of free coefficients: position and velocity
VARIANCES = (..., [0, 1], [0, 1])  # index of their variances in a covariance
HORIZONTAL = slice(0, 2)
VERTICAL = slice(2, 3)

#: Steps of expectation and maximisation.
#: Unit: 1. Origin: chosen.
STEPS = 40

#: Least standard deviation of the noise, so that exact data have weights.
#: Unit: m. Origin: chosen.
LEAST_NOISE_M = 1e-9

#: Smallest spread in the first guess, in its standard errors: with few landings a
#: nonzero spread can be estimated as zero.
#: Unit: standard errors. Origin: chosen.
LEAST_SPREAD = 0.3

#: Standard errors by which a misfit must exceed zero to be added.
#: Unit: standard errors. Origin: convention: two sigmas.
SURE_OF_MISFIT = 2.0

#: Smallest eigenvalue of an information matrix that is used, as a share of the largest.
#: Unit: 1. Origin: rounding.
SINGULAR = 1e-12


@dataclass(frozen=True)
class Coefficients:
    """Coefficients of the powers of u.

    Parameters
    ----------
    mean : (L, B, 3, K) array
        Estimates, m; NaN where there are too few frames.
    covariance : (L, B, 3, K, K) array
        Covariance of their errors, m^2.
    noise_m : (B, 3) array
        Standard deviation of the noise.
    """

    mean: FloatArray
    covariance: FloatArray
    noise_m: FloatArray


@dataclass(frozen=True)
class Population:
    """Population from which coefficients of u^2 and higher are drawn, and the noise.

    Parameters
    ----------
    mean : (B, 3, Q) array
        Means for each marker and direction, m.
    spread : (3, Q, Q) array
        Covariance over landings for each direction, m^2.
    variance : (B, 3) array
        Variance of the noise, m^2.
    """

    mean: FloatArray
    spread: FloatArray
    variance: FloatArray


def least_squares(sums: Moments, variance: FloatArray | None = None) -> Coefficients:
    """Fit each marker in each landing by itself.

    Tracks with no more frames than coefficients get NaN. The noise variance (B, 3),
    m^2, is estimated from these landings unless it is given.
    """
    solved = _solved(sums)
    inverse = np.asarray(np.linalg.inv(solved.gram)[:, :, None], float)
    if variance is None:
        variance, _ = noise([sums])
    covariance = variance[..., None, None] * inverse
    return _in_powers(sums, solved.enough, solved.mean, covariance, variance)


def noise(parts: Iterable[Moments]) -> tuple[FloatArray, FloatArray]:
    """Return the noise variance (B, 3), m^2, about separate fits, and frames (L, B).

    The frames are the usable ones of each marker in each landing.
    """
    residual_squares = []
    frames = []
    freedoms = []
    for sums in parts:
        residual_squares.append(_solved(sums).residual_square)
        frames.append(sums.frames)
        freedoms.append(sums.frames - sums.terms)
    square = np.concatenate(residual_squares)
    freedom = np.maximum(np.concatenate(freedoms), 0.0).sum(axis=0)[:, None]
    variance = square.sum(axis=0) / np.maximum(freedom, 1.0)
    return np.maximum(variance, LEAST_NOISE_M**2), np.concatenate(frames)


def residual_squares(sums: Moments) -> FloatArray:
    """Return the mean squared residual of each landing about its own fit, (L,), m^2.

    NaN for landings in which a track has no more frames than coefficients.
    """
    solved = _solved(sums)
    freedom = 3.0 * (sums.frames - sums.terms).sum(axis=1)
    square = solved.residual_square.sum(axis=(1, 2))
    is_whole = solved.enough.all(axis=1)
    return np.where(is_whole, square / np.where(is_whole, freedom, 1.0), np.nan)


@dataclass(frozen=True)
class _Solved:
    """Separate fits of tracks.

    Parameters
    ----------
    enough : (L, B) bool array
        Which tracks have more frames than coefficients.
    gram : (L, B, K, K) array
        Normal matrices; a unit matrix where there are not enough frames.
    mean : (L, B, 3, K) array
        Solutions, m.
    residual_square : (L, B, 3) array
        Sums of squared residuals, m^2; 0 where there are not enough frames.
    """

    enough: BoolArray
    gram: FloatArray
    mean: FloatArray
    residual_square: FloatArray


def _solved(sums: Moments) -> _Solved:
    """Solve the normal equations of each track by itself."""
    enough = sums.frames > sums.terms
    gram = np.where(enough[..., None, None], sums.gram, np.eye(sums.terms))
    solution = np.linalg.solve(gram[:, :, None], sums.product[..., None])[..., 0]
    mean = np.asarray(solution, float)
    residual = sums.square - (mean * sums.product).sum(axis=3)
    residual_square = np.where(enough[..., None], residual, 0.0)
    return _Solved(enough, gram, mean, residual_square)


def fit_with_population(
    sums: Moments, population: Population, *, least_frames: int
) -> Coefficients:
    """Fit landings whose accelerations are drawn from a population.

    Parameters
    ----------
    sums : Moments
        Moments of the landings.
    population : Population
        See `learn_population`.
    least_frames : int
        Fewest frames of a marker that are fitted.
    """
    enough = sums.frames >= max(least_frames, FREE + 1)
    gram = np.where(enough[..., None, None], sums.gram, np.eye(sums.terms))
    mean, covariance = _posterior(replace(sums, gram=gram), population)
    return _in_powers(sums, enough, mean, covariance, population.variance)


def misfit(
    pairs: Iterable[tuple[Coefficients, Coefficients]],
) -> tuple[FloatArray, float]:
    """Return what a model's misfit adds to variances of position and velocity, (3, 2).

    The mean squared difference between the optimal estimate of a model and a less
    biased estimate is the difference of their variances. Any excess, on average over
    landings and markers, is a squared bias (the focus of Claeskens and Hjort 2003). It
    is added if it exceeds twice its standard error. The mean variance of the
    velocities, including it, is returned as well.

    Parameters
    ----------
    pairs : iterable of (Coefficients, Coefficients)
        Fits of each block of landings: from `fit_with_population`, and from
        `least_squares` with the same frames and more powers.
    """
    variances = []
    excesses = []
    for fit, reference in pairs:
        own = fit.covariance[VARIANCES]
        difference = reference.mean[..., :FREE] - fit.mean[..., :FREE]
        by_chance = reference.covariance[VARIANCES] - own
        variances.append(own)
        excesses.append(difference**2 - by_chance)
    variance = np.concatenate(variances)
    excess = np.concatenate(excesses)
    added = np.zeros((3, FREE))
    for axes in (HORIZONTAL, VERTICAL):
        for k in range(FREE):
            known = excess[:, :, axes, k]
            known = known[np.isfinite(known)]
            if not len(known):
                continue
            standard_error = known.std() / np.sqrt(len(known))
            if known.mean() > SURE_OF_MISFIT * standard_error:
                added[axes, k] = known.mean()
    return added, float(np.nanmean(variance[..., 1] + added[:, 1]))


def landings_to_learn_from(frames: FloatArray, terms: int) -> IntArray:
    """Choose the landings from which a population is learned, at most `LOOK_AT`.

    Parameters
    ----------
    frames : (L, B) array
        Usable frames of each marker.
    terms : int
        Number of coefficients; all markers of a landing need more frames than these.

    Returns
    -------
    (n,) int array
        Rows of the landings.
    """
    determined = np.flatnonzero((frames > terms).all(axis=1))
    return determined[evenly(len(determined), LOOK_AT)]


def learn_population(sums: Moments) -> Population:
    """Learn the population by maximum likelihood (expectation-maximisation).

    Position and velocity have flat priors, so the likelihood is the restricted one.
    Only landings in which each marker has more frames than coefficients are used.
    """
    sums = sums.some(landings_to_learn_from(sums.frames, sums.terms))
    curved = _without_free(sums)
    population = _first_guess(curved, least_squares(sums).noise_m ** 2)
    for _ in range(STEPS):
        population = _improved(curved, population)
    return population


@dataclass(frozen=True)
class _Curved:
    """What landings tell of coefficients from the acceleration on.

    Position and velocity are eliminated: whatever those coefficients are, the best
    position and velocity follow. The sums of all frames are therefore reduced once, and
    each step works with the few coefficients that are left.

    Parameters
    ----------
    gram : (L, B, Q, Q) array
        Normal matrices of the coefficients that are left: Schur complements.
    product : (L, B, 3, Q) array
        Their right-hand sides, m.
    square : (L, B, 3) array
        Squared residuals about the best position and velocity alone, m^2.
    frames : (B,) array
        Frames of each marker in all landings.
    """

    gram: FloatArray
    product: FloatArray
    square: FloatArray
    frames: FloatArray


def _without_free(sums: Moments) -> _Curved:
    """Eliminate position and velocity."""
    free = sums.gram[..., :FREE, :FREE]
    mixed = sums.gram[..., :FREE, FREE:]
    hat = np.linalg.solve(free, mixed)
    across = np.swapaxes(mixed, 2, 3) @ hat
    of_free = sums.product[..., :FREE]
    best = np.linalg.solve(free[:, :, None], of_free[..., None])[..., 0]
    return _Curved(
        gram=sums.gram[..., FREE:, FREE:] - across,
        product=sums.product[..., FREE:] - of_free @ hat,
        square=sums.square - (best * of_free).sum(axis=3),
        frames=sums.frames.sum(axis=0),
    )


def _first_guess(curved: _Curved, variance: FloatArray) -> Population:
    """Guess the population from moments of separate fits, minus those of the noise."""
    information = curved.gram[:, :, None] / variance[..., None, None]
    score = curved.product / variance[..., None]
    total = information.sum(axis=0)
    mean = np.linalg.solve(total, score.sum(axis=0)[..., None])[..., 0]
    rest = score - np.einsum("lbcjk,bck->lbcj", information, mean)
    spread = np.empty((3, *total.shape[-2:]))
    for axes in (HORIZONTAL, VERTICAL):
        own_rest = rest[:, :, axes]
        own_information = information[:, :, axes].mean(axis=(0, 1, 2))
        moment = np.einsum("lbcj,lbck->jk", own_rest, own_rest)
        floor = LEAST_SPREAD * float(np.sqrt(2 / rest[:, 0, axes, 0].size))
        spread[axes] = _excess(moment / own_rest[..., 0].size, own_information, floor)
    return Population(mean, spread, variance)


def _excess(seen: FloatArray, information: FloatArray, floor: float) -> FloatArray:
    """Return the covariance of coefficients whose scores have the second moment `seen`.

    Every direction gets at least `floor` times its variance in a separate fit, because
    with few landings a nonzero spread can be estimated as zero.
    """
    values, vectors = np.linalg.eigh(information)
    root = vectors / np.sqrt(np.maximum(values, values[-1] * SINGULAR))
    ratio, turn = np.linalg.eigh(root.T @ seen @ root)
    half = root @ turn * np.sqrt(np.maximum(ratio - 1.0, floor))
    return np.asarray(half @ half.T, float)


def _posterior(sums: Moments, population: Population) -> tuple[FloatArray, FloatArray]:
    """Return posterior means (L, B, 3, K) and covariances (L, B, 3, K, K)."""
    return _expected(sums.gram, sums.product, population, n_free=FREE)


def _expected(
    gram: FloatArray, product: FloatArray, population: Population, *, n_free: int
) -> tuple[FloatArray, FloatArray]:
    """Return means and covariances of coefficients given the frames and a population.

    Parameters
    ----------
    gram : (L, B, K, K) array
        Normal matrices.
    product : (L, B, 3, K) array
        Right-hand sides, m.
    population : Population
        Of the coefficients but for the first.
    n_free : int
        Number of these, which have no prior.
    """
    variance = population.variance
    inverse = np.linalg.inv(population.spread)
    precision = gram[:, :, None] / variance[..., None, None]
    precision[..., n_free:, n_free:] += inverse
    pull = product / variance[..., None]
    pull[..., n_free:] += np.einsum("cjk,bck->bcj", inverse, population.mean)
    covariance = np.asarray(np.linalg.inv(precision), float)
    return (covariance @ pull[..., None])[..., 0], covariance


def _improved(curved: _Curved, population: Population) -> Population:
    """Take one step of expectation and maximisation."""
    variance = population.variance
    gram = curved.gram[:, :, None]
    fitted, covariance = _expected(curved.gram, curved.product, population, n_free=0)

    mean = fitted.mean(axis=0)
    away = fitted - mean
    spread = np.empty_like(population.spread)
    for axes in (HORIZONTAL, VERTICAL):
        between = np.einsum("lbcj,lbck->jk", away[:, :, axes], away[:, :, axes])
        within = covariance[:, :, axes].sum(axis=(0, 1, 2))
        spread[axes] = (between + within) / away[:, :, axes, 0].size

    # Position and velocity, which are free, add the noise of one frame each.
    squares = curved.square + FREE * variance
    squares -= 2 * (fitted * curved.product).sum(axis=3)
    squares += (fitted * (gram @ fitted[..., None])[..., 0]).sum(axis=3)
    squares += (gram * covariance).sum(axis=(3, 4))
    new_variance = squares.sum(axis=0) / curved.frames[:, None]
    return Population(mean, spread, np.maximum(new_variance, LEAST_NOISE_M**2))


def _in_powers(
    sums: Moments,
    enough: BoolArray,
    mean: FloatArray,
    covariance: FloatArray,
    variance: FloatArray,
) -> Coefficients:
    """Convert fits in the polynomials of the moments to powers of u."""
    of_powers = mean @ sums.powers.T
    covariance_of_powers = sums.powers @ covariance @ sums.powers.T
    of_powers[~enough] = np.nan
    covariance_of_powers[~enough] = np.nan
    return Coefficients(of_powers, covariance_of_powers, np.sqrt(variance))
