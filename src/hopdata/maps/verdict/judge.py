"""The verdict: one smooth map through the landing, one for each order, or no answer.

It follows from the interval of a single size (`effect`): "different" if the interval
begins above zero, "no difference" if the bound is within the margin, and "cannot tell"
otherwise. A jump of the outcome is a difference whatever the derivatives are.

`data` checks what the study brings, `sizes` computes, and `words` and `limits` tell.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from numpy.typing import ArrayLike

from hopdata.arrays import (
    BoolArray,
    FloatArray,
    Shown,
    figure_function,
    one_blas_thread,
)
from hopdata.errors import AnalysisError, told_call
from hopdata.maps.verdict import data, inputs, limits
from hopdata.maps.verdict import orders as which
from hopdata.maps.verdict.comparison import Comparison, compared
from hopdata.maps.verdict.data import Measured, Options
from hopdata.maps.verdict.effect import EffectSize
from hopdata.maps.verdict.preliminary import preliminary
from hopdata.maps.verdict.readings import Reading, read
from hopdata.maps.verdict.what_now import (
    Limit,
    limits_of_reason,
    what_limits_most,
)
from hopdata.maps.verdict.words import (
    ASKED,
    CANNOT_TELL,
    DIFFERENT,
    NO_DIFFERENCE,
    as_given,
    contacts_said,
    jump_said,
    may_be_larger,
    outlook,
    percent,
    sentence,
    with_no_more,
    with_reservation,
    without_upper_end,
)
from hopdata.messages import Message
from hopdata.notes import Note

# Names that verdicts of earlier versions have in their files -> those of this version.
EARLIER_NAMES = {
    "foretold": "contacts_r2",
    "mainly": "main_contrast",
    "so_far": "preliminary",
    "untold": "unknown_because",
}

# Values that verdicts of earlier versions lack -> what they then are.
ADDED = {"far_off": ()}

# Values of a verdict that are sizes.
SIZES = ("effect", "effect_over_landings", "jump")


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
        What these data could have shown, and how many landings would show `ASKED`; if
        the size could not be computed, how many landings a verdict needs at least.
    compared
        Whose maps were compared, in words.
    contacts
        What share of the contact instants is foretold, and by what, in one sentence; if
        the size could not be computed, the orders that occur, and this share if it can
        be told.
    n_feet, n_landings, n_window
        Number of feet, of landings used, and of landings fitted: those nearest to the
        simultaneous contact.
    confidence, margin, power
        Confidence of the interval, difference that the study is to exclude, and power
        with which the detectable difference would have been found.
    flips
        Number of random sign patterns.
    effect
        Size of the difference at the simultaneous contact, if it does not fade unseen
        (`twice_high_from`); None if it could not be computed. If the difference is
        found to saturate, it has no upper end.
    effect_over_landings
        Size of the mean difference over the landings. It is the same as ``effect``
        unless the difference is found to saturate as the contacts come farther apart.
    saturates, saturation_p_value
        Whether it does, and the p-value of the test for it: see `saturation`. Without
        standard errors of the instants, whether it would if they had none, or if all
        that is not foretold were errors.
    contact_spread
        Spread of the contacts: standard deviation of the instants of a landing, rms
        over the landings with known contacts, in their own unit of time. Of two feet,
        it is half of how far apart they touch.
    holds_from
        Time constant, in the unit of the contact instants, from which on a difference
        that saturates is at most ``margin`` at the simultaneous contact; None if no
        difference within ``margin`` is excluded.
    twice_high_from
        Time constant, in the unit of the contact instants, from which on a difference
        that saturates unseen is at most twice the ``high`` of ``effect`` at the
        simultaneous contact; None unless the derivatives differ and are not found to
        saturate.
    jump
        Size of the jumps of the outcome where two feet exchange their order, as a share
        of what the mean map makes of the inputs; None if it could not be computed, or
        if no two feet exchange their order often enough.
    jump_bound
        Bound that holds for the jump at each exchange, together with those of all
        pairs; None if no jump is known.
    decided_by
        ``"jump"`` if only the jump shows a difference, otherwise ``"effect"``.
    landings_needed
        Number of judged landings, as `n_landings` counts them, that show a difference
        of `ASKED` with the given power; None if the size could not be computed, if the
        jump decided, or if no number suffices.
    contacts_r2
        Share of the contact instants' mean square that the inputs foretell in landings
        left out of the fit (cross-validated R²); None if it could not be computed. The
        inputs are the state before the landing, and the feet if `posture` says so. The
        rest (legs whose length varies from landing to landing, noise in the state)
        rounds kinks and jumps, which sizes allow for.
    posture
        What the verdict knows of the feet before the landing, in words.
    session
        What change over the session was fitted: some of ``"block"``, ``"time"`` and
        ``"change"``, or nothing.
    levels
        Levels of the tests of ``effect`` and ``jump``. One or both find a difference
        where there is none in 1 - confidence of such studies.
    orders
        Size of each pair of contact orders, or of feet, and of each order against all
        others: see `hopdata.maps.verdict.orders.PairEffect`.
    main_contrast
        Which orders differ most or surest, in words; empty if no pair was found. That
        of the surest is not tested against other pairs: see
        `hopdata.maps.verdict.orders.mainly`.
    gross_errors
        Rows, from 1, of `x` and `y` that were left out as far off, by reason: see
        `hopdata.maps.verdict.rows`.
    far_off
        The same landings as a study names them, each with its ``recording``, its
        ``touchdown`` there (from 1, as ``recordings[].exclude`` takes it), its instant
        ``t_pre_s`` on the recording's clock, its ``reason`` and its ``row``. Empty if
        `judge` was called on arrays.
    preliminary
        Where no size could be computed: ``orders``, each contact order that occurs with
        its number of ``landings``; ``least_landings``, of which a verdict is made; and
        ``contacts_r2``, the share of how the contacts vary from landing to landing that
        state and feet foretell, None if it cannot be told, with the reason in
        ``unknown_because``. Otherwise empty: see `hopdata.maps.verdict.preliminary`.
    notes
        Limits of the answer, each with ``what`` and ``reason`` in words, and ``code``
        and ``values`` for programs: see `hopdata.notes.Note`.
    what_now
        If the study cannot tell: the causes that limit it, the one that costs most
        first, each with its ``cause``, ``costs`` (by how much the detectable size would
        fall without it), ``said`` in words, ``code`` and ``values``: see `what_now`.
    messages
        Codes and values of ``sentence``, ``outlook``, ``compared``, ``contacts`` and
        ``main_contrast``, where these are not empty.
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
    effect: EffectSize | None = None
    effect_over_landings: EffectSize | None = None
    saturates: bool = False
    saturation_p_value: float | None = None
    contact_spread: float | None = None
    holds_from: float | None = None
    twice_high_from: float | None = None
    jump: EffectSize | None = None
    jump_bound: float | None = None
    decided_by: str = "effect"
    landings_needed: int | None = None
    contacts_r2: float | None = None
    levels: Mapping[str, float] = field(default_factory=dict)
    orders: Sequence[Mapping[str, Any]] = field(default_factory=list)
    main_contrast: str = ""
    posture: str = ""
    session: Sequence[str] = ()
    gross_errors: Mapping[str, Sequence[int]] = field(default_factory=dict)
    far_off: Sequence[Mapping[str, Any]] = ()
    preliminary: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[Note] = field(default_factory=list)
    what_now: Sequence[Mapping[str, Any]] = field(default_factory=list)
    messages: Mapping[str, Message] = field(default_factory=dict)

    def _told(self) -> str:
        """Return the sentence."""
        return self.sentence

    def _rows(self) -> dict[str, Any]:
        """Return the size of the difference, its interval and bounds."""
        if self.effect is None:
            return {}
        return {name: [value] for name, value in vars(self.effect).items()}

    def to_dict(self) -> dict[str, Any]:
        """Return all values, for ``verdict.json``."""
        values = asdict(self)
        for name in SIZES:
            size = getattr(self, name)
            if size is not None:
                values[name] = size.to_dict()
        return values

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> "Verdict":
        """Return the verdict of which `to_dict` made `content`.

        Raises
        ------
        AnalysisError
            If it is not what `to_dict` returns; the message names what differs.
        """
        wanted = {one.name for one in fields(cls)}
        values = _with_names_of_this_version(content)
        if {*values} != wanted:
            odd = ", ".join(sorted(wanted ^ {*values}))
            found = f"other ones ({odd}): it is of another version of hopdata"
            raise AnalysisError.at("verdict", "the values of this version", found)
        for name in SIZES:
            if values[name] is not None:
                values[name] = EffectSize.from_dict(values[name])
        values["session"] = tuple(values["session"])
        values["far_off"] = tuple(values["far_off"])
        values["notes"] = [Note.from_dict(one) for one in values["notes"]]
        values["messages"] = {
            name: Message.from_dict(one) for name, one in values["messages"].items()
        }
        return cls(**values)

    @told_call
    def plot(self, *, ax: Any = None, style: str | None = None) -> Any:
        """Draw the size of the difference with its interval, and the answer.

        `hopdata.Study.plot` also shows what it means for a landing.

        Parameters
        ----------
        ax : Axes or Figure, optional
            Where to draw; by default a figure of its own.
        style : str, optional
            ``"nature"``, ``"ieee"`` or ``"poster"``.

        Returns
        -------
        Figure
            Or, with `ax`, what was drawn into.
        """
        draw = figure_function("verdict:size_figure")
        return draw(self.to_dict(), ax=ax, style=style)


def _with_names_of_this_version(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a ``verdict.json``, by the names of this version."""
    values = {EARLIER_NAMES.get(name, name): value for name, value in content.items()}
    values = {**ADDED, **values}
    for name in {"preliminary", "messages"} & {*values}:
        inner = values[name]
        values[name] = {EARLIER_NAMES.get(key, key): inner[key] for key in inner}
    return values


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
    keep_far_off: bool = False,
    blurred: str = "",
    foot_names: Sequence[str] = (),
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
        states do not foretell of the contacts from what was not measured well. Zero if
        the instants are exact. If they are not known (None), what is not foretold may
        be posture or errors. Intervals and bounds then hold for either and are wide,
        the estimate is that for errors, and a note has both sizes.
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
        default all are of one. Two subjects in one table without labels may be called
        different though each has one smooth map: if one of them leans to another foot,
        who lands is linked with which foot is first.
    margin
        Relative difference that the study is to exclude.
    confidence, power
        Confidence of the intervals, and power for the detectable difference. The level
        of the test is 1 - confidence.
    flips
        Number of random sign patterns.
    keep_far_off
        Whether landings that are far off all others are kept, to see how much hangs on
        them. What counts is the answer without them, since mistakes, such as swapped
        markers, count in the other.
    blurred
        Why the states cannot be trusted, if so; the answer is then ``"cannot tell"``.
        States from positions that a low-pass filter has smoothed must be declared here
        if half a period of its cut-off is longer than a landing from section to
        section. `judge` cannot see it, and its bounds would be too low.
    foot_names
        (feet) names of the feet, all different, by which sentences call them; by
        default their numbers.

    Raises
    ------
    AnalysisError
        If the shapes of the arrays do not match.
    ConfigError
        If another argument is not a number in its range, or the names of the feet are
        too few, too many or not different.
    """
    measured = data.measured(x, y, instants, instants_se)
    measured = data.with_feet(measured, feet, feet_se)
    measured = data.with_session(measured, time, blocks)
    options = Options(seed, margin, confidence, power, flips)
    options.check()
    data.require_foot_names(foot_names, measured.n_feet)
    left_out = limits.left_out(measured.known())
    try:
        if blurred:
            raise AnalysisError(blurred)
        sound = measured.sound_landings(keep_far_off=keep_far_off)
        landings = sound.landings
        comparison = compared(landings, foot_names)
        reading = read(
            landings, comparison, options, errors_known=instants_se is not None
        )
    except AnalysisError as error:
        return _no_answer(error, measured, options, left_out, foot_names)

    landings = reading.landings
    fit = reading.fit
    sizes = reading.sizes
    contact = reading.contact
    over_landings = sizes.effect
    effect = contact.size
    contact_spread = inputs.contact_spread(measured.instants[measured.known()])
    spreads = reading.least_time_constant(over_landings.upper_bound / margin)
    jump = sizes.jump

    answer = _answer(
        reading,
        comparison,
        measured,
        options,
        spreads,
    )
    answer = _with_jump(answer, reading, comparison.what, options)
    contacts = contacts_said(landings)
    jumps = answer.decided_by == "jump"
    limited = limits.what_limits(reading, jumps=jumps)
    limited += limits.bends_like_jumps(sizes)
    limited += limits.pooled(measured) + limits.far_off_kept(keep=keep_far_off)
    half_shown = None
    if answer.conclusion == DIFFERENT and not jumps:
        growth = reading.growth()
        limited += limits.grows(growth)
        if not contact.saturates:
            # Twice as large at the contact: half of it shows over the landings.
            half_shown = reading.least_time_constant(0.5)
        fades = limits.fades(growth)
        answer = _reserved(answer, over_landings.high, half_shown, fades=fades)
    if answer.conclusion != DIFFERENT:
        limited += limits.own_maps(sizes.orders, foot_names)
    messages = {
        "sentence": answer.sentence,
        "outlook": answer.outlook,
        "compared": comparison.what,
        "contacts": contacts,
    }
    most = which.mainly(sizes.orders, landings.expected, sizes.alone, foot_names)
    if most is not None:
        messages["main_contrast"] = most
    now: list[Limit] = []
    if answer.conclusion == CANNOT_TELL:
        # Of the readings that a study cannot tell apart, the last shows least.
        widest = reading.each()[-1]
        now = what_limits_most(
            over_landings,
            widest.fit,
            widest.landings,
            margin=margin,
            alike=sizes.alike,
            saturates=contact.saturates,
        )
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
        saturates=contact.saturates,
        saturation_p_value=contact.p_value,
        contact_spread=contact_spread,
        holds_from=_scaled(spreads, contact_spread),
        twice_high_from=_scaled(half_shown, contact_spread),
        jump=jump,
        jump_bound=which.largest_high(sizes.orders, which.OF_JUMP),
        decided_by=answer.decided_by,
        landings_needed=answer.landings_needed,
        contacts_r2=landings.foretold,
        levels=sizes.levels,
        orders=[asdict(pair) for pair in sizes.orders],
        main_contrast=str(most or ""),
        posture=landings.posture.value,
        session=fit.session,
        gross_errors=sound.left_out,
        notes=[*left_out, *limits.gross_errors(sound), *limited],
        what_now=[one.to_dict() for one in now],
        messages=messages,
    )


def _scaled(spreads: float | None, contact_spread: float) -> float | None:
    """Return a time constant in the unit of the instants."""
    if spreads is None:
        return None
    return spreads * contact_spread


def _no_answer(
    error: AnalysisError,
    measured: Measured,
    options: Options,
    left_out: Sequence[Note],
    foot_names: Sequence[str],
) -> Verdict:
    """Return the verdict on data that allow no number, and say why."""
    reason: Any = error.args[0]
    if not error.code:
        reason = str(error)
    said = Message("maps.no_answer", {"reason": reason})
    about = str(Message("maps.verdict_what"))
    note = Note(about, str(error), said.code, said.values)
    if error.code:
        note = Note(about, str(error), error.code, reason.values)
    messages = {"sentence": said}
    known_so_far: dict[str, Any] = {}
    far_off = dict(getattr(error, "left_out", {}))
    rows = measured.known()
    if measured.n_feet > 1 and rows.any():
        found = preliminary(
            measured.before[rows],
            measured.after[rows],
            measured.instants[rows],
            instants_se=_some(measured.instants_se, rows),
            feet=_some(measured.feet, rows),
            foot_names=foot_names,
        )
        known_so_far = asdict(found)
        messages["contacts"] = found.said()
        messages["outlook"] = found.needed()
    return Verdict(
        conclusion=CANNOT_TELL,
        sentence=str(said),
        outlook=str(messages.get("outlook", "")),
        contacts=str(messages.get("contacts", "")),
        compared="",
        n_feet=measured.n_feet,
        n_landings=measured.n_known,
        n_window=0,
        confidence=options.confidence,
        margin=options.margin,
        power=options.power,
        flips=options.flips,
        gross_errors=far_off,
        preliminary=known_so_far,
        notes=[*left_out, note],
        what_now=[
            one.to_dict()
            for one in limits_of_reason(
                error,
                known_so_far.get("orders", ()),
                {**measured.unknown(), **far_off},
            )
        ],
        messages=messages,
    )


def _some(values: FloatArray | None, rows: BoolArray) -> FloatArray | None:
    """Return some rows of an array that may not be known."""
    if values is None:
        return None
    return values[rows]


@dataclass(frozen=True)
class _Answer:
    """What a verdict says: see `Verdict`."""

    conclusion: str
    decided_by: str
    landings_needed: int | None
    sentence: Message
    outlook: Message


def _answer(
    reading: Reading,
    comparison: Comparison,
    measured: Measured,
    options: Options,
    spreads: float | None,
) -> _Answer:
    """Return what the size of the difference says.

    The sentence tells the size over the landings. If the difference saturates, that at
    the simultaneous contact is known from below only.
    """
    contact = reading.contact
    sizes = reading.sizes
    effect = contact.size
    conclusion = conclude(effect.low, effect.upper_bound, options.margin)
    judged = len(reading.landings.inputs)
    needed = None
    if effect.least_allowed < ASKED:
        needed = effect.landings_needed(judged, ASKED, measured.n_feet)
    could_show = outlook(effect, needed, judged, options.power)
    if conclusion == DIFFERENT:
        could_show = Message("maps.outlook_found", {"outlook": could_show})
    if contact.saturates:
        code = "maps.outlook_seems_to_fade"
        if conclusion == DIFFERENT and reading.surely_saturates:
            code = "maps.outlook_saturates"
        could_show = Message(code, {"outlook": could_show})
    pairs = len(comparison.names)
    said = sentence(
        conclusion,
        sizes.effect.sizes(),
        comparison.what,
        options.confidence,
        options.margin,
        spreads=spreads,
        pairs=pairs,
    )
    if conclusion == NO_DIFFERENCE:
        pair = None
        if pairs > 1:
            pair = which.largest_high(sizes.orders, which.OF_MAP)
        jump = which.largest_high(sizes.orders, which.OF_JUMP)
        said = with_no_more(said, jump, pair, margin=options.margin)
    if contact.saturates:
        said = without_upper_end(
            said, conclusion, effect.low, surely=reading.surely_saturates
        )
    return _Answer(
        conclusion=conclusion,
        decided_by="effect",
        landings_needed=needed,
        sentence=said,
        outlook=could_show,
    )


def _reserved(
    answer: _Answer, high: float, half_shown: float | None, *, fades: bool
) -> _Answer:
    """Return the answer on a difference with what it leaves open at the contact.

    There the difference is smaller if it fades towards the contact, and may be larger
    if it saturates unseen.
    """
    if fades:
        reservation = Message("maps.fades")
    elif half_shown is not None:
        reservation = may_be_larger(high, half_shown)
    else:
        return answer
    return replace(answer, sentence=with_reservation(answer.sentence, reservation))


def _with_jump(
    answer: _Answer, reading: Reading, what: Message, options: Options
) -> _Answer:
    """Return the answer with what a jump adds to it or, if none was found, as it is."""
    jump = reading.sizes.jump
    steps = reading.fit.jumps
    if steps is None or jump is None or not jump.low > 0.0:
        return answer
    said = jump_said(jump, options.confidence, len(steps.exchanges))
    if answer.conclusion == DIFFERENT:
        both = {"different": answer.sentence, "jump": said}
        return replace(answer, sentence=Message("maps.different_and_jump", both))
    # Statements about derivatives are useless beside a jump.
    shown = {"detectable": percent(jump.detectable), "power": as_given(options.power)}
    return _Answer(
        conclusion=DIFFERENT,
        decided_by="jump",
        landings_needed=None,
        sentence=Message("maps.jump_decides", {"compared": what, "jump": said}),
        outlook=Message("maps.outlook_jump", shown),
    )


def conclude(low: float, upper_bound: float, margin: float) -> str:
    """Return the conclusion from the interval and the one-sided bound."""
    if low > 0.0:
        return DIFFERENT
    if upper_bound <= margin:
        return NO_DIFFERENCE
    return CANNOT_TELL
