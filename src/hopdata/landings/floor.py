"""Floor compensation: fit the floor to the feet at rest, then subtract it.

The model is z = floor(x, y) + offset(foot): a polynomial of the place, and for each
foot the height at which its marker is mounted. The offsets sum to zero, so the level of
the floor contains their mean. The degree is the highest, up to the requested one, at
which the feet at rest still determine the floor everywhere on the ground that they step
on. Few steps do not determine it, nor do feet that each stay in one place, because a
slope then looks like a mount height.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hopdata.arrays import BoolArray, FloatArray, one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.landings.floor_motion import (
    MOST_OF_PLANE,
    STAYS,
    floor_motion,
    in_order,
    motion_messages,
    turn_messages,
)
from hopdata.landings.floor_raised import raised_rests
from hopdata.landings.floor_rests import (
    REST_BAND_M,
    REST_SPEED_M_S,
    RestPoints,
    few_of,
    rest_points,
    thinned,
    without_long_rests,
)
from hopdata.landings.floor_surface import (
    BIWEIGHT,
    CHUNK,
    RIM_DIRECTIONS,
    SLOPES,
    FloorModel,
    along,
    floor_columns,
    own_axis,
    regress_floor,
    rim_of,
)
from hopdata.landings.sections.modes import robust_rms
from hopdata.landings.treads import rests_elsewhere
from hopdata.messages import Message
from hopdata.recording import Recording

#: Share of a foot's rests above the floor that is reported.
#: Unit: 1. Origin: chosen.
NOTED_SHARE = 0.05

#: Slope that is reported: cameras are levelled better than this.
#: Unit: degrees. Origin: chosen.
NOTED_SLOPE_DEG = 1.0

#: Fewest steps per foot that tell raised rests from one that gave way below.
#: Unit: steps. Origin: chosen.
LEAST_STEPS = 5

#: Largest standard error of the floor on its rim, for an animal of 1 m.
#: Unit: m. Origin: chosen.
LARGEST_ERROR_M = 0.0005

#: Distance from the floor up to which rests take part in the first fit, in bands.
#: Unit: bands. Origin: chosen.
FIRST_BANDS = 3

#: Quantiles of the places of the rests between which the ground stepped on lies.
#: Unit: 1. Origin: chosen.
GROUND_QUANTILES = (0.005, 0.995)

#: Smallest half width of the ground stepped on, for an animal of 1 m.
#: Unit: m. Origin: chosen.
LEAST_GROUND_M = 1e-3

#: Rounds in which the plane under a sloping floor is found anew.
#: Unit: 1. Origin: chosen.
PLANE_ROUNDS = 4


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
) -> FloorModel:
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
    if not rest_speed_m_s:
        rest_speed_m_s = REST_SPEED_M_S * recording.time_scale
    if not rest_band_m:
        rest_band_m = REST_BAND_M * recording.scale
    if not largest_error_m:
        largest_error_m = LARGEST_ERROR_M * recording.scale
    rest = rest_points(recording, speed_m_s=rest_speed_m_s, window_s=rest_window_s)
    if not enabled:
        return _zero_floor(recording, rest, degree)
    _require_rest(recording, rest, rest_speed_m_s)

    # The motion of the floor is taken off, then all that is far from the floor.
    moved_s, moved_m = floor_motion(rest)
    rest.points[:, 2] -= np.interp(rest.time, moved_s, moved_m)
    rest = rest.take(_near_floor(rest, FIRST_BANDS * rest_band_m))
    n_steps = rest.n_steps
    turned = turn_messages(rest)
    rest = thinned(without_long_rests(rest), max_points)
    rest = rest.take(in_order(rest))  # later steps take every k-th point
    ground = _ground_of(rest)

    # A first fit to all rests, by which raised ones are found; then one without them.
    independent_share = min(1.0, n_steps / len(rest.foot))
    first = regress_floor(
        rest,
        ground.scaled,
        np.full(len(rest.foot), True),
        degree=degree,
        largest_error_m=largest_error_m,
        independent_share=independent_share,
    )
    columns = floor_columns(rest, ground.scaled, first.terms)
    raised = raised_rests(rest.points[:, 2], columns, rest_band_m, recording.scale)
    raised &= n_steps >= LEAST_STEPS * len(first.offsets_m)
    used = (np.abs(first.residuals) <= rest_band_m) & ~raised
    if not used.any():
        raise AnalysisError.at(
            f"{recording.name}: floor",
            f"feet at rest within {rest_band_m:.3g} m of a floor",
            "them at different heights (on a box, or never still? or does the floor "
            "move?); raise floor.rest_band_m, or set floor.enabled to false",
        )
    fit = regress_floor(
        rest,
        ground.scaled,
        used,
        degree=degree,
        largest_error_m=largest_error_m,
        independent_share=independent_share,
    )

    raised &= np.abs(fit.residuals) <= rest_band_m
    rms_m = robust_rms(fit.residuals[used])
    inlier = used & (np.abs(fit.residuals) <= BIWEIGHT * rms_m)
    messages = [*motion_messages(moved_m), *turned]
    messages += _raised_messages(recording, rest, raised)
    if fit.degree != degree:
        values = {"wanted": degree, "largest_error_m": largest_error_m}
        messages.append(Message("landings.floor_degree_lowered", values))
    if fit.degree > 0:
        without_mounts = rest.points - fit.offsets_m[rest.foot][:, None] * [0, 0, 1.0]
        messages += _slope_messages(without_mounts[inlier])
    n_points = int((used | raised).sum())
    model = FloorModel(
        terms=fit.terms,
        coefficients_m=fit.coefficients_m,
        centre_m=ground.centre_m,
        scale_m=ground.half_width_m,
        rim_m=rim_of(ground.scaled[inlier], RIM_DIRECTIONS) * ground.half_width_m,
        feet=recording.names("foot"),
        foot_offsets_m=fit.offsets_m,
        residual_rms_m=rms_m,
        n_points=n_points,
        n_outliers=n_points - int(inlier.sum()),
        degree=fit.degree,
        degree_wanted=degree,
        messages=tuple(messages),
        moved_s=moved_s,
        moved_m=moved_m,
        axis=ground.axis,
    )
    feet = level(recording[list(model.feet)], model)
    return replace(model, messages=(*model.messages, *rests_elsewhere(feet)))


@dataclass(frozen=True)
class _Ground:
    """The ground stepped on.

    Parameters
    ----------
    axis : (2,) array
        Unit vector along which the rests spread most.
    centre_m : (2,) array
        Middle of the ground, m.
    half_width_m : float
        Half of its larger side, m.
    scaled : (P, 2) array
        Places of the rests about the centre, along the axis and to its left, in half
        widths.
    """

    axis: FloatArray
    centre_m: FloatArray
    half_width_m: float
    scaled: FloatArray


def _ground_of(rest: RestPoints) -> _Ground:
    """Find the ground on which feet rest."""
    places = rest.points[:, :2]
    axis = own_axis(places)
    left = np.array([-axis[1], axis[0]])
    mean = places.mean(axis=0)
    around = along(places - mean, axis)
    low, high = np.quantile(around, GROUND_QUANTILES, axis=0)
    half_width_m = max(0.5 * float(np.max(high - low)), LEAST_GROUND_M * rest.scale)
    off_mean = 0.5 * (low + high)
    return _Ground(
        axis=axis,
        centre_m=mean + off_mean[0] * axis + off_mean[1] * left,
        half_width_m=half_width_m,
        scaled=(around - off_mean) / half_width_m,
    )


def _raised_messages(
    recording: Recording, rest: RestPoints, raised: BoolArray
) -> list[Message]:
    """Report feet that often rest above the floor; `raised` (P,) marks the rests."""
    messages = []
    for foot, name in enumerate(recording.names("foot")):
        share = float(raised[rest.foot == foot].mean())
        if share >= NOTED_SHARE:
            values = {"foot": name, "percent": 100 * share}
            messages.append(Message("landings.floor_rests_above", values))
    return messages


def _slope_messages(ground: FloatArray) -> list[Message]:
    """Report a slope of the floor.

    `ground` (P, 3) holds the places where the feet rest, with mount heights subtracted.
    """
    columns = np.column_stack([np.ones(len(ground)), ground[:, :2]])
    plane = np.linalg.lstsq(columns, ground[:, 2], rcond=None)[0]
    slope_deg = np.rad2deg(np.arctan(np.hypot(plane[1], plane[2])))
    if slope_deg < NOTED_SLOPE_DEG:
        return []
    return [Message(SLOPES, {"degrees": float(slope_deg)})]


def moving(recording: Recording) -> str:
    """Report how far the floor under a recording moves, and what to do.

    Empty if it does not move.
    """
    return "; ".join(str(message) for message in moving_messages(recording))


def moving_messages(recording: Recording) -> list[Message]:
    """Return the messages of which `moving` makes a sentence."""
    rest = rest_points(recording)
    moved_s, moved_m = floor_motion(rest)
    rest.points[:, 2] -= np.interp(rest.time, moved_s, moved_m)
    rest = rest.take(_near_floor(rest, FIRST_BANDS * REST_BAND_M * recording.scale))
    return [*motion_messages(moved_m), *turn_messages(rest)]


@one_blas_thread()
def level(
    recording: Recording, floor: FloorModel, *, overwrite: bool = False
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
    feet = recording.names("foot")
    if feet != floor.feet:
        raise ValueError(f"feet: expected {floor.feet}, found {feet}")
    positions = recording.positions
    if not overwrite:
        positions = positions.copy()
    if floor.moves:
        moved = np.interp(recording.time, floor.moved_s, floor.moved_m)
        positions[:, :, 2] -= moved[:, None]
    for first in range(0, len(positions), CHUNK):
        part = positions[first : first + CHUNK]
        part[:, :, 2] -= floor.height(part[:, :, 0], part[:, :, 1])
    positions[:, recording.indices("foot"), 2] -= floor.foot_offsets_m
    return replace(recording, positions=positions)


def _near_floor(rest: RestPoints, reach_m: float) -> BoolArray:
    """Mark rests (P,) within reach of a level floor, or of a plane if it slopes."""
    near = np.abs(rest.above_mode) <= reach_m
    few = few_of(rest.time, MOST_OF_PLANE)
    heights = rest.points[few, 2]
    columns = _columns_of_plane(rest)
    columns_of_few = columns[few]
    tells = near[few]
    for _ in range(PLANE_ROUNDS):
        plane = np.linalg.lstsq(columns_of_few[tells], heights[tells], rcond=STAYS)[0]
        slope = np.hypot(plane[-2], plane[-1])
        if slope < np.tan(np.deg2rad(NOTED_SLOPE_DEG)):
            break
        tells = np.abs(heights - columns_of_few @ plane) <= reach_m
        near = np.abs(rest.points[:, 2] - columns @ plane) <= reach_m
    return np.asarray(near)


def _columns_of_plane(rest: RestPoints) -> FloatArray:
    """Return columns for the mount of each foot and for the slope of a plane."""
    # The middle may be far from the origin.
    middle = rest.points[:, :2].sum(axis=0) / max(len(rest.points), 1)
    mounts = rest.scale * np.eye(len(rest.start_m))[rest.foot]
    return np.hstack([mounts, rest.points[:, :2] - middle])


def _require_rest(recording: Recording, rest: RestPoints, speed_m_s: float) -> None:
    """Raise an error that names the feet that are hardly ever at rest."""
    names = recording.names("foot")
    if not names:
        raise AnalysisError.at(f"{recording.name}: floor", "at least one foot", "none")
    has_no_rest = np.isnan(rest.start_m)
    restless = [name for name, never in zip(names, has_no_rest, strict=True) if never]
    if restless:
        raise AnalysisError(
            f"{recording.name}: floor: {', '.join(restless)} hardly ever at rest "
            f"(slower than {speed_m_s:.3g} m/s up or down); raise "
            "floor.rest_speed_m_s, set floor.enabled to false, or leave this recording "
            "out"
        )


def _zero_floor(recording: Recording, rest: RestPoints, degree: int) -> FloorModel:
    """Return the floor z = 0, with the residual of the feet at rest on it."""
    rms_m = float("nan")
    if len(rest.foot):
        rms_m = robust_rms(rest.points[:, 2])
    return FloorModel(
        terms=((0, 0),),
        coefficients_m=np.zeros(1),
        centre_m=np.zeros(2),
        scale_m=1.0,
        rim_m=np.ones(RIM_DIRECTIONS),
        feet=recording.names("foot"),
        foot_offsets_m=np.zeros(len(rest.start_m)),
        residual_rms_m=rms_m,
        n_points=len(rest.foot),
        n_outliers=0,
        degree=0,
        degree_wanted=degree,
        messages=(Message("landings.floor_not_compensated"),),
    )
