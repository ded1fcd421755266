"""True landings of a simulated body: states at both sections and their coordinates."""

from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from hopdata.arrays import BoolArray, FloatArray, IntArray
from hopdata.hybrid import System, field, guards, on_event, solve_batch
from hopdata.hybrid.compiled.digest import with_digest
from hopdata.hybrid.layout import TERMINATED
from hopdata.rigid import turned
from hopdata.scenes.body import (
    HEIGHT,
    N_STATES,
    PITCH,
    ROLL,
    YAW,
    rotation_entries,
    rotation_matrices,
    vertical_rate,
)
from hopdata.scenes.scene import Scene, Variant
from hopdata.synthesis.hops import padded, place_of

# A landing between the sections. It is the scene's system, with the guard for a fall
# replaced by the height of a body point (the mean of the body markers) over a section,
# which ends the integration as it falls through zero. Further states hold the instants
# of the first contacts, so that many landings can be integrated at once without logging
# their events.

NOT_YET = -1.0  # placeholder for the instant of a contact that has not happened

# Indices into the parameters: the point of the body and the height of the section come
# before the scene's own.
POINT_X = 0
POINT_Y = 1
POINT_Z = 2
SECTION_HEIGHT = 3
SCENE = 4  # the scene's own begin here

# Placeholders filled by `landing_system`: the scene's functions and its number of
# states.
scene_field: Any = None
scene_guards: Any = None
scene_event: Any = None
scene_states = 0


def landing_vectors(
    scene: Scene,
    variant: Variant | None,
    preloads_n: FloatArray,
    *,
    point_m: ArrayLike,
    height_m: float,
    since_apex_s: FloatArray | float = 0.0,
    longer_m: FloatArray | None = None,
) -> FloatArray:
    """Return the parameter vectors of L landings, (L, p).

    Parameters
    ----------
    scene, variant
        The system that lands.
    preloads_n : (L, n) array
        Preload of each leg, N.
    point_m : (3,) array_like
        Point of the body, body frame, m.
    height_m : float
        Height of the section, m.
    since_apex_s : float or (L,) array
        Time since the apex at which the integration begins, s.
    longer_m : (L, n) array, optional
        How much longer than usual each leg is, m.
    """
    vectors = scene.vectors(preloads_n, variant, since_apex_s)
    if longer_m is not None:
        vectors = scene.lengthened(vectors, longer_m)
    section = [*np.asarray(point_m, dtype=float), height_m]
    return np.hstack([np.tile(section, (len(vectors), 1)), vectors])


def _field(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` as the scene does; the contact instants stay constant."""
    scene_field(t, y, mode, p[SCENE:], dy)
    dy[scene_states:] = 0.0


def _guards(
    t: float,
    y: FloatArray,
    dy: FloatArray,
    mode: IntArray,
    p: FloatArray,
    h: FloatArray,
    hdot: FloatArray,
) -> None:
    """Fill `h` and `hdot` as the scene does, then the height over the section."""
    scene_guards(t, y, dy, mode, p[SCENE:], h, hdot)
    rot = rotation_entries(y[YAW], y[PITCH], y[ROLL])
    tx, ty, tz = vertical_rate(y, dy, rot)
    point_x = p[POINT_X]
    point_y = p[POINT_Y]
    point_z = p[POINT_Z]
    height = y[HEIGHT] + rot[6] * point_x + rot[7] * point_y + rot[8] * point_z
    last = len(h) - 1
    h[last] = height - p[SECTION_HEIGHT]
    hdot[last] = dy[HEIGHT] + tx * point_x + ty * point_y + tz * point_z


def _event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Do as the scene does, and record the instant of a leg's first contact."""
    n = len(y) - scene_states
    if guard < n and direction > 0 and y[scene_states + guard] < 0.0:
        y[scene_states + guard] = t
    return int(scene_event(t, y, mode, p[SCENE:], guard, direction))


@cache
def landing_system(system: System) -> System:
    """Return the system of a landing.

    It is the scene's, with n more states for the contact instants. The guards are
    ``foot1`` ... ``foot<n>``, ``apex`` (stops after a landing, as in the scene) and
    ``section`` (stops). Nothing stops a fall.
    """
    n_feet = system.n_guards - 2
    functions = _functions(
        system.field, system.guards, system.on_event, system.n_states
    )
    return System(
        **functions,
        n_states=system.n_states + n_feet,
        guard_names=(*system.guard_names[:-1], "section"),
        directions=(*(0 for _ in range(n_feet)), -1, -1),
        terminal=(*(False for _ in range(n_feet)), False, True),
        n_extra_modes=system.n_extra_modes,
    )


@cache
def _functions(
    own: Any, own_guards: Any, own_event: Any, n_states: int
) -> dict[str, Any]:
    """Return the functions of a landing; systems with other feet share them."""
    inside = {
        "scene_field": njit(error_model="numpy")(own.function),
        "scene_guards": njit(error_model="numpy")(own_guards.function),
        "scene_event": njit(error_model="numpy")(own_event.function),
        "scene_states": n_states,
    }
    return {
        "field": field(with_digest(_field, **inside)),
        "guards": guards(with_digest(_guards, **inside)),
        "on_event": on_event(with_digest(_event, **inside)),
    }


#: Time after which a landing that has not reached its section is given up.
#: Unit: s. Origin: chosen.
LONGEST_S = 3.0
#: Absolute tolerance of the integration of a landing, for a relative one of 1.
#: Unit: m, rad, m/s, rad/s. Origin: chosen.
ATOL_PER_RTOL = 1e-2


@dataclass(frozen=True)
class TrueLandings:
    """States at the sections of L landings of n feet; NaN where not reached.

    Parameters
    ----------
    pre_time_s, post_time_s : (L,) array
        Times at which the mean of the body markers falls through the sections, from the
        apex, s.
    pre_state, post_state : (L, 12) array
        States of the body there; see `hopdata.scenes.body`.
    contact_s : (L, n) array
        Instant of each foot's first contact, from the apex, s.
    whole : (L,) array of bool
        Whether a landing counts. It must reach both sections, with all feet up at the
        pre section and down at the post section, as the pipeline requires.
    """

    pre_time_s: FloatArray
    post_time_s: FloatArray
    pre_state: FloatArray
    post_state: FloatArray
    contact_s: FloatArray
    whole: BoolArray

    def __len__(self) -> int:
        return len(self.whole)

    @property
    def schedule(self) -> list[str]:
        """Feet in order of contact, such as ``"2>3>1"``; empty if it does not count."""
        orders = np.argsort(self.contact_s, axis=1, kind="stable") + 1
        schedules = []
        for order, whole in zip(orders, self.whole, strict=True):
            schedules.append(">".join(map(str, order)) if whole else "")
        return schedules


@dataclass(frozen=True)
class SectionHeights:
    """Heights of the sections, at which the mean of the body markers crosses them.

    Parameters
    ----------
    pre_m, post_m : float
        The two heights above the floor, m.
    points_m : (B, 3) array
        Body markers, body frame, m.
    """

    pre_m: float
    post_m: float
    points_m: FloatArray

    def __post_init__(self) -> None:
        if not self.pre_m > self.post_m:
            raise ValueError(
                f"pre_m: expected above {self.post_m} m, found {self.pre_m} m"
            )

    @property
    def centre_m(self) -> FloatArray:
        """Return the mean of the body markers, body frame, (3,), m."""
        return np.asarray(np.mean(self.points_m, axis=0))


def true_landings(
    scene: Scene,
    variant: Variant | None,
    apex_states: FloatArray,
    preloads_n: FloatArray,
    sections: SectionHeights,
    *,
    longer_m: FloatArray | None = None,
    rtol: float = 1e-8,
    workers: int | None = None,
) -> TrueLandings:
    """Integrate landings from their apexes to the pre and on to the post section.

    Parameters
    ----------
    scene, variant
        The system that lands. A boom stays as in the first hop.
    apex_states : (L, 12) array
        States in flight above the pre section.
    preloads_n : (L, n) array
        Preload of each leg, N.
    sections : SectionHeights
        Where to stop.
    longer_m : (L, n) array, optional
        How much longer than usual each leg is, m.
    rtol : float
        Relative tolerance of the integration; the absolute one is a hundredth of it.
    workers : int, optional
        Number of threads.

    Returns
    -------
    TrueLandings
        Each ends at the first passage through the post section, whether or not all feet
        are down there.
    """
    fall = partial(_fall, scene, variant, sections, rtol=rtol, workers=workers)
    legs = _Legs(preloads_n, longer_m)
    pre_time, pre, contact, fell = fall(apex_states, legs, sections.pre_m, 0.0)
    # All feet must be up at the pre section.
    whole = fell & (contact < 0).all(axis=1)
    post_time = np.full(len(apex_states), np.nan)
    post = np.full((len(apex_states), N_STATES), np.nan)
    rows = np.flatnonzero(whole)
    if len(rows) > 0:
        start = pre_time[rows]
        after, post[rows], late, fell = fall(
            pre[rows], legs.of(rows), sections.post_m, start
        )
        post_time[rows] = after + start
        contact[rows] = np.where(late >= 0, late + start[:, None], NOT_YET)
        whole[rows] = fell & (contact[rows] >= 0).all(axis=1)
    contact = np.where(contact < 0, np.nan, contact)
    return TrueLandings(pre_time, post_time, pre, post, contact, whole)


@dataclass(frozen=True)
class _Legs:
    """Preloads (L, n), N, and how much longer than usual each leg is, (L, n), m."""

    preloads_n: FloatArray
    longer_m: FloatArray | None

    def of(self, rows: IntArray) -> "_Legs":
        """Return the legs of some of the landings."""
        if self.longer_m is None:
            return _Legs(self.preloads_n[rows], None)
        return _Legs(self.preloads_n[rows], self.longer_m[rows])


def _fall(  # noqa: PLR0913 (partly applied by its only caller)
    scene: Scene,
    variant: Variant | None,
    sections: SectionHeights,
    states: FloatArray,
    legs: _Legs,
    height_m: float,
    since_apex_s: FloatArray | float,
    *,
    rtol: float,
    workers: int | None,
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Integrate until the body falls through a height.

    Returns the time taken, the states, the contact instants, and whether it fell
    through; times and states are NaN where it did not.
    """
    own = scene.system(variant)
    system = landing_system(own)
    no_contacts = np.full(legs.preloads_n.shape, NOT_YET)
    params = landing_vectors(
        scene,
        variant,
        legs.preloads_n,
        point_m=sections.centre_m,
        height_m=height_m,
        since_apex_s=since_apex_s,
        longer_m=legs.longer_m,
    )
    solution = solve_batch(
        system,
        (0.0, LONGEST_S),
        np.hstack([padded(states, own), no_contacts]),
        params=params,
        mode=[0] * system.n_modes,
        rtol=rtol,
        atol=ATOL_PER_RTOL * rtol,
        workers=workers,
    )
    was_above = place_of(sections.centre_m, states)[:, 2] > height_m
    # Only crossing the section sets its mode to down; ending at an apex leaves it
    # unchanged.
    is_below = solution.mode[:, system.n_guards - 1] < 0
    fell = was_above & (solution.status == TERMINATED) & is_below
    times = np.where(fell, solution.t_end, np.nan)
    reached = np.where(fell[:, None], solution.y_end[:, :N_STATES], np.nan)
    return times, reached, solution.y_end[:, own.n_states :], fell


# Coordinates of a rigid body on a section, where the mean of the body markers (the
# centre) has a given height. Without place and heading, eight remain as the input of a
# landing: pitch and roll, velocity of the centre in the heading frame, angular velocity
# in body axes. The outcome has eleven: the steps of centre and heading since the pre
# section, and the same eight at the post section, with the velocity in the heading
# frame of the pre section.


COMPLEX_STEP = 1e-30  # so small that its square is 0 beside any coordinate


def input_coordinates(states: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Return the coordinates of states (n, 12) at the pre section, (n, 8).

    Parameters
    ----------
    states : (n, 12) array
        See `hopdata.scenes.body`.
    centre_m : (3,) array
        Mean of the body markers, body frame, m.
    """
    return _intrinsic(states, centre_m, states[..., 3])


def output_coordinates(
    pre: FloatArray, post: FloatArray, centre_m: FloatArray
) -> FloatArray:
    """Return the outcome of landings, (n, 11), from states (n, 12) at both sections."""
    yaw = pre[..., 3]
    step = turned(place_of(centre_m, post) - place_of(centre_m, pre), yaw)[..., :2]
    turn = (post[..., 3] - yaw)[..., None]
    return np.concatenate([step, turn, _intrinsic(post, centre_m, yaw)], axis=-1)


def section_tangents(pre: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Return derivatives of a state (12,) at the pre section by its coordinates.

    Height, place and heading of the centre are held fixed.
    """

    def every(state: Any) -> Any:
        kept = np.concatenate([place_of(centre_m, state), state[..., 3:4]], axis=-1)
        return np.concatenate([kept, input_coordinates(state, centre_m)], axis=-1)

    return np.asarray(np.linalg.inv(derivative(every, pre))[:, 4:])


def output_slopes(
    pre: FloatArray, post: FloatArray, centre_m: FloatArray
) -> FloatArray:
    """Return derivatives of the outcome by the state at the post section, (11, 12)."""
    return derivative(lambda state: output_coordinates(pre, state, centre_m), post)


def height_slope(state: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Return derivatives of the height of the centre by the state, (12,)."""
    return derivative(lambda y: place_of(centre_m, y)[..., 2:], state)[0]


def derivative(function: Any, state: FloatArray) -> FloatArray:
    """Return the derivative (k, 12) of a function at a state (12,) by complex steps."""
    moved = state + 1j * COMPLEX_STEP * np.eye(len(state))
    return np.asarray(np.array([function(row) for row in moved]).imag.T / COMPLEX_STEP)


def _intrinsic(states: Any, centre_m: FloatArray, yaw: Any) -> Any:
    """Return the eight coordinates without place and heading, seen along a heading."""
    arm = np.cross(states[..., 9:12], centre_m)
    rotation = rotation_matrices(states[..., 3:6])
    velocity = states[..., 6:9] + np.einsum("...ij,...j->...i", rotation, arm)
    return np.concatenate(
        [states[..., 4:6], turned(velocity, yaw), states[..., 9:12]], axis=-1
    )
