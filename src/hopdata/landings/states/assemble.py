"""From touchdowns to pairs: states at both sections, brought to the home frame."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, require_choice
from hopdata.landings import exclusion
from hopdata.landings.contacts.joined import parts_of_feet
from hopdata.landings.schedules import AMBIGUOUS, TREATMENTS
from hopdata.landings.states.crossing import SectionStates
from hopdata.landings.states.feet import feet_at_section
from hopdata.landings.states.fits import section_states
from hopdata.landings.states.home_frames import HomeFrames, home_frames
from hopdata.landings.states.pairs import DESCRIPTIONS, Pairs
from hopdata.landings.states.tracks import joined
from hopdata.landings.touchdowns import NO_FOOT_LANDED
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.scale import sampled

logger = logging.getLogger(__name__)

#: Fewest pairs from which the units of a study can be derived.
#: Unit: pairs. Origin: chosen.
LEAST_PAIRS = 3

#: Relative difference of distances up to which markers count as equally far. Those of a
#: symmetric body differ by their noise, which shall not choose between them. With 1.5
#: times the value, a few more bodies take the first of two markers by name.
#: Unit: 1. Origin: chosen.
AS_FAR = 0.01

STATELESS = Message(exclusion.STATELESS).text()  # why a touchdown has no state


@one_blas_thread()
def assemble_pairs(  # noqa: PLR0913 (the data, and the options of the states)
    recordings: Iterable[Recording],
    table: pd.DataFrame,
    *,
    pre_height_m: float,
    post_height_m: float,
    home_marker: str | Sequence[str] | None = None,
    method: str = "split_fit",
    window_s: float | None = None,
    gravity: str = "auto",
    ambiguous: str = "keep",
    begins_s: Mapping[str, float | None] | None = None,
) -> Pairs:
    """Collect the pairs of all touchdowns that are not excluded.

    Parameters
    ----------
    recordings : iterable of Recording
        Levelled recordings with the same body markers.
    table : pandas.DataFrame
        Their touchdowns.
    pre_height_m, post_height_m : float
        The sections, m.
    home_marker : str or sequence of str, optional
        Body marker on the x axis of the home frame, or several whose middle is on it;
        by default the `farthest_marker`.
    method, window_s, gravity
        See `hopdata.landings.states.fits.section_states`.
    ambiguous : {"keep", "pool", "exclude"}
        With ``pool``, touchdowns of the class ``ambiguous`` get no schedule and are
        used only where the order of the contacts does not matter.
    begins_s : mapping, optional
        When each recording begins in the session, s, by its name. Without an entry, or
        with None, it follows the one before it in the order of names.

    Returns
    -------
    Pairs
        Pairs in SI units, not normalised, in the order of the recordings' names. A
        touchdown with too few frames to fit its states is logged and left out (see
        `exclude_stateless`).

    Raises
    ------
    AnalysisError
        If fewer than `LEAST_PAIRS` remain, or the recordings differ in their body
        markers.
    ConfigError
        If `home_marker` is not a body marker, or `method`, `gravity` or `ambiguous` is
        unknown.
    """
    require_choice("touchdowns.ambiguous", ambiguous, TREATMENTS)
    recordings = list(recordings)
    if ambiguous == "pool":
        is_sure = table["order_class"] != AMBIGUOUS
        table = table.assign(schedule=table["schedule"].where(is_sure, ""))
    if not home_marker:
        home_marker = farthest_marker(recordings)
    if isinstance(home_marker, str):
        home_marker = [home_marker]
    parts = []
    # The order of the landings decides random draws, so it is not that of the
    # configuration.
    in_order = sorted(recordings, key=lambda one: one.name)
    starts = session_starts(in_order, begins_s or {})
    for recording, start_s in zip(in_order, starts, strict=True):
        names = recording.names("body")
        home = [names.index(one) for one in home_marker]
        is_own = table["recording"] == recording.name
        used = table[is_own & ~table["excluded"].astype(bool)]
        if not len(used):
            continue
        options = {"method": method, "window_s": window_s, "gravity": gravity}
        pre, post = _states(recording, used, pre_height_m, post_height_m, options)
        later_s = start_s - float(recording.time[0])
        part = _pairs_of(recording, used, pre, post, home, window_s, later_s)
        parts.append(part)
    n_pairs = sum(len(part) for part in parts)
    if n_pairs < LEAST_PAIRS:
        rest = table
        if parts:
            rest = exclude_stateless(table, joined(parts, DESCRIPTIONS))
        found = "; ".join(
            _why_few(one, rest[rest["recording"] == one.name]) for one in recordings
        )
        change = "set sections.pre_height_m and sections.post_height_m"
        n_landed = int((table["reason"] != NO_FOOT_LANDED).sum())
        if 0 < n_landed < LEAST_PAIRS:
            # No section makes them more.
            change = f"maps need at least {LEAST_PAIRS} landings: record more"
        raise AnalysisError(
            f"pairs: expected at least {LEAST_PAIRS} usable touchdowns, found "
            f"{n_pairs or 'none'} with the pre section at {pre_height_m:.4g} m and the "
            f"post section at {post_height_m:.4g} m ({found}); {change}"
        )
    return joined(parts, DESCRIPTIONS)


def session_starts(
    recordings: Sequence[Recording], begins_s: Mapping[str, float | None]
) -> list[float]:
    """Return when each recording begins in its session, s.

    Parameters
    ----------
    recordings : sequence of Recording
        In the order in which they follow one another. The first begins at the first
        instant of its own clock.
    begins_s : mapping
        Instants that are known, by the names of the recordings.
    """
    starts = []
    after = float(recordings[0].time[0])
    for recording in recordings:
        start = begins_s.get(recording.name)
        if start is None:
            start = after
        starts.append(start)
        after = start + float(recording.time[-1] - recording.time[0])
    return starts


def farthest_marker(recordings: Sequence[Recording]) -> str:
    """Return the body marker farthest from the middle of the body, seen from above.

    The longest arm gives the most accurate heading. Neither the order of the markers
    nor that of the recordings matters; among equally far markers, the first by name is
    taken.

    Parameters
    ----------
    recordings : sequence of Recording
        With the same body markers, at least one.

    Returns
    -------
    str
        Name of the marker with the largest median distance, as a mean over the
        recordings.
    """
    names = sorted(recordings[0].names("body"))
    far = np.zeros(len(names))
    for recording in recordings:
        body = sampled(recording.body)[:, :, :2]
        whole = body[~np.isnan(body).any(axis=(1, 2))]
        if not len(whole):
            continue
        arms = whole - whole.mean(axis=1, keepdims=True)
        distance = np.median(np.hypot(arms[:, :, 0], arms[:, :, 1]), axis=0)
        markers = recording.names("body")
        far += distance[[markers.index(name) for name in names]]
    is_as_far = far >= (1 - AS_FAR) * far.max()
    return names[int(np.argmax(is_as_far))]


def exclude_stateless(table: pd.DataFrame, pairs: Pairs) -> pd.DataFrame:
    """Return the touchdown table with touchdowns that have no pair excluded."""
    paired = set(zip(pairs.recording.tolist(), pairs.touchdown.tolist(), strict=True))
    rows = zip(table["recording"], table["touchdown"], strict=True)
    has_no_pair = np.array([row not in paired for row in rows])
    stateless = has_no_pair & ~table["excluded"].to_numpy(bool)
    table = table.copy()
    table.loc[stateless, ["reason", "excluded"]] = STATELESS, True
    return table


def _why_few(recording: Recording, table: pd.DataFrame) -> str:
    """Say why a recording gives few pairs.

    That is its descents and the most common reason, or the heights of its body.
    """
    if len(table):
        found = f"{len(table)} descent"
        if len(table) > 1:
            found += "s"
        is_out = table["excluded"].astype(bool)
        reasons = table.loc[is_out, "reason"].value_counts()
        if len(reasons):
            found += f", {reasons.index[0]} in {reasons.iloc[0]}"
        return f"{recording.name}: {found}"
    heights = recording.body_height[np.isfinite(recording.body_height)]
    if not len(heights):
        return f"{recording.name}: no frame shows the whole body"
    return (
        f"{recording.name}: the body never sinks through the pre section, with heights "
        f"from {heights.min():.4g} to {heights.max():.4g} m"
    )


def _states(
    recording: Recording,
    used: pd.DataFrame,
    pre_height_m: float,
    post_height_m: float,
    options: dict[str, Any],
) -> tuple[SectionStates, SectionStates]:
    """Fit the states of used touchdowns at the pre and the post section, in the world.

    `options` are those of `section_states`.
    """
    columns = [f"contact_{foot}_s" for foot in recording.names("foot")]
    contacts = used[columns].to_numpy()
    pre = section_states(
        recording.time,
        recording.body,
        used["t_pre_s"].to_numpy(),
        height_m=pre_height_m,
        side="before",
        contact=contacts.min(axis=1),
        time_scale=recording.time_scale,
        **options,
    )
    post = section_states(
        recording.time,
        recording.body,
        used["t_post_s"].to_numpy(),
        height_m=post_height_m,
        side="after",
        contact=contacts.max(axis=1),
        time_scale=recording.time_scale,
        **options,
    )
    return pre, post


def _pairs_of(
    recording: Recording,
    used: pd.DataFrame,
    pre: SectionStates,
    post: SectionStates,
    markers: Sequence[int],
    window_s: float | None,
    later_s: float,
) -> Pairs:
    """Bring states and feet to their home frames; leave undetermined states out.

    The session's clock shows `later_s` more than that of the recording.
    """
    t_pre = used["t_pre_s"].to_numpy()
    home = home_frames(
        recording.time,
        recording.body,
        t_pre,
        used["t_post_s"].to_numpy(),
        marker=markers,
        time_scale=recording.time_scale,
    )
    x, x_se = _in_home_frame(home, pre)
    y, y_se = _in_home_frame(home, post)
    instants = used.filter(regex="^contact_")
    instants_se = used.filter(regex="^se_").to_numpy(float)
    feet, feet_se = feet_at_section(
        recording.time,
        recording.positions,
        _markers_of_feet(recording, instants.columns),
        pre,
        home,
        contacts=instants.to_numpy(float),
        contacts_se=instants_se,
        window_s=window_s,
        time_scale=recording.time_scale,
    )
    whole = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if not whole.all():
        lost = ", ".join(f"{t:.2f}" for t in t_pre[~whole])
        logger.info("%s: %s for states at %s s", recording.name, STATELESS, lost)
    kept = used[whole]
    return Pairs(
        x=x[whole],
        y=y[whole],
        schedule=kept["schedule"].to_numpy(str),
        spread_s=kept["spread_s"].to_numpy(float),
        recording=kept["recording"].to_numpy(str),
        touchdown=kept["touchdown"].to_numpy(np.int64),
        body_markers=recording.names("body"),
        x_se=x_se[whole],
        y_se=y_se[whole],
        instants=instants.to_numpy(float)[whole],
        instants_se=instants_se[whole],
        feet=feet[whole],
        feet_se=feet_se[whole],
        time_s=pre.time[whole] + later_s,
    )


def _markers_of_feet(
    recording: Recording, contact_columns: Iterable[str]
) -> list[list[int]]:
    """Return the numbers of each foot's markers, in the order of these columns."""
    parts = dict(zip(recording.names("foot"), parts_of_feet(recording), strict=True))
    markers = []
    for column in contact_columns:
        foot = column.removeprefix("contact_").removesuffix("_s")
        markers.append(list(parts[foot]))
    return markers


def _in_home_frame(
    home: HomeFrames, states: SectionStates
) -> tuple[FloatArray, FloatArray]:
    """Return states and their standard errors in the home frames, (L, 6B) each."""
    values = _rows(home.points(states.position), home.vectors(states.velocity))
    errors = _rows(
        home.standard_errors(states.position_covariance),
        home.standard_errors(states.velocity_covariance),
    )
    return values, errors


def _rows(positions: FloatArray, velocities: FloatArray) -> FloatArray:
    """Set positions and velocities (L, B, 3) side by side, (L, 6B)."""
    return np.concatenate([positions, velocities], axis=1).reshape(len(positions), -1)
