"""The verdict: one smooth map through the landing, one for each order, or no answer.

It follows from the interval of a single size (`effect`): "different" if the interval
begins above zero, "no difference" if the bound is within the margin, and "cannot tell"
otherwise. A jump of the outcome is a difference whatever the derivatives are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import ceil
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, IntArray, Shown, one_blas_thread
from hopdata.errors import AnalysisError, require, require_choice, told_call
from hopdata.maps.draws import Notes, named_generator
from hopdata.maps.verdict import effect as sizing
from hopdata.maps.verdict import inputs, rows
from hopdata.maps.verdict import orders as which
from hopdata.maps.verdict.model import LEFT, KinkFit, err_alike
from hopdata.maps.verdict.session import Session
from hopdata.maps.verdict.window import fit_of_best_window
from hopdata.messages import Message
from hopdata.recording import numbers

DIFFERENT = "different"
NO_DIFFERENCE = "no difference"
CANNOT_TELL = "cannot tell"
CONCLUSIONS = (DIFFERENT, NO_DIFFERENCE, CANNOT_TELL)

#: Difference for which every verdict gives the number of landings needed to show it.
#: Unit: share of the map. Origin: chosen.
ASKED = 0.2

#: Kinks that averaging makes fainter than this are noted.
#: Unit: 1. Origin: chosen.
FAINT = 1.3

#: A map that the post section bends by more than this share is noted.
#: Unit: 1. Origin: measured: sections 50 to 70 mm below the contact bent maps of bodies
#: by 0.001 to 0.005, and those among the lowest points by 0.1 and more (`grazing`).
BENT = 0.02

# Relative error of a product of two numbers, with room.
ROUNDING = 1e-9

# Change over the session -> its code.
SESSION_CODES = {
    "time": "maps.session_time",
    "block": "maps.session_block",
    "change": "maps.session_change",
}

# Codes of notes that others look for.
TWO_KINDS_CODE = "maps.two_kinds"
NOT_FORETOLD_CODE = "maps.not_foretold"

# What foretells the contact instants, by what is known of the feet.
FORETOLD_BY = {
    inputs.Posture.USED: "maps.contacts_used",
    inputs.Posture.NOT_NEEDED: "maps.contacts_not_needed",
    inputs.Posture.NOT_SEEN: "maps.contacts_not_seen",
}

#: What the first of these is about, in words.
TWO_KINDS = str(Message(f"{TWO_KINDS_CODE}_what"))


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
    contacts
        What share of the contact instants is foretold, and by what, in one sentence.
    n_feet, n_landings, n_window
        Number of feet, of landings used, and of landings fitted: those nearest to the
        simultaneous contact.
    confidence, margin, power
        Confidence of the interval, difference that the study is to exclude, and power
        with which the detectable difference would have been found.
    flips
        Number of random sign patterns.
    effect
        Size of the difference at the simultaneous contact; None if it could not be
        computed.
    effect_over_landings
        Size of the mean difference over the landings. It is the same as ``effect``
        unless the difference saturates as the contacts come farther apart.
    saturates, saturation_p_value
        Whether it does, and the p-value of the test for it: see `saturation`.
    contact_spread
        How far apart the contacts of a landing are, rms, in their own unit of time.
    holds_from
        Time constant, in the unit of the contact instants, from which on a difference
        that saturates is at most ``margin`` at the simultaneous contact; None if no
        difference within ``margin`` is excluded.
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
        Share of the contact instants' mean square that the inputs foretell; None if it
        could not be computed. The inputs are the state before the landing, and the feet
        if `posture` says so. The rest (legs whose length varies from landing to
        landing, noise in the state) rounds kinks and jumps, which sizes allow for.
    posture
        What the verdict knows of the feet before the landing, in words.
    session
        What change over the session was fitted: some of ``"block"``, ``"time"`` and
        ``"change"``, or nothing.
    levels
        Levels of the tests of ``effect`` and ``jump``. One or both find a difference
        where there is none in 1 - confidence of such studies.
    orders
        Size of each pair of contact orders, or of feet: see
        `hopdata.maps.verdict.orders.PairEffect`.
    mainly
        Which orders differ most, in words; empty if no pair was found.
    gross_errors
        Rows of the landings that were left out as mistakes, by reason: see
        `hopdata.maps.verdict.rows`.
    notes
        Limits of the answer, each ``{"what": ..., "reason": ...}`` in words and
        ``{"code": ..., "values": ...}`` for programs: see `hopdata.messages`.
    messages
        Codes and values of ``sentence``, ``outlook``, ``compared``, ``contacts`` and
        ``mainly``, where these are not empty.
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
    contacts: str = ""
    effect: sizing.EffectSize | None = None
    effect_over_landings: sizing.EffectSize | None = None
    saturates: bool = False
    saturation_p_value: float | None = None
    contact_spread: float | None = None
    holds_from: float | None = None
    jump: sizing.EffectSize | None = None
    decided_by: str = "effect"
    landings_needed: int | None = None
    foretold: float | None = None
    levels: Mapping[str, float] = field(default_factory=dict)
    orders: Sequence[Mapping[str, Any]] = field(default_factory=list)
    mainly: str = ""
    posture: str = ""
    session: Sequence[str] = ()
    gross_errors: Mapping[str, Sequence[int]] = field(default_factory=dict)
    notes: Sequence[Mapping[str, Any]] = field(default_factory=list)
    messages: Mapping[str, Message] = field(default_factory=dict)

    def told(self) -> str:
        """Return the sentence."""
        return self.sentence

    def rows(self) -> dict[str, Any]:
        """Return the size of the difference, its interval and bounds."""
        if self.effect is None:
            return {}
        return {name: [value] for name, value in vars(self.effect).items()}

    def to_dict(self) -> dict[str, Any]:
        """Return all values, for ``verdict.json``."""
        return asdict(self)


@told_call
@one_blas_thread()
def judge(  # noqa: PLR0913 - the data, and the method's options
    x: ArrayLike,
    y: ArrayLike,
    instants: ArrayLike,
    *,
    seed: int,
    instants_se: ArrayLike | None = None,
    feet: ArrayLike | None = None,
    feet_se: ArrayLike | None = None,
    time: ArrayLike | None = None,
    blocks: ArrayLike | None = None,
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
        states do not foretell of the contacts from what was not measured well. If they
        are not known (None), all that is not foretold counts as real, which makes
        intervals wide rather than wrong.
    feet
        (n, feet, 3) positions of the feet at the pre section, in the frame and unit of
        `x`; NaN where a foot is not seen. They are inputs of the map where legs have a
        posture of their own. Without them (None) kinks are averaged over posture.
    feet_se
        (n, feet, 3) their standard errors; zero if None.
    time
        (n,) instants of the landings in the session, in any unit; by default one after
        the other.
    blocks
        (n,) labels of the blocks (recordings, surfaces, subjects) of the landings; by
        default all are of one.
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
    measured = _measured(x, y, instants, instants_se)
    measured = _with_feet(measured, feet, feet_se)
    measured = _with_session(measured, time, blocks)
    options = _Options(seed, margin, confidence, power, flips)
    options.check()
    left_out = _left_out(measured.known())
    try:
        if blurred:
            raise AnalysisError(blurred)
        sound = measured.sound_landings()
        landings = sound.landings
        comparison = sizing.compared(landings)
        fit = fit_of_best_window(landings, comparison)
    except AnalysisError as error:
        return _no_answer(error, measured, options, left_out)

    sizes = _sizes(fit, landings, comparison, options)
    over_landings = sizes.effect
    at_contact = options.at_contact(fit, landings, comparison, over_landings)
    effect = at_contact.size
    contact_spread = inputs.contact_spread(measured.instants[measured.known()])
    share = over_landings.upper_bound / margin
    spreads = fit.least_time_constant(landings, share)
    holds_from = None
    if spreads is not None:
        holds_from = spreads * contact_spread
    jump = sizes.jump

    answer = _answer(
        effect,
        comparison.what,
        measured,
        options,
        spreads,
        saturates=at_contact.saturates,
    )
    if jump is not None and jump.low > 0.0:
        answer = _with_jump(answer, jump, comparison.what, options)
    contacts = _contacts_said(landings)
    limits = _limits(landings, fit, sizes.alike, jumps=answer.decided_by == "jump")
    messages = {
        "sentence": answer.sentence,
        "outlook": answer.outlook,
        "compared": comparison.what,
        "contacts": contacts,
    }
    most = which.mainly(sizes.orders, landings.expected)
    if most is not None:
        messages["mainly"] = most
    return Verdict(
        conclusion=answer.conclusion,
        sentence=str(answer.sentence),
        outlook=str(answer.outlook),
        compared=str(comparison.what),
        contacts=str(contacts),
        n_feet=measured.n_feet,
        n_landings=len(landings.inputs),
        n_window=len(fit.rows),
        confidence=confidence,
        margin=margin,
        power=power,
        flips=flips,
        effect=effect,
        effect_over_landings=over_landings,
        saturates=at_contact.saturates,
        saturation_p_value=at_contact.p_value,
        contact_spread=contact_spread,
        holds_from=holds_from,
        jump=jump,
        decided_by=answer.decided_by,
        landings_needed=answer.landings_needed,
        foretold=landings.foretold,
        levels=sizes.levels,
        orders=[asdict(pair) for pair in sizes.orders],
        mainly=str(most or ""),
        posture=landings.posture.value,
        session=fit.session,
        gross_errors=sound.left_out,
        notes=[*left_out, *_gross_errors(sound), *limits],
        messages=messages,
    )


@dataclass(frozen=True)
class _Sizes:
    """The sizes of a study, the levels of their tests, and the size of each pair."""

    effect: sizing.EffectSize
    jump: sizing.EffectSize | None
    alike: bool
    levels: dict[str, float]
    orders: list[which.PairEffect]


def _sizes(
    fit: KinkFit,
    landings: inputs.SectionLandings,
    comparison: sizing.Comparison,
    options: "_Options",
) -> _Sizes:
    """Return the sizes of kinks and jumps, and of each pair, from the same signs."""
    fits = [fit]
    roots = [sizing.squared_size(fit, landings, comparison)]
    if fit.jumps is not None:
        fits.append(fit.jumps)
        roots.append(sizing.squared_jump(fit.jumps, landings))
    alike = any(
        err_alike(part.scores @ root.T) for part, root in zip(fits, roots, strict=True)
    )
    generator = named_generator(options.seed, "verdict", "signs")
    errors = sizing.signed_errors(fits, options.flips, generator, alike=alike)
    draws = [
        sizing.Draws(part, root, signed, alike=alike)
        for part, root, signed in zip(fits, roots, errors, strict=True)
    ]
    shares = [1.0]
    if fit.jumps is not None:
        shares = [1.0 - which.OF_JUMPS, which.OF_JUMPS]
    tests = [
        which.OneTest(drawn, part.allowed, share)
        for drawn, part, share in zip(draws, fits, shares, strict=True)
    ]
    joint = which.joint_level(tests, round(1.0 - options.confidence, 12))
    effects = [
        sizing.size_drawn(
            drawn,
            part,
            level_found=level,
            confidence=options.confidence,
            power=options.power,
        )
        for drawn, part, level in zip(draws, fits, joint.of_each, strict=True)
    ]
    pairs = which.pairs_of_maps(fit, errors[0], landings, comparison)
    jump = None
    if fit.jumps is not None:
        jump = effects[1]
        pairs += which.pairs_of_jumps(fit.jumps, errors[1], landings)
    of_pairs = which.pair_effects(
        pairs, alike=alike, joint_p_value=joint.p_value, confidence=options.confidence
    )
    levels = dict(zip(("effect", "jump"), joint.of_each, strict=False))
    return _Sizes(effects[0], jump, alike, levels, of_pairs)


@dataclass(frozen=True)
class _Measured:
    """The arrays of a study, of shapes that match: see `judge`."""

    before: FloatArray
    after: FloatArray
    instants: FloatArray
    instants_se: FloatArray | None
    feet: FloatArray | None = None
    feet_se: FloatArray | None = None
    time: FloatArray | None = None
    blocks: IntArray | None = None

    @property
    def n_feet(self) -> int:
        return self.instants.shape[1]

    @property
    def n_known(self) -> int:
        return int(self.known().sum())

    def known(self) -> BoolArray:
        """Return of which landings all states and instants are known, (n,)."""
        both = np.hstack([self.before, self.after, self.instants])
        return np.asarray(np.isfinite(both).all(axis=1))

    def sound_landings(self) -> rows.Sound:
        """Return the known landings without gross errors."""
        known = np.flatnonzero(self.known())
        found = rows.sound_landings(
            self.before[known],
            self.after[known],
            lambda some: self.landings(known[some]),
        )
        left_out = {}
        for reason, some in found.left_out.items():
            left_out[reason] = known[some].tolist()
        return rows.Sound(found.landings, left_out)

    def landings(self, known: IntArray) -> inputs.SectionLandings:
        """Return landings by their numbers, in the coordinates of the verdict."""
        errors = None
        if self.instants_se is not None:
            errors = np.nan_to_num(self.instants_se[known])
        feet = None
        if self.feet is not None:
            feet = self.feet[known]
        feet_se = None
        if self.feet_se is not None:
            feet_se = self.feet_se[known]
        contacts = inputs.Contacts(self.instants[known], errors, feet, feet_se)
        return inputs.section_landings(
            self.before[known], self.after[known], contacts, self.session(known)
        )

    def session(self, known: IntArray) -> Session:
        """Return when and where these landings were recorded."""
        time = self.time
        if time is None:
            time = np.arange(len(self.before), dtype=float)
        blocks = self.blocks
        if blocks is None:
            blocks = np.zeros(len(self.before), dtype=np.int64)
        return Session.of(time[known], blocks[known])


def _measured(
    x: ArrayLike, y: ArrayLike, instants: ArrayLike, instants_se: ArrayLike | None
) -> _Measured:
    """Return the arrays, if their shapes match."""
    before = numbers("x", x)
    after = numbers("y", y)
    touched = numbers("instants", instants)
    are_tables = before.ndim == 2 and after.ndim == 2 and touched.ndim == 2
    matches = (
        are_tables
        and before.shape == after.shape
        and len(before) == len(touched)
        and before.shape[1] > 0
        and before.shape[1] % 6 == 0
    )
    if not matches:
        expected = "one row per landing, (n, 6B), (n, 6B), (n, feet)"
        found = f"{before.shape}, {after.shape}, {touched.shape}"
        raise AnalysisError.at("x, y, instants", expected, found)
    errors = None
    if instants_se is not None:
        errors = numbers("instants_se", instants_se)
        wanted = f"a standard error for each instant, {touched.shape}"
        matches = errors.shape == touched.shape
        require(matches, "instants_se", wanted, errors.shape)
    return _Measured(before, after, touched, errors)


def _with_feet(
    measured: _Measured, feet: ArrayLike | None, feet_se: ArrayLike | None
) -> _Measured:
    """Return the data with the feet at the pre section, if their shapes match."""
    if feet is None:
        return measured
    places = numbers("feet", feet)
    shape = (*measured.instants.shape, 3)
    wanted = f"a position for each foot in each landing, {shape}"
    require(places.shape == shape, "feet", wanted, places.shape)
    errors = None
    if feet_se is not None:
        errors = numbers("feet_se", feet_se)
        wanted = f"a standard error for each coordinate of feet, {shape}"
        require(errors.shape == shape, "feet_se", wanted, errors.shape)
    return replace(measured, feet=places, feet_se=errors)


def _with_session(
    measured: _Measured, time: ArrayLike | None, blocks: ArrayLike | None
) -> _Measured:
    """Return the data with time and block of each landing, if their shapes match."""
    n_landings = len(measured.before)
    if time is not None:
        instants = numbers("time", time)
        is_known = bool(np.isfinite(instants).all())
        fits = instants.shape == (n_landings,) and is_known
        wanted = f"an instant for each of {n_landings} landings"
        require(fits, "time", wanted, instants.shape)
        measured = replace(measured, time=instants)
    if blocks is not None:
        labels = np.asarray(blocks)
        wanted = f"a label for each of {n_landings} landings"
        require(labels.shape == (n_landings,), "blocks", wanted, labels.shape)
        _, numbered = np.unique(labels.astype(str), return_inverse=True)
        measured = replace(measured, blocks=np.asarray(numbered, np.int64))
    return measured


@dataclass(frozen=True)
class _Options:
    """What is asked for: see `judge`."""

    seed: int
    margin: float
    confidence: float
    power: float
    flips: int

    def check(self) -> None:
        """Raise a `ConfigError` unless every option is a number in its range."""
        for key, share in (("confidence", self.confidence), ("power", self.power)):
            fits = isinstance(share, Real) and 0 < share < 1
            require(fits, key, "a number between 0 and 1", share)
        fits = isinstance(self.margin, Real) and 0 < self.margin <= 1
        require(fits, "margin", "a number in (0, 1]", self.margin)
        fits = isinstance(self.seed, Integral) and self.seed >= 0
        require(fits, "seed", "a whole number, 0 or more", self.seed)
        # With fewer flips no p-value could be small enough.
        least = ceil(1 / (1 - self.confidence))
        fits = isinstance(self.flips, Integral) and self.flips >= least
        require(fits, "flips", f"a whole number, {least} or more", self.flips)

    def at_contact(
        self,
        fit: KinkFit,
        landings: inputs.SectionLandings,
        comparison: sizing.Comparison,
        over_landings: sizing.EffectSize,
    ) -> sizing.AtContact:
        """Return the size at the simultaneous contact, from that over the landings."""
        root = sizing.squared_size(fit, landings, comparison)

        def size(slopes: KinkFit) -> sizing.EffectSize:
            return sizing.effect_size(
                slopes,
                root,
                generator=named_generator(self.seed, "verdict", "contact"),
                confidence=self.confidence,
                power=self.power,
                flips=self.flips,
            )

        return sizing.at_the_contact(
            fit,
            landings,
            over_landings,
            size,
            generator=named_generator(self.seed, "verdict", "saturation"),
            flips=self.flips,
        )


def _no_answer(
    error: AnalysisError, measured: _Measured, options: _Options, left_out: Notes
) -> Verdict:
    """Return the verdict on data that allow no number, and say why."""
    reason: Any = error.args[0]
    if not error.code:
        reason = str(error)
    said = Message("maps.no_answer", {"reason": reason})
    note = {
        "what": str(Message("maps.verdict_what")),
        "reason": str(error),
        "code": error.code or said.code,
        "values": dict(reason.values) if error.code else {"reason": reason},
    }
    return Verdict(
        conclusion=CANNOT_TELL,
        sentence=str(said),
        outlook="",
        compared="",
        n_feet=measured.n_feet,
        n_landings=measured.n_known,
        n_window=0,
        confidence=options.confidence,
        margin=options.margin,
        power=options.power,
        flips=options.flips,
        notes=[*left_out, note],
        messages={"sentence": said},
    )


@dataclass(frozen=True)
class _Answer:
    """What a verdict says: see `Verdict`."""

    conclusion: str
    decided_by: str
    landings_needed: int | None
    sentence: Message
    outlook: Message


def _answer(
    effect: sizing.EffectSize,
    what: Message,
    measured: _Measured,
    options: _Options,
    spreads: float | None,
    *,
    saturates: bool,
) -> _Answer:
    """Return what the size of the difference says."""
    conclusion = conclude(effect.low, effect.upper_bound, options.margin)
    needed = None
    if effect.allowed < ASKED:
        needed = sizing.landings_needed(
            measured.n_known, effect.detectable, effect.allowed, ASKED, measured.n_feet
        )
    return _Answer(
        conclusion=conclusion,
        decided_by="effect",
        landings_needed=needed,
        sentence=sentence(
            conclusion,
            effect.sizes(),
            what,
            options.confidence,
            options.margin,
            spreads=spreads,
            over_landings=not saturates,
        ),
        outlook=outlook(effect, needed, measured.n_known, options.power),
    )


def _with_jump(
    answer: _Answer, jump: sizing.EffectSize, what: Message, options: _Options
) -> _Answer:
    """Return the answer if the outcome jumps, beside the size or without it."""
    jumps = _jump_said(jump, options.confidence)
    if answer.conclusion == DIFFERENT:
        both = {"different": answer.sentence, "jump": jumps}
        return replace(answer, sentence=Message("maps.different_and_jump", both))
    # Statements about derivatives are useless beside a jump.
    shown = {"detectable": percent(jump.detectable), "power": _per_cent(options.power)}
    return _Answer(
        conclusion=DIFFERENT,
        decided_by="jump",
        landings_needed=None,
        sentence=Message("maps.jump_decides", {"compared": what, "jump": jumps}),
        outlook=Message("maps.outlook_jump", shown),
    )


def conclude(low: float, upper_bound: float, margin: float) -> str:
    """Return the conclusion from the interval and the one-sided bound."""
    if low > 0.0:
        return DIFFERENT
    if upper_bound <= margin:
        return NO_DIFFERENCE
    return CANNOT_TELL


def sentence(
    conclusion: str,
    sizes: Sequence[float],
    compared: Message | str,
    confidence: float,
    margin: float,
    *,
    subjects: int | None = None,
    spreads: float | None = None,
    over_landings: bool = False,
) -> Message:
    """Return a conclusion in one sentence.

    Parameters
    ----------
    conclusion
        One of `CONCLUSIONS`.
    sizes
        Estimate, low, high and upper bound.
    compared
        Whose maps were compared.
    confidence, margin
        As for `judge`.
    subjects
        Number of subjects, if it is the conclusion on a group of them.
    spreads
        `Verdict.holds_from` in contact spreads: what the bound does not cover is said
        with it.
    over_landings
        Whether the bound is one over the landings only.
    """
    require_choice("conclusion", conclusion, CONCLUSIONS)
    estimate, low, high, bound = sizes
    values: dict[str, Any] = {
        "compared": compared,
        "where": "",
        "size": percent(estimate),
        "low": percent(low),
        "high": percent(high),
        "bound": percent(bound),
        "confidence": _per_cent(confidence),
        "margin": percent(margin),
    }
    name = conclusion.replace(" ", "_")
    if conclusion == CANNOT_TELL and values["bound"] == values["margin"]:
        name = "cannot_tell_just"
    if conclusion == NO_DIFFERENCE and spreads is not None:
        name = "no_difference_at_contact"
        values["spreads"] = f"{float(f'{spreads:.2g}'):g}"
    if over_landings:
        values["where"] = Message("maps.over_landings")
    if subjects is not None:
        name = f"group_{name}"
        values["subjects"] = subjects
    return Message(f"maps.{name}", values)


def outlook(
    effect: sizing.EffectSize, needed: int | None, landings: int, power: float
) -> Message:
    """Return what these data could have shown, and what would show more.

    Parameters
    ----------
    effect
        Size of the difference.
    needed
        Number of landings that show a difference of `ASKED`; None if no number does.
    landings
        Number of landings that these data have.
    power
        Power with which the detectable difference would have been found.
    """
    seen = Message("maps.nothing_seen")
    if effect.detectable <= 1.0:
        shown = {"detectable": percent(effect.detectable), "power": _per_cent(power)}
        seen = Message("maps.seen", shown)
    values: dict[str, Any] = {"seen": seen, "asked": percent(ASKED)}
    if needed is None:
        return Message("maps.outlook_never", values)
    two_digits = int(float(f"{needed:.1e}"))
    values["number"] = f"{two_digits:,}"
    if needed <= landings:
        return Message("maps.outlook_enough", values)
    if needed > sizing.MOST_LANDINGS:
        values["more_spread"] = Message("maps.more_spread")
        return Message("maps.outlook_spread", values)
    return Message("maps.outlook_more", values)


def _jump_said(jump: sizing.EffectSize, confidence: float) -> Message:
    values = {
        "size": percent(jump.estimate),
        "low": percent(jump.low),
        "high": percent(jump.high),
        "confidence": _per_cent(confidence),
    }
    return Message("maps.jump", values)


def _left_out(known: BoolArray) -> Notes:
    unknown = int((~known).sum())
    if not unknown:
        return []
    return [_note("left_out", unknown=unknown, landings=len(known))]


def _gross_errors(sound: rows.Sound) -> Notes:
    """Return a note on the landings that are left out as mistakes, if there are any."""
    if not sound.left_out:
        return []
    count = sum(len(some) for some in sound.left_out.values())
    why = []
    for reason, some in sound.left_out.items():
        why.append(str(Message(f"maps.{reason}", {"count": len(some)})))
    return [
        _note(
            "gross_errors",
            count=count,
            landings=count + len(sound.landings.kept),
            why=", ".join(why),
            rows=sound.left_out,
        )
    ]


def _contacts_said(landings: inputs.SectionLandings) -> Message:
    """Return what share of the contact instants is foretold, and by what."""
    said = FORETOLD_BY[landings.posture]
    return Message(said, {"share": f"{100 * landings.foretold:.1f} %"})


def _limits(
    landings: inputs.SectionLandings, fit: KinkFit, alike: bool, *, jumps: bool
) -> Notes:
    """Return notes on what limits the answer, and on what was done about it.

    `alike` tells whether successive landings err alike, and `jumps` whether a jump
    decided, beside which sizes of kinks do not matter.
    """
    notes = []
    share = f"{100 * landings.foretold:.1f} %"
    hidden = int((~landings.kept).sum())
    if hidden:
        notes.append(_note("feet_hidden", count=hidden, landings=len(landings.kept)))
    if inputs.feet_as_one(landings):
        notes.append(_note("feet_as_one"))
    without_bend = fit.allowed / fit.faded - landings.bent
    if without_bend > LEFT * (1.0 + ROUNDING) and not jumps:
        notes.append(_note("contacts_far_apart", allowed=percent(fit.allowed)))
    if fit.faded > FAINT:
        notes.append(_note("faint", share=share, allowed=percent(fit.allowed)))
    if landings.bent > BENT:
        notes.append(_note("grazes", bent=percent(landings.bent)))
    state = inputs.two_kinds(landings.inputs[:, : inputs.STATE])
    if state:
        notes.append(_note("two_kinds", state=Message(f"maps.{state}")))
    if alike:
        notes.append(_note("err_alike", in_a_row=sizing.IN_A_ROW))
    if landings.posture is inputs.Posture.USED:
        notes.append(_note("feet_used", share=share))
    elif landings.foretold < inputs.WELL_FORETOLD:
        notes.append(_note("not_foretold", share=share))
    if fit.session:
        change = [str(Message(SESSION_CODES[name])) for name in fit.session]
        notes.append(_note("session", change=" and ".join(change)))
    return notes


def _note(name: str, **values: Any) -> dict[str, Any]:
    reason = Message(f"maps.{name}", values)
    return {
        "what": str(Message(f"maps.{name}_what")),
        "reason": str(reason),
        "code": reason.code,
        "values": values,
    }


def percent(share: float) -> str:
    """Return a share in per cent, to two digits."""
    two_digits = float(f"{100 * share:.2g}")
    return f"{two_digits:g} %"


def _per_cent(share: float) -> str:
    """Return a share that a user gave in per cent, as it was given."""
    return f"{100 * share:g} %"
