"""Contact instants of every foot in every landing, by the chosen method.

`find_landings` makes the table of a recording, and `find_study_landings` those of all
recordings of a study, which learn from one another: descents of the body, and the
contacts of its feet in them. `find_contacts` times the contacts in given descents.
Everything here is tuned on an animal of 1 m; times and heights of others are scaled to
it first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from hopdata.arrays import (
    GRAVITY_M_S2,
    BoolArray,
    FloatArray,
    IntArray,
    one_blas_thread,
    pd,
)
from hopdata.errors import AnalysisError, chosen, require_choice
from hopdata.landings.contacts import descents, joined, kink_law, passes, steps
from hopdata.landings.contacts.approach import approaches
from hopdata.landings.contacts.bounces import bounce_errors
from hopdata.landings.contacts.doubted import doubted
from hopdata.landings.contacts.judged import Contacts, frames_missing, judge_fits
from hopdata.landings.contacts.law import UNDETERMINED_S, FootHeights, Trials, taken
from hopdata.landings.contacts.learning import FEW, pooled_noises
from hopdata.landings.contacts.noise import (
    height_noise,
    noise_correlation,
    widening,
)
from hopdata.landings.contacts.velocity_minimum import velocity_minima
from hopdata.recording import Recording
from hopdata.recordings.quality.processing import (
    frames_of_pattern,
    low_pass,
    middle,
)

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

#: Error that all contacts share after positions were brought to another rate, in frames
#: of the rate before.
#: Unit: frames. Origin: measured: contacts at 100 Hz that straight lines brought to
#: another rate were off by up to 3.4 ms.
RESAMPLED_FRAMES = 0.35

#: Height below which a foot is down, as a share of the median descent of the body.
#: Unit: 1. Origin: chosen.
DOWN_SHARE = 0.15

#: Least height below which a foot is down, in standard deviations of the noise.
#: Unit: standard deviations. Origin: chosen.
DOWN_SIGMAS = 4.0

#: Fewest frames of a flight from which the body's acceleration is taken.
#: Unit: frames. Origin: chosen.
FALL_FRAMES = 6

#: Shortest flight from which it is taken.
#: Unit: s. Origin: chosen. Noise of 1 mm at 100 Hz then costs 0.8 m/s^2.
FALL_S = 0.08

#: Largest difference of the body's acceleration from that of gravity, as a share of it,
#: at which the animal falls freely: legs and arms move against the body.
#: Unit: 1. Origin: chosen.
NEAR_GRAVITY = 0.2

#: Methods by name: a function that finds instants between the sections, or None for
#: the kink fit.
METHODS: dict[str, Callable[..., tuple[FloatArray, FloatArray]] | None] = {
    "kink": None,
    "velocity_minimum": partial(velocity_minima, parabola=False),
    "velocity_minimum_parabola": partial(velocity_minima, parabola=True),
}


@dataclass(frozen=True)
class Trial:
    """A recording in which contacts are sought.

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
    correlation : float
        Correlation of the noise in consecutive frames (`noise_correlation`).
    foot_of : tuple of int, optional
        Number of the rigid foot that each of the n belongs to, where several are
        markers of one.
    body : (N,) array, optional
        Height of the body, m; NaN where unseen. It tells whether the animal falls
        freely.
    """

    time: FloatArray
    heights: FloatArray
    transitions: descents.Transitions
    down_height_m: float
    lead_s: float = passes.SHORT_WINDOWS_S[0]
    correlation: float = 0.0
    foot_of: tuple[int, ...] = ()
    body: FloatArray = field(default_factory=lambda: np.empty(0))


def find_landings(recording: Recording, **options: Any) -> pd.DataFrame:
    """Find the descents of the body, and time each foot's contact in them.

    It is `find_study_landings` for one recording, which then learns from itself alone.
    """
    return find_study_landings([recording], **options)[0]


@one_blas_thread()
def find_study_landings(
    recordings: Sequence[Recording],
    *,
    method: str = "kink",
    gravity: str = "learned",
    window_before_s: float | None = None,
    window_after_s: float | None = None,
    down_height_m: float | None = None,
    maximum_misfit: float = 5.0,
    of_feet: bool = False,
) -> list[pd.DataFrame]:
    """Find the descents of the body in each recording, and time the contacts in them.

    The recordings are those of one subject and session. Those with the same feet share
    what they have in common; their order does not matter.

    Parameters
    ----------
    recordings : sequence of Recording
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
    list of pandas.DataFrame
        For each recording, one row for each descent, in order of time: begin_s and
        end_s (apex and nadir of
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
    descending = [
        _descents_of(one, down_height_m, of_feet=of_feet) for one in recordings
    ]
    if printed:
        contacts = [_printed_contacts(one, method) for one in descending]
    else:
        contacts = _kink_contacts(
            descending,
            gravity=gravity,
            window_before_s=window_before_s,
            window_after_s=window_after_s,
            maximum_misfit=maximum_misfit,
        )
    return [
        _table_of(one, its, method)
        for one, its in zip(descending, contacts, strict=True)
    ]


@dataclass(frozen=True)
class _Descending:
    """The descents of a recording, for an animal of 1 m, on which all was tuned.

    Parameters
    ----------
    recording : Recording
        At its own size.
    spans : (L, 2) array
        Apex and nadir of each descent, s.
    hidden : (L,) bool array
        Whether only the feet show the landing.
    down_m : float
        Height to which a foot must sink to have landed, m.
    steps : Steps, optional
        Descents of the feet, if landings were looked for in these.
    stranger : (L, n) bool array
        Feet that do not land in a landing which only other feet show.
    """

    recording: Recording
    spans: FloatArray
    hidden: BoolArray
    down_m: float
    steps: steps.Steps | None
    stranger: BoolArray


def _descents_of(
    recording: Recording, down_height_m: float | None, *, of_feet: bool
) -> _Descending:
    """Find the descents of the body, and the landings that none of them shows."""
    n_feet = len(recording.names("foot"))
    least_feet = 1 if of_feet else 2
    if n_feet < least_feet:
        raise AnalysisError.at(
            recording.name, f"at least {least_feet} foot markers", n_feet
        )
    time_scale = recording.pace
    time = recording.time / time_scale
    heights = recording.feet[:, :, 2] / recording.scale
    body = _body_height(recording)
    falls = descents.descents(body, time, longest=descents.HIDDEN_S)
    if of_feet:
        falls = steps.clear_falls(body, falls)
    seen_spans = time[np.array(falls, dtype=np.int64).reshape(-1, 2)]
    if not down_height_m:
        down_height_m = usual_down_height(recording, seen_spans * time_scale)
    down_m = down_height_m / recording.scale
    found = None
    if of_feet:
        noise_m = height_noise(heights)
        found, fall_m = steps.find_steps(time, heights, noise_m=noise_m)
        low_m = max(steps.LOW_SHARE * fall_m, steps.LEAST_FALL_SIGMAS * noise_m)
        down_m = max(down_m, low_m)
        unseen = steps.unseen_in(found, seen_spans)
        more_spans, own = steps.landings_of(unseen, n_feet)
    else:
        more_spans = descents.find_hidden_landings(
            time, heights, body, seen_spans, down_height_m=down_m
        )
        own = np.ones((len(more_spans), n_feet), dtype=bool)
    both = np.concatenate([seen_spans, more_spans])
    all_own = np.concatenate([np.ones((len(seen_spans), n_feet), dtype=bool), own])
    order = np.argsort(both[:, 0], kind="stable")
    return _Descending(
        recording,
        spans=both[order],
        hidden=order >= len(seen_spans),
        down_m=down_m,
        steps=found,
        stranger=~all_own[order],
    )


def _body_height(recording: Recording) -> FloatArray:
    """Return the height of the body (N,), m, of an animal of 1 m; NaN without one."""
    if not recording.indices("body"):
        return np.full(len(recording.time), np.nan)
    return np.asarray(recording.body_height / recording.scale)


def _without_strangers(found: _Descending, contacts: Contacts) -> Contacts:
    """Leave out contacts (L, n) that are another landing's, or that have two rows."""
    if found.steps is None:
        return contacts
    instant = np.where(found.stranger, np.nan, contacts.instant)
    stranger = found.stranger | steps.found_twice(
        found.steps, instant, contacts.se, contacts.status
    )
    return replace(
        contacts,
        instant=np.where(stranger, np.nan, contacts.instant),
        se=np.where(stranger, np.nan, contacts.se),
        status=np.where(stranger, descents.NOT_LANDED, contacts.status),
    )


def _table_of(found: _Descending, contacts: Contacts, method: str) -> pd.DataFrame:
    """Return the table of `find_study_landings` for one recording, at its own size."""
    recording = found.recording
    feet = recording.names("foot")
    time_scale = recording.pace
    contacts = _without_strangers(found, contacts)
    down = contacts.down
    if not down.size:
        down = contacts.instant
    columns: dict[str, Any] = {
        "method": method,
        "begin_s": found.spans[:, 0] * time_scale,
        "end_s": found.spans[:, 1] * time_scale,
        "hidden": found.hidden,
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
    descending: Sequence[_Descending],
    *,
    window_before_s: float | None,
    window_after_s: float | None,
    **options: Any,
) -> list[Contacts]:
    """Return contacts by the kink fit, of animals of 1 m, in each recording."""
    trials = [_trial_of(one) for one in descending]
    markers = [_foot_markers(one.recording) for one in descending]
    contacts: list[Contacts | None] = [None] * len(trials)
    # Recordings learn from those with the same feet, in an order that is their own.
    for same in sorted(set(markers)):
        numbers = [n for n, own in enumerate(markers) if own == same]
        numbers.sort(key=lambda n: descending[n].recording.name)
        paces = [descending[n].recording.pace for n in numbers]
        found = find_all_contacts(
            [trials[n] for n in numbers],
            window_before_s=[_at_time_scale(window_before_s, pace) for pace in paces],
            window_after_s=[_at_time_scale(window_after_s, pace) for pace in paces],
            **options,
        )
        for n, of_markers in zip(numbers, found, strict=True):
            contacts[n] = _processed(
                descending[n].recording, _of_feet(of_markers, trials[n].foot_of)
            )
    return [one for one in contacts if one is not None]


def _foot_markers(recording: Recording) -> tuple[tuple[str, ...], ...]:
    """Return the names of the markers of each foot."""
    return tuple(
        tuple(recording.markers[marker] for marker in own)
        for own in joined.parts_of_feet(recording)
    )


def _trial_of(found: _Descending) -> Trial:
    """Return what is sought in a recording, of an animal of 1 m."""
    recording = found.recording
    parts = joined.parts_of_feet(recording)
    markers = [marker for own in parts for marker in own]
    if len(markers) > len(parts):
        tracks = recording.positions[:, markers]
    else:
        tracks = recording.feet
    heights = tracks[:, :, 2] / recording.scale
    is_doubted = doubted(tracks, scale=recording.scale)
    if is_doubted.any():
        heights = np.where(is_doubted, np.nan, heights)
    return Trial(
        recording.time / recording.pace,
        heights,
        _whole_spans(found.spans),
        found.down_m,
        lead_s=0.0,
        correlation=noise_correlation(recording.body),
        foot_of=tuple(foot for foot, own in enumerate(parts) for _ in own),
        body=_body_height(recording),
    )


def _processed(recording: Recording, contacts: Contacts) -> Contacts:
    """Add to the common error what a filter or another rate did to contacts."""
    if not recording.indices("body"):
        return contacts
    frame_s = 1 / recording.rate_hz / recording.pace
    period = frames_of_pattern(middle(recording.body))
    early_s = RESAMPLED_FRAMES * period * frame_s
    late_s = 0.0
    cut_off = low_pass(recording.body, scale=recording.scale)
    if cut_off:
        late_s = FILTER_DELAYS / cut_off * frame_s
    if not max(early_s, late_s) > 0:
        return contacts
    return replace(contacts, common=np.maximum(contacts.common, early_s + late_s))


def _printed_contacts(found: _Descending, method: str) -> Contacts:
    """Return contacts by a printed method, of an animal of 1 m.

    The recording is not scaled: the filter of these methods lasts 0.07 s whatever the
    size of the animal.
    """
    recording = found.recording
    time_scale = recording.pace
    contacts = find_contacts(
        recording.time,
        recording.feet[:, :, 2],
        _whole_spans(found.spans * time_scale),
        down_height_m=found.down_m * recording.scale,
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
    falls_m = np.empty(0)
    if len(spans):
        falls_m = recording.body_height[apex] - recording.body_height[nadir]
    usual_fall_m = 0.0
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
    time, heights, transitions, down_height_m, lead_s, correlation, foot_of
        See `Trial`.
    method : {"kink", "velocity_minimum", "velocity_minimum_parabola"}
        Maximum-likelihood kink, or the minimum of the vertical velocity in the
        transition (the printed method, Sec. 2.2.3), to a whole frame or at the vertex
        of a parabola through it.
    gravity : {"learned", "free", "known"}
        Acceleration of a foot in free flight, for the kink fit: drawn from a
        distribution learned from the landings, unknown in each landing, or that of
        gravity.
    window_before_s, window_after_s : float, optional
        Time before and after the contact whose frames the kink fit uses, s (at least 5
        and 3 frames that show the foot). The defaults are 0.08 and 0.05 s where feet
        fly freely and then stand still to within the noise, and 0.04 and 0.027 s where
        they do not (a runner's foot rolls).
    maximum_misfit : float
        Largest accepted ratio of a kink fit's rms residual to that of the whole
        recording.

    Returns
    -------
    Contacts

    Raises
    ------
    ConfigError
        If `method` or `gravity` is unknown.
    """
    find_minima = chosen("touchdowns.method", method, METHODS)
    trial = Trial(
        time, heights, transitions, down_height_m, lead_s, correlation, foot_of
    )
    if find_minima is None:
        return find_all_contacts(
            [trial],
            gravity=gravity,
            window_before_s=[window_before_s],
            window_after_s=[window_after_s],
            maximum_misfit=maximum_misfit,
        )[0]
    require_choice("touchdowns.gravity", gravity, kink_law.GRAVITIES)
    rough = _rough(trial, window_after_s)
    instant, se = find_minima(time, heights, transitions, noise_m=rough.noise_m)
    landed = rough.status == descents.LANDED
    instant = np.where(landed, instant, np.nan)
    lost = landed & np.isnan(instant)
    return Contacts(
        instant=instant,
        se=np.where(landed, se, np.nan),
        status=np.where(lost, descents.MISSING, rough.status),
        noise_m=rough.noise_m,
        down=rough.near,
    )


@dataclass(frozen=True)
class _Rough:
    """What is known of L contacts of n feet before any is fitted.

    Parameters
    ----------
    near, earliest, status : (L, n) array
        See `hopdata.landings.contacts.approach.approaches`.
    noise_m : float
        Standard deviation of a height, m.
    """

    near: FloatArray
    earliest: FloatArray
    status: IntArray
    noise_m: float


def _rough(trial: Trial, window_after_s: float | None) -> _Rough:
    """Find where to look for the contacts."""
    noise_m = height_noise(trial.heights)
    found = approaches(
        trial.time,
        trial.heights,
        trial.transitions,
        noise_m=noise_m,
        down_height_m=trial.down_height_m,
        lead_s=trial.lead_s,
        trail_s=window_after_s or passes.SHORT_WINDOWS_S[1],
    )
    return _Rough(*found, noise_m)


def find_all_contacts(
    trials: Sequence[Trial],
    *,
    gravity: str,
    window_before_s: Sequence[float | None],
    window_after_s: Sequence[float | None],
    maximum_misfit: float,
) -> list[Contacts]:
    """Find the contacts of the same feet in several recordings, by the kink fit.

    Parameters
    ----------
    trials : sequence of Trial
        The recordings; all have the same feet.
    gravity, maximum_misfit
        See `find_contacts`.
    window_before_s, window_after_s : sequence of float or None
        The windows of `find_contacts`, s, for each recording.

    Returns
    -------
    list of Contacts
        One for each recording.
    """
    require_choice("touchdowns.gravity", gravity, kink_law.GRAVITIES)
    asked_s = list(zip(window_before_s, window_after_s, strict=True))
    rough = [
        _rough(trial, after_s)
        for trial, (_, after_s) in zip(trials, asked_s, strict=True)
    ]
    feet = [
        FootHeights(
            trial.time,
            trial.heights,
            passes.windows_of_at_least(trial.time, asked, passes.LONG_WINDOWS_S),
            known.earliest,
            leaves_m=LEAVES * known.noise_m,
            foot_of=trial.foot_of,
        )
        for trial, known, asked in zip(trials, rough, asked_s, strict=True)
    ]
    side_by_side = Trials.of(feet, [len(known.near) for known in rough])
    if gravity == "learned" and _fall_freely(trials, rough):
        gravity = kink_law.FALLS
    noise_m = np.array([known.noise_m for known in rough])
    status = np.concatenate([known.status for known in rough])
    fitted = passes.fit_contacts(
        side_by_side,
        np.concatenate([known.near for known in rough]),
        status == descents.LANDED,
        short_windows_s=[
            passes.windows_of_at_least(trial.time, asked, passes.SHORT_WINDOWS_S)
            for trial, asked in zip(trials, asked_s, strict=True)
        ],
        noise_m=noise_m,
        gravity=gravity,
    )
    about_fit_m = pooled_noises(fitted.fits, side_by_side, noise_m)
    return [
        _judged(
            trial, known, fitted, number, float(about_fit_m[number]), maximum_misfit
        )
        for number, (trial, known) in enumerate(zip(trials, rough, strict=True))
    ]


def _fall_freely(trials: Sequence[Trial], rough: Sequence[_Rough]) -> bool:
    """Tell whether landings are few, and the body falls as gravity says before them."""
    landings = 0
    falls = []
    for trial, known in zip(trials, rough, strict=True):
        landed = known.status == descents.LANDED
        landings += int(landed.any(axis=1).sum())
        if trial.body.size:
            first_s = np.where(landed, known.near, np.inf).min(axis=1, initial=np.inf)
            apex_s = trial.transitions.t_pre
            flights = zip(apex_s.tolist(), first_s.tolist(), strict=True)
            falls += [_fall(trial.time, trial.body, *flight) for flight in flights]
    known_falls = [fall for fall in falls if np.isfinite(fall)]
    if landings >= FEW or not known_falls:
        return False
    usual = float(np.median(known_falls))
    return abs(usual + GRAVITY_M_S2) < NEAR_GRAVITY * GRAVITY_M_S2


def _fall(time: FloatArray, height: FloatArray, begin_s: float, end_s: float) -> float:
    """Return the acceleration of a body between two instants, m/s^2; NaN if unknown."""
    in_flight = (time >= begin_s) & (time < end_s) & np.isfinite(height)
    if not np.isfinite(end_s) or in_flight.sum() < FALL_FRAMES:
        return np.nan
    since = time[in_flight] - begin_s
    if since[-1] - since[0] < FALL_S:
        return np.nan
    return 2 * float(np.polyfit(since, height[in_flight], 2)[0])


def _judged(
    trial: Trial,
    rough: _Rough,
    fitted: passes.Fitted,
    number: int,
    noise_m: float,
    maximum_misfit: float,
) -> Contacts:
    """Return the contacts of one of the recordings that were fitted together.

    `noise_m` is the noise of its heights about the fits.
    """
    rows = fitted.trials.of_landing == number
    fits = taken(fitted.fits, rows)
    windows_s = fitted.trials.feet[number].windows_s
    judged = judge_fits(
        fits,
        rough.status,
        frames_missing(trial.time, trial.heights, fitted.near[rows], windows_s),
        noise_m=noise_m,
        maximum_misfit=maximum_misfit,
    )

    # A foot that rises at once may have touched at any time until its rise was noticed.
    fall_m_s = np.abs(fits.velocity)
    unnoticed_s = np.where(fitted.rises[rows], LEAVES * rough.noise_m / fall_m_s, 0.0)
    frame_s = float(np.median(np.diff(trial.time)))
    frames_before = round(windows_s[0] / frame_s)
    frames_after = round(windows_s[1] / frame_s)
    factor = widening(trial.correlation, frames_before, frames_after)
    se = np.hypot(judged.se, unnoticed_s) * factor

    bounce_s = bounce_errors(
        trial.time,
        trial.heights,
        np.where(judged.status == descents.LANDED, judged.instant, np.nan),
        fits.velocity,
        rough.noise_m,
    )
    # Markers of one foot turn about one another: their law says how they come down.
    feet = trial.foot_of or range(trial.heights.shape[1])
    turns = np.bincount(feet)[list(feet)] > 1
    common = np.hypot(fitted.common[number], np.where(turns, 0.0, bounce_s))

    # After the earliest instant the foot only has to come to rest, which takes no
    # longer than this.
    longest_s = np.where(np.isfinite(rough.earliest), 2 * UNDETERMINED_S, np.inf)
    return replace(
        judged,
        se=np.minimum(se, longest_s),
        common=common,
        earliest=rough.earliest,
    )
