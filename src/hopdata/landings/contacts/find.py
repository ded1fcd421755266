"""Contact instants of every foot in every landing, by the chosen method.

`find_landings` makes the table of a recording: descents of the body, and the contacts
of its feet in them. `find_contacts` times the contacts in given descents. Everything
here is tuned on an animal of 1 m; times and heights of others are scaled to it first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, chosen, require_choice
from hopdata.landings.contacts import descents, joined, kink_law, passes, steps
from hopdata.landings.contacts.approach import approaches
from hopdata.landings.contacts.judged import Contacts, frames_missing, judge_fits
from hopdata.landings.contacts.law import UNDETERMINED_S, FootHeights
from hopdata.landings.contacts.learning import pooled_noise
from hopdata.landings.contacts.noise import (
    height_noise,
    noise_correlation,
    widening,
)
from hopdata.landings.contacts.velocity_minimum import velocity_minima
from hopdata.recording import Recording
from hopdata.recordings.quality.processing import low_pass

#: Rise at which a foot has left the floor again, in standard deviations of a height.
#: Frames from then on are left out: when such feet were taken to stand, contacts came
#: out 0.5 to 2 ms early.
#: Unit: standard deviations. Origin: chosen.
LEAVES = 8.0

#: Delay of contacts by a low-pass filter, in periods of its cut-off (17 ms at 12 Hz);
#: this is stated as an error that all contacts share.
#: Unit: periods. Origin: measured: docs/contacts.md, "Positions that are not the
#: cameras' own".
FILTER_DELAYS = 0.21

#: Height below which a foot is down, as a share of the median descent of the body.
#: Unit: 1. Origin: chosen.
DOWN_SHARE = 0.15

#: Least height below which a foot is down, in standard deviations of the noise.
#: Unit: standard deviations. Origin: chosen.
DOWN_SIGMAS = 4.0

#: Methods by name: a function that finds instants between the sections, or None for
#: the kink fit.
METHODS: dict[str, Callable[..., tuple[FloatArray, FloatArray]] | None] = {
    "kink": None,
    "velocity_minimum": partial(velocity_minima, parabola=False),
    "velocity_minimum_parabola": partial(velocity_minima, parabola=True),
}


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
    of_feet: bool = False,
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
    of_feet : bool
        Whether to look also for landings that no descent of the body shows, in the
        descents of each foot (`hopdata.landings.contacts.steps`). One foot is then
        enough, and no body is needed.

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
        If there are fewer than two feet, or none with `of_feet`.
    ConfigError
        If `method` or `gravity` is unknown.
    """
    printed = chosen("touchdowns.method", method, METHODS) is not None
    feet = recording.names("foot")
    least_feet = 1 if of_feet else 2
    if len(feet) < least_feet:
        raise AnalysisError.at(
            recording.name, f"at least {least_feet} foot markers", len(feet)
        )
    # From here on, times and heights are those of an animal of 1 m, on which this was
    # tuned.
    time_scale = recording.pace
    time = recording.time / time_scale
    looked = _where_to_look(recording, time, down_height_m, of_feet=of_feet)
    spans = looked.spans
    down_m = looked.down_m
    if printed:
        contacts = _printed_contacts(recording, spans, down_m, method)
        down = contacts.down
    else:
        contacts = _kink_contacts(
            recording,
            spans,
            down_m,
            gravity=gravity,
            window_before_s=_at_time_scale(window_before_s, time_scale),
            window_after_s=_at_time_scale(window_after_s, time_scale),
            maximum_misfit=maximum_misfit,
        )
        down = contacts.instant
    if of_feet:
        contacts = _without_strangers(contacts, looked)
    columns: dict[str, Any] = {
        "method": method,
        "begin_s": spans[:, 0] * time_scale,
        "end_s": spans[:, 1] * time_scale,
        "hidden": looked.is_hidden,
    }
    for i, foot in enumerate(feet):
        columns[f"contact_{foot}_s"] = contacts.instant[:, i] * time_scale
    for i, foot in enumerate(feet):
        columns[f"se_{foot}_s"] = contacts.se[:, i] * time_scale
    for i, foot in enumerate(feet):
        columns[f"status_{foot}"] = contacts.status[:, i]
    for i, foot in enumerate(feet):
        columns[f"common_{foot}_s"] = contacts.common[i] * time_scale
    for i, foot in enumerate(feet):
        columns[f"down_{foot}_s"] = down[:, i] * time_scale
    return pd.DataFrame(columns)


@dataclass(frozen=True)
class _Looked:
    """Where contacts are looked for, of an animal of 1 m.

    Parameters
    ----------
    spans : (L, 2) array
        Begin and end of each landing, s, in order of time.
    is_hidden : (L,) bool array
        Whether no descent of the body shows it, but only feet do.
    down_m : float
        Height below which a foot is down, m.
    found : Steps, optional
        Descents of the feet, if landings were looked for in these.
    stranger : (L, n) bool array
        Feet that do not land in a landing of single feet.
    """

    spans: FloatArray
    is_hidden: BoolArray
    down_m: float
    found: steps.Steps | None
    stranger: BoolArray


def _where_to_look(
    recording: Recording,
    time: FloatArray,
    down_height_m: float | None,
    *,
    of_feet: bool,
) -> _Looked:
    """Find the descents of the body, and the landings that none of them shows.

    `time` (N,), s, is that of an animal of 1 m.
    """
    heights = recording.feet[:, :, 2] / recording.scale
    n_feet = heights.shape[1]
    body = np.full(len(time), np.nan)
    if recording.indices("body"):
        body = recording.body_height / recording.scale
    falls = descents.descents(body, time, longest=descents.HIDDEN_S)
    if of_feet:
        falls = steps.clear_falls(body, falls)
    spans = time[np.array(falls, dtype=np.int64).reshape(-1, 2)]
    if not down_height_m:
        down_height_m = usual_down_height(recording, spans * recording.pace)
    down_m = down_height_m / recording.scale
    found = None
    if of_feet:
        noise_m = height_noise(heights)
        found, fall_m = steps.find_steps(time, heights, noise_m=noise_m)
        low_m = max(steps.LOW_SHARE * fall_m, steps.LEAST_FALL_SIGMAS * noise_m)
        down_m = max(down_m, low_m)
        unseen = steps.unseen_in(found, spans)
        more_spans, own = steps.landings_of(unseen, n_feet)
    else:
        more_spans = descents.find_hidden_landings(
            time, heights, body, spans, down_height_m=down_m
        )
        own = np.ones((len(more_spans), n_feet), dtype=bool)
    both = np.concatenate([spans, more_spans])
    stranger = np.concatenate([np.zeros((len(spans), n_feet), dtype=bool), ~own])
    order = np.argsort(both[:, 0], kind="stable")
    return _Looked(both[order], order >= len(spans), down_m, found, stranger[order])


def _without_strangers(contacts: Contacts, looked: _Looked) -> Contacts:
    """Leave out contacts (L, n) that are another landing's, or that have two rows."""
    stranger = looked.stranger
    if looked.found is not None:
        instant = np.where(stranger, np.nan, contacts.instant)
        stranger = stranger | steps.found_twice(
            looked.found, instant, contacts.se, contacts.status
        )
    return replace(
        contacts,
        instant=np.where(stranger, np.nan, contacts.instant),
        se=np.where(stranger, np.nan, contacts.se),
        status=np.where(stranger, descents.NOT_LANDED, contacts.status),
    )


def _at_time_scale(duration_s: float | None, time_scale: float) -> float | None:
    """Return a duration of the recording, s, for an animal of 1 m."""
    if duration_s is None:
        return None
    return duration_s / time_scale


def _whole_spans(spans: FloatArray) -> descents.Transitions:
    """Return transitions from the apex to the nadir of each descent (L, 2), s."""
    no_gap = np.full(len(spans), np.nan)
    return descents.Transitions(spans[:, 0], spans[:, 1], no_gap, no_gap)


def _kink_contacts(
    recording: Recording, spans: FloatArray, down_height_m: float, **options: Any
) -> Contacts:
    """Return contacts by the kink fit, of an animal of 1 m.

    `spans` (L, 2), s, and `down_height_m` are those of such an animal.
    """
    parts = joined.parts_of_feet(recording)
    foot_of = tuple(foot for foot, own in enumerate(parts) for _ in own)
    markers = [marker for own in parts for marker in own]
    if len(markers) > len(parts):
        heights = recording.positions[:, markers, 2] / recording.scale
    else:
        heights = recording.feet[:, :, 2] / recording.scale
    of_markers = find_contacts(
        recording.time / recording.pace,
        heights,
        _whole_spans(spans),
        down_height_m=down_height_m,
        lead_s=0.0,
        correlation=noise_correlation(recording.body),
        foot_of=foot_of,
        **options,
    )
    contacts = _of_feet(of_markers, foot_of)
    if not recording.indices("body"):
        return contacts
    cut_off = low_pass(recording.body, scale=recording.scale)
    if not cut_off:
        return contacts
    late_s = FILTER_DELAYS / (cut_off * recording.rate_hz) / recording.pace
    return replace(contacts, common=np.maximum(contacts.common, late_s))


def _printed_contacts(
    recording: Recording, spans: FloatArray, down_height_m: float, method: str
) -> Contacts:
    """Return contacts by a printed method, of an animal of 1 m.

    `spans` (L, 2), s, and `down_height_m` are those of such an animal. The recording is
    not: the filter of these methods lasts 0.07 s whatever the size of the animal.
    """
    time_scale = recording.pace
    contacts = find_contacts(
        recording.time,
        recording.feet[:, :, 2],
        _whole_spans(spans * time_scale),
        down_height_m=down_height_m * recording.scale,
        lead_s=0.0,
        method=method,
    )
    n_feet = contacts.instant.shape[1]
    return replace(
        contacts,
        instant=contacts.instant / time_scale,
        se=contacts.se / time_scale,
        common=np.full(n_feet, np.nan),
        down=contacts.down / time_scale,
    )


def _of_feet(contacts: Contacts, foot_of: tuple[int, ...]) -> Contacts:
    """Combine the contacts of markers into those of feet, numbered by `foot_of`."""
    feet = sorted(set(foot_of))
    if len(feet) == len(foot_of):
        return contacts
    instants = []
    errors = []
    statuses = []
    common = []
    for foot in feet:
        own = np.flatnonzero(np.equal(foot_of, foot))
        of_markers = contacts.instant[:, own]
        instant, se, status = joined.first_of(
            of_markers,
            contacts.se[:, own],
            contacts.status[:, own],
            contacts.earliest[:, own],
        )
        instants.append(instant)
        errors.append(se)
        statuses.append(status)
        # The foot shares the error of the marker that touches first most often.
        known = np.where(np.isfinite(of_markers), of_markers, np.inf)
        first_marker = known.argmin(axis=1)
        usual_first = np.bincount(first_marker, minlength=1).argmax()
        common.append(contacts.common[own][usual_first])
    return replace(
        contacts,
        instant=np.stack(instants, axis=1),
        se=np.stack(errors, axis=1),
        status=np.stack(statuses, axis=1),
        common=np.array(common),
    )


def usual_down_height(recording: Recording, spans: FloatArray) -> float:
    """Return the height, m, below which a foot is down.

    `spans` (L, 2), s, are apex and nadir of the body's descents.
    """
    # The instants are those of frames, but for rounding: half a frame earlier finds the
    # same ones.
    half_frame_s = 0.5 * float(np.min(np.diff(recording.time)))
    apex = np.searchsorted(recording.time, spans[:, 0] - half_frame_s)
    nadir = np.searchsorted(recording.time, spans[:, 1] - half_frame_s)
    usual_fall_m = 0.0
    falls_m = np.empty(0)
    if len(spans):
        falls_m = recording.body_height[apex] - recording.body_height[nadir]
    if np.isfinite(falls_m).any():
        usual_fall_m = float(np.nanmedian(falls_m))
    noise_m = height_noise(recording.feet[:, :, 2], scale=recording.scale)
    return max(DOWN_SHARE * usual_fall_m, DOWN_SIGMAS * noise_m)


def contacts_of(landings: pd.DataFrame) -> Contacts:
    """Read the contacts from a table made by `find_landings`."""
    instant = landings.filter(regex="^contact_").to_numpy(float)
    se = landings.filter(regex="^se_").to_numpy(float)
    status = landings.filter(regex="^status_").to_numpy(float)
    common = landings.filter(regex="^common_").to_numpy(float)
    return Contacts(
        instant=instant,
        se=se,
        status=status.astype(np.int64),
        noise_m=np.nan,  # the errors already contain the noise
        common=common.max(axis=0, initial=0.0),
    )


def floor_instants(landings: pd.DataFrame) -> FloatArray:
    """Return when each foot reached the floor, (L, n), s, by `find_landings`."""
    return np.asarray(landings.filter(regex="^down_").to_numpy(float))


def are_by(landings: pd.DataFrame, method: str) -> bool:
    """Return whether a table by `find_landings` holds the contacts of a method."""
    return bool((landings["method"] == method).all())


def find_contacts(  # noqa: PLR0913 (the data, and the options of the method)
    time: FloatArray,
    heights: FloatArray,
    transitions: descents.Transitions,
    *,
    down_height_m: float,
    lead_s: float = passes.SHORT_WINDOWS_S[0],
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
        Correlation of the noise in consecutive frames (`noise_correlation`).
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
    find_minima = chosen("touchdowns.method", method, METHODS)
    require_choice("touchdowns.gravity", gravity, kink_law.GRAVITIES)
    noise_m = height_noise(heights)
    near, earliest, status = approaches(
        time,
        heights,
        transitions,
        noise_m=noise_m,
        down_height_m=down_height_m,
        lead_s=lead_s,
        trail_s=window_after_s or passes.SHORT_WINDOWS_S[1],
    )
    landed = status == descents.LANDED
    if find_minima is not None:
        instant, se = find_minima(time, heights, transitions, noise_m=noise_m)
        instant = np.where(landed, instant, np.nan)
        lost = landed & np.isnan(instant)
        return Contacts(
            instant=instant,
            se=np.where(landed, se, np.nan),
            status=np.where(lost, descents.MISSING, status),
            noise_m=noise_m,
            down=near,
        )

    asked_s = (window_before_s, window_after_s)
    feet = FootHeights(
        time,
        heights,
        passes.windows_of_at_least(time, asked_s, passes.LONG_WINDOWS_S),
        earliest,
        leaves_m=LEAVES * noise_m,
        foot_of=foot_of,
    )
    fitted = passes.fit_contacts(
        feet,
        near,
        landed,
        short_windows_s=passes.windows_of_at_least(
            time, asked_s, passes.SHORT_WINDOWS_S
        ),
        noise_m=noise_m,
        gravity=gravity,
    )
    windows_s = fitted.feet.windows_s
    judged = judge_fits(
        fitted.fits,
        status,
        frames_missing(time, heights, fitted.near, windows_s),
        noise_m=pooled_noise(fitted.fits),
        maximum_misfit=maximum_misfit,
    )

    # A foot that rises at once may have touched at any time until its rise was noticed.
    fall_m_s = np.abs(fitted.fits.velocity)
    unnoticed_s = np.where(fitted.rises, LEAVES * noise_m / fall_m_s, 0.0)
    frame_s = float(np.median(np.diff(time)))
    frames_before = round(windows_s[0] / frame_s)
    frames_after = round(windows_s[1] / frame_s)
    factor = widening(correlation, frames_before, frames_after)
    se = np.hypot(judged.se, unnoticed_s) * factor

    # After the earliest instant the foot only has to come to rest, which takes no
    # longer than this.
    longest_s = np.where(np.isfinite(earliest), 2 * UNDETERMINED_S, np.inf)
    return replace(
        judged, se=np.minimum(se, longest_s), common=fitted.common, earliest=earliest
    )
