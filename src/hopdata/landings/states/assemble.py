"""From touchdowns to pairs: fit the states at both sections, and bring them to the home frame."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread, pd
from hopdata.errors import AnalysisError, require_choice
from hopdata.landings.contacts.descents import longest_gap_s, longest_gaps
from hopdata.landings.schedules import AMBIGUOUS, TREATMENTS
from hopdata.landings.states.crossing import SectionStates
from hopdata.landings.states.fits import section_states
from hopdata.landings.states.pairs import DESCRIPTIONS, Pairs
from hopdata.landings.states.tracks import joined, turned
from hopdata.recording import Recording, sampled

# The home frame moves the plane so that the place and heading of a landing do not
# matter.

LEAST_RADIUS_M = 1e-6  # smallest distance of the home marker from the origin


@dataclass(frozen=True)
class HomeFrames:
    """Planar frames of L touchdowns.

    Parameters
    ----------
    origin : (L, 2) array
        Origins in the world, m.
    direction : (L, 2) array
        Unit vectors along the x axes.
    """

    origin: FloatArray
    direction: FloatArray

    def points(self, positions: FloatArray) -> FloatArray:
        """Bring positions (L, B, 3) in the world to the home frame; heights are kept."""
        moved = positions.copy()
        moved[:, :, :2] -= self.origin[:, None, :]
        return self.vectors(moved)

    def vectors(self, vectors: FloatArray) -> FloatArray:
        """Turn free vectors (L, B, 3), such as velocities, into the home frame."""
        return turned(vectors, self.direction)

    def standard_errors(self, covariance: FloatArray) -> FloatArray:
        """Return standard errors (L, B, 3) along the axes; covariances are (L, B, 3, 3)."""
        c, s = self.direction[:, :1], self.direction[:, 1:]
        xx, yy, zz = (covariance[:, :, k, k] for k in range(3))
        xy = 2 * c * s * covariance[:, :, 0, 1]
        along, across = c**2 * xx + xy + s**2 * yy, s**2 * xx - xy + c**2 * yy
        return np.sqrt(np.stack([along, across, zz], axis=2))


def home_frames(
    time: FloatArray, body: FloatArray, t_pre: FloatArray, t_post: FloatArray, *, marker: int,
    pace: float = 1.0,
) -> HomeFrames:  # fmt: skip
    """Find the home frame of each touchdown (Sec. 2.2.4 of the dissertation).

    The origin is the mean body position during the touchdown, and the x axis runs from
    it through the mean position of one marker. Means are time averages of the markers'
    tracks between the two instants. Tracks are linear between frames, so the means do
    not depend on where the frames fall. Short gaps are bridged by a straight line; a
    touchdown with a longer gap has no home frame (NaN).

    Parameters
    ----------
    time : (N,) array
        Time of each frame, s.
    body : (N, B, 3) array
        Body markers in the world, m; NaN where unseen.
    t_pre, t_post : (L,) array
        Beginning and end of each touchdown, s.
    marker : int
        Number of the body marker on the x axis.
    pace : float
        Pace of the recording.

    Returns
    -------
    HomeFrames

    Raises
    ------
    AnalysisError
        If the marker lies at the origin in some touchdown.
    """
    means = track_means(time, body[:, :, :2], t_pre, t_post, pace)
    origin = means.mean(axis=1)
    ray = means[:, marker] - origin
    length = np.hypot(ray[:, 0], ray[:, 1])
    if (length < LEAST_RADIUS_M).any():
        when = float(t_pre[np.argmin(np.where(np.isnan(length), np.inf, length))])
        found = f"it there in the touchdown at {when:.3f} s"
        wanted = "a body marker away from the mean body position"
        raise AnalysisError.at("home.marker", wanted, found)
    return HomeFrames(origin, ray / length[:, None])


def track_means(
    time: FloatArray,
    tracks: FloatArray,
    t_pre: FloatArray,
    t_post: FloatArray,
    pace: float = 1.0,
) -> FloatArray:
    """Average tracks (N, B, k) over time between instants (L,), (L, B, k).

    Short gaps are bridged by a straight line; NaN where a gap is longer than
    `longest_gap_s`.
    """
    means = np.full((len(t_pre), *tracks.shape[1:]), np.nan)
    longest_gap = longest_gap_s(time, pace) * (1 + 1e-9)
    for b, seen in enumerate(np.asarray(np.isfinite(tracks).all(axis=2)).T):
        t = time[seen]
        if len(t) < 2:
            continue
        gap = longest_gaps(t, np.column_stack([t_pre, t_post]))
        for c in range(tracks.shape[2]):
            track = tracks[seen, b, c]
            middle = (
                track.mean()
            )  # integrals of places far from the origin would lose digits
            before, after = _integral(t, track - middle, np.stack([t_pre, t_post]))
            share = middle + (after - before) / (t_post - t_pre)
            means[:, b, c] = np.where(gap <= longest_gap, share, np.nan)
    return means


def _integral(t: FloatArray, track: FloatArray, at: FloatArray) -> FloatArray:
    """Integrate a track that is linear between frames, from the first frame to `at`."""
    whole = np.append(0.0, np.cumsum(0.5 * np.diff(t) * (track[1:] + track[:-1])))
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    step = t[k + 1] - t[k]
    u = (at - t[k]) / step
    return np.asarray(
        whole[k] + step * u * (track[k] + 0.5 * u * (track[k + 1] - track[k]))
    )


logger = logging.getLogger(__name__)

LEAST_PAIRS = 3  # fewest pairs from which the units of a study can be derived
STATELESS = "too few frames of the body markers"


@one_blas_thread()
def assemble_pairs(
    recordings: Iterable[Recording],
    table: pd.DataFrame,
    *,
    pre_height_m: float,
    post_height_m: float,
    home_marker: str | None = None,
    method: str = "split_fit",
    window_s: float | None = None,
    gravity: str = "auto",
    ambiguous: str = "keep",
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
    home_marker : str, optional
        Body marker on the x axis of the home frame; by default the `farthest_marker`.
    method, window_s, gravity
        See `hopdata.landings.states.fits.section_states`.
    ambiguous : {"keep", "pool", "exclude"}
        With ``pool``, touchdowns of the class ``ambiguous`` get no schedule and are
        used only where the order of the contacts does not matter.

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
    recordings, parts = list(recordings), []
    if ambiguous == "pool":
        table = table.assign(
            schedule=table["schedule"].where(table["class"] != AMBIGUOUS, "")
        )
    home_marker = home_marker or farthest_marker(recordings)
    # The order of the landings decides random draws, so it is not that of the
    # configuration.
    for recording in sorted(recordings, key=lambda one: one.name):
        marker = recording.names("body").index(home_marker)
        used = table[
            (table["recording"] == recording.name) & ~table["excluded"].astype(bool)
        ]
        if len(used):
            sections = (pre_height_m, post_height_m)
            options: Any = {"method": method, "window_s": window_s, "gravity": gravity}
            states = _states(recording, used, sections, **options)
            parts.append(_pairs_of(recording, used, states, marker))
    n_pairs = sum(len(part) for part in parts)
    if n_pairs < LEAST_PAIRS:
        rest = exclude_stateless(table, joined(parts, DESCRIPTIONS)) if parts else table
        found = "; ".join(
            _why_few(r, rest[rest["recording"] == r.name]) for r in recordings
        )
        raise AnalysisError(
            f"pairs: expected at least {LEAST_PAIRS} usable touchdowns, found {n_pairs or 'none'} "
            f"with the pre section at {pre_height_m:.4g} m and the post section at "
            f"{post_height_m:.4g} m ({found}); set sections.pre_height_m and "
            "sections.post_height_m"
        )
    return joined(parts, DESCRIPTIONS)


# Relative difference of distances up to which markers count as equally far. Those of a
# symmetric body differ by their noise, which shall not choose between them. With 1.5
# times the value, a few more bodies take the first of two markers by name.
AS_FAR = 0.01


def farthest_marker(recordings: Sequence[Recording]) -> str:
    """Return the body marker that is farthest from the middle of the body, seen from above.

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
        far += distance[[recording.names("body").index(name) for name in names]]
    return names[int(np.argmax(far >= (1 - AS_FAR) * far.max()))]


def exclude_stateless(table: pd.DataFrame, pairs: Pairs) -> pd.DataFrame:
    """Return the touchdown table with touchdowns that have no pair excluded."""
    paired = set(zip(pairs.recording.tolist(), pairs.index.tolist(), strict=True))
    rows = zip(table["recording"], table["index"], strict=True)
    stateless = np.array([row not in paired for row in rows]) & ~table[
        "excluded"
    ].to_numpy(bool)
    table = table.copy()
    table.loc[stateless, ["reason", "excluded"]] = STATELESS, True
    return table


def _why_few(recording: Recording, table: pd.DataFrame) -> str:
    """Say why a recording gives few pairs: descents and the most common reason, or heights."""
    if len(table):
        reasons = table.loc[table["excluded"].astype(bool), "reason"].value_counts()
        found = f"{len(table)} descent" + ("s" if len(table) > 1 else "")
        why = f", {reasons.index[0]} in {reasons.iloc[0]}" if len(reasons) else ""
        return f"{recording.name}: {found}{why}"
    heights = recording.body_height[np.isfinite(recording.body_height)]
    if not len(heights):
        return f"{recording.name}: no frame shows the whole body"
    never = "the body never sinks through the pre section"
    between = f"{heights.min():.4g} to {heights.max():.4g} m"
    return f"{recording.name}: {never}, with heights from {between}"


def _states(
    recording: Recording,
    used: pd.DataFrame,
    sections: tuple[float, float],
    **options: Any,
) -> tuple[SectionStates, SectionStates]:
    """Fit the states of the used touchdowns at the pre and at the post section, in the world."""
    contacts = used[
        [f"contact_{foot}_s" for foot in recording.names("foot")]
    ].to_numpy()
    time, body, options["pace"] = recording.time, recording.body, recording.pace
    pre: Any = {
        "height_m": sections[0],
        "side": "before",
        "contact": contacts.min(axis=1),
    }
    post: Any = {
        "height_m": sections[1],
        "side": "after",
        "contact": contacts.max(axis=1),
    }
    return (
        section_states(time, body, used["t_pre_s"].to_numpy(), **pre, **options),
        section_states(time, body, used["t_post_s"].to_numpy(), **post, **options),
    )


def _pairs_of(
    recording: Recording,
    used: pd.DataFrame,
    states: Sequence[SectionStates],
    marker: int,
) -> Pairs:
    """Bring states to the home frames of their touchdowns; leave out undetermined ones."""
    t_pre, t_post = used["t_pre_s"].to_numpy(), used["t_post_s"].to_numpy()
    of, pace = (recording.time, recording.body), recording.pace
    home = home_frames(*of, t_pre, t_post, marker=marker, pace=pace)
    x, y = (_rows(home.points(s.position), home.vectors(s.velocity)) for s in states)
    both = [(s.position_covariance, s.velocity_covariance) for s in states]
    x_se, y_se = (
        _rows(*map(home.standard_errors, covariances)) for covariances in both
    )
    whole = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    if not whole.all():
        lost = ", ".join(f"{t:.2f}" for t in t_pre[~whole])
        logger.info("%s: %s for states at %s s", recording.name, STATELESS, lost)
    kept, found = used[whole], (("x", x), ("y", y), ("x_se", x_se), ("y_se", y_se))
    kinds = {"schedule": str, "spread_s": float, "recording": str, "index": np.int64}
    columns: dict[str, Any] = {
        name: kept[name].to_numpy(dtype) for name, dtype in kinds.items()
    }
    columns |= {name: states[whole] for name, states in found}
    columns["instants"] = kept.filter(regex="^contact_").to_numpy(float)
    columns["instants_se"] = kept.filter(regex="^se_").to_numpy(float)
    return Pairs(**columns, body_markers=recording.names("body"))


def _rows(positions: FloatArray, velocities: FloatArray) -> FloatArray:
    """Set positions and velocities (L, B, 3) side by side, (L, 6B)."""
    return np.concatenate([positions, velocities], axis=1).reshape(len(positions), -1)
