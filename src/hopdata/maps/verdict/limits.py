"""The notes of a verdict: what limits the answer, and what was done about it."""

from collections.abc import Sequence

from hopdata.arrays import BoolArray
from hopdata.feet import with_foot_names
from hopdata.maps.verdict import inputs, rows
from hopdata.maps.verdict.data import Measured
from hopdata.maps.verdict.growth import Growth
from hopdata.maps.verdict.model import BY_CHANCE, KinkFit
from hopdata.maps.verdict.orders import OF_ORDER, PairEffect
from hopdata.maps.verdict.pooled import of_more_bodies
from hopdata.maps.verdict.readings import Reading
from hopdata.maps.verdict.signs import IN_A_ROW
from hopdata.maps.verdict.sizes import Sizes
from hopdata.maps.verdict.smooth import Curvature
from hopdata.maps.verdict.words import percent
from hopdata.messages import Message
from hopdata.notes import Note

#: Kinks that averaging makes fainter than this are noted.
#: Unit: 1. Origin: chosen.
FAINT = 1.3

#: A map that the post section bends by more than this share is noted.
#: Unit: 1. Origin: measured: sections 50 to 70 mm below the contact bent maps of bodies
#: by 0.001 to 0.005, and those among the lowest points by 0.1 and more (`grazing`).
BENT = 0.02

#: A map is noted as strongly curved if terms of third order explain more than this
#: share of the variance of its outcomes, beside those of second order.
#: Unit: 1. Origin: measured: of bodies (bodies.py, seeds 40 to 43) it was up to 0.003,
#: of sines and cubes 0.03 and more (verdict_curvature.py, seeds 8000 to 8007).
CURVED = 0.02

#: A difference whose slope over the contact spread is surely above this is noted.
#: Unit: 1. Origin: measured: on bodies, kinks whose size was right had slopes surely
#: above 0.15 at most, and those whose size was too large 0.25 and more, but one
#: (verdict_growth.py, seeds 0 to 9).
GROWS = 0.2

#: Slope of a map whose curvature jumps, and not its derivative.
#: Unit: 1. Origin: derived: a square has a derivative in proportion to the time.
CURVATURE = 1.0

# Change over the session -> its code.
SESSION_CODES = {
    "time": "maps.session_time",
    "block": "maps.session_block",
    "change": "maps.session_change",
}

# Codes of notes that others look for.
TWO_KINDS_CODE = "maps.two_kinds"

NOT_FORETOLD_CODE = "maps.not_foretold"

ERRORS_UNKNOWN_CODE = "maps.errors_unknown"

#: What the first of these is about, in words.
TWO_KINDS = str(Message(f"{TWO_KINDS_CODE}_what"))


def left_out(known: BoolArray) -> list[Note]:
    """Return a note on the landings of which something is not known, if any."""
    unknown = int((~known).sum())
    if not unknown:
        return []
    return [_note("left_out", unknown=unknown, landings=len(known))]


def gross_errors(sound: rows.Sound) -> list[Note]:
    """Return a note on the landings that are left out as far off, if there are any."""
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
            judged=len(sound.landings.kept),
            why=", ".join(why),
            which=Message("maps.far_off_in_rows"),
            rows=sound.left_out,
        )
    ]


def far_off_kept(*, keep: bool) -> list[Note]:
    """Return a note that landings were kept however far off they are, if they were."""
    if not keep:
        return []
    return [_note("far_off_kept")]


def what_limits(reading: Reading, *, jumps: bool) -> list[Note]:
    """Return notes on what limits the answer, and on what was done about it.

    `jumps` tells whether a jump decided, beside which sizes of kinks do not matter.
    """
    landings = reading.landings
    fit = reading.fit
    notes: list[Note] = []
    share = f"{100 * landings.foretold:.1f} %"
    hidden = int((~landings.kept).sum())
    if hidden:
        notes.append(_note("feet_hidden", count=hidden, landings=len(landings.kept)))
    if inputs.feet_as_one(landings):
        notes.append(_note("feet_as_one"))
    allowed = percent(reading.sizes.effect.allowed)
    if fit.leaves_more(landings.bent) and not jumps:
        notes.append(_of_third(fit, landings.bent, allowed))
    notes += curved(fit.curvature())
    if fit.faded > FAINT:
        notes.append(_note("faint", share=share, allowed=allowed))
    if landings.bent > BENT:
        notes.append(_note("grazes", bent=percent(landings.bent)))
    state = inputs.two_kinds(landings.inputs[:, : inputs.STATE])
    if state:
        notes.append(_note("two_kinds", state=Message(f"maps.{state}")))
    if reading.sizes.alike:
        notes.append(_note("err_alike", in_a_row=IN_A_ROW))
    if landings.posture is inputs.Posture.USED:
        notes.append(_note("feet_used", share=share))
    elif landings.foretold < inputs.WELL_FORETOLD and not reading.parts:
        notes.append(_note("not_foretold", share=share))
    if reading.parts:
        notes += _of_unknown_errors(reading)
    if fit.session:
        change = [str(Message(SESSION_CODES[name])) for name in fit.session]
        notes.append(_note("session", change=" and ".join(change)))
    return notes


def _of_third(fit: KinkFit, bent: float, allowed: str) -> Note:
    """Return the note on what third orders leave, with why they leave so much."""
    if fit.wants_landings(bent):
        return _note("few_for_third", allowed=allowed)
    return _note("contacts_far_apart", allowed=allowed)


def curved(curvature: Curvature | None) -> list[Note]:
    """Return a note on a map that is strongly curved over the landings, if it is."""
    if curvature is None:
        return []
    if curvature.share <= max(CURVED, BY_CHANCE * curvature.error):
        return []
    values = {
        "share": percent(curvature.share),
        "times": f"{curvature.by_mean_slope:.2g}",
    }
    return [_note("strongly_curved", **values)]


def _of_unknown_errors(reading: Reading) -> list[Note]:
    """Return a note on a reading of errors and of posture, if that matters."""
    of_errors, of_posture = reading.parts
    sizes = {
        "of_errors": percent(of_errors.sizes.effect.estimate),
        "of_posture": percent(of_posture.sizes.effect.estimate),
    }
    name = "errors_unknown"
    if reading.contact.saturates and not reading.surely_saturates:
        name = "errors_unknown_fades"
    elif (
        sizes["of_errors"] == sizes["of_posture"]
        and reading.landings.foretold >= inputs.WELL_FORETOLD
    ):
        return []
    share = f"{100 * reading.landings.foretold:.1f} %"
    return [_note(name, share=share, **sizes)]


def fades(growth: Growth | None) -> bool:
    """Return whether every slope that fits fades towards the simultaneous contact."""
    return growth is not None and growth.low > GROWS


def grows(growth: Growth | None) -> list[Note]:
    """Return a note on a difference that grows with the time between contacts, if any.

    `growth` is that of a difference that was found; None if it was not looked for.
    """
    if growth is None:
        return []
    # For programs. In words it would promise too much: the slopes that fit are those
    # of one family of shapes, and the difference may be of another.
    values = {"slope": f"{growth.slope:.2g}"}
    if fades(growth):
        return [_note("grows", **values)]
    if growth.high >= CURVATURE:
        return [_note("may_grow", **values)]
    return []


def pooled(measured: Measured) -> list[Note]:
    """Return a note on landings that seem to be of more bodies, and have no blocks."""
    if measured.blocks is not None:
        return []
    if of_more_bodies(measured.before[measured.known()]):
        return [_note("more_bodies")]
    return []


def bends_like_jumps(sizes: Sizes) -> list[Note]:
    """Return a note on a jump that may be a bend, if any."""
    if sizes.jump is None:
        return []
    if sizes.jump_unsure:
        return [_note("jump_unsure", size=percent(sizes.jump.estimate))]
    if sizes.jump_or_bend:
        return [_note("jump_or_bend")]
    return []


def own_maps(effects: Sequence[PairEffect], names: Sequence[str] = ()) -> list[Note]:
    """Return a note on orders with a map of their own that no kink or jump shows."""
    found = []
    for effect in effects:
        if effect.of == OF_ORDER and effect.low > 0.0:
            found.append(with_foot_names(effect.first, names))
    if not found:
        return []
    return [_note("own_map", orders=", ".join(found))]


def _note(name: str, **values: object) -> Note:
    return Note.of(f"maps.{name}", **values)
