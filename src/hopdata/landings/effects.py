"""What filters, resampling and soft tissue do to contacts and states, in ms and mm.

Nothing here is a table: the recording is compared with itself, as it was before its
positions were processed (`recordings.quality.restoring`), or without what its markers
move against one another. Contacts and states of both are found in the same way: that of
the study, whose recordings learn from one another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError
from hopdata.landings.contacts.find import find_study_landings
from hopdata.landings.contacts.joined import join_feet
from hopdata.landings.filling import fill_gaps
from hopdata.landings.floor import fit_floor, level
from hopdata.landings.sections.poincare import Sections
from hopdata.landings.sections.select import select_sections
from hopdata.landings.states.assemble import assemble_pairs
from hopdata.landings.states.pairs import Pairs
from hopdata.landings.touchdowns import touchdown_table
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.recordings.quality.restoring import filter_of, recorded, unfiltered
from hopdata.recordings.quality.rigid import frame_noise
from hopdata.recordings.quality.softness import softness_remark
from hopdata.rigid import body_shape, rigid_fit

#: Time between two descents up to which they are the same landing, of an animal of 1 m.
#: Unit: s. Origin: chosen. Filters move contacts by some 40 ms.
SAME_LANDING_S = 0.12

#: Time after the first contact in which the wobble is measured, of an animal of 1 m.
#: Unit: s. Origin: chosen.
WOBBLE_S = 0.08

#: Time after the first contact in which markers are taken to wobble as much, and else
#: as in flight, of an animal of 1 m.
#: Unit: s. Origin: chosen.
WOBBLES_FOR_S = 0.25

#: Time before the first contact in which they do not, of an animal of 1 m.
#: Unit: s. Origin: chosen.
FLIGHT_S = 0.08

#: Wobble after an impact, relative to what the markers move against one another in
#: flight, from which on it is told.
#: Unit: 1. Origin: chosen.
LEAST_WOBBLE = 1.0

#: Frames of the middle of a recording that are compared.
#: Unit: frames. Origin: chosen.
MOST_FRAMES = 30_000

#: Mean square of what the markers move against one another, relative to the one that
#: its median gives for noise, from which on contacts are looked for.
#: Unit: 1. Origin: chosen.
UNEVEN = 1.15

# Seed of the turns of the wobble.
WOBBLE_SEED = 56

# Landings from which a wobble is told.
LEAST_LANDINGS = 3


@dataclass(frozen=True)
class ContactsAndStates:
    """Contacts and states of a recording.

    Parameters
    ----------
    begin_s : (L,) array
        Apexes of the body before each landing, s.
    instants : (L, F) array
        Contact of each foot, s; NaN if none was found.
    pairs : Pairs, optional
        States at two sections; None if there are too few.
    sections : Sections, optional
        Those two; None without states.
    """

    begin_s: FloatArray
    instants: FloatArray
    pairs: Pairs | None
    sections: Sections | None


@dataclass(frozen=True)
class Methods:
    """How a study finds contacts and states; by default as the schema's defaults do.

    Parameters
    ----------
    floor : mapping
        Options of `fit_floor`.
    feet : sequence of mapping
        Feet with several markers, see `join_feet`.
    longest_s : float, optional
        Longest gap that is filled, s; None as `fill_gaps` chooses.
    fills : bool
        Whether gaps are filled.
    contacts : mapping
        Options of `find_study_landings`.
    sections : mapping
        Options of `select_sections`.
    touchdowns : mapping
        Options of `touchdown_table`.
    states : mapping
        Options of `assemble_pairs` that concern the fit.
    home_marker : str or sequence of str, optional
        Marker of the home frame, or several.
    """

    floor: Mapping[str, Any] = field(default_factory=dict)
    feet: Sequence[Mapping[str, Any]] = ()
    longest_s: float | None = None
    fills: bool = False
    contacts: Mapping[str, Any] = field(default_factory=dict)
    sections: Mapping[str, Any] = field(default_factory=dict)
    touchdowns: Mapping[str, Any] = field(default_factory=dict)
    states: Mapping[str, Any] = field(default_factory=dict)
    home_marker: str | Sequence[str] | None = None


@dataclass(frozen=True)
class _Processed:
    """A recording, and what it was before its positions were processed.

    Parameters
    ----------
    recording : Recording
        As given, or its middle.
    kind : str
        ``"filter"``, ``"resampling"``, or empty if nothing is recognised.
    original : Recording
        As it was before; the same recording if nothing is recognised.
    values : mapping
        What is told of the processing.
    """

    recording: Recording
    kind: str
    original: Recording
    values: Mapping[str, Any]


def effects(recording: Recording, methods: Methods | None = None) -> list[Message]:
    """Report by how much processing and soft tissue move contacts and states.

    It is `study_effects` for one recording, which then learns from itself alone.
    """
    (found,) = study_effects([recording], methods)
    return found


@one_blas_thread()
def study_effects(
    recordings: Sequence[Recording], methods: Methods | None = None
) -> list[list[Message]]:
    """Report by how much processing and soft tissue move contacts and states.

    Parameters
    ----------
    recordings : sequence of Recording
        Those of a study, as imported, with feet and body.
    methods : Methods, optional
        How the study finds contacts and states.

    Returns
    -------
    list of list of Message
        One list for each recording; none for positions as the cameras saw them on a
        rigid body. Values are in ms, mm and m/s.
    """
    methods = methods or Methods()
    told: list[list[Message]] = [[] for _ in recordings]
    numbers = [n for n, one in enumerate(recordings) if _can_be_compared(one)]
    study = [_processed(_middle(recordings[n])) for n in numbers]
    wobbles = [_wobble_of(one.recording) for one in study]
    is_any_processed = any(one.kind for one in study)
    if not is_any_processed and not any(wobbles):
        return told
    given = find_in_study([one.recording for one in study], methods)
    before: Sequence[ContactsAndStates | None] = [None] * len(study)
    if is_any_processed:
        # States are compared at the same heights, so the sections are those as given.
        sections = next((one.sections for one in given if one and one.sections), None)
        before = find_in_study([one.original for one in study], methods, sections)
    for k, (n, one, wobble) in enumerate(zip(numbers, study, wobbles, strict=True)):
        if one.kind:
            told[n] += _told_of_processing(one, given[k], before[k])
        if wobble is not None:
            others = [other.recording for other in study]
            told[n] += _told_of_wobble(k, others, given, wobble, methods, told[n])
    return told


def _can_be_compared(recording: Recording) -> bool:
    """Tell whether a recording has enough feet and markers of a body."""
    return len(recording.names("foot")) > 1 and len(recording.names("body")) > 2


def _processed(recording: Recording) -> _Processed:
    """Return a recording with what it was before, as far as that is recognised."""
    found = filter_of(recording.body, scale=recording.scale)
    if found is not None:
        original = replace(recording, positions=unfiltered(recording.positions, found))
        half_period_ms = 500.0 / (found.cut_off * recording.rate_hz)
        values = {"half_period_ms": half_period_ms}
        return _Processed(recording, "filter", original, values)
    frames = recorded(recording)
    if frames is not None:
        values = {"from_hz": frames.rate_hz, "rate_hz": recording.rate_hz}
        return _Processed(recording, "resampling", frames, values)
    return _Processed(recording, "", recording, {})


def _middle(recording: Recording) -> Recording:
    """Return a recording, or its middle if it is very long."""
    n_frames = len(recording.time)
    first = max(0, (n_frames - MOST_FRAMES) // 2)
    return recording.part(slice(first, first + MOST_FRAMES))


def find_contacts_and_states(
    recording: Recording,
    sections: Sections | None = None,
    methods: Methods | None = None,
) -> ContactsAndStates:
    """Find contacts and states of a recording, at given sections or at its own."""
    methods = methods or Methods()
    return _find([_levelled(recording, methods)], methods, sections)[0]


def find_in_study(
    recordings: Sequence[Recording],
    methods: Methods,
    sections: Sections | None = None,
) -> list[ContactsAndStates | None]:
    """Find contacts and states in all recordings of a study, which share one law.

    Parameters
    ----------
    recordings : sequence of Recording
        As imported.
    methods : Methods
        How the study finds them.
    sections : Sections, optional
        Where states are taken; by default the study's own.

    Returns
    -------
    list of ContactsAndStates or None
        None where a recording has no floor.
    """
    standing = {}
    for n, recording in enumerate(recordings):
        try:
            standing[n] = _levelled(recording, methods)
        except AnalysisError:
            continue
    found: list[ContactsAndStates | None] = [None] * len(recordings)
    try:
        of_standing = _find([*standing.values()], methods, sections)
    except AnalysisError:
        return found
    for n, one in zip(standing, of_standing, strict=True):
        found[n] = one
    return found


def _levelled(recording: Recording, methods: Methods) -> Recording:
    """Return a recording on a level floor, with its feet joined and its gaps filled."""
    ready = level(recording, fit_floor(recording, **methods.floor))
    ready = join_feet(ready, methods.feet)
    if methods.fills:
        ready = fill_gaps(ready, longest_s=methods.longest_s)
    return ready


def _find(
    standing: Sequence[Recording], methods: Methods, sections: Sections | None
) -> list[ContactsAndStates]:
    """Find contacts and states of levelled recordings."""
    if not standing:
        return []
    tables = find_study_landings(standing, **methods.contacts)
    if sections is None:
        sections = _sections(standing, tables, methods)
    found = []
    for one, landings in zip(standing, tables, strict=True):
        columns = [f"contact_{foot}_s" for foot in one.names("foot")]
        found.append(
            ContactsAndStates(
                begin_s=landings["begin_s"].to_numpy(dtype=float),
                instants=landings[columns].to_numpy(dtype=float),
                pairs=_pairs(one, landings, sections, methods),
                sections=sections,
            )
        )
    return found


def _sections(
    standing: Sequence[Recording], tables: Sequence[pd.DataFrame], methods: Methods
) -> Sections | None:
    """Return the sections of levelled recordings; None with too few landings."""
    # Recordings are told apart by their names, which may be the same here.
    named = [replace(one, name=f"{n}") for n, one in enumerate(standing)]
    landings = {one.name: table for one, table in zip(named, tables, strict=True)}
    try:
        return select_sections(
            named, landings=landings, states=methods.states, **methods.sections
        )
    except AnalysisError:
        return None  # with few landings contacts alone are compared


def _pairs(
    standing: Recording,
    landings: pd.DataFrame,
    sections: Sections | None,
    methods: Methods,
) -> Pairs | None:
    """Return the states of a levelled recording at both sections; None with too few."""
    if sections is None:
        return None
    pre_m = sections.pre_height_m
    post_m = sections.post_height_m
    try:
        table = touchdown_table(
            standing,
            landings=landings,
            pre_height_m=pre_m,
            post_height_m=post_m,
            **methods.touchdowns,
        )
        return assemble_pairs(
            [standing],
            table,
            pre_height_m=pre_m,
            post_height_m=post_m,
            home_marker=methods.home_marker,
            ambiguous=methods.touchdowns.get("ambiguous", "keep"),
            **methods.states,
        )
    except AnalysisError:
        return None


def _told_of_processing(
    processed: _Processed,
    after: ContactsAndStates | None,
    before: ContactsAndStates | None,
) -> list[Message]:
    """Report by how much contacts and states of a recording differ from the original's.

    Nothing if there are no contacts to compare.
    """
    if after is None or before is None:
        return []
    kind = processed.kind
    time_scale = processed.recording.time_scale
    values = processed.values
    moved, n_before = moved_contacts(after, before, time_scale=time_scale)
    if not n_before:
        return []
    if not len(moved):
        return [Message(f"landings.{kind}_hides_contacts", values)]
    common = float(np.median(moved))
    values = {
        **values,
        "common_ms": 1e3 * common,
        "spread_ms": 1e3 * float(np.std(moved)),
        "lost_percent": 100 * max(0.0, 1.0 - len(moved) / n_before),
    }
    states = moved_states(after, before, time_scale=time_scale)
    if not states:
        return [Message(f"landings.{kind}_moves_contacts", values)]
    return [Message(f"landings.{kind}_moves", {**values, **states})]


def moved_contacts(
    after: ContactsAndStates, before: ContactsAndStates, *, time_scale: float
) -> tuple[FloatArray, int]:
    """Return by how much the contacts of landings moved, s, and how many there were."""
    near = _nearest(after.begin_s, before.begin_s, time_scale)
    moved = after.instants[near[:, 0]] - before.instants[near[:, 1]]
    n_before = int(np.isfinite(before.instants).sum())
    return moved[np.isfinite(moved)], n_before


def _nearest(one: FloatArray, other: FloatArray, time_scale: float) -> FloatArray:
    """Return which entries of two lists of instants, s, are of the same landing."""
    if not len(one) or not len(other):
        return np.zeros((0, 2), dtype=np.int64)
    apart = np.abs(one[:, None] - other[None])
    nearest = apart.argmin(axis=1)
    rows = np.arange(len(one))
    is_same = apart[rows, nearest] < SAME_LANDING_S * time_scale
    return np.column_stack([rows[is_same], nearest[is_same]])


def moved_states(
    after: ContactsAndStates, before: ContactsAndStates, *, time_scale: float
) -> dict[str, float]:
    """Return the rms change of the body's states: mm and m/s at both sections.

    Empty if there are no states to compare.
    """
    if after.pairs is None or before.pairs is None:
        return {}
    near = _nearest(_touches(after.pairs), _touches(before.pairs), time_scale)
    if not len(near):
        return {}
    found = {}
    for side, name in (("pre", "x"), ("post", "y")):
        changed = getattr(after.pairs, name)[near[:, 0]]
        changed = changed - getattr(before.pairs, name)[near[:, 1]]
        place, speed = np.split(changed, 2, axis=1)
        found[f"{side}_mm"] = 1e3 * _rms(place)
        found[f"{side}_m_s"] = _rms(speed)
    return found


def _touches(pairs: Pairs) -> FloatArray:
    """Return the mean contact of each pair, s."""
    if pairs.instants is None:
        return np.zeros(0)
    return np.asarray(np.nanmean(pairs.instants, axis=1))


def _rms(values: FloatArray) -> float:
    """Return the root mean square of the values that are known; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


# Soft tissue.


@dataclass(frozen=True)
class _Wobbling:
    """A recording whose body may wobble.

    Parameters
    ----------
    is_soft : bool
        Whether its body is soft altogether.
    rigid : Recording
        With a rigid body.
    residual_m : (N,) array
        What its markers move otherwise, m, from `as_rigid`.
    """

    is_soft: bool
    rigid: Recording
    residual_m: FloatArray


def _wobble_of(recording: Recording) -> _Wobbling | None:
    """Return a recording as one that wobbles, if its body is soft or uneven.

    Wobble is told of bodies that are soft, and of those whose markers wobble after
    impacts only.
    """
    names = recording.names("body")
    is_soft = bool(softness_remark(recording.body, names))
    try:
        rigid, residual_m = as_rigid(recording)
    except AnalysisError:
        return None
    if not is_soft and not _is_uneven(residual_m, n_markers=len(names)):
        return None
    return _Wobbling(is_soft, rigid, residual_m)


def _told_of_wobble(
    number: int,
    recordings: Sequence[Recording],
    found: Sequence[ContactsAndStates | None],
    wobbling: _Wobbling,
    methods: Methods,
    processing: Sequence[Message],
) -> list[Message]:
    """Report what the markers of a body move against one another after an impact."""
    recording = recordings[number]
    given = found[number]
    if given is None:
        return []
    first_s = _first_contacts(given)
    if len(first_s) < LEAST_LANDINGS:
        return []
    flight_m, after_m = _about_contacts(recording, wobbling.residual_m, first_s)
    noise_m = flight_m
    if not processing:
        # Processing leaves less noise from frame to frame than there is.
        noise_m = min(flight_m, float(np.nanmedian(frame_noise(recording.body))))
    wobbles_after = _beyond(after_m, flight_m) > LEAST_WOBBLE * flight_m
    if not (wobbling.is_soft or wobbles_after) or not after_m > noise_m:
        return []
    values = {"wobble_mm": 1e3 * _beyond(after_m, noise_m), "flight_mm": 1e3 * flight_m}
    # What the markers move but for noise, of what is seen.
    shares = {
        "flight": _beyond(flight_m, noise_m) / flight_m,
        "after": _beyond(after_m, noise_m) / after_m,
    }
    if given.pairs is None or given.sections is None:
        return [Message("landings.wobble", values)]
    shaken = _shaken(recording, wobbling.rigid, first_s, shares)
    # The other recordings stay as they are: what is learned of them is not shaken.
    study = [*recordings[:number], shaken, *recordings[number + 1 :]]
    again = find_in_study(study, methods, given.sections)[number]
    moved = {}
    if again is not None:
        moved = moved_states(again, given, time_scale=recording.time_scale)
    # Velocities hang on the window of the fit: see `_shaken`.
    moved = {key: value for key, value in moved.items() if key.endswith("_mm")}
    if not moved:
        return [Message("landings.wobble", values)]
    return [Message("landings.wobble_moves", {**values, **moved})]


def _about_contacts(
    recording: Recording, residual_m: FloatArray, first_s: FloatArray
) -> tuple[float, float]:
    """Return rms residuals in flight, and after the first contacts (L,), s; m.

    The residuals (N,), m, are those of a rigid body, from `as_rigid`.
    """
    time_scale = recording.time_scale
    in_flight = _within(recording.time, first_s - FLIGHT_S * time_scale, first_s)
    after = _after(recording, first_s, WOBBLE_S)
    return _rms(residual_m[in_flight]), _rms(residual_m[after])


def _after(recording: Recording, first_s: FloatArray, lasting_s: float) -> BoolArray:
    """Mark frames (N,) for some time, of an animal of 1 m, after first contacts."""
    return _within(recording.time, first_s, first_s + lasting_s * recording.time_scale)


def _first_contacts(found: ContactsAndStates) -> FloatArray:
    """Return the first contact of each landing that has one, s."""
    known = np.isfinite(found.instants)
    first_s = np.where(known, found.instants, np.inf).min(axis=1, initial=np.inf)
    return np.asarray(first_s[np.isfinite(first_s)])


def _beyond(whole_m: float, part_m: float) -> float:
    """Return what is left of an rms value without an independent part of it."""
    return float(np.sqrt(max(0.0, whole_m**2 - part_m**2)))


def _is_uneven(residual_m: FloatArray, *, n_markers: int) -> bool:
    """Tell whether residuals (N,), m, are often larger than noise alone makes them.

    This costs little, unlike looking for contacts.
    """
    from scipy.special import gammaincinv

    squares = residual_m[np.isfinite(residual_m)] ** 2
    n_free = 3 * n_markers - 6
    if not len(squares):
        return False
    # The median of chi squared; `scipy.stats` takes a second to load.
    median = 2 * float(gammaincinv(n_free / 2, 0.5))
    usual = float(np.median(squares)) * n_free / median
    return bool(np.mean(squares) > UNEVEN * usual)


def as_rigid(recording: Recording) -> tuple[Recording, FloatArray]:
    """Return a recording whose body is rigid, and what its markers moved otherwise.

    The latter is the rms residual of a coordinate per degree of freedom, (N,), m.
    """
    body = recording.body
    whole = body[np.isfinite(body).all(axis=(1, 2))]
    shape = body_shape(whole[:: max(1, len(whole) // 500)])
    fit = rigid_fit(body, shape)
    moved = fit.centre[:, None] + np.einsum("nij,bj->nbi", fit.rotation, shape)
    positions = recording.positions.copy()
    columns = [recording.markers.index(name) for name in recording.names("body")]
    positions[:, columns] = np.where(np.isfinite(body), moved, np.nan)
    return replace(recording, positions=positions), fit.residual_m


def _within(time: FloatArray, begin_s: FloatArray, end_s: FloatArray) -> BoolArray:
    """Mark the instants (N,), s, within any span from a begin (L,) to its end, s."""
    inside = np.zeros(len(time), dtype=bool)
    for first, last in zip(begin_s, end_s, strict=True):
        inside |= (time >= first) & (time < last)
    return inside


def _shaken(
    recording: Recording,
    rigid: Recording,
    first_s: FloatArray,
    shares: Mapping[str, float],
) -> Recording:
    """Return a recording whose body wobbles once more.

    The motion that is seen is added once more, each marker's turned at random, and
    enlarged by what is not seen: a rigid motion follows as many as six of the
    coordinates. The velocities of states are not told of it: they depend on the window
    of the fit, which a wobble also changes.

    Parameters
    ----------
    recording, rigid : Recording
        As given, and with a rigid body.
    first_s : (L,) array
        First contacts, s.
    shares : mapping
        Share of the residual's amplitude that is no noise: ``after`` contacts, and in
        ``flight``.
    """
    from scipy.spatial.transform import Rotation

    columns = [recording.markers.index(name) for name in recording.names("body")]
    n_coordinates = 3 * len(columns)
    unseen = np.sqrt(n_coordinates / (n_coordinates - 6))
    after = _after(recording, first_s, WOBBLES_FOR_S)
    share = unseen * np.where(after, shares["after"], shares["flight"])
    residual = (recording.positions - rigid.positions)[:, columns]
    generator = np.random.default_rng(np.random.SeedSequence(WOBBLE_SEED))
    turns = Rotation.random(len(columns), random_state=generator).as_matrix()
    added = share[:, None, None] * np.einsum("bij,nbj->nbi", turns, residual)
    positions = recording.positions.copy()
    positions[:, columns] += added
    return replace(recording, positions=positions)
