"""Floor compensation: fit the floor to the feet at rest, then subtract it.

The model is z = floor(x, y) + offset(foot): a polynomial of the place, and for each
foot the height at which its marker is mounted. The offsets sum to zero, so the level of
the floor contains their mean. The degree is the highest, up to the requested one, at
which the feet at rest still determine the floor everywhere on the ground that they step
on. Few steps do not determine it, nor do feet that each stay in one place, because a
slope then looks like a mount height.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, IntArray, one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.landings import floor_surface
from hopdata.landings.sections.modes import ground_mode, robust_rms
from hopdata.recording import Recording

NOTED_SHARE = 0.05  # share of a foot's rests above the floor that is reported
NOTED_SLOPE_DEG = 1.0  # slope that is reported: cameras are levelled better than this


def _notes(
    recording: Recording,
    rest: floor_surface.RestPoints,
    raised: BoolArray,
    degrees: tuple[int, int],
    largest_error_m: float,
    ground: FloatArray,
) -> str:
    """Report feet that often rest above the floor, a lowered degree, and a slope.

    `ground` (P, 3) holds the places where the feet rest, with mount heights subtracted;
    `degrees` are the degree found and the degree requested.
    """
    notes = []
    for foot, name in enumerate(recording.names("foot")):
        if (share := float(raised[rest.foot == foot].mean())) >= NOTED_SHARE:
            told = f"{100 * share:.0f} % of its frames at rest"
            notes.append(f"{name} rests above the floor in {told} (left out)")
    found, wanted = degrees
    if found != wanted:
        notes.append(
            f"feet at rest do not fix a floor of degree {wanted} to {largest_error_m:g} m"
        )
    columns = np.column_stack([np.ones(len(ground)), ground[:, :2]])
    plane = np.linalg.lstsq(columns, ground[:, 2], rcond=None)[0]
    slope = np.rad2deg(np.arctan(np.hypot(plane[1], plane[2])))
    if found > 0 and slope >= NOTED_SLOPE_DEG:
        told = f"the floor slopes by {slope:.1f} degrees"
        notes.append(f"{told}; turn the file's axes upright if it is level")
    return "; ".join(notes)


# Rests above the floor: the foot hangs low, drags, or stands on something.
#
# Nothing is below the floor, so rests that spoil the fit lie above it, often in one
# part of the run or of the ground, where a polynomial can follow them. An M-estimator
# that starts from least squares then stays there. The fit here starts from a low
# quantile, which tolerates that most rests are raised.

_QUANTILE = 0.05
_START_POINTS = 2000  # points that suffice for the start
_MOST_FITS = 300
_STILL = 5e-5  # change of the surface at which the fits end, as a share of the band
# Height above the mode, in deviations of its left flank, at which a rest is raised
_SIGMAS = 4.0
_ROUNDS = 4
_LEAST_POINTS = 20  # fewest points that determine a ground mode
LEAST_STEPS = (
    5  # fewest steps per foot that tell raised rests from one that gave way below
)
_LEAST_SHARE = 0.02  # share of the points below which the regression copes by itself


def raised_rests(
    heights: FloatArray, columns: FloatArray, band_m: float, scale: float = 1.0
) -> BoolArray:
    """Find the rests that are above the floor.

    Parameters
    ----------
    heights : (P,) array
        Heights of feet at rest, m.
    columns : (P, T) array
        Terms of the floor and of the mount heights at each of them.
    band_m : float
        Largest distance of a resting foot from the floor, m; points farther away are
        uninformative.
    scale : float
        Scale of the recording.

    Returns
    -------
    (P,) bool array
        Rests that lie above the mode of the heights over the fitted surface by more
        than four standard deviations of the scatter below that mode. None if these are
        fewer than 2 % of the points, since a robust regression then copes by itself.

    Notes
    -----
    The first fit is a quantile regression (iterated weights, as in statsmodels'
    `QuantReg`). A few least-squares fits of the points about the mode follow.
    """
    residuals = heights - columns @ _low_surface(heights, columns, _STILL * band_m)
    raised = np.zeros(len(heights), dtype=bool)
    for _ in range(_ROUNDS):
        near = residuals[np.abs(residuals) <= band_m]
        if len(near) < _LEAST_POINTS:
            return np.zeros(len(heights), dtype=bool)
        mode = ground_mode(near, scale=scale)
        above = (residuals - mode.height_m) / mode.sigma_m
        raised, core = above > _SIGMAS, np.abs(above) <= _SIGMAS
        residuals = (
            heights
            - columns @ np.linalg.lstsq(columns[core], heights[core], rcond=None)[0]
        )
    near_floor = np.abs(residuals) <= band_m
    return raised & bool((raised & near_floor).sum() >= _LEAST_SHARE * near_floor.sum())


def _low_surface(
    heights: FloatArray, columns: FloatArray, still_m: float = 1e-6
) -> FloatArray:
    """Return coefficients of the surface with a twentieth of the points below; nearly optimal."""
    step = max(1, len(heights) // _START_POINTS)
    heights, columns = heights[::step], columns[::step]
    found, weights = np.zeros(columns.shape[1]), np.ones_like(heights)
    for _ in range(_MOST_FITS):
        before, root = found, np.sqrt(weights)
        found = np.asarray(
            np.linalg.lstsq(columns * root[:, None], heights * root, rcond=None)[0]
        )
        moved = columns @ (
            found - before
        )  # unlike the coefficients, the same in any axes
        if np.abs(moved).max() <= still_m:
            break
        residuals = heights - columns @ found
        share = np.where(residuals < 0, 1 - _QUANTILE, _QUANTILE)
        weights = share / np.maximum(np.abs(residuals), still_m)
    return np.asarray(found)


_STAYS = (
    0.01  # relative singular value below which feet stay in place and show no slope
)
_MOST_OF_PLANE = 20_000  # evenly sampled rests from which a slope of the floor is found


@one_blas_thread()
def fit_floor(
    recording: Recording,
    *,
    enabled: bool = True,
    degree: int = 5,
    rest_speed_m_s: float | None = None,
    rest_window_s: float | None = None,
    rest_band_m: float | None = None,
    largest_error_m: float | None = None,
    max_points: int = 10000,
) -> floor_surface.FloorModel:
    """Fit the floor under a recording.

    Parameters
    ----------
    recording : Recording
        With at least one foot, z up, m.
    enabled : bool
        If false, the floor is z = 0 and the offsets are zero; the residual is still
        that of the feet at rest.
    degree : int
        Highest degree of the polynomial, 0 (level) to 8.
    rest_speed_m_s : float, optional
        Largest vertical speed of a foot at rest, m/s.
    rest_window_s : float, optional
        Span of the central difference that gives this speed, s.
    rest_band_m : float, optional
        Largest distance of a resting foot from the floor, m; three times this in the
        first fit.
    largest_error_m : float, optional
        Largest standard error of the floor on the rim of the ground stepped on, m,
        where one step counts as one point. The degree is lowered until the error is met
        or the degree is 0. The defaults scale with the animal's size
        (`Recording.scale`).
    max_points : int
        Largest number of rest points used, sampled evenly.

    Raises
    ------
    AnalysisError
        If a foot is never at rest.

    Notes
    -----
    See Sec. 2.2.1 of the dissertation (compensation of the slight curvature of the
    floor). A moving floor is followed (`floor_motion`) and rests above the floor are
    left out (`raised_rests`). The floor is then fitted by robust regression with
    iteratively reweighted least squares
    (`hopdata.landings.floor_surface.robust_regression`).
    """
    rest_speed_m_s = rest_speed_m_s or floor_surface.REST_SPEED_M_S * recording.pace
    rest_band_m = rest_band_m or floor_surface.REST_BAND_M * recording.scale
    largest_error_m = largest_error_m or 0.0005 * recording.scale
    rest = floor_surface.rest_points(
        recording, speed_m_s=rest_speed_m_s, window_s=rest_window_s
    )
    if not enabled:
        return _zero_floor(recording, rest, degree)
    _require_rest(recording, rest, rest_speed_m_s)
    moved = floor_motion(rest)
    rest.points[:, 2] -= np.interp(rest.time, *moved)
    rest = rest.take(_near_floor(rest, 3 * rest_band_m))
    n_steps, turned = rest.n_steps, turning(rest)
    rest = floor_surface.thinned(rest, max_points)
    rest = rest.take(_in_order(rest))  # later steps take every k-th point
    axis = floor_surface.own_axis(rest.points[:, :2])
    middle = rest.points[:, :2].mean(axis=0)
    around = floor_surface.along(rest.points[:, :2] - middle, axis)
    low, high = np.quantile(around, [0.005, 0.995], axis=0)  # the ground stepped on
    scale = max(0.5 * float(np.max(high - low)), 1e-3 * recording.scale)
    off_middle = 0.5 * (low + high)
    scaled = (around - off_middle) / scale
    centre = (
        middle + off_middle[0] * axis + off_middle[1] * np.array([-axis[1], axis[0]])
    )
    share = min(1.0, n_steps / len(rest.foot))
    by: Any = {
        "degree": degree,
        "largest_error_m": largest_error_m,
        "independent_share": share,
    }
    first = floor_surface.regress_floor(
        rest, scaled, np.full(len(rest.foot), True), **by
    )
    columns = floor_surface.floor_columns(rest, scaled, first.terms)
    raised = raised_rests(rest.points[:, 2], columns, rest_band_m, recording.scale)
    raised &= n_steps >= LEAST_STEPS * len(first.offsets_m)
    used = (np.abs(first.residuals) <= rest_band_m) & ~raised
    if not used.any():
        found = "them at different heights (on a box, or never still? or does the floor move?)"
        found += "; raise floor.rest_band_m, or set floor.enabled to false"
        wanted = f"feet at rest within {rest_band_m:.3g} m of a floor"
        raise AnalysisError.at(f"{recording.name}: floor", wanted, found)
    fit = floor_surface.regress_floor(rest, scaled, used, **by)
    raised &= np.abs(fit.residuals) <= rest_band_m
    rms = robust_rms(fit.residuals[used])
    inlier = used & (np.abs(fit.residuals) <= floor_surface.BIWEIGHT * rms)
    ground = rest.points - fit.offsets_m[rest.foot][:, None] * [0.0, 0.0, 1.0]
    rim = floor_surface.rim_of(scaled[inlier], floor_surface.RIM_DIRECTIONS) * scale
    note = _notes(
        recording, rest, raised, (fit.degree, degree), largest_error_m, ground[inlier]
    )
    note = "; ".join(filter(None, [_told_motion(moved[1]), turned, note]))
    n = int((used | raised).sum())
    feet = recording.names("foot")
    n_outliers = n - int(inlier.sum())
    own = (
        feet,
        fit.offsets_m,
        rms,
        n,
        n_outliers,
        fit.degree,
        degree,
        note,
        *moved,
        axis,
    )
    return floor_surface.FloorModel(
        fit.terms, fit.coefficients_m, centre, scale, rim, *own
    )


# A floor that moves up and down: the deck of a treadmill or ship, or a floor under
# sinking cameras.

# A foot's rest gives one point per span, s; a rest shorter than the second, s, may be
# in the air.
_SPAN_S, _REST_S = 0.3, 0.04
_LEAST_RESTS = 10  # fewest rests per foot: two jumps on a soft sole prove nothing
_LEAST_MOVE_M, _FOLLOWED_M = 0.005, 0.15  # range of a moving floor, m; a box is higher
# Distance from the mode, in ranges of nine in ten rests, of a foot in the air; and the
# quantile of the motion beyond which disagreement between feet is judged, since feet
# that roll alike differ there.
_SELDOM, _FAR = 5.0, 0.9
# Smallest turn of the floor between the halves, degrees, and the factor by which
# residuals must grow if it is ignored.
_TURNED_DEG, _TURN_SHOWS = 0.3, 1.3
# Smallest ratio of the motion to the disagreement of feet that rest in succession:
# chance gives 3.5, a hand that lifts slowly 8, a moving deck 50.
_MOVE_PER_APART = 12.0


def floor_motion(rest: floor_surface.RestPoints) -> tuple[FloatArray, FloatArray]:
    """Find how a floor moves up and down, from feet at rest that rise and fall together.

    Return instants (W,), s, and the height of the floor at each, (W,), m, beyond what a
    floor of degree 2 and the mount heights explain. Both are a single 0 if nine in ten
    rests are within 5 mm of each other, or if the feet disagree.
    """
    still, n_feet = (np.zeros(1), np.zeros(1)), len(rest.start_m)
    rest = rest.take(
        (np.abs(rest.above_mode) <= _FOLLOWED_M * rest.scale) & ~rest.let_go
    )
    steps = _settled(rest) if len(rest.foot) else rest
    if n_feet < 2 or min(len(steps.foot), rest.n_steps) < _LEAST_RESTS * n_feet:
        return still
    least_m = (
        _LEAST_MOVE_M * rest.scale
    )  # rare rests farther off than this are in the air
    usual_m = max(_SELDOM * _range(steps.above_mode), least_m)
    steps = steps.take(np.abs(steps.above_mode) <= usual_m)
    place = _in_own_axes(steps.points[:, :2])
    terms = floor_surface.design(place, floor_surface.polynomial_terms(2))
    columns = np.hstack([np.eye(n_feet)[steps.foot], terms[:, 1:]])
    height, other = steps.points[:, 2], np.diff(steps.foot) != 0
    at_once = (
        np.diff(columns, axis=0)[other],
        np.diff(height)[other],
    )  # cancels the floor's motion
    fits = [
        np.linalg.lstsq(a, b, rcond=_STAYS)[0] for a, b in ((columns, height), at_once)
    ]
    apart = np.abs(at_once[1] - at_once[0] @ fits[1])
    lines = np.stack([steps.time, *(height - columns @ fit for fit in fits)])
    around = np.lib.stride_tricks.sliding_window_view(lines, max(n_feet, 3), axis=1)
    when, beyond_place, moved = np.median(around, axis=2)
    far = np.argsort(
        np.abs(np.interp(steps.time[1:][other], when, moved) - np.median(moved))
    )
    apart = max(np.median(apart), np.median(apart[far[int(_FAR * len(far)) :]]))
    if _range(beyond_place) > least_m and _range(moved) > _MOVE_PER_APART * apart:
        return when, moved + np.median(
            steps.above_mode - np.interp(steps.time, when, moved)
        )
    return still


def _settled(rest: floor_surface.RestPoints) -> floor_surface.RestPoints:
    """Return one point for each foot and span in which it rests, in order of time.

    The first of several spans is left out, because a soft sole settles in it. Each
    point is a lower quartile, because a foot in the air is above the floor.
    """
    span_s, least_s = _SPAN_S * np.sqrt(rest.scale), _REST_S * np.sqrt(rest.scale)
    begins = (np.diff(rest.foot, prepend=-1) != 0) | (
        np.diff(rest.time, prepend=0) > span_s
    )
    one = np.cumsum(begins)
    span = ((rest.time - rest.time[begins][one - 1]) / span_s).astype(int)
    order = np.lexsort((rest.points[:, 2], span, one))
    first = np.flatnonzero(
        np.diff(one[order], prepend=0) | np.diff(span[order], prepend=0)
    )
    count = np.diff(first, append=len(order))
    frame_s = np.diff(np.unique(rest.time[:1000])).min(initial=np.inf)
    goes_on = np.append(np.diff(one[order[first]]) == 0, False)
    kept = (count >= least_s / frame_s) & ((span[order[first]] > 0) | ~goes_on)
    lower = rest.take(order[(first + count // 4)[kept]])
    return lower.take(_in_order(lower))


def _in_order(rest: floor_surface.RestPoints) -> IntArray:
    """Return the order of the points in time; heights, not numbers of feet, decide within one."""
    return np.lexsort((rest.points[:, 2], rest.time))


def _in_own_axes(places: FloatArray) -> FloatArray:
    """Return places (P, 2) about their mean, in their own axes, with the farthest at 1."""
    around = floor_surface.along(
        places - places.mean(axis=0), floor_surface.own_axis(places)
    )
    return np.asarray(around / np.hypot(around[:, 0], around[:, 1]).max())


def _range(moved_m: FloatArray) -> float:
    return float(np.subtract(*np.quantile(moved_m, [0.95, 0.05])))


def moving(recording: Recording) -> str:
    """Report how far the floor under a recording moves, and what to do; empty if it does not."""
    rest = floor_surface.rest_points(recording)
    moved = floor_motion(rest)
    rest.points[:, 2] -= np.interp(rest.time, *moved)
    rest = rest.take(_near_floor(rest, 3 * floor_surface.REST_BAND_M * recording.scale))
    return "; ".join(filter(None, [_told_motion(moved[1]), turning(rest)]))


def turning(rest: floor_surface.RestPoints) -> str:
    """Report if the floor is tilted in the second half of a recording; empty if it is not."""
    rest = floor_surface.thinned(rest, _MOST_OF_PLANE)
    if len(np.unique(rest.foot)) < 2 or rest.n_steps < _LEAST_RESTS * len(rest.start_m):
        return ""
    late = (rest.time > np.median(rest.time))[:, None]
    at = rest.points[:, :2] - rest.points[:, :2].mean(axis=0)
    place = _in_own_axes(rest.points[:, :2])
    bends = floor_surface.design(place, floor_surface.polynomial_terms(3))[:, 1:]
    still = np.hstack([np.eye(len(rest.start_m))[rest.foot], bends, late])
    columns = np.hstack([still, late * at])
    height = rest.points[:, 2]
    fits = [floor_surface.robust_regression(one, height) for one in (still, columns)]
    left = [
        robust_rms(height - c @ fit)
        for c, fit in zip((still, columns), fits, strict=True)
    ]
    turned = np.rad2deg(np.hypot(*fits[1][-2:]))
    if turned < _TURNED_DEG or left[0] < _TURN_SHOWS * left[1]:
        return ""
    told = f"the floor is tilted by {turned:.1f} degrees in the second half"
    why = "it or the cameras turned, which is not followed, or a foot's marker moved"
    return f"{told}: {why}; split the recording in two"


def _told_motion(moved_m: FloatArray) -> str:
    if len(moved_m) < 2:
        return ""
    far = f"all feet at rest rise and fall together by {1e3 * _range(moved_m):.0f} mm"
    better = "better still, export positions relative to a marker on it"
    return f"the floor moves: {far}; hopdata uses them to follow it; {better}"


@one_blas_thread()
def level(
    recording: Recording, floor: floor_surface.FloorModel, *, overwrite: bool = False
) -> Recording:
    """Subtract the floor from a recording, so that feet at rest have height 0.

    Parameters
    ----------
    recording : Recording
        Recording with the feet of `floor`, in the same order.
    floor : FloorModel
        Floor to subtract.
    overwrite : bool
        Work in the memory of the recording, whose own positions are lost.

    Returns
    -------
    Recording
        The same recording with the floor's height at the marker's (x, y) and time
        subtracted from each marker's z, and the foot's offset from each foot's z as
        well. NaN stays NaN.
    """
    if recording.names("foot") != floor.feet:
        raise ValueError(
            f"feet: expected {floor.feet}, found {recording.names('foot')}"
        )
    positions = recording.positions if overwrite else recording.positions.copy()
    if len(floor.moved_s) > 1:
        positions[:, :, 2] -= np.interp(recording.time, floor.moved_s, floor.moved_m)[
            :, None
        ]
    for first in range(0, len(positions), floor_surface.CHUNK):
        part = positions[first : first + floor_surface.CHUNK]
        part[:, :, 2] -= floor.height(part[:, :, 0], part[:, :, 1])
    positions[:, recording.indices("foot"), 2] -= floor.foot_offsets_m
    return replace(recording, positions=positions)


def _near_floor(rest: floor_surface.RestPoints, reach_m: float) -> BoolArray:
    """Mark the rests within reach of a level floor, or of a plane if the floor slopes, (P,)."""
    near = np.abs(rest.above_mode) <= reach_m
    few = floor_surface.few_of(rest.time, _MOST_OF_PLANE)
    heights, columns, told = (
        rest.points[few, 2],
        _columns_of_plane(rest, few),
        near[few],
    )
    for _ in range(_ROUNDS):
        plane = np.linalg.lstsq(columns[told], heights[told], rcond=_STAYS)[0]
        if np.hypot(plane[-2], plane[-1]) < np.tan(np.deg2rad(NOTED_SLOPE_DEG)):
            break
        told = np.abs(heights - columns @ plane) <= reach_m
        near = np.abs(rest.points[:, 2] - _columns_of_plane(rest) @ plane) <= reach_m
    return np.asarray(near)


def _columns_of_plane(
    rest: floor_surface.RestPoints, rows: BoolArray | slice = slice(None)
) -> FloatArray:
    middle = rest.points[:, :2].sum(axis=0) / max(
        len(rest.points), 1
    )  # may be far from the origin
    places = rest.points[rows, :2] - middle
    return np.hstack([rest.scale * np.eye(len(rest.start_m))[rest.foot[rows]], places])


def _require_rest(
    recording: Recording, rest: floor_surface.RestPoints, speed_m_s: float
) -> None:
    """Raise an error that names the feet that are hardly ever at rest."""
    if not (names := recording.names("foot")):
        raise AnalysisError.at(f"{recording.name}: floor", "at least one foot", "none")
    moving = [
        name for name, start in zip(names, rest.start_m, strict=True) if np.isnan(start)
    ]
    if moving:
        raise AnalysisError(
            f"{recording.name}: floor: {', '.join(moving)} hardly ever at rest (slower than "
            f"{speed_m_s:.3g} m/s up or down); raise floor.rest_speed_m_s, set floor.enabled to "
            "false, or leave this recording out"
        )


def _zero_floor(
    recording: Recording, rest: floor_surface.RestPoints, degree: int
) -> floor_surface.FloorModel:
    """Return the floor z = 0, with the residual of the feet at rest on it."""
    n_feet, n = len(rest.start_m), len(rest.foot)
    rms = robust_rms(rest.points[:, 2]) if n else float("nan")
    rim, note = (
        np.ones(floor_surface.RIM_DIRECTIONS),
        "not compensated: floor.enabled is false",
    )
    own = (recording.names("foot"), np.zeros(n_feet), rms, n, 0, 0, degree, note)
    return floor_surface.FloorModel(((0, 0),), np.zeros(1), np.zeros(2), 1.0, rim, *own)
