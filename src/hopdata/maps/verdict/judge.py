"""The verdict: one smooth map through the landing, a map for every contact order, or no answer.

What decides is the test of the kinks (`significance`); the size of the difference and what could
have been excluded or seen stand beside it (`effect`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.maps.draws import named_generator
from hopdata.maps.verdict.answer import CANNOT_TELL, Verdict, WindowResult, conclude, sentence
from hopdata.maps.verdict.attenuation import attenuation, calibrated
from hopdata.maps.verdict.effect import (
    EffectSize,
    agreeing,
    effect_size,
    outcome_variance,
    squared_size,
)
from hopdata.maps.verdict.estimate import WINDOWS, KinkFit, choose_window, fit_kinks
from hopdata.maps.verdict.inputs import LEAST_CLASS, SectionLandings, section_landings
from hopdata.maps.verdict.significance import flip_signs

Floats = NDArray[np.float64]
Notes = list[dict[str, str]]

MEASURED_FEET = 3  # of the studies on which the verdict's power was measured


@one_blas_thread()
def judge(
    x: ArrayLike,
    y: ArrayLike,
    instants: ArrayLike,
    *,
    seed: int,
    time_unit_s: float,
    margin: float = 0.2,
    confidence: float = 0.95,
    power: float = 0.8,
    flips: int = 1999,
    all_windows: bool = True,
) -> Verdict:
    """Say whether the map through the landing has one derivative.

    Parameters
    ----------
    x, y
        (n, 6B) home-frame states at the pre and the post section: positions, m, and velocities,
        m/s, of the markers of a rigid body.
    instants
        (n, feet) contact instants, s; NaN where not known.
    seed
        Seed of the study.
    time_unit_s
        Unit of time that weighs velocities against positions.
    margin
        Relative difference that the study wants to exclude.
    confidence, power
        Of intervals, and of the detectable difference. The test's level is 1 - confidence.
    flips
        Number of random sign patterns.
    all_windows
        Whether to report every window, or only the one that the verdict rests on.
    """
    before, after, times = (np.asarray(part, float) for part in (x, y, instants))
    known = np.asarray(np.isfinite(times).all(axis=1))
    notes = _unknown_notes(known)
    limits = (int(known.sum()), confidence, margin, power, notes)
    try:
        landings = section_landings(before[known], after[known], times[known], time_unit_s)
        fits = fit_kinks(
            landings.inputs, landings.outputs, landings.expected, all_windows=all_windows
        )
        _check_enough(landings, fits)
    except AnalysisError as error:
        return _no_answer(str(error), *limits)
    fit = choose_window(fits)
    schedules = list(landings.schedules)

    # Each window sees kinks of its own; all are measured against the same linear map.
    whole = _without_attenuation(fit, landings, seed)
    outcome = outcome_variance(whole, landings.inputs, landings.expected, schedules)

    def size(one: KinkFit) -> EffectSize:
        form = squared_size(one, landings.expected, schedules, outcome)
        own = named_generator(seed, "verdict", "effect", str(one.window))
        restored = whole if one is fit else _without_attenuation(one, landings, seed)
        return effect_size(restored, form, generator=own, confidence=confidence, power=power)

    test = flip_signs(fit, generator=named_generator(seed, "verdict", "signs"), flips=flips)
    sizes = {one.window: size(one) for one in (fits if all_windows else [fit])}
    sizes[fit.window] = effect = agreeing(sizes[fit.window], test.p_value, 1.0 - confidence)
    windows = tuple(
        _window_result(landings, one, sizes[one.window], fit) for one in fits if one.window in sizes
    )
    conclusion = conclude(test, effect, 1.0 - confidence, margin)
    return Verdict(
        conclusion,
        sentence(conclusion, effect, test, confidence, margin),
        len(landings.inputs),
        len(schedules),
        confidence,
        margin,
        power,
        effect,
        test,
        windows,
        notes + _window_notes(fit) + _feet_notes(times.shape[1]),
    )


def _without_attenuation(fit: KinkFit, landings: SectionLandings, seed: int) -> KinkFit:
    generator = named_generator(seed, "verdict", "attenuation", str(fit.window))
    found = attenuation(
        fit,
        landings.inputs,
        landings.expected,
        landings.errors,
        landings.instant_noise_s,
        generator=generator,
    )
    return calibrated(fit, found)


def _check_enough(landings: SectionLandings, fits: list[KinkFit]) -> None:
    if len(landings.schedules) < 2:
        raise AnalysisError(
            f"mode schedules with {LEAST_CLASS} touchdowns or more: expected at least 2, found "
            f"{len(landings.schedules)}"
        )
    if not fits:
        raise AnalysisError(f"{len(landings.inputs)} touchdowns are too few for second-order terms")
    if not choose_window(fits).coefficients.size:
        raise AnalysisError("no two feet exchange their order among these touchdowns")


def _window_result(
    landings: SectionLandings, fit: KinkFit, effect: EffectSize, chosen: KinkFit
) -> WindowResult:
    spread = 1e3 * landings.expected[fit.rows].std(axis=1)
    return WindowResult(
        fit.window,
        len(fit.rows),
        fit.degree,
        float(spread.mean()),
        float(spread.max()),
        fit.curvature_share,
        effect.estimate,
        effect.low,
        effect.high,
        fit is chosen,
    )


def _no_answer(
    reason: str, landings: int, confidence: float, margin: float, power: float, notes: Notes
) -> Verdict:
    note = {"what": "verdict", "reason": reason}
    sentence = f"These data cannot tell: {reason}."
    return Verdict(
        CANNOT_TELL, sentence, landings, 0, confidence, margin, power, notes=[*notes, note]
    )


def _unknown_notes(known: NDArray[np.bool_]) -> Notes:
    if known.all():
        return []
    reason = (
        f"{int((~known).sum())} of {len(known)} touchdowns used lack the contact instant of a foot"
    )
    return [{"what": "touchdowns left out of the verdict", "reason": reason}]


def _feet_notes(feet: int) -> Notes:
    if feet == MEASURED_FEET:
        return []
    reason = (
        "the detectable difference and the interval were checked for three feet; with two, four or "
        "six the test finds less than they say"
    )
    return [{"what": f"verdict on {feet} feet", "reason": reason}]


def _window_notes(fit: KinkFit) -> Notes:
    notes = []
    if not fit.nearly_straight and fit.window > WINDOWS[-1]:
        reason = f"{len(fit.rows)} touchdowns in the narrowest window that their number allows"
        notes.append({"what": "window of the verdict", "reason": reason})
    if fit.degree < 3:
        reason = f"{len(fit.rows)} touchdowns: third-order terms are shrunk, not fitted freely"
        notes.append({"what": "smooth terms of the verdict", "reason": reason})
    return notes
