"""Rigid clusters and the noise of markers, both from distances between pairs."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.recordings.quality.stretches import near, quantiles, runs

SAMPLE_FRAMES = 4000
SAMPLE_NUMBERS, LEAST_SAMPLED = (
    10_000_000,
    500,
)  # fewer frames for many markers, down to these
MOST_FRAMES = 200_000
LEAST_FRAMES = 5  # with fewer frames nothing lies between the outer fifths
STRAIN = 0.025  # relative spread of a distance up to which a pair counts as rigid
SIGMAS = 4.0  # or up to this multiple of the spread from the markers' own noise
LEAST = 3
MEDIAN_LENGTH = 1.5381722544550522  # of vectors of three independent standard normals
FIFTHS_TO_SD = (
    1.6832  # range from the 20 % to the 80 % quantile of a normal distribution
)


@dataclass(frozen=True)
class PairDistances:
    """Distances between markers during a recording.

    Parameters
    ----------
    median : (M, M) array
        Median distance; NaN for pairs that are never seen together.
    spread : (M, M) array
        Standard deviation from the range between the outer fifths. A fifth of the
        frames may be wrong on either side, yet a leg that is stiff half of the time is
        not taken for rigid.
    """

    median: FloatArray
    spread: FloatArray


@dataclass(frozen=True)
class Cluster:
    """Markers that keep their mutual distances.

    Parameters
    ----------
    markers : tuple of int
        Indices of at least three markers.
    noise : float
        Standard deviation of a marker's coordinate that corresponds to the pairs'
        median spread, in the unit of the positions. Bending and slipping count as
        noise.
    """

    markers: tuple[int, ...]
    noise: float


def pair_distances(positions: FloatArray) -> PairDistances:
    """Measure all distances of (N, M, 3) positions over about `SAMPLE_FRAMES` frames.

    With more than fifty markers, fewer frames are used to keep the work the same. A
    spread needs `LEAST_FRAMES` frames.
    """
    n = positions.shape[1]
    most = max(LEAST_SAMPLED, min(SAMPLE_FRAMES, SAMPLE_NUMBERS // max(n, 1) ** 2))
    tracks = np.moveaxis(positions[:: max(1, len(positions) // most)], 1, 0)
    median, spread = np.zeros((2, n, n))
    for i in range(1, n):
        apart = np.linalg.norm(tracks[:i] - tracks[i], axis=2)
        low, middle, high = quantiles(apart.T, [0.2, 0.5, 0.8])
        few = np.isfinite(apart).sum(axis=1) < LEAST_FRAMES
        median[i, :i] = median[:i, i] = middle
        spread[i, :i] = spread[:i, i] = np.where(
            few, np.nan, (high - low) / FIFTHS_TO_SD
        )
    return PairDistances(median, spread)


def frame_noise(positions: FloatArray, *, lag: int = 1) -> FloatArray:
    """Return the frame-to-frame noise of each marker, (M,), from fourth differences.

    The standard deviation of a coordinate, robust against the frames at which a foot
    lands. NaN for a marker without five frames in a row, `lag` frames apart. Noise that
    a camera system has smoothed is not detected. At most `MOST_FRAMES` evenly spaced
    frames are used.
    """
    n, n_markers = len(positions) - 4 * lag, positions.shape[1]
    noise = np.full(n_markers, np.nan)
    stride = max(1, -(-n // MOST_FRAMES))
    for m in range(n_markers if n > 0 else 0):
        parts = [positions[k : k + n : stride, m] for k in range(0, 5 * lag, lag)]
        fourth = np.diff(parts, 4, axis=0)[0]
        fourth = fourth[np.isfinite(fourth).all(axis=1)]
        if len(fourth):
            # The length of the vector, because its coordinates depend on the axes.
            length = np.sqrt(np.median((fourth**2).sum(axis=1)))
            noise[m] = float(length) / MEDIAN_LENGTH / np.sqrt(70.0)
    return noise


def rigid_clusters(pairs: PairDistances, noise: FloatArray) -> tuple[Cluster, ...]:
    """Group markers so that every pair in a group is rigid, the largest groups first.

    Parameters
    ----------
    pairs : PairDistances
        Distances of all M markers.
    noise : (M,) array
        Frame-to-frame noise of each marker, in the same unit.
    """
    if len(pairs.median) < LEAST:
        return ()
    own = np.sqrt(noise[:, None] ** 2 + noise[None] ** 2)
    allowed = np.fmax(STRAIN * _local(pairs.median), SIGMAS * np.nan_to_num(own))
    with np.errstate(invalid="ignore", divide="ignore"):
        softness = np.nan_to_num(pairs.spread / allowed, nan=1e6, posinf=1e6)
    np.fill_diagonal(softness, 0.0)
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    groups = fcluster(
        linkage(squareform(softness, checks=False), "complete"), 1.0, "distance"
    )
    members = [tuple(np.flatnonzero(groups == g).tolist()) for g in np.unique(groups)]
    clusters = [Cluster(m, _noise(pairs.spread, m)) for m in members if len(m) >= LEAST]
    return tuple(sorted(clusters, key=lambda c: (-len(c.markers), c.markers)))


def _local(median: FloatArray) -> FloatArray:
    """Limit distances (M, M) to twice the distance to a neighbour: far pairs all seem rigid."""
    others = median + np.where(np.eye(len(median)), np.inf, 0.0)
    nearest = np.nanmin(np.where(np.isnan(others), np.inf, others), axis=1)
    return np.fmin(median, 2 * np.fmin(nearest[:, None], nearest[None]))


def _noise(spread: FloatArray, members: tuple[int, ...]) -> float:
    inner = spread[np.ix_(members, members)][np.triu_indices(len(members), 1)]
    return float(np.median(inner) / np.sqrt(2.0))


# Processing of positions before they were written: resampling or smoothing.

SPECTRUM_FRAMES, SEGMENT = 2**14, 256
QUICKEST = 0.09  # of the rate; slower patterns may be the animal's own motion
PATTERN_SHARE, PATTERN_PEAK = (
    0.15,
    60.0,
)  # of the total variance; of the usual power nearby
NO_CAMERA_M = 2e-5  # m; least frame-to-frame noise of any camera, for an animal of 1 m
ABOVE_FLOOR, LAW_HOLDS = (
    30.0,
    0.5,
)  # power over the rounding floor; largest misfit of log power
# Ratio of the last frequency above the floor to the lowest one fitted, below which the
# body may bend. Range of exponents of the frequency in the noise. Poles of a
# Butterworth filter, which runs forwards and backwards.
SLOWER, NOISE_SLOPES, POLES = 5, (-2.5, 0.5), (2, 4)


def treated(body: FloatArray, rate_hz: float, *, scale: float = 1.0) -> list[str]:
    """Report processing of the markers (N, m, 3), m, of a rigid part after recording."""
    body = middle(body)
    if pattern := frames_of_pattern(body):
        told = f"noise repeats every {pattern:.3g} frames, as if resampled to {rate_hz:g} Hz"
        return [
            f"{told} from another rate: contacts come some ms early; export frames as recorded"
        ]
    noise_m = float(quantiles(frame_noise(body)[:, None], [0.5])[0, 0])
    if len(body) < 2 * SEGMENT or not noise_m < NO_CAMERA_M * scale:
        return []
    cut = cut_off(body)
    by = f", by a low-pass of some {cut * rate_hz:.2g} Hz" if cut else ""
    told = f"positions were smoothed ({1e6 * noise_m:.2g} um of noise from frame to frame){by}"
    return [
        f"{told}: contacts come late, fit poorly or not at all; export them unfiltered"
    ]


def low_pass(body: FloatArray, *, scale: float = 1.0) -> float:
    """Return the `cut_off` of filtered markers (N, m, 3), m; 0 if unfiltered."""
    body = middle(body)
    quiet = quantiles(frame_noise(body)[:, None], [0.5])[0, 0] < NO_CAMERA_M * scale
    return cut_off(body) if quiet else 0.0


def middle(body: FloatArray) -> FloatArray:
    """Return the middle frames, from which the processing of all frames is inferred."""
    first = max(0, (len(body) - SPECTRUM_FRAMES) // 2)
    return body[first : first + SPECTRUM_FRAMES]


def recorded_frames(body: FloatArray) -> slice:
    """Select the recorded frames of (N, m, 3): all, or every second one between made-up frames.

    Recorded frames have more noise and are not copies. In other patterns too few frames
    coincide with recorded ones.
    """
    body = middle(body[: len(body) // 2 * 2])
    if round(frames_of_pattern(body), 2) != 2:
        return slice(None)
    moved = np.diff(body, axis=0, prepend=body[1:2]) != 0
    noise = [moved[k::2].mean() * np.nanmedian(frame_noise(body[k::2])) for k in (0, 1)]
    return slice(int(np.argmax(noise)), None, 2)


def frames_of_pattern(body: FloatArray) -> float:
    """Return the period, frames, of a pattern in the noise of positions (N, m, 3); 0 if none.

    Frames between the recorded ones have less noise, or are copies.
    """
    if len(body) < SEGMENT or not body.size:
        return 0.0
    track = body.reshape(len(body), -1)
    rough = np.abs(np.diff(track, 4, axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        rough = np.nan_to_num(np.minimum(rough / quantiles(rough, [0.5]), 3.0), nan=1.0)
    rough = rough.mean(axis=1) + 3.0 * (np.diff(track, axis=0)[:-3] == 0).mean(axis=1)
    rough -= rough.mean()
    power, often = np.abs(np.fft.rfft(rough)) ** 2, np.fft.rfftfreq(len(rough))
    at = int(np.argmax(np.where(often < QUICKEST, 0.0, power)))
    usual = np.median(power[max(0, at - SEGMENT // 2) : at + SEGMENT // 2])
    share = 2 * power[at] / max(len(rough) * float(rough @ rough), EXACT)
    return (
        1 / often[at]
        if share > PATTERN_SHARE and power[at] > PATTERN_PEAK * usual
        else 0.0
    )


def cut_off(body: FloatArray) -> float:
    """Return the cut-off of a filter applied to markers (N, m, 3) of a rigid part; 0 if none.

    Relative to the frame rate, for a zero-phase Butterworth filter (3 dB in each of two
    directions). It is fitted to the spectra of the distances, assuming that the
    unfiltered noise is a power of the frequency.
    """
    from scipy.signal import welch

    i, j = np.triu_indices(body.shape[1], 1)
    apart = np.linalg.norm(body[:, i] - body[:, j], axis=2)
    apart = apart[np.isfinite(apart).all(axis=1)]
    if len(apart) < 2 * SEGMENT or not apart.size:
        return 0.0
    often, power = welch(apart, 1.0, nperseg=SEGMENT, axis=0, detrend="linear")
    often, power = often[2:-1], np.median(power[2:-1], axis=1)
    above = np.flatnonzero(power > ABOVE_FLOOR * np.median(power[often > 0.4]))
    last = int(above.max(initial=0))
    if not last:
        return 0.0
    often, power = (x[last // SLOWER : last + 1, None] for x in (often, power))
    cuts, poles = (x.ravel() for x in np.meshgrid(np.geomspace(0.01, 0.4, 100), POLES))
    loss = 2 * np.log1p((np.tan(np.pi * often) / np.tan(np.pi * cuts)) ** (2 * poles))
    before, law = np.log(power + EXACT**3) + loss, np.log(often) ** [0, 1]
    noise = np.linalg.lstsq(law, before)[0]
    miss = np.std(before - law @ noise, axis=0)
    miss[(noise[1] < NOISE_SLOPES[0]) | (noise[1] > NOISE_SLOPES[1])] = np.inf
    best = int(miss.argmin())
    return float(cuts[best]) if miss[best] < LAW_HOLDS else 0.0


# Stretches in which two markers keep each other's distances to a rigid cluster.

OFF = 6.0  # spreads: a distance further off is not the marker's own
# Spreads, rms: exchanged distances further off do not fit the other marker either
FITS = 3.0
EXACT = 1e-12  # m; smallest spread
MOST_REFERENCES = 12  # evenly spaced markers of a cluster that serve as references
EXCHANGED_DISTANCES_LEAST_FRAMES = 2
NEAR = (
    3  # frames: both markers must jump or be unseen this close to the end of a stretch
)


def exchanged_stretches(
    positions: FloatArray,
    pairs: PairDistances,
    clusters: tuple[Cluster, ...],
    *,
    breaks: BoolArray,
) -> Iterator[tuple[int, int, int, int]]:
    """Yield both markers, the first frame of each stretch, and the frame after its last.

    Names can only be exchanged where both tracks break, so a stretch must begin and end
    at breaks.

    Parameters
    ----------
    positions : (N, M, 3) array
        NaN where a marker was not seen.
    pairs : PairDistances
        Distances of all M markers.
    clusters : tuple of Cluster
        A marker of a cluster may have been exchanged with any other marker. Two markers
        outside it are told apart by their usual places relative to it.
    breaks : (N, M) bool array
        Frames in which a marker jumps or is not seen.
    """
    # Frame boundaries with a break of a track nearby, (N + 1, M); both ends count as
    # breaks.
    around, end = near(breaks, NEAR - 1), np.ones((1, breaks.shape[1]), dtype=bool)
    breaking = np.concatenate([end, around[1:] | around[:-1], end])
    edges = (
        breaking[:-1] | breaking[1:]
    )  # frames that may be the first or last of a stretch
    for cluster in clusters:
        inside = set(cluster.markers)
        known = list(cluster.markers[:: -(-len(cluster.markers) // MOST_REFERENCES)])
        away = [
            _away(positions, pairs, known, m, np.flatnonzero(e))
            for m, e in enumerate(edges.T)
        ]
        for a, b in combinations(range(len(away)), 2):
            first, second = (b, a) if b in inside and a not in inside else (a, b)
            both = breaking[:, a] & breaking[:, b]
            ends = away[first][both[away[first]] | both[away[first] + 1]]
            if not _exchanged(
                positions[ends], pairs, inside, known, first, second
            ).any():
                continue
            here = _away(positions, pairs, known, first, np.arange(len(positions)))
            mask = np.zeros(len(positions), dtype=bool)
            mask[here] = _exchanged(
                positions[here], pairs, inside, known, first, second
            )
            for start, stop in _stretches(mask, breaks[:, a] | breaks[:, b], both):
                yield a, b, start, stop


def _stretches(
    mask: BoolArray, broken: BoolArray, both: BoolArray
) -> Iterator[tuple[int, int]]:
    """Yield the stretches of a mask (N,) that begin and end where both tracks break (N + 1,).

    A stretch may include frames in which one of the tracks is `broken` (N,).
    """
    for start, stop in runs(mask | broken):
        inside = start + np.flatnonzero(mask[start:stop])
        if len(inside) >= EXCHANGED_DISTANCES_LEAST_FRAMES:
            ends = int(inside[0]), int(inside[-1]) + 1
            if both[ends[0]] and both[ends[1]]:
                yield ends


def _away(
    positions: FloatArray,
    pairs: PairDistances,
    known: list[int],
    a: int,
    frames: IntArray,
) -> IntArray:
    """Select the frames (K,) in which a distance of marker `a` to known markers is not its own."""
    away = np.zeros(len(frames), dtype=bool)
    track = positions[:, a][frames]
    for c in known:
        if c != a:
            off = np.abs(norms(track - positions[:, c][frames]) - pairs.median[a, c])
            away |= off > OFF * max(pairs.spread[a, c], EXACT)
    return frames[away]


def _exchanged(
    positions: FloatArray,
    pairs: PairDistances,
    inside: set[int],
    known: list[int],
    a: int,
    b: int,
) -> BoolArray:
    """Mask frames (N,) in which exchanged names fit the cluster but the own names do not."""
    others = [c for c in known if c not in (a, b)]
    if not len(positions) or len(others) < (
        1 if {a, b} <= inside else 2 if a in inside else 3
    ):
        return np.zeros(len(positions), dtype=bool)
    terms = [(a, b, c) for c in others]
    if (a in inside) == (b in inside):  # otherwise the place of `b` is unknown
        terms += [(b, a, c) for c in others]
    own, exchanged = np.zeros(len(positions)), np.zeros(len(positions))
    for m, other, c in terms:
        for total, marker in ((own, m), (exchanged, other)):
            distance = norms(positions[:, marker] - positions[:, c])
            total += (
                (distance - pairs.median[m, c]) / max(pairs.spread[m, c], EXACT)
            ) ** 2
    with np.errstate(invalid="ignore"):
        fits: BoolArray = (own > OFF**2 * len(terms)) & (
            exchanged < FITS**2 * len(terms)
        )
    return fits


def norms(vectors: FloatArray) -> FloatArray:
    """Return the lengths (...) of vectors (..., 3)."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))
