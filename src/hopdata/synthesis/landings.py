"""True landings of a simulated body: states at both sections and their coordinates."""

from dataclasses import dataclass
from functools import cache
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
    N_STATES,
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
SECTION = 4  # section parameters, before the scene's: point of the body and height

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
    """
    vectors = scene.vectors(preloads_n, variant, since_apex_s)
    section = [*np.asarray(point_m, dtype=float), height_m]
    return np.hstack([np.tile(section, (len(vectors), 1)), vectors])


def _field(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, dy: FloatArray
) -> None:
    """Fill `dy` as the scene does; the contact instants stay constant."""
    scene_field(t, y, mode, p[SECTION:], dy)
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
    """Fill `h` and `hdot` as the scene does, and add the point's height over the section."""
    scene_guards(t, y, dy, mode, p[SECTION:], h, hdot)
    rot, last = rotation_entries(y[3], y[4], y[5]), len(h) - 1
    tx, ty, tz = vertical_rate(y, dy, rot)
    h[last] = y[2] + rot[6] * p[0] + rot[7] * p[1] + rot[8] * p[2] - p[3]
    hdot[last] = dy[2] + tx * p[0] + ty * p[1] + tz * p[2]


def _event(
    t: float, y: FloatArray, mode: IntArray, p: FloatArray, guard: int, direction: int
) -> int:
    """Do as the scene does, and record the instant of a leg's first contact."""
    n = len(y) - scene_states
    if guard < n and direction > 0 and y[scene_states + guard] < 0.0:
        y[scene_states + guard] = t
    return int(scene_event(t, y, mode, p[SECTION:], guard, direction))


@cache
def landing_system(system: System) -> System:
    """Return the system of a landing: the scene's, with n more states for the contact instants.

    The guards are ``foot1`` ... ``foot<n>``, ``apex`` (stops after a landing, as in the
    scene) and ``section`` (stops). Nothing stops a fall.
    """
    feet = system.n_guards - 2
    return System(
        **_functions(system.field, system.guards, system.on_event, system.n_states),
        n_states=system.n_states + feet,
        guard_names=(*system.guard_names[:-1], "section"),
        directions=(*(0 for _ in range(feet)), -1, -1),
        terminal=(*(False for _ in range(feet + 1)), True),
        n_extra_modes=system.n_extra_modes,
    )


@cache
def _functions(
    own: Any, own_guards: Any, own_event: Any, n_states: int
) -> dict[str, Any]:
    """Return the functions of a landing; systems that differ only in feet share them."""
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


LONGEST_S = 3.0
ATOL_PER_RTOL = 1e-2


@dataclass(frozen=True)
class TrueLandings:
    """States at the sections of L landings of n feet; NaN where a section is not reached.

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
        """Return the feet in order of contact, such as ``"2>3>1"``; empty if it does not count."""
        orders = np.argsort(self.contact_s, axis=1, kind="stable") + 1
        landings = zip(orders, self.whole, strict=True)
        return [">".join(map(str, order)) if whole else "" for order, whole in landings]


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
    rtol: float = 1e-8,
    workers: int | None = None,
) -> TrueLandings:
    """Integrate landings from their apexes to the pre section and on to the post section.

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
    what, count = (scene, variant, sections), len(apex_states)
    options: dict[str, Any] = {
        "rtol": rtol,
        "atol": ATOL_PER_RTOL * rtol,
        "workers": workers,
    }
    pre_time, pre, early, fell = _fall(
        *what, apex_states, preloads_n, sections.pre_m, 0.0, **options
    )
    whole = fell & (early < 0).all(axis=1)
    post_time, post, contact = (
        np.full(count, np.nan),
        np.full((count, N_STATES), np.nan),
        early,
    )
    go = np.flatnonzero(whole)
    if len(go):
        after, post[go], contact[go], fell = _fall(
            *what, pre[go], preloads_n[go], sections.post_m, pre_time[go], **options
        )
        post_time[go] = after + pre_time[go]
        contact[go] = np.where(
            contact[go] >= 0, contact[go] + pre_time[go, None], NOT_YET
        )
        whole[go] = fell & (contact[go] >= 0).all(axis=1)
    contact = np.where(contact < 0, np.nan, contact)
    return TrueLandings(pre_time, post_time, pre, post, contact, whole)


def _fall(
    scene: Scene,
    variant: Variant | None,
    sections: SectionHeights,
    states: FloatArray,
    preloads_n: FloatArray,
    height_m: float,
    since_apex_s: FloatArray | float,
    **options: Any,
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Integrate until the body falls through a height.

    Returns the time taken, the states, the contact instants, and whether it fell
    through; times and states are NaN where it did not.
    """
    own, centre = scene.system(variant), sections.centre_m
    system, unknown = landing_system(own), np.full(preloads_n.shape, NOT_YET)
    at: dict[str, Any] = {
        "point_m": centre,
        "height_m": height_m,
        "since_apex_s": since_apex_s,
    }
    above = place_of(centre, states)[:, 2] > height_m
    solution = solve_batch(
        system,
        (0.0, LONGEST_S),
        np.hstack([padded(states, own), unknown]),
        params=landing_vectors(scene, variant, preloads_n, **at),
        mode=[0] * system.n_modes,
        **options,
    )
    # Only crossing the section sets its mode to down; ending at an apex leaves it
    # unchanged.
    fell = (
        above
        & (solution.status == TERMINATED)
        & (solution.mode[:, system.n_guards - 1] < 0)
    )
    return (
        np.where(fell, solution.t_end, np.nan),
        np.where(fell[:, None], solution.y_end[:, :N_STATES], np.nan),
        solution.y_end[:, own.n_states :],
        fell,
    )


# Coordinates of a rigid body on a section, where the mean of the body markers (the
# centre) has a given height. Without place and heading, eight remain as the input of a
# landing: pitch and roll, velocity of the centre in the heading frame, angular velocity
# in body axes. The outcome has eleven: the steps of centre and heading since the pre
# section, and the same eight at the post section, with the velocity in the heading
# frame of the pre section.


COMPLEX_STEP = 1e-30


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
    """Return the outcome of landings, (n, 11), from their states (n, 12) at both sections."""
    yaw = pre[..., 3]
    step = turned(place_of(centre_m, post) - place_of(centre_m, pre), yaw)[..., :2]
    turn = (post[..., 3] - yaw)[..., None]
    return np.concatenate([step, turn, _intrinsic(post, centre_m, yaw)], axis=-1)


def section_tangents(pre: FloatArray, centre_m: FloatArray) -> FloatArray:
    """Return derivatives of a state (12,) at the pre section by its coordinates, (12, 8).

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
    arm = np.cross(states[..., 9:12], centre_m)
    rotation = rotation_matrices(states[..., 3:6])
    velocity = states[..., 6:9] + np.einsum("...ij,...j->...i", rotation, arm)
    return np.concatenate(
        [states[..., 4:6], turned(velocity, yaw), states[..., 9:12]], axis=-1
    )
