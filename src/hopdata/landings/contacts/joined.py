"""A foot with several markers: as low as its lowest marker, down as soon as one of them is."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, IntArray
from hopdata.landings.contacts.descents import ALREADY_DOWN, LANDED, NOT_LANDED
from hopdata.recording import Recording


def join_feet(recording: Recording, feet: Sequence[Mapping[str, Any]]) -> Recording:
    """Replace groups of markers by the feet that they belong to.

    Parameters
    ----------
    recording : Recording
        Levelled, so that each marker rests at height 0.
    feet : sequence of mapping
        ``name`` and ``markers`` of each foot; the markers are foot markers of the
        recording. A foot marker that is not listed is a foot of its own.

    Returns
    -------
    Recording
        With each foot listed in place of its first marker. The foot is where its lowest
        marker is, NaN where one of them is not seen. Its markers follow it, with the
        role ``part``.
    """
    if not feet:
        return recording
    order: list[
        tuple[str, str, list[int]]
    ] = []  # name, role, and numbers of its markers
    taken = {marker: foot for foot in feet for marker in foot["markers"]}
    for number, (marker, role) in enumerate(
        zip(recording.markers, recording.roles, strict=True)
    ):
        foot = taken.get(marker)
        if foot is None:
            order.append((marker, role, [number]))
        elif marker == min(foot["markers"], key=recording.markers.index):
            parts = [recording.markers.index(one) for one in foot["markers"]]
            order.append((str(foot["name"]), "foot", parts))
            order += [(recording.markers[part], "part", [part]) for part in parts]
    markers, roles, groups = zip(*order, strict=True)
    rows, all_of_it = np.arange(len(recording.time)), recording.positions
    lowest = [np.asarray(of)[np.argmin(all_of_it[:, of, 2], axis=1)] for of in groups]
    positions = np.stack([all_of_it[rows, marker] for marker in lowest], axis=1)
    filled = (
        None
        if recording.filled is None
        else recording.filled[:, [of[0] for of in groups]]
    )
    return replace(
        recording, positions=positions, markers=markers, roles=roles, filled=filled
    )


def parts_of_feet(recording: Recording) -> list[list[int]]:
    """Return the markers of each foot: the foot itself, or the parts that follow it."""
    parts: list[list[int]] = []
    for number, role in enumerate(recording.roles):
        if role == "foot":
            parts.append([number])
        elif role == "part":
            parts[-1] = [one for one in parts[-1] if recording.roles[one] == "part"] + [
                number
            ]
    return parts


def first_of(
    instant: FloatArray, se: FloatArray, status: IntArray, earliest: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the contacts (L,) of a foot: the first landing among its p markers (L, p).

    If a marker was already down, so was the foot. If a marker may have landed unseen,
    or fits badly, the foot's contact stays open, unless that marker was too high (until
    `earliest`, s). Instant and standard error, s, are the mean and deviation of the
    earliest of independent normals, taken two at a time (Clark 1961).
    """
    down, landed = status == ALREADY_DOWN, status == LANDED
    first = np.where(landed, instant, np.inf).min(axis=1, keepdims=True)
    open_ = ~(np.isin(status, (LANDED, NOT_LANDED, ALREADY_DOWN)) | (earliest > first))
    worst = np.where(open_, status, -1).max(axis=1)
    found = np.where(landed.any(axis=1), LANDED, NOT_LANDED)
    found = np.where(down.any(axis=1), ALREADY_DOWN, np.where(worst >= 0, worst, found))
    mean, sd = np.full(len(status), np.nan), np.full(len(status), np.nan)
    for part in range(status.shape[1]):
        later, error = (
            np.where(landed[:, part], x[:, part], np.nan) for x in (instant, se)
        )
        both = _earlier(mean, sd, later, error)
        alone = np.isnan(mean) | np.isnan(later)
        mean = np.where(alone, np.fmax(mean, later), both[0])
        sd = np.where(alone, np.fmax(sd, error), both[1])
    known = found == LANDED
    return np.where(known, mean, np.nan), np.where(known, sd, np.nan), found


def _earlier(
    a: FloatArray, sd_a: FloatArray, b: FloatArray, sd_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the mean and standard deviation of the smaller of two independent normals."""
    from scipy.special import ndtr

    width = np.hypot(sd_a, sd_b)
    x = (b - a) / width
    first, density = ndtr(x), width * np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi)
    mean = a * first + b * (1 - first) - density
    away_a, away_b = a - mean, b - mean  # moments about the mean avoid cancellation
    square = (away_a**2 + sd_a**2) * first + (away_b**2 + sd_b**2) * (1 - first)
    return mean, np.sqrt(np.maximum(square - (away_a + away_b) * density, 0.0))
