"""When feet come down on the force plates of a recording's file, and which feet.

A threshold is crossed some time after the contact, and a plate's samples, noise and
filter blur that instant. The onset is therefore extrapolated to the force of the
unloaded plate, and has a standard error of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.landings import forces
from hopdata.landings.overlay import match_instants
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.recordings.external import Column, ExternalContacts, ForceSignal
from hopdata.recordings.force_plates import (
    FilePlates,
    ForcePlate,
    plates_of_recording,
)
from hopdata.recordings.readers.formats import read_raw

#: Length of the pieces of which the unloaded ones are chosen.
#: Unit: s. Origin: chosen.
PIECE_S = 0.02

#: Share of the range of the pieces' forces up to which a piece counts as unloaded.
#: Unit: 1. Origin: chosen.
UNLOADED_SHARE = 0.1

#: Quantile of the pieces' forces that stands for the unloaded plate. The least force is
#: not taken, since a plate rings after a foot has left it.
#: Unit: 1. Origin: chosen.
LOW_QUANTILE = 0.02

#: Threshold of an onset above the unloaded force, in standard deviations of its noise.
#: Unit: standard deviations. Origin: chosen: noise exceeds it some 1e-9 of the time.
NOISES = 6.0

#: Least threshold, as a share of the large forces, for plates without noise.
#: Unit: 1. Origin: chosen.
LEAST_SHARE = 0.01

#: Least force of a plate on which something stands.
#: Unit: N. Origin: chosen.
LEAST_LOAD_N = 5.0

#: Longest blur that correlated noise may tell of; beyond it the noise is drift or hum.
#: Unit: s. Origin: chosen.
LONGEST_BLUR_S = 0.02

#: Correlation of neighbouring samples from which noise tells of a filter.
#: Unit: 1. Origin: chosen.
LEAST_CORRELATION = 0.3

#: Length of the stretches in which the correlation of the noise is measured.
#: Unit: s. Origin: chosen.
STRETCH_S = 0.2

#: Time after an onset in which a foot must be on the plate to have made it.
#: Unit: s, of an animal of about 1 m. Origin: chosen.
ON_PLATE_S = 0.06

#: How far outside of a plate's corners a foot's marker may be while the foot is on it.
#: Unit: m, of an animal of about 1 m. Origin: chosen: half the length of a shoe.
MARGIN_M = 0.15

#: Height above its rest up to which a foot's marker may be on the plate.
#: Unit: m, of an animal of about 1 m. Origin: chosen.
LOW_M = 0.06

#: How far the centre of pressure may be from a foot that bears the load, or from the
#: box around several feet that share it; farther, another foot does.
#: Unit: m, of an animal of about 1 m. Origin: chosen: the length of a shoe, whose
#: markers may be at one end and the pressure at the other.
REACH_M = 0.3


#: Difference between a contact and a plate's onset up to which they are the same.
#: Unit: s. Origin: chosen: as ``external.window_s``.
SAME_CONTACT_S = 0.05


@dataclass(frozen=True)
class Onsets:
    """When a plate begins to bear load.

    Parameters
    ----------
    instant, error_s : (S,) arrays
        Onsets and their standard errors, s.
    level_n, noise_n : float
        Vertical force that the unloaded plate shows, and its noise, N.
    threshold_n : float
        Force above that level which begins an onset, N; NaN if nothing loads the plate.
    blur_s : float
        Standard deviation of the filter that the noise tells of, s.
    """

    instant: FloatArray
    error_s: FloatArray
    level_n: float
    noise_n: float
    threshold_n: float
    blur_s: float

    @property
    def is_loaded(self) -> bool:
        """Tell whether anything stands on the plate at some time and not at others."""
        return not np.isnan(self.threshold_n)


def find_onsets(time: FloatArray, vertical: FloatArray) -> Onsets:
    """Find when a plate begins to bear load.

    Parameters
    ----------
    time : (K,) array
        Times of the samples, s, at a constant rate.
    vertical : (K,) array
        Vertical force, N, positive under load; NaN where missing.

    Returns
    -------
    Onsets
        Without instants if the plate is never loaded, or never unloaded.
    """
    none = np.empty(0)
    step_s = float(np.median(np.diff(time))) if len(time) > 1 else float("nan")
    unloaded = _unloaded(vertical, step_s)
    if not unloaded.any():
        nan = float("nan")
        return Onsets(none, none, nan, nan, nan, nan)
    level = float(np.median(vertical[unloaded]))
    noise = forces.noise_sd(vertical[unloaded])
    force = vertical - level
    # Pieces beside a contact hold some of it.
    blur_s = _blur_s(force, np.abs(force) <= NOISES * noise, step_s)
    loads = force[force > max(NOISES * noise, LEAST_LOAD_N)]
    large = forces.large_force(loads)
    threshold = max(NOISES * noise, LEAST_SHARE * large)
    sure = forces.loaded_from(threshold, large)
    # A plate on which somebody stands all the time has no unloaded force.
    if not large > max(LEAST_LOAD_N, sure) or abs(level) > UNLOADED_SHARE * large:
        return Onsets(none, none, level, noise, float("nan"), blur_s)
    crossed = forces.force_onsets(time, force, least_n=threshold, sure_n=sure)
    instant, error_s = forces.extrapolated(
        time, force, crossed, noise_n=noise, blur_s=blur_s
    )
    return Onsets(instant, error_s, level, noise, threshold, blur_s)


def _unloaded(vertical: FloatArray, step_s: float) -> BoolArray:
    """Tell in which samples (K,) the plate bears nothing, by pieces of the signal."""
    if not step_s > 0:
        return np.zeros(len(vertical), dtype=bool)
    per_piece = max(5, round(PIECE_S / step_s))
    n_pieces = len(vertical) // per_piece
    pieces = vertical[: n_pieces * per_piece].reshape(n_pieces, per_piece)
    means = pieces.mean(axis=1)
    known = means[np.isfinite(means)]
    if not len(known):
        return np.zeros(len(vertical), dtype=bool)
    low = np.quantile(known, LOW_QUANTILE)
    limit = low + UNLOADED_SHARE * (known.max() - low)
    # A piece in which the load changes is neither.
    is_even = np.abs(pieces - means[:, None]).max(axis=1) <= known.max() - limit
    inside = np.zeros(len(vertical), dtype=bool)
    of_pieces = (means <= limit) & is_even
    inside[: n_pieces * per_piece] = np.repeat(of_pieces, per_piece)
    return inside


def _blur_s(force: FloatArray, unloaded: BoolArray, step_s: float) -> float:
    """Return the standard deviation of a filter, s, by the correlation of its noise.

    White noise behind a Gaussian filter of deviation s is correlated by exp(-(t/2s)^2)
    at a lag of t, so by 1/e at 2 s. Noise without a correlation, or none at all, tells
    of no filter.

    Parameters
    ----------
    force : (K,) array
        Vertical force above that of the unloaded plate, N.
    unloaded : (K,) bool array
        Samples that show noise alone.
    step_s : float
        Time between two samples, s.
    """
    length = max(10, round(STRETCH_S / step_s))
    n_lags = max(2, min(length // 2, round(2 * LONGEST_BLUR_S / step_s) + 1))
    covariance = _autocovariance(force, unloaded, length=length, n_lags=n_lags)
    if not covariance[0] > 0:
        return 0.0
    correlation = covariance / covariance[0]
    # What chance does to noise that is not correlated is no filter.
    if correlation[1] < max(1 / np.sqrt(length), LEAST_CORRELATION):
        return 0.0
    below = np.flatnonzero(correlation < np.exp(-1))
    if not len(below):
        return LONGEST_BLUR_S
    after = int(below[0])
    before = after - 1
    share = correlation[before] - np.exp(-1)
    share /= correlation[before] - correlation[after]
    return min(float((before + share) * step_s / 2), LONGEST_BLUR_S)


def _autocovariance(
    force: FloatArray, unloaded: BoolArray, *, length: int, n_lags: int
) -> FloatArray:
    """Return the autocovariance of noise at lags of 0 to `n_lags` samples, N^2.

    It is summed over whole stretches of `length` unloaded samples, each without its
    trend, since drift is correlated for longer than any filter makes noise.
    """
    summed = np.zeros(n_lags + 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], unloaded, [False]])))
    for start, stop in edges.reshape(-1, 2):
        for first in range(start, stop - length + 1, length):
            stretch = _without_trend(force[first : first + length])
            for lag in range(n_lags + 1):
                n_products = length - lag
                summed[lag] += stretch[:n_products] @ stretch[lag:] / n_products
    return summed


def _without_trend(piece: FloatArray) -> FloatArray:
    """Return samples (n,) without their mean and linear trend."""
    at = np.arange(len(piece)) - (len(piece) - 1) / 2
    return piece - piece.mean() - at * (at @ piece) / (at @ at)


# Which feet step on which plate.


@dataclass(frozen=True)
class PlateContacts:
    """Contacts of a recording's plates, as the comparison takes them.

    Parameters
    ----------
    contacts : tuple of ExternalContacts
        One for each plate that a followed foot steps on.
    signals : tuple of ForceSignal
        Vertical force of each of them above that of the unloaded plate, N.
    notes : tuple of Message
        What is worth knowing: several feet on a plate, plates that nobody steps on.
    """

    contacts: tuple[ExternalContacts, ...]
    signals: tuple[ForceSignal, ...]
    notes: tuple[Message, ...]


def plates_of_files(
    recording: Recording, files: Sequence[Path], *, unit: str = "auto"
) -> FilePlates:
    """Read the force plates of a recording's files, on the recording's clock.

    Parameters
    ----------
    recording : Recording
        Imported from these files, all of whose frames it has.
    files : sequence of path
        In order of time. Each has a clock of its own.
    unit : {"auto", "m", "mm"}
        ``input.unit``, as for the recording.

    Raises
    ------
    RecordingError
        If a file cannot be read.
    """
    if len(files) == 1:
        return plates_of_recording(recording, files[0], unit=unit)
    plates: list[ForcePlate] = []
    refused: list[Message] = []
    times = [read_raw(file, rate_hz=recording.rate_hz).time for file in files]
    if sum(map(len, times)) != len(recording.time):
        # Frames were left out: nothing says where a file begins.
        return FilePlates()
    begin = 0
    for file, time in zip(files, times, strict=True):
        shift_s = float(recording.time[begin] - time[0])
        begin += len(time)
        found = plates_of_recording(recording, file, unit=unit)
        plates += [replace(one, time=one.time + shift_s) for one in found.plates]
        refused += found.refused
    return FilePlates(tuple(plates), tuple(refused))


def beside_plates(
    table: pd.DataFrame, contacts: Sequence[ExternalContacts]
) -> pd.DataFrame:
    """Return contacts with the onset of the plate that each of them made.

    Parameters
    ----------
    table : DataFrame
        Contacts of one recording, see `hopdata.contact_times.ContactTimes`.
    contacts : sequence of ExternalContacts
        Onsets of plates, see `contacts_on_plates`.

    Returns
    -------
    DataFrame
        The rows with the columns plate, plate_s and plate_se_s: the name of the plate,
        its onset and the onset's standard error, s. They are empty for a contact within
        `SAME_CONTACT_S` of no onset, and for all but the first contact of the feet that
        share a plate.
    """
    table = table.assign(plate="", plate_s=np.nan, plate_se_s=np.nan)
    for one in contacts:
        is_own = table["found"].astype(bool) & table["foot"].isin(one.column.feet)
        firsts = table[is_own].sort_values("contact_s", kind="stable")
        firsts = firsts.drop_duplicates("landing")
        onsets = np.flatnonzero(_of_followed_feet(one))
        ours_s = firsts["contact_s"].to_numpy(float)
        at, of = match_instants(one.instant[onsets], ours_s, window_s=SAME_CONTACT_S)
        rows = firsts.index[of]
        table.loc[rows, "plate"] = one.column.name
        table.loc[rows, "plate_s"] = one.instant[onsets[at]]
        if one.error_s is not None:
            table.loc[rows, "plate_se_s"] = one.error_s[onsets[at]]
    return table


def onsets_without_contact(
    table: pd.DataFrame, contacts: Sequence[ExternalContacts]
) -> list[float]:
    """Return the onsets of followed feet that no contact made, s, in order of time.

    Parameters
    ----------
    table, contacts
        What `beside_plates` returns, and what it was given.
    """
    alone = []
    for one in contacts:
        on_plate_s = table.loc[table["plate"] == one.column.name, "plate_s"]
        onsets_s = one.instant[_of_followed_feet(one)]
        alone += onsets_s[~np.isin(onsets_s, on_plate_s.to_numpy(float))].tolist()
    return sorted(alone)


def _of_followed_feet(contacts: ExternalContacts) -> BoolArray:
    """Tell which onsets (K,) the feet of their column made."""
    if contacts.of_other_foot is None:
        return np.ones(len(contacts.instant), dtype=bool)
    return ~contacts.of_other_foot


def contacts_on_plates(
    recording: Recording, plates: Sequence[ForcePlate]
) -> PlateContacts:
    """Find the onsets of plates, and the feet that make them.

    A foot makes an onset if it is low and within the plate's corners soon after, and
    the centre of pressure is at such feet. Of an onset without them, another foot is
    the cause: one that is not followed.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    plates : sequence of ForcePlate
        Of the recording's file, in the same axes.
    """
    contacts = []
    signals = []
    notes: list[Message] = []
    feet = recording.names("foot")
    for plate in plates:
        notes += plate.remarks
        onsets = find_onsets(plate.time, plate.force[:, 2])
        if not len(onsets.instant):
            notes.append(Message("landings.plate_without_onset", {"plate": plate.name}))
            continue
        made_by = feet_on(recording, plate, onsets.instant)
        own = [foot for k, foot in enumerate(feet) if made_by[:, k].any()]
        if not own:
            values = {"plate": plate.name, "number": len(onsets.instant)}
            notes.append(Message("landings.plate_of_other_feet", values))
            continue
        n_together = int((made_by.sum(axis=1) > 1).sum())
        if n_together:
            values = {"plate": plate.name, "number": n_together, "feet": ", ".join(own)}
            notes.append(Message("landings.plate_shared", values))
        column = Column(plate.name, tuple(own))
        span_s = (float(plate.time[0]), float(plate.time[-1]))
        contacts.append(
            ExternalContacts(
                column,
                onsets.instant,
                "plates",
                span_s,
                error_s=onsets.error_s,
                of_other_foot=np.asarray(~made_by.any(axis=1)),
            )
        )
        above = plate.force[:, 2] - onsets.level_n
        options = {"threshold_n": onsets.threshold_n}
        signals.append(ForceSignal(column, plate.time, above, "N", options))
    return PlateContacts(tuple(contacts), tuple(signals), tuple(notes))


def feet_on(recording: Recording, plate: ForcePlate, instants: FloatArray) -> BoolArray:
    """Tell which feet are on a plate soon after each instant.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    plate : ForcePlate
        In the same axes.
    instants : (S,) array
        Onsets of the plate, s.

    Returns
    -------
    (S, F) bool array
        For each instant and foot.
    """
    feet = recording.feet
    margin_m = MARGIN_M * recording.scale
    inside = within(plate.corners, feet, margin_m=margin_m)
    low = feet[:, :, 2] <= LOW_M * recording.scale
    with np.errstate(invalid="ignore"):
        on_plate = inside & low
    until = instants + ON_PLATE_S * recording.time_scale
    begin = np.searchsorted(recording.time, instants)
    end = np.searchsorted(recording.time, until)
    centres = _centres_of_pressure(plate, instants, until, margin_m=margin_m)
    found = np.zeros((len(instants), feet.shape[1]), dtype=bool)
    for k, (first, stop) in enumerate(zip(begin, end, strict=True)):
        # At a low rate, the first frame after the onset has to do.
        frames = slice(first, max(stop, first + 1))
        there = on_plate[frames]
        if there.any():
            places = feet[frames, :, :2]
            reach_m = REACH_M * recording.scale
            found[k] = _under_pressure(places, there, centres[k], reach_m=reach_m)
    return found


def _under_pressure(
    places: FloatArray, there: BoolArray, centre: FloatArray, *, reach_m: float
) -> BoolArray:
    """Tell which of the feet (F,) that are on a plate bear its load.

    These are the feet near the centre of pressure. If there is none, several feet may
    share the load with the centre amid them. Without a centre, all of them may.

    Parameters
    ----------
    places : (N, F, 2) array
        Positions of the feet in some frames, m.
    there : (N, F) bool array
        Whether a foot is on the plate.
    centre : (2,) array
        Centre of pressure, m; NaN if it is not known.
    reach_m : float
        Distance that counts as near, m.
    """
    on_plate = np.asarray(there.any(axis=0))
    if np.isnan(centre).any():
        return on_plate
    away = np.hypot(*np.moveaxis(places - centre, 2, 0))
    near = np.asarray((there & (away <= reach_m)).any(axis=0))
    if near.any():
        return near
    of_feet = places[there]
    beside = np.maximum(of_feet.min(axis=0) - centre, centre - of_feet.max(axis=0))
    if np.hypot(*np.maximum(beside, 0)) > reach_m:
        return np.zeros_like(on_plate)
    return on_plate


def _centres_of_pressure(
    plate: ForcePlate, begin_s: FloatArray, end_s: FloatArray, *, margin_m: float
) -> FloatArray:
    """Return the mean centres of pressure (S, 2) between times, weighted by the force.

    NaN where it is not on the plate: then channels or moments are not what they should
    be, and tell nothing.
    """
    centres = np.full((len(begin_s), 3), np.nan)
    known = np.isfinite(plate.pressure).all(axis=1)
    weight = np.where(known, np.maximum(plate.force[:, 2], 0), 0.0)
    first = np.searchsorted(plate.time, begin_s)
    stop = np.searchsorted(plate.time, end_s)
    for k, (a, b) in enumerate(zip(first, stop, strict=True)):
        share = weight[a:b]
        if share.sum() > 0:
            pressure = np.nan_to_num(plate.pressure[a:b])
            centres[k] = share @ pressure / share.sum()
    centres[~within(plate.corners, centres, margin_m=margin_m)] = np.nan
    return centres[:, :2]


def within(corners: FloatArray, points: FloatArray, *, margin_m: float) -> BoolArray:
    """Tell which points (..., 3) lie above a plate, or up to a margin beside it.

    Parameters
    ----------
    corners : (4, 3) array
        Of the plate, m, one after the other around it.
    points : (..., 3) array
        m, z up; NaN where not seen, which is not within.
    margin_m : float
        Distance from an edge up to which a point beside the plate counts, m.
    """
    flat = corners[:, :2]
    middle = flat.mean(axis=0)
    result = np.ones(points.shape[:-1], dtype=bool)
    for start, stop in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        along = stop - start
        outward = np.array([along[1], -along[0]]) / np.hypot(*along)
        if outward @ (middle - start) > 0:
            outward = -outward
        result &= (points[..., :2] - start) @ outward <= margin_m
    return result
