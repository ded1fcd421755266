"""The verdict: one smooth map through the landing, a map for each contact order, or no answer.

It follows from the interval of a single size (`effect`): "different" if the interval
begins above zero, "no difference" if the bound is within the margin, and "cannot tell"
otherwise. A jump of the outcome is a difference whatever the derivatives are.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from math import ceil
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, Shown, one_blas_thread
from hopdata.errors import AnalysisError, require, require_choice, told_call
from hopdata.maps.draws import Notes, named_generator
from hopdata.maps.verdict import effect as sizing
from hopdata.maps.verdict import inputs
from hopdata.maps.verdict.model import LEFT, KinkFit, err_alike, fit_kinks
from hopdata.recording import numbers

DIFFERENT, NO_DIFFERENCE, CANNOT_TELL = CONCLUSIONS = (
    "different",
    "no difference",
    "cannot tell",
)
#: Difference for which every verdict gives the number of landings needed to show it.
ASKED = 0.2
TWO_KINDS = "landings are of two kinds"
NOT_FORETOLD = "contacts are not explained by the body's state"


@dataclass(frozen=True, repr=False)
class Verdict(Shown):
    """The answer of a study.

    Attributes
    ----------
    conclusion
        ``"different"``, ``"no difference"`` (larger than the margin) or ``"cannot
        tell"``.
    sentence
        The same in one sentence, with its numbers.
    outlook
        What these data could have shown, and how many landings would show `ASKED`;
        empty if the size could not be computed.
    compared
        Whose maps were compared, in words.
    n_feet, n_landings, n_window
        Number of feet, of landings used, and of landings fitted: those nearest to the
        simultaneous contact.
    confidence, margin, power
        Confidence of the interval, difference that the study is to exclude, and power
        with which the detectable difference would have been found.
    flips
        Number of random sign patterns.
    effect
        Size of the difference; None if it could not be computed.
    jump
        Size of the jumps of the outcome where two feet exchange their order, as a share
        of its variation; None if it could not be computed, or if no two feet exchange
        their order often enough.
    decided_by
        ``"jump"`` if only the jump shows a difference, otherwise ``"effect"``.
    landings_needed
        Number of landings that show a difference of `ASKED` with the given power; None
        if the size could not be computed, if the jump decided, or if no number
        suffices.
    foretold
        Share of the contact instants' mean square that the state before the landing
        foretells; None if it could not be computed. What it does not foretell (legs
        whose length varies from landing to landing, noise in the state) makes every
        size too small.
    notes
        Limits of the answer, each ``{"what": ..., "reason": ...}``.
    """

    conclusion: str
    sentence: str
    outlook: str
    compared: str
    n_feet: int
    n_landings: int
    n_window: int
    confidence: float
    margin: float
    power: float
    flips: int
    effect: sizing.EffectSize | None = None
    jump: sizing.EffectSize | None = None
    decided_by: str = "effect"
    landings_needed: int | None = None
    foretold: float | None = None
    notes: Notes = field(default_factory=list)

    def told(self) -> str:
        """Return the sentence."""
        return self.sentence

    def rows(self) -> dict[str, Any]:
        """Return the size of the difference, its interval and bounds, as shares of the map."""
        return {k: [v] for k, v in vars(self.effect).items()} if self.effect else {}

    def to_dict(self) -> dict[str, Any]:
        """Return all values, for ``verdict.json``."""
        return asdict(self)


def conclude(low: float, upper_bound: float, margin: float) -> str:
    """Return the conclusion from the interval and the one-sided bound."""
    return (
        DIFFERENT
        if low > 0.0
        else NO_DIFFERENCE
        if upper_bound <= margin
        else CANNOT_TELL
    )


def sentence(
    conclusion: str,
    sizes: Sequence[float],
    compared: str,
    confidence: float,
    margin: float,
) -> str:
    """Return a conclusion as a sentence; `sizes` are estimate, low, high and upper bound."""
    require_choice("conclusion", conclusion, CONCLUSIONS)
    size, low, high, bound, wanted = map(percent, [*sizes, margin])
    sure, more = f"{100 * confidence:g} %", "just over " * (bound == wanted)
    if conclusion == DIFFERENT:
        interval = f"({sure} interval {low} to {high})"
        return f"The maps of {compared} are different: by {size} of the map {interval}."
    if conclusion == NO_DIFFERENCE:
        larger = f"larger than {bound} of the map, at {sure} confidence"
        return f"No difference between the maps of {compared} {larger}."
    none = f"no difference between the maps of {compared} was found"
    open_ = f"one of up to {more}{bound} of the map cannot be excluded, and {wanted} was wanted"
    return f"These data cannot tell: {none}, but {open_}."


def outlook(
    effect: sizing.EffectSize, needed: int | None, landings: int, power: float
) -> str:
    """Return words on what these data could have shown, and on what would show more.

    Parameters
    ----------
    effect : EffectSize
    needed : int, optional
        Number of landings that show a difference of `ASKED`; None if no number does.
    landings : int
        Number of landings that these data have.
    power : float
        Power with which the detectable difference would have been found.
    """
    seen = (
        "Nothing could have been seen here: a difference would have to be larger than the map"
        if effect.detectable > 1.0
        else f"A difference that shows as {percent(effect.detectable)} would be found in "
        f"{100 * power:g} % of such studies"
    )
    if needed is None:
        return f"{seen}; {percent(ASKED)} cannot be seen with any number of landings."
    number = f"{int(float(f'{needed:.1e}')):,}"
    if needed <= landings:
        return f"{seen}; to see {percent(ASKED)}, about {number} of these landings are enough."
    instead = sizing.MORE_SPREAD * (needed > sizing.MOST_LANDINGS)
    return f"{seen}; to see {percent(ASKED)} you would need about {number} landings{instead}."


@told_call
@one_blas_thread()
def judge(
    x: ArrayLike,
    y: ArrayLike,
    instants: ArrayLike,
    *,
    seed: int,
    instants_se: ArrayLike | None = None,
    margin: float = 0.2,
    confidence: float = 0.95,
    power: float = 0.8,
    flips: int = 1999,
    blurred: str = "",
) -> Verdict:
    """Judge whether the map through the landing has one derivative.

    Parameters
    ----------
    x, y
        (n, 6B) home-frame states at the pre and the post section, z up: x, y and z of
        each marker of a rigid body, then the velocities in the same order, in any
        units. Landings are in chronological order.
    instants
        (n, feet) contact instants, in the same unit of time; NaN where not known.
    seed
        Seed of the study.
    instants_se
        (n, feet) standard errors of the instants, in the same unit; they tell what the
        states do not foretell of the contacts from what was not measured well. None if
        they are not known.
    margin
        Relative difference that the study is to exclude.
    confidence, power
        Confidence of the intervals, and power for the detectable difference. The level
        of the test is 1 - confidence.
    flips
        Number of random sign patterns.
    blurred
        Why the states cannot be trusted, if so; the answer is then ``"cannot tell"``.

    Raises
    ------
    AnalysisError
        If the shapes of the arrays do not match.
    ConfigError
        If another argument is not a number in its range.
    """
    parts = [numbers(*one) for one in (("x", x), ("y", y), ("instants", instants))]
    shapes = [part.shape for part in parts]
    fits = [len(shape) for shape in shapes] == [2, 2, 2] and shapes[0] == shapes[1]
    if not fits or shapes[0][0] != shapes[2][0] or shapes[0][1] % 6 or not shapes[0][1]:
        told = "x, y, instants: expected one row per landing, (n, 6B), (n, 6B), (n, feet), found "
        raise AnalysisError(told + ", ".join(map(str, shapes)))
    errors = None
    if instants_se is not None:
        errors = numbers("instants_se", instants_se)
        told = "a standard error for each instant, " + str(shapes[2])
        require(errors.shape == shapes[2], "instants_se", told, errors.shape)
    for key, share in (("confidence", confidence), ("power", power)):
        require(
            isinstance(share, Real) and 0 < share < 1,
            key,
            "a number between 0 and 1",
            share,
        )
    require(
        isinstance(margin, Real) and 0 < margin <= 1,
        "margin",
        "a number in (0, 1]",
        margin,
    )
    # With fewer flips no p-value could be small enough.
    for key, whole, least in (
        ("seed", seed, 0),
        ("flips", flips, ceil(1 / (1 - confidence))),
    ):
        fits = isinstance(whole, Integral) and whole >= least
        require(fits, key, f"a whole number, {least} or more", whole)
    known = np.asarray(np.isfinite(np.hstack(parts)).all(axis=1))
    notes = _left_out(known)
    how: dict[str, Any] = {"confidence": confidence, "power": power, "flips": flips}
    asked = how | {
        "n_feet": parts[2].shape[1],
        "n_landings": int(known.sum()),
        "margin": margin,
    }
    try:
        if blurred:
            raise AnalysisError(blurred)
        known_errors = None
        if errors is not None:
            known_errors = np.nan_to_num(errors[known])
        before, after, touched = (part[known] for part in parts)
        landings = inputs.section_landings(before, after, touched, known_errors)
        *differences, what = sizing.compared(landings)
        fit = fit_kinks(landings)
    except AnalysisError as error:
        note = {"what": "verdict", "reason": str(error)}
        said = f"These data cannot tell: {error}."
        return Verdict(
            CANNOT_TELL, said, "", "", n_window=0, notes=[*notes, note], **asked
        )

    def sized(part: KinkFit, root: FloatArray, stream: str) -> sizing.EffectSize:
        draw = named_generator(seed, "verdict", stream)
        return sizing.effect_size(part, root, generator=draw, **how)

    size = sizing.squared_size(fit, landings, *differences)
    effect = sized(fit, size, "signs")
    jump = None
    if fit.jumps is not None:
        jump = sized(fit.jumps, sizing.squared_jump(fit.jumps, landings), "jumps")
    conclusion, needed = conclude(effect.low, effect.upper_bound, margin), None
    said = sentence(conclusion, effect.sizes(), what, confidence, margin)
    decided_by, no_evidence = "effect", effect.allowed
    if effect.allowed < ASKED:
        seen = effect.detectable, effect.allowed
        needed = sizing.landings_needed(
            asked["n_landings"], *seen, ASKED, asked["n_feet"]
        )
    foreseen = outlook(effect, needed, asked["n_landings"], power)
    if jump and jump.low > 0.0:
        told = f"{_jump_told(jump, confidence)}."
        if conclusion == DIFFERENT:
            said = f"{said} And {told}"
        else:  # statements about derivatives are useless beside a jump
            said = f"The maps of {what} are different: {told}"
            often = f"{100 * power:g} % of such studies"
            foreseen = (
                f"A jump of {percent(jump.detectable)} would be found in {often}."
            )
            conclusion, decided_by, no_evidence, needed = DIFFERENT, "jump", 0.0, None
    return Verdict(
        conclusion,
        said,
        foreseen,
        what,
        n_window=len(fit.rows),
        effect=effect,
        jump=jump,
        decided_by=decided_by,
        landings_needed=needed,
        foretold=landings.foretold,
        notes=notes + _limits(landings, no_evidence, err_alike(fit.scores @ size.T)),
        **asked,
    )


def _jump_told(jump: sizing.EffectSize, confidence: float) -> str:
    size, low, high, _ = map(percent, jump.sizes())
    sure = f"({100 * confidence:g} % interval {low} to {high})"
    jumps = f"the outcome jumps by {size} of its variation {sure}"
    return f"where two feet exchange their order, {jumps}"


def _left_out(known: BoolArray) -> Notes:
    unknown = int((~known).sum())
    reason = (
        f"{unknown} of {len(known)} used lack a state or the contact instant of a foot"
    )
    return (
        [{"what": "touchdowns left out of the verdict", "reason": reason}]
        if unknown
        else []
    )


def _limits(landings: inputs.SectionLandings, allowed: float, alike: bool) -> Notes:
    far, state = inputs.far_off(landings), inputs.two_kinds(landings.inputs)
    apart = f"a C1 map may look different by up to {percent(allowed)}"
    kinds = (
        f"by their {state} before, such as two speeds or heights: a size is a share of the "
        "variation of both together, and may be larger within one of them: judge each alone, too"
    )
    mistakes = f"if these {far} are mistakes, they distort the size and its bounds"
    in_a_row = (
        f"successive ones err alike, so signs are drawn for {sizing.IN_A_ROW} together, which "
        "widens the interval; even so, a difference may be false"
    )
    explained = f"{100 * landings.foretold:.1f} % of how far apart the feet touch"
    unforetold = (
        f"the state before the landing foretells {explained}; the rest is posture, such as legs "
        "whose length varies from landing to landing, or noise in the state. Differences between "
        "orders then look smaller than they are, and the bounds are too low, those of a jump most"
    )
    copies = "is one marker a copy of the other? The order of these two was not judged"
    told = [
        (
            inputs.feet_as_one(landings),
            "two feet are always the same time apart",
            copies,
        ),
        (
            allowed > LEFT,
            "contacts far apart",
            f"{apart}: smaller sizes are not evidence",
        ),
        (state, TWO_KINDS, kinds),
        (far, "landings far from all others", mistakes),
        (alike, "landings are not independent", in_a_row),
        (landings.foretold < inputs.WELL_FORETOLD, NOT_FORETOLD, unforetold),
    ]
    return [{"what": what, "reason": reason} for holds, what, reason in told if holds]


def percent(share: float) -> str:
    """Return a share in per cent, to two digits."""
    return f"{float(f'{100 * share:.2g}'):g} %"
