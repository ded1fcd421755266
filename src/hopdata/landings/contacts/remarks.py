"""What users should know of how contacts were timed: soles, bounces, doubted frames.

A remark tells of one foot in all recordings: in how many of its landings, and by how
much at most. What it tells of is in the stated errors already.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, pd
from hopdata.errors import counted
from hopdata.landings.contacts import descents, joined
from hopdata.landings.contacts.altered import resampled_error
from hopdata.landings.contacts.bounces import bounces, rises
from hopdata.landings.contacts.doubted import kinds_of_doubt
from hopdata.landings.contacts.noise import height_noise
from hopdata.landings.contacts.passes import LONG_WINDOWS_S
from hopdata.landings.contacts.springs_back import springs_back
from hopdata.landings.contacts.tables import are_by
from hopdata.messages import Message
from hopdata.recording import Recording

BOUNCES = "landings.foot_bounces"
SINKS_ON = "landings.foot_sinks_on"
SPRINGS_BACK = "landings.foot_springs_back"
FILLED = "landings.foot_frames_filled"
EXCHANGED = "landings.foot_exchanged"
SPIKES = "landings.foot_spikes"

CODES = (BOUNCES, SINKS_ON, SPRINGS_BACK, FILLED, EXCHANGED, SPIKES)

# The remark on several feet, and what it says of each.
OF_FEET = {
    BOUNCES: "landings.feet_bounce",
    SINKS_ON: "landings.feet_sink_on",
    SPRINGS_BACK: "landings.feet_spring_back",
    FILLED: "landings.feet_frames_filled",
    EXCHANGED: "landings.feet_exchanged",
    SPIKES: "landings.feet_spikes",
}
_OF_EACH = {
    BOUNCES: "{foot} ({often}, some {ms:.2g} ms)",
    SINKS_ON: "{foot} ({often}, {mm:.2g} mm, {ms:.2g} ms)",
    SPRINGS_BACK: "{foot} ({often}, by {mm:.1f} mm, {ms:.2g} ms)",
    FILLED: "{foot} ({often}, up to {ms:.0f} ms each)",
    EXCHANGED: "{foot} ({often}, up to {ms:.0f} ms each)",
    SPIKES: "{foot} ({often})",
}


#: Depth by which feet sink and come back, at least, where a remark tells of it.
#: Unit: m. Origin: chosen: what a user can see in a plot of the marker's height.
LEAST_DEPTH_M = 5e-4


class Counted(NamedTuple):
    """What a remark tells of a foot in one recording."""

    code: str
    foot: str
    landings: int
    error_s: float
    height_m: float = 0.0


def contact_remarks(
    recordings: Sequence[Recording], tables: Sequence[pd.DataFrame]
) -> list[Message]:
    """Tell which feet bounce or sink, and which have frames that no camera saw.

    Parameters
    ----------
    recordings : sequence of Recording
        Levelled, as they were given to `find_study_landings`.
    tables : sequence of DataFrame
        What it returned. Only the kink fit takes notice of such feet: of contacts by
        another method nothing is told.

    Returns
    -------
    list of Message
        Values are the foot, the number of its landings, and in words, the time in ms
        and in mm how far it is above its rest, or how deep it sinks.
    """
    counts: list[Counted] = []
    for recording, table in zip(recordings, tables, strict=True):
        if are_by(table, "kink"):
            counts += _bouncing(recording, table)
            counts += _springing(recording, table)
            counts += _doubted(recording, table)
    messages = []
    for code in CODES:
        feet = dict.fromkeys(one.foot for one in counts if one.code == code)
        for foot in feet:
            own = [one for one in counts if one.code == code and one.foot == foot]
            n_landings = sum(one.landings for one in own)
            values = {
                "foot": foot,
                "landings": n_landings,
                "often": counted(n_landings, "landing"),
                "ms": 1e3 * max(one.error_s for one in own),
                "mm": 1e3 * max(one.height_m for one in own),
            }
            messages.append(Message(code, values))
    return messages


def one_for_all_feet(remarks: Sequence[Message]) -> list[Message]:
    """Return remarks with one for all feet of which the same is told.

    Parameters
    ----------
    remarks : sequence of Message
        As of `contact_remarks`, and others, which stay as they are.
    """
    by_code: dict[str, list[Message]] = {}
    for remark in remarks:
        by_code.setdefault(remark.code, []).append(remark)
    together: list[Message] = []
    for code, alike in by_code.items():
        if code in CODES and len(alike) > 1:
            feet = [_OF_EACH[code].format_map(one.values) for one in alike]
            together.append(Message(OF_FEET[code], {"feet": ", ".join(feet)}))
        else:
            together += alike
    return together


def resampled_remarks(recordings: Sequence[Recording]) -> list[Message]:
    """Tell by how much contacts may be off because frames were brought to another rate.

    Parameters
    ----------
    recordings : sequence of Recording
    """
    errors_s = [resampled_error(one) * one.time_scale for one in recordings]
    n_resampled = int(np.count_nonzero(errors_s))
    if not n_resampled:
        return []
    values = {
        "recordings": n_resampled,
        "of_recordings": counted(n_resampled, "recording"),
        "ms": 1e3 * max(errors_s),
    }
    return [Message("landings.contacts_resampled", values)]


def _bouncing(recording: Recording, table: pd.DataFrame) -> Iterator[Counted]:
    """Find feet that bounce or sink on, and by this may be timed wrongly."""
    feet = recording.names("foot")
    parts = joined.parts_of_feet(recording)
    heights = recording.feet[:, :, 2] / recording.scale
    instant = _instants(recording, table)
    time = recording.time / recording.time_scale
    contact_s = instant / recording.time_scale
    noise_m = height_noise(heights)
    higher_m = bounces(time, heights, contact_s, noise_m)
    is_bouncing = rises(time, heights, contact_s, noise_m)
    for i, foot in enumerate(feet):
        # Of several markers of one foot, one rises while the next comes down.
        if len(parts[i]) > 1 or not higher_m[i]:
            continue
        common_s = float(table[f"common_{foot}_s"].iloc[0])
        timed = np.isfinite(instant[:, i])
        if common_s > float(np.median(table.loc[timed, f"se_{foot}_s"])):
            code = BOUNCES if is_bouncing[i] else SINKS_ON
            above_m = float(higher_m[i]) * recording.scale
            yield Counted(code, foot, int(timed.sum()), common_s, above_m)


def _springing(recording: Recording, table: pd.DataFrame) -> Iterator[Counted]:
    """Find feet that sink and spring back, so that contacts may be early or late."""
    heights = joined.tracks_of_feet(recording)[:, :, 2] / recording.scale
    noise_m = height_noise(heights)
    instants = _instants(recording, table)
    feet = zip(recording.names("foot"), joined.parts_of_feet(recording), strict=True)
    end = 0
    for i, (foot, markers) in enumerate(feet):
        own = heights[:, end : end + len(markers)]
        end += len(markers)
        # Those that come down later are still above their rest.
        instant = np.repeat(instants[:, [i]], len(markers), axis=1)
        time = recording.time / recording.time_scale
        depth_m = springs_back(time, own, instant / recording.time_scale, noise_m)
        timed = np.isfinite(instants[:, i])
        # A smaller depth cannot be seen in the heights; the common error contains it.
        if not depth_m.max() > max(noise_m, LEAST_DEPTH_M):
            continue
        common_s = float(table[f"common_{foot}_s"].iloc[0])
        if common_s > float(np.median(table.loc[timed, f"se_{foot}_s"])):
            sunk_m = float(depth_m.max()) * recording.scale
            yield Counted(SPRINGS_BACK, foot, int(timed.sum()), common_s, sunk_m)


def _instants(recording: Recording, table: pd.DataFrame) -> FloatArray:
    """Return the contacts of feet that landed, (L, n), s; NaN for others."""
    feet = recording.names("foot")
    instant = np.full((len(table), len(feet)), np.nan)
    for i, foot in enumerate(feet):
        landed = (table[f"status_{foot}"] == descents.LANDED).to_numpy()
        own = table[f"contact_{foot}_s"].to_numpy(float)
        instant[landed, i] = own[landed]
    return instant


def _doubted(recording: Recording, table: pd.DataFrame) -> Iterator[Counted]:
    """Count the landings about which frames of a foot are not what cameras saw."""
    tracks = joined.tracks_of_feet(recording)
    is_filled, is_exchanged, is_spike = kinds_of_doubt(
        tracks, rate_hz=recording.rate_hz, scale=recording.scale
    )
    # The markers of all feet, foot by foot.
    end = 0
    for foot, own in zip(
        recording.names("foot"), joined.parts_of_feet(recording), strict=True
    ):
        markers = slice(end, end + len(own))
        end += len(own)
        spans = _spans(table, foot, recording.time_scale)
        for code, marked in (
            (FILLED, is_filled),
            (EXCHANGED, is_exchanged),
            (SPIKES, is_spike),
        ):
            of_foot = np.asarray(marked[:, markers].any(axis=1))
            lasting_s = _lasting(recording, of_foot, spans)
            if (lasting_s > 0).any():
                n_landings = int((lasting_s > 0).sum())
                yield Counted(code, foot, n_landings, float(lasting_s.max()))


def _spans(table: pd.DataFrame, foot: str, time_scale: float) -> FloatArray:
    """Return the times (L, 2), s, that say when a foot touched, in its landings.

    Without a contact it is the whole descent.
    """
    status = table[f"status_{foot}"].to_numpy()
    is_idle = np.isin(status, (descents.ALREADY_DOWN, descents.NOT_LANDED))
    own = table[~is_idle]
    contact_s = own[f"contact_{foot}_s"].to_numpy(float)
    before_s, after_s = LONG_WINDOWS_S
    timed = np.isfinite(contact_s)
    begin_s = np.where(timed, contact_s - before_s * time_scale, own["begin_s"])
    end_s = np.where(timed, contact_s + after_s * time_scale, own["end_s"])
    return np.stack([begin_s, end_s], axis=1)


def _lasting(recording: Recording, marked: BoolArray, spans: FloatArray) -> FloatArray:
    """Return for how long frames (N,) are marked within each of the spans, (L,), s."""
    count = np.concatenate([[0], np.cumsum(marked)])
    first, stop = np.searchsorted(recording.time, spans).T
    return np.asarray((count[stop] - count[first]) / recording.rate_hz)
