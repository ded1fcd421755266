"""Noise-free landings whose deviations from simultaneous contact are scaled down.

As the inputs of a map draw together about a point, its behaviour there is that of its
derivative. The error of the best linear map falls with the square of the scale if a
derivative exists, and with the scale itself if each order of contacts has its own.
"""

import json
import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.arrays import FloatArray, IntArray, one_blas_thread
from hopdata.errors import AnalysisError
from hopdata.rigid import INPUT_NAMES, OUTPUT_NAMES
from hopdata.scenes import STANDARD, scene_class
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis import landings as true
from hopdata.synthesis.camera import fixed_markers, in_world
from hopdata.synthesis.exact_maps import homed, leg_slopes, section_jacobians
from hopdata.synthesis.landings import SectionHeights, true_landings
from hopdata.truth import Truth

# The scene that the truth of a synthetic recording was made with.


@dataclass(frozen=True)
class KnownScene:
    """The system that landed, and the places of its body markers.

    Parameters
    ----------
    name : str
        Name of the scene in `hopdata.scenes.SCENES`.
    scene, control
        The system that landed; a boom stays as in the first hop.
    body_points_m : (B, 3) array
        Body markers, body frame, m.
    """

    name: str
    scene: Scene
    control: Control
    body_points_m: FloatArray

    def points_of(self, body: Sequence[str]) -> FloatArray:
        """Return places of the named markers (``body1`` ...), body frame, (k, 3), m."""
        rows = [int(name.removeprefix("body")) - 1 for name in body]
        return self.body_points_m[rows]


def known_scene(truth: Truth) -> KnownScene:
    """Read the scene from the parameters stored in a truth."""
    parameters = json.loads(truth.parameters_json)
    simulation = parameters["simulation"]
    name = simulation.get("scene", STANDARD)
    scene = scene_class(name)(**simulation[name])
    control = Control(**simulation.get("control", {}))
    points = np.array(parameters["motion_capture"]["markers"]["body_m"])
    return KnownScene(name, scene, control, points)


def common_scene(truths: Iterable[Truth]) -> KnownScene:
    """Return the scene shared by all recordings of a study.

    Raises
    ------
    AnalysisError
        If there are no scenes, or they differ.
    """
    scenes = [known_scene(truth) for truth in truths]
    same = {(s.scene, s.control, s.body_points_m.tobytes()) for s in scenes}
    if len(same) != 1:
        raise AnalysisError(
            f"truth: expected recordings of one scene, found {len(same)}"
        )
    return scenes[0]


#: Relative tolerance of the integration of scaled landings.
#: Unit: 1. Origin: chosen.
RTOL = 1e-10

#: Key of ``exact_maps.json`` with the reason why there are none.
UNKNOWN = "unknown"

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ScaledLandings:
    """Landings of one kind at one scale, of which n count.

    Parameters
    ----------
    case : str
        Name of the scene, "coupling", "impulse", "delay", or "study" for a mixture.
    control : Control
        Strengths of the control.
    scale : float
        Factor applied to the deviations.
    x, y : (n, 8) and (n, 11) array
        Inputs and outcomes; see `hopdata.synthesis.landings`.
    preloads_n : (n, legs) array
        Deviations of the preloads, N.
    contact_s : (n, legs) array
        Contact instants, from the apex, s.
    schedule : (n,) array of str
        Orders of the contacts.
    n_failed : int
        Number of landings that do not count.
    exact_maps : (S, 11, 8) array
        Derivatives at the simultaneous contact, one per schedule.
    """

    case: str
    control: Control
    scale: float
    x: FloatArray
    y: FloatArray
    preloads_n: FloatArray
    contact_s: FloatArray
    schedule: NDArray[np.str_]
    n_failed: int
    exact_maps: FloatArray


def study_landings(  # noqa: PLR0913 (the study's options)
    truths: Sequence[Truth],
    *,
    body: Sequence[str],
    pre_m: float,
    post_m: float,
    landings: int = 1000,
    scales: Sequence[float] = (1.0, 0.5, 0.25, 0.125, 0.0625),
    coupling: float = 0.2,
    impulse: float = 0.3,
    delay_s: float = 0.01,
    workers: int | None = None,
) -> Iterator[ScaledLandings]:
    """Yield the scaled landings of a simulated study, for the scene and its controls.

    Parameters
    ----------
    truths : sequence of Truth
        Truths of all its recordings. With a swinging boom, only hops with the boom as
        in the first hop are used.
    body : sequence of str
        Names of the body markers used by the study.
    pre_m, post_m : float
        Heights of the sections, m.
    landings : int
        Largest number of landings, taken evenly from all.
    scales, coupling, impulse, delay_s
        Factors of the deviations, and strengths of controls other than the study's own.
    workers : int, optional
        Number of threads.
    """
    known = common_scene(truths)
    apexes, preloads = _starts(truths, known.scene)
    every = slice(None, None, -(-len(apexes) // landings))
    cases = scaling_cases(known, coupling=coupling, impulse=impulse, delay_s=delay_s)
    sections = SectionHeights(pre_m, post_m, known.points_of(body))
    return scaled_landings(
        known.scene,
        cases,
        apexes[every],
        preloads[every],
        sections,
        scales=scales,
        workers=workers,
    )


def _starts(truths: Sequence[Truth], scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Return apex states and preloads of all hops with the boom as in the first hop."""
    apexes = []
    preloads = []
    for truth in truths:
        _, hops = next(scene.by_hop(len(truth.apex_states)))
        apexes.append(truth.apex_states[hops])
        preloads.append(truth.preloads_n[hops])
    return np.concatenate(apexes), np.concatenate(preloads)


def scaling_cases(known: KnownScene, **strengths: float) -> dict[str, Control]:
    """Name the scene and its controls, each with its own or the given strength.

    The study's own control replaces that of its kind, or is added last if it mixes
    kinds.
    """
    own = known.control
    cases = {known.name: Control()}
    for name in known.scene.controls:
        strength = getattr(own, name) or strengths[name]
        cases[name.removesuffix("_s")] = Control(**{name: strength})
    if own not in cases.values():
        cases["study"] = own
    return cases


def scaled_landings(
    scene: Scene,
    cases: dict[str, Control],
    apex_states: FloatArray,
    preloads_n: FloatArray,
    sections: SectionHeights,
    *,
    scales: Sequence[float],
    workers: int | None = None,
) -> Iterator[ScaledLandings]:
    """Integrate the landings of each case at each scale.

    Parameters
    ----------
    scene : Scene
    cases : dict
        Name -> system that lands.
    apex_states : (L, 12) array
        States at the apexes.
    preloads_n : (L, legs) array
        Preload of each leg, N; scaled towards `scene.preload_n`.
    sections : SectionHeights
        The sections.
    scales : sequence of float
        Factors of the deviations.
    workers : int, optional
        Number of threads.

    Yields
    ------
    ScaledLandings
        Without landings for a case whose simultaneous contact is not between the
        sections, or that does not sink to the lower one; the log gives the reason.
    """
    apart = preloads_n - scene.preload_n
    still = scene.still()
    for case, control in cases.items():
        try:
            exact = section_jacobians(still, control, apex_states, sections)
        except AnalysisError as error:
            logger.warning("scaling study, %s: %s", case, error)
            yield from (_nothing(case, control, scale, preloads_n) for scale in scales)
            continue
        middle = exact.landing.apex_state
        deviations = homed(apex_states) - middle
        for scale in scales:
            states = middle + scale * deviations
            preloads = scene.preload_n + scale * apart
            found = true_landings(
                still, control, states, preloads, sections, rtol=RTOL, workers=workers
            )
            rows = np.flatnonzero(found.whole)
            pre = found.pre_state[rows]
            post = found.post_state[rows]
            yield ScaledLandings(
                case=case,
                control=control,
                scale=scale,
                x=true.input_coordinates(pre, sections.centre_m),
                y=true.output_coordinates(pre, post, sections.centre_m),
                preloads_n=scale * apart[rows],
                contact_s=found.contact_s[rows],
                schedule=np.array(found.schedule)[rows],
                n_failed=len(found) - len(rows),
                exact_maps=exact.maps,
            )


def _nothing(
    case: str, control: Control, scale: float, preloads_n: FloatArray
) -> ScaledLandings:
    """Return the result for a case in which no landing counts."""
    n_landings, n_legs = preloads_n.shape
    return ScaledLandings(
        case=case,
        control=control,
        scale=scale,
        x=np.empty((0, len(INPUT_NAMES))),
        y=np.empty((0, len(OUTPUT_NAMES))),
        preloads_n=np.empty((0, n_legs)),
        contact_s=np.empty((0, n_legs)),
        schedule=np.empty(0, dtype=str),
        n_failed=n_landings,
        exact_maps=np.full((1, len(OUTPUT_NAMES), len(INPUT_NAMES)), np.nan),
    )


# Noise-free states at the sections of a simulated study, and its exact linear maps.

#: Relative tolerance of the integration of true landings to the sections.
#: Unit: 1. Origin: chosen.
TRUE_SECTIONS_RTOL = 1e-9


@dataclass(frozen=True)
class TrueStates:
    """Marker states of one recording at the sections, of which n landings count.

    Parameters
    ----------
    x, y : (n, 6B) array
        World positions of the B body markers (x1, y1, z1, x2, ...), m, followed by
        their velocities, m/s, at the pre and the post section.
    schedule : (n,) array of str
        Orders of the contacts.
    spread_s : (n,) array
        Standard deviation of the contact instants, s.
    touchdown : (n,) array of int
        Number of each landing in the truth, from 1.
    """

    x: FloatArray
    y: FloatArray
    schedule: NDArray[np.str_]
    spread_s: FloatArray
    touchdown: IntArray


@one_blas_thread()
def true_states(
    truth: Truth, known: KnownScene, sections: SectionHeights
) -> TrueStates:
    """Integrate the landings of a recording to the sections.

    Parameters
    ----------
    truth : Truth
        Truth with the apex states and preloads.
    known : KnownScene
        The system that landed.
    sections : SectionHeights
        The sections of the study.
    """
    parts = []
    for scene, rows in known.scene.by_hop(len(truth.apex_states)):
        longer_m = None
        if truth.longer_m is not None:
            longer_m = truth.longer_m[rows]
        found = true_landings(
            scene,
            known.control,
            truth.apex_states[rows],
            truth.preloads_n[rows],
            sections,
            longer_m=longer_m,
            rtol=TRUE_SECTIONS_RTOL,
            workers=1,
        )
        parts.append((rows, found))
    numbers = 1 + np.concatenate([rows[found.whole] for rows, found in parts])
    order = np.argsort(numbers)

    def joined(name: str) -> Any:
        """Return a property of the landings that count, in the truth's order."""
        values = [np.array(getattr(found, name))[found.whole] for _, found in parts]
        return np.concatenate(values)[order]

    return TrueStates(
        x=marker_states(joined("pre_state"), sections.points_m),
        y=marker_states(joined("post_state"), sections.points_m),
        schedule=joined("schedule"),
        spread_s=joined("contact_s").std(axis=1),
        touchdown=numbers[order],
    )


def marker_states(states: FloatArray, points_m: FloatArray) -> FloatArray:
    """Return positions and velocities, (n, 6B), of body points (B, 3)."""
    turning = np.cross(states[:, None, 9:12], points_m[None])
    # Turned into the world and added to that of the origin, as places are.
    velocities = in_world(states[:, [6, 7, 8, 3, 4, 5]], turning)
    both = (fixed_markers(states, points_m), velocities)
    return np.hstack([one.reshape(len(states), -1) for one in both])


@one_blas_thread()
def exact_maps(truths: Sequence[Truth], sections: SectionHeights) -> dict[str, Any]:
    """Return the exact linear maps of a study as plain data.

    Returns
    -------
    dict
        ``inputs`` and ``outputs`` (names of the coordinates), ``body_points_m`` (B, 3),
        ``schedules`` (S), ``maps`` (S, 11, 8), and the input ``x`` (8) and outcomes
        ``y`` (S, 11) of the landing at which they hold. Where legs scatter, ``legs``
        has ``maps`` (S, 11, n) by their lengths, and the ``covariance_m2`` (n, n) of
        these. If there are none, as where feet never touch at once between the
        sections, only ``unknown``: why.
    """
    known = common_scene(truths)
    apexes, _ = _starts(truths, known.scene)
    scene = known.scene.still()
    try:
        found = section_jacobians(scene, known.control, apexes, sections)
    except AnalysisError as error:
        # The study of the recordings does not need them.
        logger.warning("there are no exact maps: %s", error)
        return {UNKNOWN: str(error)}
    exact = {
        "inputs": list(INPUT_NAMES),
        "outputs": list(OUTPUT_NAMES),
        "body_points_m": sections.points_m.tolist(),
        "schedules": list(found.schedules),
        "maps": found.maps.tolist(),
        "x": found.x.tolist(),
        "y": found.y.tolist(),
    }
    lengths = [truth.longer_m for truth in truths if truth.longer_m is not None]
    if lengths:
        slopes = leg_slopes(scene, known.control, sections, found)
        covariance = np.cov(np.concatenate(lengths).T)
        exact["legs"] = {
            "maps": slopes.tolist(),
            "covariance_m2": covariance.tolist(),
        }
    return exact
