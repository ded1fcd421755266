"""The floor's surface: a polynomial inside a rim, and the mount heights of the feet."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.polynomial.polynomial import polyvander
from numpy.typing import ArrayLike, NDArray

from hopdata.arrays import FloatArray, IntArray
from hopdata.landings.sections.modes import ground_mode, robust_rms
from hopdata.recording import Recording

# Frames in which a foot is at rest: hardly moving up or down, and low.

_LEAST_FRAMES = 20  # fewest frames at rest that a foot needs
_SHORT_FRAMES = (
    1000  # recordings this short hold a jump or two, so feet may rest less still
)
BIWEIGHT = 4.685  # deviations at which Tukey's weight reaches zero (95 % efficiency)
# For an animal of 1 m; others are multiplied by `Recording.scale`, or its square root.
REST_SPEED_M_S, REST_WINDOW_S, REST_BAND_M = 0.05, 0.04, 0.02
_PAUSE_S = 0.1  # time not at rest that ends a rest, s
_LEVEL_M = (
    0.06  # range of the heights of a foot at rest on one floor, however uneven, m
)
_LET_GO_S, _LET_GO_M = (
    0.15,
    0.02,
)  # within this time after a rest, a foot that sinks this far fell


@dataclass(frozen=True)
class RestPoints:
    """Feet at rest.

    Parameters
    ----------
    points : (P, 3) array
        Marker positions, m, z up.
    foot : (P,) array of int8
        Number of the foot, from 0 in the order of the recording.
    time : (P,) array
        Time of each point, s.
    start_m : (n,) array
        Ground mode of each foot's resting heights, m; NaN for a foot that never rests.
    let_go : (P,) bool array
        Whether the foot fell when its rest ended: it was held, or stood on something.
    scale : float
        Scale of the recording.
    """

    points: FloatArray
    foot: NDArray[np.int8]
    time: FloatArray
    start_m: FloatArray
    let_go: NDArray[np.bool_]
    scale: float = 1.0

    @property
    def above_mode(self) -> FloatArray:
        """Height of each point above its foot's ground mode, (P,), m."""
        return self.points[:, 2] - self.start_m[self.foot]

    @property
    def n_steps(self) -> int:
        """Number of times that a foot came to rest (a pause of 0.1 s ends a rest)."""
        pause_s = _PAUSE_S * np.sqrt(self.scale)
        apart = (np.diff(self.foot) != 0) | (np.diff(self.time) > pause_s)
        return int(apart.sum()) + (len(self.foot) > 0)

    def take(self, keep: NDArray[Any] | slice) -> Self:
        """Return the points that `keep` selects."""
        per_point = ("points", "foot", "time", "let_go")
        return replace(self, **{name: getattr(self, name)[keep] for name in per_point})


def rest_points(
    recording: Recording,
    *,
    speed_m_s: float | None = None,
    window_s: float | None = None,
) -> RestPoints:
    """Collect the frames in which feet are at rest.

    Only the vertical speed counts, because on a treadmill a foot on the ground travels.

    Parameters
    ----------
    recording : Recording
        With at least one foot.
    speed_m_s : float, optional
        Largest vertical speed of a foot at rest, m/s.
    window_s : float, optional
        Span of the central difference, s; at least one frame to either side. A frame
        counts only if the marker is seen there and at both ends of the span.

    Returns
    -------
    RestPoints
        All slow frames, including high ones, which the caller removes because it knows
        the floor. If these are too few in a recording of a jump or two, the speed limit
        is up to four times higher.
    """
    speed_m_s = speed_m_s or REST_SPEED_M_S * recording.pace
    lag = max(
        1, round(0.5 * (window_s or REST_WINDOW_S * recording.pace) * recording.rate_hz)
    )
    n_feet = recording.feet.shape[1]
    frames, let_go, start = [], [np.empty(0, dtype=bool)], np.full(n_feet, np.nan)
    for foot in range(n_feet):
        height = recording.feet[:, foot, 2]
        speed = np.abs(vertical_speed(recording.time, height, lag=lag))
        speed = np.where(
            np.isfinite(recording.feet[:, foot]).all(axis=1), speed, np.nan
        )
        for more in (1.0, 2.0, 4.0) if len(speed) <= _SHORT_FRAMES else (1.0,):
            slow = np.flatnonzero(speed < more * speed_m_s)
            if len(slow) >= _LEAST_FRAMES:
                start[foot] = _ground_of(
                    recording.time[slow], height[slow], recording.scale
                )
                break
        else:
            slow = slow[:0]
        frames.append(slow)
        let_go.append(_let_go(recording, height, slow))
    foot_of = np.repeat(np.arange(n_feet, dtype=np.int8), [len(f) for f in frames])
    frame_of = np.concatenate([np.empty(0, dtype=np.int64), *frames])
    points = recording.feet[frame_of, foot_of]
    own = (points, foot_of, recording.time[frame_of], start, np.concatenate(let_go))
    return RestPoints(*own, recording.scale)


def _let_go(
    recording: Recording, height: FloatArray, slow: IntArray
) -> NDArray[np.bool_]:
    """Mark the slow frames of a foot, (K,), that belong to a rest after which the foot falls."""
    long = np.diff(recording.time[slow], append=np.inf) > _PAUSE_S * recording.pace
    ends = slow[long]
    ahead = np.arange(1 + round(_LET_GO_S * recording.pace * recording.rate_hz))
    after = height[np.minimum(ends[:, None] + ahead, len(height) - 1)]
    fell = np.fmin.reduce(after, axis=1) < height[ends] - _LET_GO_M * recording.scale
    return np.asarray(np.repeat(fell, np.diff(np.flatnonzero(long), prepend=-1)))


def _ground_of(time: FloatArray, heights: FloatArray, scale: float) -> float:
    """Return the height on which a foot rests, m; of a box and the ground, the one used more often.

    Each rest counts by its duration, but by 0.1 s at most, because an animal stands for
    long before it jumps. The lowest level with at least half the weight of the heaviest
    is taken.
    """
    mode = ground_mode(heights, scale=scale).height_m
    pause_s, level_m = _PAUSE_S * np.sqrt(scale), _LEVEL_M * scale
    rest = np.cumsum(np.diff(time, prepend=time[0]) > pause_s)
    weight = 1 / np.maximum(np.bincount(rest) * np.diff(time).min(), pause_s)
    levels, sums = (
        np.sort(heights),
        np.cumsum(np.append(0, weight[rest[np.argsort(heights)]])),
    )
    share = sums[np.searchsorted(levels, levels + level_m, side="right")] - sums[:-1]
    lowest = levels[np.argmax(share >= 0.5 * share.max())]
    on_it = levels[(levels >= lowest) & (levels <= lowest + level_m)]
    return float(np.median(on_it)) if lowest + level_m < mode else mode


def thinned(rest: RestPoints, max_points: int) -> RestPoints:
    """Keep the points of every k-th instant, so that about `max_points` remain."""
    return rest.take(few_of(rest.time, max_points))


def few_of(time: FloatArray, max_points: int) -> NDArray[np.bool_]:
    """Mark the points (P,) of every k-th instant, so that about `max_points` are marked.

    Instants are kept whole, so the choice does not depend on the order of the feet.
    """
    if not len(time):
        return np.zeros(0, dtype=bool)
    step = max(1, -(-len(time) // max_points))
    kept = np.unique(time)[::step]
    place = np.searchsorted(kept[1:], time, side="right")
    return np.asarray(kept[place] == time)


def own_axis(places: FloatArray) -> FloatArray:
    """Return the unit vector (2,) along which places (P, 2) spread most; its sign is arbitrary.

    The axes of the laboratory are nobody's choice. What is measured along this one and
    across it is the same for a recording that was turned about the vertical.
    """
    from_mean = places - places.mean(axis=0)
    return np.asarray(np.linalg.eigh(from_mean.T @ from_mean)[1][:, -1])


def along(places: FloatArray, axis: FloatArray) -> FloatArray:
    """Return places (P, 2) in coordinates along a unit vector (2,) and to its left."""
    left = np.array([-axis[1], axis[0]])
    return np.asarray(places @ np.stack([axis, left], axis=1))


def vertical_speed(time: FloatArray, height: FloatArray, *, lag: int) -> FloatArray:
    """Return the central difference over `lag` frames to either side, (N,), m/s; NaN in gaps."""
    speed = np.full(len(time), np.nan)
    if len(time) > 2 * lag:
        span = time[2 * lag :] - time[: -2 * lag]
        speed[lag:-lag] = (height[2 * lag :] - height[: -2 * lag]) / span
    speed[np.isnan(height)] = np.nan
    return speed


Terms = tuple[tuple[int, int], ...]

CHUNK = 8192  # frames whose floor is computed together, to bound memory


@dataclass(frozen=True)
class FloorModel:
    """A floor surface and the mount heights of the feet.

    Parameters
    ----------
    terms : tuple of (int, int)
        Exponents (i, j) of u^i v^j. The scaled coordinates u and v are the distances
        from the centre along `axis` and to its left, divided by `scale_m`.
    coefficients_m : (T,) array
        Coefficient of each term, m.
    centre_m : (2,) array
        Origin of the scaled coordinates, m.
    scale_m : float
        Unit of the scaled coordinates, m.
    rim_m : (K,) array
        Reach of the rest points from the centre in K directions, equally spaced from
        `axis` towards its left, m. The floor is known inside the polygon of these K
        half-planes.
    feet : tuple of str
        Names of the feet.
    foot_offsets_m : (n,) array
        Height of each foot's marker above the mean of all feet, m; sums to zero.
    residual_rms_m : float
        Robust deviation of the rest points from the model (1.4826 median |residual|),
        m.
    n_points, n_outliers : int
        Number of rest points near the floor, and how many of them the fit rejects,
        including raised ones.
    degree, degree_wanted : int
        Degree of the polynomial, and the degree requested. The first is lower if the
        feet at rest do not cover enough ground.
    note : str
        Whether the floor moves, which feet often rest above it, why the degree is
        lower, or that compensation is off; empty if there is nothing to report.
    moved_s, moved_m : (W,) arrays
        Instants, s, and the rise of the floor at each, m; a single 0 if it does not
        move.
    axis : (2,) array
        Unit vector in the world along which the rest points spread most.
    """

    terms: Terms
    coefficients_m: FloatArray
    centre_m: FloatArray
    scale_m: float
    rim_m: FloatArray
    feet: tuple[str, ...]
    foot_offsets_m: FloatArray
    residual_rms_m: float
    n_points: int
    n_outliers: int
    degree: int
    degree_wanted: int
    note: str = ""
    moved_s: FloatArray = field(default_factory=lambda: np.zeros(1))
    moved_m: FloatArray = field(default_factory=lambda: np.zeros(1))
    axis: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0]))

    def height(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the floor's height, m, at places (x, y) of any shape; NaN where a place is NaN.

        A place beyond the rim of the ground stepped on is first moved straight towards
        the centre onto the rim, so that the polynomial never extrapolates.
        """
        place = np.stack(np.broadcast_arrays(x, y), axis=-1).astype(np.float64)
        heights = (
            design(self._scaled(place.reshape(-1, 2)), self.terms) @ self.coefficients_m
        )
        return np.asarray(heights).reshape(place.shape[:-1])

    def _scaled(self, place: FloatArray) -> FloatArray:
        """Scale places (P, 2), and move those beyond the rim onto it."""
        scaled = along(place - self.centre_m, self.axis) / self.scale_m
        return within_rim(scaled, self.rim_m / self.scale_m)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers and lists, for JSON."""
        fields = vars(self).items()
        out = {
            name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in fields
        }
        if np.isnan(self.residual_rms_m):
            out["residual_rms_m"] = None  # JSON has no NaN
        return out | {
            "terms": [list(term) for term in self.terms],
            "feet": list(self.feet),
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Self:
        """Make the model from the fields that `to_dict` returns."""
        arrays = [
            "coefficients_m",
            "centre_m",
            "rim_m",
            "foot_offsets_m",
            "moved_s",
            "moved_m",
        ]
        if "axis" in fields:  # files of earlier versions have u along x
            arrays.append("axis")
        made = dict(fields) | {
            name: np.array(fields[name], dtype=float) for name in arrays
        }
        made["terms"] = tuple((int(i), int(j)) for i, j in fields["terms"])
        made["feet"] = tuple(fields["feet"])
        made["residual_rms_m"] = float(np.array(fields["residual_rms_m"], dtype=float))
        return cls(**made)


def design(scaled: FloatArray, terms: Terms) -> FloatArray:
    """Return the columns u^i v^j, (P, T), for places (P, 2) in scaled coordinates."""
    u, v = polyvander(scaled.T, max(map(max, terms))).transpose(0, 2, 1)
    return np.stack([u[i] * v[j] for i, j in terms]).T


def polynomial_terms(degree: int) -> Terms:
    """List the exponents (i, j) with i + j <= `degree`, by total degree."""
    return tuple(
        (total - j, j) for total in range(degree + 1) for j in range(total + 1)
    )


def rim_of(places: FloatArray, n_directions: int) -> FloatArray:
    """Return the reach of places (P, 2) from the origin in equally spaced directions, (K,)."""
    reach = (places @ directions(n_directions).T).max(axis=0)
    return np.maximum(reach, 1e-6 * np.abs(reach).max())


def within_rim(places: FloatArray, rim: FloatArray) -> FloatArray:
    """Move places (P, 2) beyond the rim towards the origin onto the rim."""
    moved = np.array(places, dtype=np.float64)
    outer = np.flatnonzero(
        np.einsum("pk,pk->p", places, places) > max(rim.min(), 0.0) ** 2
    )
    beyond = np.max(places[outer] @ directions(len(rim)).T / rim, axis=1)
    moved[outer] /= np.maximum(beyond, 1.0)[:, np.newaxis]
    return moved


def directions(n: int) -> FloatArray:
    """Make unit vectors (n, 2), equally spaced from the first axis towards the second."""
    angle = 2.0 * np.pi * np.arange(n) / n
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


# Robust regression of the floor, at the highest degree that the feet at rest determine.

RIM_DIRECTIONS = 24  # the polygon overshoots a round rim by at most 0.9 %
_COLLINEAR = 1e-6  # relative singular value below which columns are collinear


@dataclass(frozen=True)
class FloorRegression:
    """Outcome of one regression.

    Parameters
    ----------
    terms, coefficients_m : tuple, (T,) array
        Exponents of the polynomial, and the coefficients, m.
    offsets_m : (n,) array
        Mount heights of the feet, m; they sum to zero.
    residuals : (P,) array
        Residuals of all rest points, including those not fitted, m.
    degree : int
        Degree of the polynomial.
    """

    terms: Terms
    coefficients_m: FloatArray
    offsets_m: FloatArray
    residuals: FloatArray
    degree: int


def regress_floor(
    rest: RestPoints,
    scaled: FloatArray,
    near: NDArray[np.bool_],
    *,
    degree: int,
    largest_error_m: float,
    independent_share: float,
) -> FloorRegression:
    """Fit floor and mount heights at the highest degree that is accurate enough.

    Parameters
    ----------
    rest : RestPoints
        Feet at rest.
    scaled : (P, 2) array
        Their places in scaled coordinates.
    near : (P,) bool array
        Points to fit.
    degree : int
        Highest degree to try.
    largest_error_m : float
        Largest standard error of the floor on its rim, m.
    independent_share : float
        Share of independent points, 0 to 1; the points of one step share their error.
    """
    contrasts = _sum_to_zero(len(rest.start_m))
    far = 1e3 * directions(RIM_DIRECTIONS)
    rim = within_rim(far, rim_of(scaled[near], RIM_DIRECTIONS))
    for tried in range(degree, -1, -1):
        terms = polynomial_terms(tried)
        columns = floor_columns(rest, scaled, terms)
        spread = _floor_spread(columns[near], design(rim, terms))
        if tried > 0 and not np.isfinite(spread):
            continue
        estimate = robust_regression(columns[near], rest.points[near, 2])
        residuals = rest.points[:, 2] - columns @ estimate
        error_m = robust_rms(residuals[near]) * spread / np.sqrt(independent_share)
        if tried == 0 or error_m <= largest_error_m:
            break
    n_terms = len(terms)
    offsets = contrasts @ estimate[n_terms:]
    return FloorRegression(terms, estimate[:n_terms], offsets, residuals, tried)


def robust_regression(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Regress values (n,) on columns (n, k) with little weight on outliers, (k,).

    These are M-estimates with Tukey's biweight (c = 4.685), with weights iterated until
    the coefficients are stationary. The scale is the median absolute residual.
    statsmodels' `RLM` gives the same result, but takes longer to load than the rest of
    the job to run.
    """
    found = np.linalg.lstsq(columns, values, rcond=None)[0]
    for _ in range(100):
        residuals = values - columns @ found
        scale = robust_rms(residuals)
        if scale <= np.finfo(float).eps * np.abs(values).max(
            initial=0.0
        ):  # a perfect fit
            break
        root = np.clip(
            1 - (residuals / scale / BIWEIGHT) ** 2, 0, None
        )  # root of the weights
        before = found
        found = np.linalg.lstsq(columns * root[:, None], values * root, rcond=None)[0]
        if np.abs(found - before).max() <= 1e-10 * scale:
            break
    return np.asarray(found)


def floor_columns(rest: RestPoints, scaled: FloatArray, terms: Terms) -> FloatArray:
    """Return polynomial terms at places (P, 2) and contrasts of the mounts, (P, T + n - 1)."""
    return np.hstack(
        [design(scaled, terms), _sum_to_zero(len(rest.start_m))[rest.foot]]
    )


def _floor_spread(columns: FloatArray, rim: FloatArray) -> float:
    """Return the largest standard error on the rim for unit residuals; inf if undetermined.

    The error is that of the floor alone, without the offset of the foot that stands on
    it. If each foot stays in its own place, the data cannot separate a slope from mount
    heights and determine only their sum. The rim is where a polynomial is least
    certain.
    """
    _, values, right = np.linalg.svd(columns, full_matrices=False)
    if len(columns) <= columns.shape[1] or values[-1] < _COLLINEAR * values[0]:
        return float("inf")
    errors = rim @ (right / values[:, np.newaxis]).T[: rim.shape[1]]
    return float(np.linalg.norm(errors, axis=1).max())


def _sum_to_zero(n_feet: int) -> FloatArray:
    """Return contrasts (n, n - 1) that span all offsets that sum to zero."""
    return np.vstack([np.eye(n_feet - 1), -np.ones((1, n_feet - 1))])
