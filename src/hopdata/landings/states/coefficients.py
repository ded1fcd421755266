"""Coefficients of polynomials fitted to marker tracks, with their covariance.

There are two ways to fit. One fits each landing by itself, by least squares. The other
fits all landings together: position and velocity of every marker are free, but the
coefficients from the acceleration on are drawn from a population that is learned
(random coefficients, Laird and Ware 1982). What the landings share is then known well,
and what they do not share is fitted. A power that no landing needs gets no variance, so
the evidence chooses the order of the polynomials.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.landings.states.tracks import LOOK_AT, Moments, evenly, turned

FREE = 2  # number of free coefficients: position and velocity
VARIANCES = (..., [0, 1], [0, 1])  # index of their variances in a covariance
STEPS = 40  # steps of expectation and maximisation
LEAST_NOISE_M = 1e-9
LEAST_SPREAD = 0.3  # smallest spread in the first guess, in its standard errors
HORIZONTAL, VERTICAL = slice(0, 2), slice(2, 3)


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


Fitted = tuple[Moments, Coefficients]


@dataclass(frozen=True)
class Population:
    """Population from which the coefficients of u^2 and higher powers are drawn, and the noise.

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
    """Fit each marker in each landing by itself, where it has more frames than coefficients.

    The noise variance (B, 3), m^2, is estimated from these landings unless it is given.
    """
    enough, gram, mean, _ = _solved(sums)
    inverse = np.asarray(np.linalg.inv(gram)[:, :, None], float)
    variance = noise([sums])[0] if variance is None else variance
    return _in_powers(sums, enough, mean, variance[..., None, None] * inverse, variance)


def noise(parts: Iterable[Moments]) -> tuple[FloatArray, FloatArray]:
    """Return the noise variance (B, 3), m^2, about separate fits, and usable frames (L, B)."""
    found = [(_solved(one)[3], one.frames, one.frames - one.terms) for one in parts]
    left, frames, freedom = map(np.concatenate, zip(*found, strict=True))
    freedom = np.maximum(freedom, 0.0).sum(axis=0)[:, None]
    return np.maximum(
        left.sum(axis=0) / np.maximum(freedom, 1.0), LEAST_NOISE_M**2
    ), frames


def _solved(sums: Moments) -> tuple[BoolArray, FloatArray, FloatArray, FloatArray]:
    """Return which tracks have enough frames, normal matrices, solutions, and residual squares."""
    enough = sums.frames > sums.terms
    gram = np.where(enough[..., None, None], sums.gram, np.eye(sums.terms))
    mean = np.asarray(
        np.linalg.solve(gram[:, :, None], sums.product[..., None])[..., 0], float
    )
    left = sums.square - (mean * sums.product).sum(axis=3)
    return enough, gram, mean, np.where(enough[..., None], left, 0.0)


def drawn(sums: Moments, population: Population, *, least_frames: int) -> Coefficients:
    """Fit landings whose accelerations are drawn from a population.

    Parameters
    ----------
    sums : Moments
        Moments of the landings.
    population : Population
        See `learn`.
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
    """Return what the model's misfit adds to the variances of position and velocity, (3, 2).

    The mean squared difference between the optimal estimate of a model and a less
    biased estimate is the difference of their variances. Any excess, on average over
    landings and markers, is a squared bias (the focus of Claeskens and Hjort 2003). It
    is added if it exceeds twice its standard error. The mean variance of the
    velocities, including it, is returned as well.

    Parameters
    ----------
    pairs : iterable of (Coefficients, Coefficients)
        Fits of each block of landings: from `drawn`, and from `least_squares` with the
        same frames and more powers.
    """
    parts = []
    for fit, reference in pairs:
        own, beyond = (
            fit.covariance[VARIANCES],
            reference.mean[..., :FREE] - fit.mean[..., :FREE],
        )
        parts.append((own, beyond**2 - (reference.covariance[VARIANCES] - own)))
    variance, excess = map(np.concatenate, zip(*parts, strict=True))
    added = np.zeros((3, FREE))
    for axes in (HORIZONTAL, VERTICAL):
        for k in range(FREE):
            beyond = excess[:, :, axes, k][np.isfinite(excess[:, :, axes, k])]
            if len(beyond) and beyond.mean() > 2 * beyond.std() / np.sqrt(len(beyond)):
                added[axes, k] = beyond.mean()
    return added, float(np.nanmean(variance[..., 1] + added[:, 1]))


def teachers(frames: FloatArray, terms: int) -> IntArray:
    """Choose landings to learn from; all their markers have more frames (L, B) than `terms`."""
    teaching = np.flatnonzero((frames > terms).all(axis=1))
    return teaching[evenly(len(teaching), LOOK_AT)]


def learn(sums: Moments) -> Population:
    """Learn the population by maximum likelihood (expectation-maximisation).

    Position and velocity have flat priors, so the likelihood is the restricted one.
    Only landings in which each marker has more frames than coefficients are used.
    """
    sums = sums.some(teachers(sums.frames, sums.terms))
    population = _first_guess(sums)
    for _ in range(STEPS):
        population = _improved(sums, population)
    return population


def _first_guess(sums: Moments) -> Population:
    """Guess the population from the moments of separate fits, minus those of the noise."""
    variance = least_squares(sums).noise_m ** 2
    hat = np.linalg.solve(sums.gram[..., :FREE, :FREE], sums.gram[..., :FREE, FREE:])
    across = np.swapaxes(sums.gram[..., :FREE, FREE:], 2, 3) @ hat
    information = (sums.gram[..., FREE:, FREE:] - across)[:, :, None] / variance[
        ..., None, None
    ]
    score = sums.product[..., FREE:] - np.einsum(
        "lbfq,lbcf->lbcq", hat, sums.product[..., :FREE]
    )
    score = score / variance[..., None]
    total = information.sum(axis=0)
    mean = np.linalg.solve(total, score.sum(axis=0)[..., None])[..., 0]
    rest = score - np.einsum("lbcjk,bck->lbcj", information, mean)
    spread = np.empty((3, *total.shape[-2:]))
    for axes in (HORIZONTAL, VERTICAL):
        one = information[:, :, axes].mean(axis=(0, 1, 2))
        seen = np.einsum("lbcj,lbck->jk", rest[:, :, axes], rest[:, :, axes])
        floor = LEAST_SPREAD * float(np.sqrt(2 / rest[:, 0, axes, 0].size))
        spread[axes] = _excess(seen / rest[:, :, axes, 0].size, one, floor)
    return Population(mean, spread, variance)


def _excess(seen: FloatArray, information: FloatArray, floor: float) -> FloatArray:
    """Return the covariance of coefficients whose scores have the second moment `seen`.

    Every direction gets at least `floor` times its variance in a separate fit, because
    with few landings a nonzero spread can be estimated as zero.
    """
    values, vectors = np.linalg.eigh(information)
    root = vectors / np.sqrt(np.maximum(values, values[-1] * 1e-12))
    ratio, turn = np.linalg.eigh(root.T @ seen @ root)
    half = root @ turn * np.sqrt(np.maximum(ratio - 1.0, floor))
    return np.asarray(half @ half.T, float)


def _posterior(sums: Moments, population: Population) -> tuple[FloatArray, FloatArray]:
    """Return posterior means (L, B, 3, K) and covariances (L, B, 3, K, K) of the coefficients."""
    inverse = np.linalg.inv(population.spread)
    precision = sums.gram[:, :, None] / population.variance[..., None, None]
    precision[..., FREE:, FREE:] += inverse
    pull = sums.product / population.variance[..., None]
    pull[..., FREE:] += np.einsum("cjk,bck->bcj", inverse, population.mean)
    covariance = np.asarray(np.linalg.inv(precision), float)
    return (covariance @ pull[..., None])[..., 0], covariance


def _improved(sums: Moments, population: Population) -> Population:
    """Take one step of expectation and maximisation."""
    fitted, covariance = _posterior(sums, population)
    mean = fitted[..., FREE:].mean(axis=0)
    away = fitted[..., FREE:] - mean
    spread = np.empty_like(population.spread)
    for axes in (HORIZONTAL, VERTICAL):
        own = np.einsum("lbcj,lbck->jk", away[:, :, axes], away[:, :, axes])
        own += covariance[:, :, axes, FREE:, FREE:].sum(axis=(0, 1, 2))
        spread[axes] = own / away[:, :, axes, 0].size
    gram = sums.gram[:, :, None]
    squares = sums.square - 2 * (fitted * sums.product).sum(axis=3)
    squares += (fitted * (gram @ fitted[..., None])[..., 0]).sum(axis=3)
    squares += (gram * covariance).sum(axis=(3, 4))
    variance = squares.sum(axis=0) / sums.frames.sum(axis=0)[:, None]
    return Population(mean, spread, np.maximum(variance, LEAST_NOISE_M**2))


def _in_powers(
    sums: Moments,
    enough: BoolArray,
    mean: FloatArray,
    covariance: FloatArray,
    variance: FloatArray,
) -> Coefficients:
    mean, covariance = mean @ sums.powers.T, sums.powers @ covariance @ sums.powers.T
    mean[~enough], covariance[~enough] = np.nan, np.nan
    return Coefficients(mean, covariance, np.sqrt(variance))


# Evaluate fitted tracks where the mean height of the markers crosses a section, with
# errors.

NEWTON_STEPS = 8
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class SectionStates:
    """States of B body markers at L crossings of a section, in the world; NaN if undetermined.

    Parameters
    ----------
    time : (L,) array
        Instants at which the mean height of the fitted markers equals the section's, s.
    position, velocity : (L, B, 3) array
        Positions, m, and velocities, m/s.
    position_covariance, velocity_covariance : (L, B, 3, 3) array
        Covariance of the errors of each marker, m^2 and m^2/s^2. It includes the error
        of the instant: the mean height equals that of the section for any noise.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    position_covariance: FloatArray
    velocity_covariance: FloatArray


def cross(parts: Iterable[Fitted], near: FloatArray, height_m: float) -> SectionStates:
    """Evaluate polynomials at the instant at which the mean height is that of the section.

    Parameters
    ----------
    parts : iterable of (Moments, Coefficients)
        Moments about `near`, and the fit, for each block of landings.
    near : (L,) array
        Instants at which u is zero, s.
    height_m : float
        Height of the section, m.

    Returns
    -------
    SectionStates
    """
    found = (vars(_cross(*part, near, height_m)).values() for part in parts)
    return SectionStates(*map(np.concatenate, zip(*found, strict=True)))


def _cross(
    sums: Moments, fit: Coefficients, near: FloatArray, height_m: float
) -> SectionStates:
    """Evaluate the polynomials of one block."""
    coefficients = _whole(sums, fit.mean)
    u = _instants(coefficients[:, :, 2].mean(axis=1), height_m)
    place, speed, bend = (
        (coefficients * _powers(u, coefficients.shape[-1], order)[:, None, None]).sum(
            axis=3
        )
        / sums.scale**order
        for order in range(3)
    )
    errors = _errors(fit.covariance, u, sums.scale)
    sinking = speed[..., 2].mean(axis=1)
    covariances = (
        _with_instant(errors, m, sinking, of) for of, m in enumerate((speed, bend))
    )
    return SectionStates(
        near[sums.rows] + u * sums.scale,
        turned(place, sums.direction, back=True),
        turned(speed, sums.direction, back=True),
        *(_turned_back(covariance, sums.direction) for covariance in covariances),
    )


def _turned_back(covariance: FloatArray, direction: FloatArray) -> FloatArray:
    """Turn covariances (L, B, 3, 3) from frames with these x axes (L, 2) into the world."""
    once = turned(covariance, direction, back=True)
    return turned(np.swapaxes(once, 2, 3), direction, back=True)


def _whole(sums: Moments, fitted: FloatArray) -> FloatArray:
    """Add back what was subtracted before the fit, (L, B, 3, K') with K' at least 3."""
    terms = max(fitted.shape[-1], 3)
    whole = np.concatenate(
        [fitted, np.zeros((*fitted.shape[:3], terms - fitted.shape[3]))], axis=3
    )
    whole[..., 0] += sums.centre
    whole[:, :, 2, 2] += sums.fall
    return whole


def _powers(u: FloatArray, terms: int, order: int) -> FloatArray:
    """Return the derivatives of the given order of the powers 1, u, ..., (L, terms)."""
    columns = np.zeros((len(u), terms))
    for k in range(order, terms):
        factor = float(np.prod(np.arange(k - order + 1, k + 1)))
        columns[:, k] = factor * u ** (k - order)
    return columns


def _instants(mean: FloatArray, height_m: float) -> FloatArray:
    """Return scaled times (L,) at which polynomials (L, K) equal `height_m`; NaN out of window."""
    u = np.zeros(len(mean))
    for _ in range(NEWTON_STEPS):
        miss = (mean * _powers(u, mean.shape[1], 0)).sum(axis=1) - height_m
        slope = (mean * _powers(u, mean.shape[1], 1)).sum(axis=1)
        u = u - miss / np.where(slope == 0, np.nan, slope)
        u = np.where(np.abs(u) <= 1.0, u, np.nan)
    return u


def _errors(covariance: FloatArray, u: FloatArray, scale: float) -> FloatArray:
    """Return the covariance (2, 2, L, B, 3) of position and velocity of each coordinate at u."""
    terms = covariance.shape[-1]
    rows = np.stack([_powers(u, terms, order) / scale**order for order in (0, 1)])
    return np.asarray(
        np.einsum("olk,lbckj,plj->oplbc", rows, covariance, rows, optimize=True)
    )


def _with_instant(
    errors: FloatArray, motion: FloatArray, sinking: FloatArray, of: int
) -> FloatArray:
    """Return covariances (L, B, 3, 3), including shifts along the track by errors of height."""
    markers = motion.shape[1]
    along = -motion / sinking[:, None, None]
    height = errors[0, 0, :, :, 2].sum(axis=1) / markers**2
    shared = errors[of, 0, :, :, 2] / markers
    own = errors[of, of][..., None] * np.eye(3)
    moved = along[..., None] * along[..., None, :] * height[:, None, None, None]
    mixed = shared[..., None, None] * along[..., None] * UP
    return np.asarray(own + moved + mixed + np.swapaxes(mixed, 2, 3), float)
