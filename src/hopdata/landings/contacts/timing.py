"""Contact instants of every foot in given descents, by the chosen method.

`find_contacts` times those of one recording, and `find_all_contacts` those of several
with the same feet, which learn from one another, by the kink fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import EntryPoint

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, BoolArray, FloatArray, IntArray
from hopdata.errors import ConfigError, chosen, require_choice
from hopdata.foreign.plugins import blamed, name_of, plugins
from hopdata.landings.contacts import descents, kink_law, passes
from hopdata.landings.contacts.approach import approaches
from hopdata.landings.contacts.bounces import bounce_errors
from hopdata.landings.contacts.falls_on import later_contact
from hopdata.landings.contacts.glides import (
    CLEAR_S,
    COMES_DOWN_M_S,
    GLIDED_M,
    LEG_M_S2,
    LEG_OR_FLOOR_M_S2,
    LOWEST_SIGMAS,
    ROLLS,
    SINKS_M,
    SINKS_SIGMAS,
    SLOWLY_SINKS_M,
    UNKNOWN_SOFTNESS_S,
    YIELDED_S,
    doubts,
    glides,
    is_slowed_by_leg,
    is_stopped_hard,
    last_descents,
)
from hopdata.landings.contacts.judged import Contacts, frames_missing, judge_fits
from hopdata.landings.contacts.law import (
    LEAVES,
    UNDETERMINED_S,
    FootHeights,
    Trials,
    taken,
)
from hopdata.landings.contacts.learning import FEW, pooled_noises
from hopdata.landings.contacts.noise import height_noise, widening
from hopdata.landings.contacts.too_high import low_enough_from
from hopdata.landings.contacts.velocity_minimum import velocity_minima

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

#: Times that contacts are fitted again, from where feet are low enough to touch.
#: Unit: 1. Origin: chosen.
MOST_ROUNDS = 3

Method = Callable[..., tuple[FloatArray, FloatArray]]
_OWN: dict[str, Method | None] = {
    "kink": None,
    "velocity_minimum": partial(velocity_minima, parabola=False),
    "velocity_minimum_parabola": partial(velocity_minima, parabola=True),
}


def _of_package(entry: EntryPoint) -> Method:
    """Return a method of another package, whose errors are told as its own."""
    plugin = name_of("labelling method", entry)
    key = "touchdowns.method"

    def find_instants(
        time: FloatArray,
        heights: FloatArray,
        transitions: descents.Transitions,
        noise_m: float,
    ) -> tuple[FloatArray, FloatArray]:
        with blamed(plugin, key):
            found = entry.load()(time, heights, transitions, noise_m=noise_m)
            instant, se = (np.array(one, float) for one in found)
        shape = (len(transitions), heights.shape[1])
        if instant.shape != shape or se.shape != shape:
            wanted = f"instants and standard errors of shape {shape} by {plugin}"
            raise ConfigError.at(key, wanted, f"{instant.shape} and {se.shape}")
        return instant, se

    return find_instants


#: Methods by name: a function that finds instants between the sections, or None for
#: the kink fit. Installed packages add theirs by entry points (``hopdata.labelling``).
METHODS: dict[str, Method | None] = {
    **_OWN,
    **{
        name: _of_package(entry)
        for name, entry in plugins(
            "hopdata.labelling", "labelling method", _OWN
        ).items()
    },
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
    if gravity == "learned" and _fall_freely(trials, rough):
        gravity = kink_law.FALLS
    round_of = partial(
        _round, trials, asked_s=asked_s, gravity=gravity, limit=maximum_misfit
    )
    one = _low_enough(trials, round_of, rough)
    found = []
    for number, (trial, known) in enumerate(zip(trials, one.rough, strict=True)):
        short_s = passes.windows_of_at_least(
            trial.time, asked_s[number], passes.SHORT_WINDOWS_S
        )
        contacts = _after_falls(trial, one.contacts[number], known.noise_m)
        rolls = bool(one.about_fit_m[number] > ROLLS * known.noise_m)
        judged = one.judged[number]
        found.append(
            _after_glides(trial, contacts, known, judged, short_s, gravity, rolls=rolls)
        )
    return found


@dataclass(frozen=True)
class _Round:
    """Contacts of all recordings, fitted from what was known of them before.

    Parameters
    ----------
    rough : list of _Rough
        What was known of them.
    contacts : list of Contacts
        The contacts of each recording.
    judged : sequence of callable
        Judges other fits of each recording: see `_judged`.
    about_fit_m : (R,) array
        Noise of the heights of each recording about the fits, m.
    common_errors : callable
        Computes the errors (R, n), s, that the fits of a foot share: see
        `passes.CommonErrors`.
    """

    rough: list[_Rough]
    contacts: list[Contacts]
    judged: Sequence[Callable[..., Contacts]]
    about_fit_m: FloatArray
    common_errors: passes.CommonErrors


def _round(
    trials: Sequence[Trial],
    rough: list[_Rough],
    *,
    asked_s: Sequence[tuple[float | None, float | None]],
    gravity: str,
    limit: float,
) -> _Round:
    """Fit the contacts of all recordings once; `limit` is the largest misfit."""
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
    noise_m = np.array([known.noise_m for known in rough])
    status = np.concatenate([known.status for known in rough])
    fitted, common_errors = passes.fit_contacts(
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
    judged = [
        partial(_judged, trial, noise_m=float(own_m), limit=limit)
        for trial, own_m in zip(trials, about_fit_m, strict=True)
    ]
    contacts = [
        judge(known, fitted, number)
        for number, (judge, known) in enumerate(zip(judged, rough, strict=True))
    ]
    return _Round(rough, contacts, judged, about_fit_m, common_errors)


def _low_enough(
    trials: Sequence[Trial],
    round_of: Callable[[list[_Rough]], _Round],
    rough: list[_Rough],
) -> _Round:
    """Fit contacts, and again later where the foot was still too high to touch.

    One that is too high has the status `GLIDES` if no later one can be trusted.
    """
    one = round_of(rough)
    refuted = [np.zeros(known.near.shape, dtype=bool) for known in rough]
    for _ in range(MOST_ROUNDS):
        higher = [
            _too_high(trial, its, known)
            for trial, its, known in zip(trials, one.contacts, one.rough, strict=True)
        ]
        if not any(too_high.any() for _, too_high in higher):
            break
        refuted = [
            before | too_high
            for before, (_, too_high) in zip(refuted, higher, strict=True)
        ]
        one = round_of([known for known, _ in higher])
    contacts = []
    for trial, its, known, too_high, common in zip(
        trials, one.contacts, one.rough, refuted, one.common_errors(), strict=True
    ):
        glides_on = too_high & (its.status != descents.LANDED)
        glides_on |= _too_high(trial, its, known)[1]
        status = np.where(glides_on, descents.GLIDES, its.status)
        common = np.hypot(common, its.common)
        contacts.append(replace(its, status=status, common=common))
    return replace(one, contacts=contacts)


def _too_high(
    trial: Trial, contacts: Contacts, rough: _Rough
) -> tuple[_Rough, BoolArray]:
    """Return what is known once contacts that are too high are refuted, and which are.

    Contacts without a kink keep their large errors.
    """
    near = rough.near.copy()
    earliest = rough.earliest.copy()
    refuted = np.zeros(near.shape, dtype=bool)
    has_kink = (contacts.status == descents.LANDED) & (contacts.se < UNDETERMINED_S)
    for landing, marker in np.argwhere(has_kink).tolist():
        low_from_s = low_enough_from(
            trial.time,
            trial.heights[:, marker],
            float(contacts.instant[landing, marker]),
            rough.noise_m,
        )
        if low_from_s is None:
            continue
        refuted[landing, marker] = True
        earliest[landing, marker] = low_from_s
        near[landing, marker] = max(near[landing, marker], low_from_s)
    return replace(rough, near=near, earliest=earliest), refuted


def _after_falls(trial: Trial, contacts: Contacts, noise_m: float) -> Contacts:
    """Time feet at their second kink that fall on after the first one.

    One that is not seen to stop has the status `GLIDES`. Contacts without a kink keep
    their large errors.
    """
    instant = contacts.instant.copy()
    se = contacts.se.copy()
    status = contacts.status.copy()
    earliest = contacts.earliest.copy()
    has_kink = (status == descents.LANDED) & (se < UNDETERMINED_S)
    for landing, marker in np.argwhere(has_kink).tolist():
        first_s = float(instant[landing, marker])
        height = trial.heights[:, marker]
        later = later_contact(trial.time, height, first_s, noise_m)
        if later is None:
            continue
        earliest[landing, marker] = max(earliest[landing, marker], first_s)
        if np.isfinite(later).all():
            instant[landing, marker], se[landing, marker] = later
        else:
            status[landing, marker] = descents.GLIDES
    return replace(contacts, instant=instant, se=se, status=status, earliest=earliest)


def _after_glides(
    trial: Trial,
    contacts: Contacts,
    rough: _Rough,
    judged: Callable[..., Contacts],
    windows_s: tuple[float, float],
    gravity: str,
    *,
    rolls: bool,
) -> Contacts:
    """Time feet again, nearer to the floor, that were timed while they still glide.

    One that is not seen to come down keeps its instant, with the status `GLIDES`. One
    that may have glided, but sinks too little to tell, keeps its instant with an error
    that reaches to where it is down.

    Parameters
    ----------
    trial : Trial
        The recording.
    contacts : Contacts
        Its contacts.
    rough : _Rough
        What was known of them before.
    judged : callable
        Judges new fits of this recording: see `_judged`.
    windows_s : tuple of float
        Windows before and after a contact of a foot that is fitted alone, s.
    gravity : str
        See `find_contacts`.
    rolls : bool
        Whether feet roll, and so sink on after sound contacts: see `glides.ROLLS`.
    """
    foot_of = trial.foot_of or tuple(range(trial.heights.shape[1]))
    without_kink = contacts.se >= UNDETERMINED_S
    least_m = np.where(without_kink, SLOWLY_SINKS_M, SINKS_M)
    noise_m = rough.noise_m
    least_m = np.maximum(least_m, SINKS_SIGMAS * noise_m)
    lowered = _with_lowered(trial, contacts, noise_m)
    may_glide, is_sure = _may_glide(trial, lowered, foot_of, least_m, noise_m)
    if not may_glide.any():
        return contacts
    glided_m = GLIDED_M + LOWEST_SIGMAS * noise_m
    has_glided = is_sure & _are_gliding(trial, lowered, foot_of, glided_m, noise_m)
    near, earliest = last_descents(
        trial.time, trial.heights, contacts.instant, may_glide, noise_m=noise_m
    )
    feet = FootHeights(trial.time, trial.heights, windows_s, earliest)
    alone = Trials.of([feet], [len(near)])
    fits = kink_law.soft_fits(alone, near, noise_m=np.array([noise_m]), gravity=gravity)
    sought = np.where(np.isfinite(near), descents.LANDED, descents.GLIDES)
    none_rises = np.zeros(near.shape, dtype=bool)
    again = judged(
        _Rough(near, earliest, sought, noise_m),
        passes.Fitted(alone, near, fits, none_rises),
        0,
    )
    se = np.hypot(again.se, UNKNOWN_SOFTNESS_S)
    # A foot that only sinks may stand: it has glided if it then comes down, or, without
    # a first kink, if it has a later one.
    is_clear = fits.unit_se * noise_m < CLEAR_S
    is_clear &= again.se < CLEAR_S
    comes_down = is_clear & (fits.velocity < -COMES_DOWN_M_S)
    comes_down |= without_kink & (se < UNDETERMINED_S)
    is_down = is_sure & (has_glided | comes_down)
    is_down &= again.status == descents.LANDED
    is_down &= again.instant > contacts.instant + YIELDED_S
    down = replace(contacts, instant=np.where(is_down, again.instant, np.nan))
    is_down &= ~_are_gliding(trial, down, foot_of, glided_m, noise_m)
    # The toe of a foot stops so, and sinks as the heel comes down; and so does a heel
    # as its toe touches. Either instant may be the contact.
    may_stand = is_down & ~without_kink & _stopped_hard(trial, contacts, is_down)
    is_down &= ~may_stand
    has_glided &= ~may_stand
    status = np.where(has_glided, descents.GLIDES, contacts.status)
    is_unsure = may_stand
    if not rolls:
        is_unsure |= may_glide & ~is_down & ~has_glided
    later = np.where(again.status == descents.LANDED, again.instant, np.nan)
    doubt_s = doubts(contacts.instant, later)
    first_se = np.where(is_unsure, np.hypot(contacts.se, doubt_s), contacts.se)
    return replace(
        contacts,
        instant=np.where(is_down, again.instant, contacts.instant),
        se=np.where(is_down, se, first_se),
        status=np.where(is_down, descents.LANDED, status),
        earliest=np.where(is_down, earliest, contacts.earliest),
    )


def _with_lowered(trial: Trial, contacts: Contacts, noise_m: float) -> Contacts:
    """Return contacts of which those that rise count as landed where a leg slowed them.

    The kink of a foot that is lowered smoothly is anywhere, also where it rises.
    """
    rises = contacts.status == descents.RISES
    lowered = _slowed_by_leg(trial, contacts, rises, noise_m)
    return replace(contacts, status=np.where(lowered, descents.LANDED, contacts.status))


def _slowed_by_leg(
    trial: Trial,
    contacts: Contacts,
    asked: BoolArray,
    noise_m: float,
    *,
    most_m_s2: float = LEG_M_S2,
) -> BoolArray:
    """Mark those of the contacts (L, n) asked for in which a leg slowed the foot."""
    slowed = np.zeros(asked.shape, dtype=bool)
    for landing, marker in np.argwhere(asked).tolist():
        slowed[landing, marker] = is_slowed_by_leg(
            trial.time,
            trial.heights[:, marker],
            float(contacts.instant[landing, marker]),
            noise_m,
            most_m_s2=most_m_s2,
        )
    return slowed


def _stopped_hard(trial: Trial, contacts: Contacts, asked: BoolArray) -> BoolArray:
    """Mark those of the contacts (L, n) asked for at which a foot stopped hard."""
    hard = np.zeros(asked.shape, dtype=bool)
    for landing, marker in np.argwhere(asked).tolist():
        hard[landing, marker] = is_stopped_hard(
            trial.time,
            trial.heights[:, marker],
            float(contacts.instant[landing, marker]),
        )
    return hard


def _may_glide(
    trial: Trial,
    contacts: Contacts,
    foot_of: tuple[int, ...],
    least_m: FloatArray,
    noise_m: float,
) -> tuple[BoolArray, BoolArray]:
    """Mark the contacts (L, n) of feet that may have glided, and those sought again.

    A foot that a leg slowed has no kink there, so it need not sink as far.
    """
    again = _are_gliding(trial, contacts, foot_of, least_m, noise_m)
    slowly_m = SLOWLY_SINKS_M + LOWEST_SIGMAS * noise_m
    sinks_slowly = _are_gliding(
        trial, contacts, foot_of, slowly_m, noise_m, leg_m_s2=LEG_OR_FLOOR_M_S2
    )
    asked = sinks_slowly & ~again
    may_glide = again | _slowed_by_leg(
        trial, contacts, asked, noise_m, most_m_s2=LEG_OR_FLOOR_M_S2
    )
    again |= _slowed_by_leg(trial, contacts, asked, noise_m)
    return may_glide, again


def _are_gliding(
    trial: Trial,
    contacts: Contacts,
    foot_of: tuple[int, ...],
    least_m: FloatArray | float,
    noise_m: float,
    leg_m_s2: float = LEG_M_S2,
) -> BoolArray:
    """Mark the contacts (L, n) of feet that sink on by more than `least_m`, m."""
    landed = contacts.status == descents.LANDED
    instant = np.where(landed, contacts.instant, np.nan)
    return glides(
        trial.time,
        trial.heights,
        instant,
        foot_of,
        least_m=least_m,
        noise_m=noise_m,
        leg_m_s2=leg_m_s2,
    )


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
    *,
    noise_m: float,
    limit: float,
) -> Contacts:
    """Return the contacts of one of the recordings that were fitted together.

    What they share is only that feet bounce: `_low_enough` adds what the law leaves.

    `noise_m` is the noise of its heights about the fits, and `limit` the largest
    accepted misfit.
    """
    rows = fitted.trials.of_landing == number
    fits = taken(fitted.fits, rows)
    windows_s = fitted.trials.feet[number].windows_s
    judged = judge_fits(
        fits,
        rough.status,
        frames_missing(trial.time, trial.heights, fitted.near[rows], windows_s),
        noise_m=noise_m,
        maximum_misfit=limit,
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

    # After the earliest instant the foot only has to come to rest, which takes no
    # longer than this.
    longest_s = np.where(np.isfinite(rough.earliest), 2 * UNDETERMINED_S, np.inf)
    return replace(
        judged,
        se=np.minimum(se, longest_s),
        common=np.where(turns, 0.0, bounce_s),
        earliest=rough.earliest,
    )
