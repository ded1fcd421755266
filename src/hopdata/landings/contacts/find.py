"""Contact instants of every foot in every landing, by the chosen method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, chosen, require_choice
from hopdata.landings.contacts import descents, joined, kink_law
from hopdata.landings.contacts.kink import WINDOW_FRAMES, KinkFits
from hopdata.landings.contacts.kink_law import FRAMES_AFTER, FRAMES_BEFORE
from hopdata.landings.contacts.velocity_minimum import velocity_minima
from hopdata.recording import Recording
from hopdata.recordings.quality.processing import low_pass

LONG_WINDOWS_S = (0.08, 0.05)  # before and after the contact, if the flight law holds
SHORT_WINDOWS_S = (0.04, 0.027)  # before and after the contact, if it does not
# Rise, in standard deviations of a height, at which a foot has left the floor again
LEAVES = 8.0
REFUTED = (
    2.0  # rms residual over measurement noise above which the flight law does not hold
)
MOST_ODD = 0.5  # largest share of landings that may be left out when the law is learned
FILTER_DELAYS = (
    0.21  # delay of contacts by a low-pass filter, in periods of its cut-off
)
# Height below which a foot is down: this share of the median descent, but at least this
# many standard deviations of the noise.
DOWN_SHARE, DOWN_SIGMAS = 0.15, 4.0


@dataclass(frozen=True)
class Contacts:
    """Contact instants of L landings and n feet.

    Parameters
    ----------
    instant, se : (L, n) array
        Contact instant and its standard error, s; NaN where none was found.
    status : (L, n) int array
        Codes of `hopdata.landings.contacts.descents`: ``LANDED``, or why the instant
        cannot be trusted.
    noise_m : float
        Standard deviation of a foot's height in this recording, m.
    common : (n,) array
        Error that all instants of a foot may share, s, because its contact may be
        softer or harder than it appears; not in `se`, and empty for the printed
        methods.
    earliest : (L, n) array
        Last instant at which the foot was still too high to touch, s; empty for the
        printed methods.
    down : (L, n) array
        When the foot reached the floor, by its height alone, s; empty for the kink fit,
        whose instants say it better. The printed methods need it, since the minima of a
        smoothed velocity lie some 20 ms ahead of the contact.
    """

    instant: FloatArray
    se: FloatArray
    status: IntArray
    noise_m: float
    common: FloatArray = field(default_factory=lambda: np.empty(0))
    earliest: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    down: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


@one_blas_thread()
def find_landings(
    recording: Recording,
    *,
    method: str = "kink",
    gravity: str = "learned",
    window_before_s: float | None = None,
    window_after_s: float | None = None,
    down_height_m: float | None = None,
    maximum_misfit: float = 5.0,
) -> pd.DataFrame:
    """Find the descents of the body, and time each foot's contact in them.

    Parameters
    ----------
    recording : Recording
        Levelled: feet rest at height 0.
    down_height_m : float, optional
        Height to which a foot must sink to have landed, m. By default 15 % of the
        median descent of the body, but at least four times the noise.
    method, gravity, window_before_s, window_after_s, maximum_misfit
        See `find_contacts`. No sections are known yet, so every method searches from
        the apex to the nadir of the body.

    Returns
    -------
    pandas.DataFrame
        One row for each descent, in order of time: begin_s and end_s (apex and nadir of
        the body), hidden (whether only the feet show the landing; it then lasts from
        all up to all down), and for each foot contact_<foot>_s, se_<foot>_s,
        status_<foot> and common_<foot>_s, which is the same in all rows, and NaN for
        the printed methods. down_<foot>_s is when the foot reached the floor, as far as
        the method knows: the contact by the kink fit, else the instant at which the
        foot's height says so. In all rows, method.

    Raises
    ------
    AnalysisError
        If there are fewer than two feet.
    ConfigError
        If `method` or `gravity` is unknown.
    """
    printed = chosen("touchdowns.method", method, METHODS) is not None
    feet, pace, scale = recording.names("foot"), recording.pace, recording.scale
    if len(feet) < 2:
        told = f"{recording.name}: expected at least 2 foot markers, found {len(feet)}"
        raise AnalysisError(told)
    before, after = (w and w / pace for w in (window_before_s, window_after_s))
    # From here on, times and heights are those of an animal of 1 m, on which this was
    # tuned.
    down_m = down_height_m and down_height_m / scale
    time = recording.time / pace
    heights = recording.feet[:, :, 2] / scale
    body = recording.body_height / scale
    parts = joined.parts_of_feet(recording)
    falls = descents.descents(body, time, longest=descents.HIDDEN_S)
    spans = time[np.array(falls, dtype=np.int64).reshape(-1, 2)]
    down_m = down_m or usual_down_height(recording, spans * pace) / scale
    hidden = descents.find_hidden_landings(
        time, heights, body, spans, down_height_m=down_m
    )
    spans = np.concatenate([spans, hidden])
    order = np.argsort(spans[:, 0], kind="stable")
    gap = np.full(len(spans), np.nan)
    markers = [marker for foot in parts for marker in foot]
    seen = heights
    if len(markers) > len(feet):
        seen = recording.positions[:, markers, 2] / scale
    complete = descents.Transitions(spans[order, 0], spans[order, 1], gap, gap)
    if printed:
        contacts = _printed_contacts(recording, spans[order], down_m, method)
    else:
        options: Any = {
            "gravity": gravity,
            "maximum_misfit": maximum_misfit,
            "lead_s": 0.0,
        }
        options |= {
            "window_before_s": before,
            "window_after_s": after,
            "down_height_m": down_m,
        }
        options |= {"correlation": descents.noise_correlation(recording.body)}
        options["foot_of"] = tuple(foot for foot, own in enumerate(parts) for _ in own)
        contacts = _of_feet(
            find_contacts(time, seen, complete, **options), options["foot_of"]
        )
        if cut := low_pass(recording.body, scale=scale):
            late_s = FILTER_DELAYS / (cut * recording.rate_hz) / pace
            contacts = replace(contacts, common=np.maximum(contacts.common, late_s))
    down = contacts.down if printed else contacts.instant
    columns = {
        "method": method,
        "begin_s": spans[order, 0],
        "end_s": spans[order, 1],
        "hidden": order >= len(spans) - len(hidden),
        **{f"contact_{foot}_s": contacts.instant[:, i] for i, foot in enumerate(feet)},
        **{f"se_{foot}_s": contacts.se[:, i] for i, foot in enumerate(feet)},
        **{f"status_{foot}": contacts.status[:, i] for i, foot in enumerate(feet)},
        **{
            f"common_{foot}_s": one
            for foot, one in zip(feet, contacts.common, strict=True)
        },
        **{f"down_{foot}_s": down[:, i] for i, foot in enumerate(feet)},
    }
    return pd.DataFrame(
        {k: v * pace if k.endswith("_s") else v for k, v in columns.items()}
    )


def _printed_contacts(
    recording: Recording, spans: FloatArray, down_height_m: float, method: str
) -> Contacts:
    """Return contacts by a printed method, at the pace of an animal of 1 m as all else there is.

    `spans` (L, 2), s, and `down_height_m` are at that pace. The recording is not: the
    filter of these methods lasts 0.07 s whatever the size of the animal.
    """
    pace = recording.pace
    begin, end = spans.T * pace
    no_gap = np.full(len(spans), np.nan)
    contacts = find_contacts(
        recording.time,
        recording.feet[:, :, 2],
        descents.Transitions(begin, end, no_gap, no_gap),
        down_height_m=down_height_m * recording.scale,
        lead_s=0.0,
        method=method,
    )
    unknown = np.full(contacts.instant.shape[1], np.nan)
    return replace(
        contacts,
        instant=contacts.instant / pace,
        se=contacts.se / pace,
        common=unknown,
        down=contacts.down / pace,
    )


def _of_feet(contacts: Contacts, foot_of: tuple[int, ...]) -> Contacts:
    """Combine the contacts of markers into those of their feet; `foot_of` numbers the feet."""
    if len(set(foot_of)) == len(foot_of):
        return contacts
    found, common = [], []
    for foot in sorted(set(foot_of)):
        own = np.flatnonzero(np.equal(foot_of, foot))
        one: Any = (contacts.instant, contacts.se, contacts.status, contacts.earliest)
        instant, *rest = (part[:, own] for part in one)
        found.append(joined.first_of(instant, *rest))
        earliest = np.where(np.isfinite(instant), instant, np.inf).argmin(axis=1)
        common.append(contacts.common[own][np.bincount(earliest, minlength=1).argmax()])
    instant, se, status = (np.stack(part, axis=1) for part in zip(*found, strict=True))
    return replace(
        contacts, instant=instant, se=se, status=status, common=np.array(common)
    )


def usual_down_height(recording: Recording, spans: FloatArray) -> float:
    """Return the height, m, below which a foot is down, from the body's descents (L, 2), s."""
    # The instants are those of frames, but for rounding: half a frame earlier finds the
    # same ones.
    half_s = 0.5 * float(np.min(np.diff(recording.time)))
    apex, nadir = (np.searchsorted(recording.time, side - half_s) for side in spans.T)
    falls = recording.body_height[apex] - recording.body_height[nadir]
    fall_m = float(np.nanmedian(falls)) if np.isfinite(falls).any() else 0.0
    noise_m = descents.height_noise(recording.feet[:, :, 2], scale=recording.scale)
    return max(DOWN_SHARE * fall_m, DOWN_SIGMAS * noise_m)


def contacts_of(landings: pd.DataFrame) -> Contacts:
    """Read the contacts from a table made by `find_landings`."""
    kinds = ("^contact_", "^se_", "^status_", "^common_")
    instant, se, status, common = (
        landings.filter(regex=k).to_numpy(float) for k in kinds
    )
    # The errors already contain the noise.
    return Contacts(
        instant, se, status.astype(np.int64), np.nan, common.max(axis=0, initial=0.0)
    )


def floor_instants(landings: pd.DataFrame) -> FloatArray:
    """Return when each foot reached the floor, (L, n), s, from a table by `find_landings`."""
    return np.asarray(landings.filter(regex="^down_").to_numpy(float))


def are_by(landings: pd.DataFrame, method: str) -> bool:
    """Return whether the contacts of a table made by `find_landings` are those of a method."""
    return bool((landings["method"] == method).all())


def find_contacts(
    time: FloatArray,
    heights: FloatArray,
    transitions: descents.Transitions,
    *,
    down_height_m: float,
    lead_s: float = SHORT_WINDOWS_S[0],
    method: str = "kink",
    gravity: str = "learned",
    window_before_s: float | None = None,
    window_after_s: float | None = None,
    maximum_misfit: float = 5.0,
    correlation: float = 0.0,
    foot_of: tuple[int, ...] = (),
) -> Contacts:
    """Find the instant at which each foot touched in each transition.

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    heights : (N, n) array
        Heights of the feet above the levelled floor, m; NaN where unseen.
    transitions : Transitions
        The descents of the body.
    down_height_m : float
        Height to which a foot must sink to have landed, m.
    lead_s : float
        Time before a transition at which the search for a contact begins, s.
    method : {"kink", "velocity_minimum", "velocity_minimum_parabola"}
        Maximum-likelihood kink, or the minimum of the vertical velocity in the
        transition (the printed method, Sec. 2.2.3), to a whole frame or at the vertex
        of a parabola through it.
    gravity : {"learned", "free", "known"}
        Acceleration of a foot in free flight, for the kink fit: drawn from a
        distribution learned from the recording, unknown in each landing, or that of
        gravity.
    window_before_s, window_after_s : float, optional
        Time before and after the contact whose frames the kink fit uses, s (at least 5
        and 3 frames that show the foot). The defaults are 0.08 and 0.05 s where feet
        fly freely and then stand still to within the noise, and 0.04 and 0.027 s where
        they do not (a runner's foot rolls).
    maximum_misfit : float
        Largest accepted ratio of a kink fit's rms residual to that of the whole
        recording.
    correlation : float
        Correlation of the noise in consecutive frames (`descents.noise_correlation`).
    foot_of : tuple of int, optional
        Number of the rigid foot that each of the n belongs to, where several are
        markers of one.

    Returns
    -------
    Contacts

    Raises
    ------
    ConfigError
        If `method` or `gravity` is unknown.
    """
    find = chosen("touchdowns.method", method, METHODS)
    require_choice("touchdowns.gravity", gravity, kink_law.GRAVITIES)
    noise_m = descents.height_noise(heights)
    of, trail_s = (time, heights, transitions), window_after_s or SHORT_WINDOWS_S[1]
    near, earliest, status = descents.approaches(
        *of,
        noise_m=noise_m,
        down_height_m=down_height_m,
        lead_s=lead_s,
        trail_s=trail_s,
    )
    if find is not None:
        instant, se = find(time, heights, transitions, noise_m=noise_m)
        landed = status == descents.LANDED
        instant, se = np.where(landed, instant, np.nan), np.where(landed, se, np.nan)
        status = np.where(landed & np.isnan(instant), descents.MISSING, status)
        return Contacts(instant, se, status, noise_m, down=near)
    asked = (window_before_s, window_after_s)
    seen = time, heights, _windows(time, asked, LONG_WINDOWS_S), earliest
    feet = kink_law.FootHeights(*seen, leaves_m=LEAVES * noise_m, foot_of=foot_of)
    fits, common = kink_law.joint_fits(feet, near, noise_m=noise_m, gravity=gravity)
    if (
        rising := (fits.velocity > 0) & np.isfinite(earliest)
    ).any():  # the search began too late
        near = np.where(rising, earliest, near)
        fits, common = kink_law.joint_fits(feet, near, noise_m=noise_m, gravity=gravity)
    stands = fits.n_after[status == descents.LANDED] >= FRAMES_AFTER
    rolls = (
        2 * stands.sum() <= stands.size
        or kink_law.pooled_noise(fits) > REFUTED * noise_m
    )
    odd = _is_odd(fits) & (not rolls)
    if (
        0
        < (rows := np.asarray(odd.any(axis=1, keepdims=True))).sum()
        < MOST_ODD * len(rows)
    ):
        feet = replace(feet, odd=rows)
        fits, common = kink_law.joint_fits(feet, near, noise_m=noise_m, gravity=gravity)
        odd = _is_odd(fits)
    bounces = not rolls and stands.mean() < 1 - kink_law.UNDETERMINED_SHARE
    # A marker may rise right after its contact, such as the toes while the heel comes
    # down.
    rises = np.asarray((fits.n_after < FRAMES_AFTER) & bounces)
    if rolls or bounces or odd.any():
        short = replace(
            feet, windows_s=_windows(time, asked, SHORT_WINDOWS_S), leaves_m=np.inf
        )
        alone, own = kink_law.single_fits(short, near, noise_m=noise_m, gravity=gravity)
        feet, common = (short, own) if rolls else (feet, common)
        fits = kink_law.merged(fits, alone, np.asarray(rises | rolls | odd))
    hidden = _hidden(time, heights, near, feet.windows_s)
    found = _judged(fits, status, hidden, kink_law.pooled_noise(fits), maximum_misfit)
    risen_s = np.where(rises, LEAVES * noise_m / np.abs(fits.velocity), 0.0)
    about = [
        round(window / float(np.median(np.diff(time)))) for window in feet.windows_s
    ]
    se = np.hypot(found.se, risen_s) * descents.widening(correlation, *about)
    # After the earliest instant the foot only has to come to rest, which takes no
    # longer than this.
    longest = np.where(np.isfinite(earliest), 2 * kink_law.UNDETERMINED_S, np.inf)
    return replace(found, se=np.minimum(se, longest), common=common, earliest=earliest)


METHODS: dict[str, Callable[..., tuple[FloatArray, FloatArray]] | None] = {
    "kink": None,
    "velocity_minimum": partial(velocity_minima, parabola=False),
    "velocity_minimum_parabola": partial(velocity_minima, parabola=True),
}


def _windows(
    time: FloatArray,
    asked: tuple[float | None, float | None],
    default: tuple[float, float],
) -> tuple[float, float]:
    """Return the windows before and after a contact, s, widened to hold enough frames."""
    frame_s = float(np.median(np.diff(time)))
    before, after = (d if a is None else a for a, d in zip(asked, default, strict=True))
    return max(before, WINDOW_FRAMES[0] * frame_s), max(
        after, WINDOW_FRAMES[1] * frame_s
    )


def _hidden(
    time: FloatArray,
    heights: FloatArray,
    near: FloatArray,
    windows_s: tuple[float, float],
) -> BoolArray:
    """Mark the landings and feet (L, n) with frames missing about the contacts `near`, s."""
    lost = np.cumsum(np.isnan(heights), axis=0)
    ends = (np.searchsorted(time, near + way) for way in (-windows_s[0], windows_s[1]))
    first, last = (
        np.take_along_axis(lost, k.clip(max=len(time) - 1), axis=0) for k in ends
    )
    return np.asarray(last > first)


def _is_odd(fits: KinkFits) -> BoolArray:
    """Mark contacts (L, n) that break the law of the others, such as those of a swinging leg."""
    ratio, chance = _misfits(fits, kink_law.pooled_noise(fits))
    return np.asarray(ratio > np.maximum(REFUTED, chance))


def _misfits(fits: KinkFits, noise_m: float) -> tuple[FloatArray, FloatArray]:
    """Return rms residuals over the noise (L, n), and their limits at three standard deviations."""
    dof = np.maximum(fits.dof, 1.0)
    return np.sqrt(fits.misfit / dof) / noise_m, 1 + 3 / np.sqrt(2 * dof)


def _judged(
    fits: KinkFits,
    status: IntArray,
    hidden: BoolArray,
    noise_m: float,
    maximum_misfit: float,
) -> Contacts:
    """Mark fits with too few frames or too large a misfit; widen errors by the misfit."""
    thin = (
        (fits.n_before < FRAMES_BEFORE)
        | (fits.n_after < FRAMES_AFTER)
        | (fits.dof <= 0)
    )
    thin |= ~np.isfinite(fits.unit_se)
    ratio, chance = _misfits(fits, noise_m)
    landed = status == descents.LANDED
    status = np.where(landed & (ratio > maximum_misfit), descents.POOR_FIT, status)
    status = np.where(landed & ~(fits.velocity < 0), descents.RISES, status)
    status = np.where(
        landed & thin, np.where(hidden, descents.MISSING, descents.THIN), status
    )
    # Widen the error by Birge's ratio where the misfit exceeds what chance explains.
    se = fits.unit_se * noise_m * np.where(ratio > chance, ratio, 1.0)
    untimed = np.isin(status, (descents.MISSING, descents.THIN))
    instant, se = (np.where(untimed, np.nan, x) for x in (fits.instant, se))
    return Contacts(instant, se, status, noise_m)
