"""A recording of a simulated hopper, with its truth, from two blocks of the configuration."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdata.blas import one_blas_thread
from hopdata.errors import ConfigError, did_you_mean
from hopdata.recordings.recording import Recording
from hopdata.recordings.truth import Truth
from hopdata.scenes.hopper_control import HopperControl
from hopdata.scenes.hopper_parameters import HopperParameters
from hopdata.synthesis.capture import observe
from hopdata.synthesis.floor import CurvedFloor, draw_floor
from hopdata.synthesis.gaps import draw_gaps
from hopdata.synthesis.hops import rest_foot
from hopdata.synthesis.markers import MarkerTracks, track_markers
from hopdata.synthesis.options import (
    FloorOptions,
    GapOptions,
    Kicks,
    MarkerOptions,
    Operator,
    from_mapping,
    require,
)
from hopdata.synthesis.tape import Trial
from hopdata.synthesis.trial import run_trial

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """The config's ``simulation``: how many hops, of which hopper, how disturbed and handled.

    Parameters
    ----------
    hops : int
        Number of hops.
    duration_s : float, optional
        Cut the recording at this time, s.
    hopper, kicks, operator
        See their classes.
    control : HopperControl
        What lands in the hopper's place, from the apexes of its gait; at strength zero itself.
    """

    hops: int = 1000
    duration_s: float | None = None
    hopper: HopperParameters = field(default_factory=HopperParameters)
    kicks: Kicks = field(default_factory=Kicks)
    operator: Operator = field(default_factory=Operator)
    control: HopperControl = field(default_factory=HopperControl)

    def __post_init__(self) -> None:
        require(self.hops >= 1, "simulation.hops", "at least 1", self.hops)
        longer = self.duration_s is None or self.duration_s > 0
        require(longer, "simulation.duration_s", "> 0", self.duration_s)
        push, share = self.hopper.push_at_release_n, self.hopper.weight_per_leg_n
        what = f"preload_n - stiffness_n_m release_extension_m > {share:.2f} N, the weight per leg"
        require(push > share, "simulation.hopper", what, f"{push:.2f} N: it cannot lift off")


@dataclass(frozen=True, kw_only=True)
class MotionCapture:
    """The config's ``motion_capture``: how the hopper is seen.

    Parameters
    ----------
    rate_hz : float
        Frame rate, Hz.
    noise_m : float
        Standard deviation of the noise on each coordinate of each marker, m. The default takes
        the dissertation's 0.6 mm as that; a distance between markers then varies by 0.85 mm.
    resolution_m : float
        Step to which coordinates are rounded, m; 0 for none. A power of two packs well.
    floor, gaps, markers
        See their classes.
    """

    rate_hz: float = 100.0
    noise_m: float = 0.0006
    resolution_m: float = 2.0**-15
    floor: FloorOptions = field(default_factory=FloorOptions)
    gaps: GapOptions = field(default_factory=GapOptions)
    markers: MarkerOptions = field(default_factory=MarkerOptions)

    def __post_init__(self) -> None:
        require(self.rate_hz > 0, "motion_capture.rate_hz", "> 0", self.rate_hz)
        require(self.noise_m >= 0, "motion_capture.noise_m", ">= 0", self.noise_m)
        require(self.resolution_m >= 0, "motion_capture.resolution_m", ">= 0", self.resolution_m)


_BLOCKS: dict[type, dict[str, type]] = {
    Simulation: {
        "hopper": HopperParameters,
        "kicks": Kicks,
        "operator": Operator,
        "control": HopperControl,
    },
    MotionCapture: {"floor": FloorOptions, "gaps": GapOptions, "markers": MarkerOptions},
}


@one_blas_thread()
def simulate_recording(
    simulation: Mapping[str, Any] | None = None,
    motion_capture: Mapping[str, Any] | None = None,
    *,
    seed: int | Sequence[int],
    name: str = "hopper",
) -> tuple[Recording, Truth]:
    """Simulate a hopper and observe it.

    Parameters
    ----------
    simulation, motion_capture : mapping, optional
        Blocks of the configuration (fields of `Simulation` and `MotionCapture`); keys not given
        take their defaults.
    seed : int or sequence of int
        Seed of everything random. Kicks, floor, noise and gaps have streams of their own, so that
        changing one leaves the others as they were.
    name : str
        Name of the recording.

    Raises
    ------
    ConfigError
        If a key is unknown or a value out of range.
    """
    scene = _options(Simulation, simulation, "simulation")
    camera = _options(MotionCapture, motion_capture, "motion_capture")
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(4)]
    kicks_rng, floor_rng, noise_rng, gaps_rng = streams
    trial = run_trial(
        scene.hopper,
        hops=scene.hops,
        rate_hz=camera.rate_hz,
        rng=kicks_rng,
        kicks=scene.kicks,
        operator=scene.operator,
        control=scene.control if scene.control.active else None,
        duration_s=math.inf if scene.duration_s is None else scene.duration_s,
    )
    tracks = track_markers(trial, scene.hopper, camera.markers, delay_s=scene.control.delay_s)
    floor = draw_floor(camera.floor, floor_rng)
    recording = observed(tracks, floor, camera, name, noise_rng, gaps_rng)
    parameters = {"seed": seed, "simulation": _said(scene), "motion_capture": asdict(camera)}
    return recording, _truth(trial, tracks, floor, scene.hopper, camera, parameters)


def _said(scene: Simulation) -> dict[str, Any]:
    """Return the options as plain data; a control only if there is one."""
    said = asdict(scene)
    if not scene.control.active:
        del said["control"]
    return said


def _options(kind: type[Any], values: Mapping[str, Any] | None, where: str) -> Any:
    """Build a block and the blocks within it."""
    values = dict(values or {})
    for key, inner in _BLOCKS[kind].items():
        values[key] = from_mapping(inner, values.get(key), f"{where}.{key}")
    names = list(kind.__dataclass_fields__)
    for key in values:
        if key not in names:
            raise ConfigError(f"{where}.{key}: no such key{did_you_mean(key, names)}")
    return kind(**values)


def observed(
    tracks: MarkerTracks,
    floor: CurvedFloor,
    camera: MotionCapture,
    name: str,
    noise_rng: np.random.Generator,
    gaps_rng: np.random.Generator,
) -> Recording:
    """Return what a motion-capture system records of marker tracks."""
    frames, markers, _ = tracks.positions.shape
    hidden = draw_gaps(
        camera.gaps, frames=frames, markers=markers, rate_hz=camera.rate_hz, rng=gaps_rng
    )
    positions = observe(
        tracks.positions,
        floor=floor,
        noise_m=camera.noise_m,
        resolution_m=camera.resolution_m,
        hidden=hidden,
        rng=noise_rng,
    )
    return Recording(
        name=name,
        time=np.arange(frames) / camera.rate_hz,
        positions=positions,
        markers=tracks.names,
        roles=tracks.roles,
        rate_hz=camera.rate_hz,
        source="simulation",
    )


def _truth(
    trial: Trial,
    tracks: MarkerTracks,
    floor: CurvedFloor,
    hopper: HopperParameters,
    camera: MotionCapture,
    parameters: dict[str, Any],
) -> Truth:
    times, points = first_contacts(trial, hopper)
    bodies = [i for i, role in enumerate(tracks.roles) if role == "body"]
    return Truth(
        contact_times=times,
        apex_times=trial.hop_start_s,
        complete=np.array([hop.all_stood() for hop in trial.hops]),
        foot_down=tracks.foot_down,
        body_height=tracks.positions[:, bodies, 2].mean(axis=1),
        contact_points=points,
        floor_at_contacts=floor.height(points),
        apex_states=np.array([hop.start_state for hop in trial.hops]),
        preloads_n=np.array([hop.preloads_n for hop in trial.hops]),
        noise_m=camera.noise_m,
        parameters_json=json.dumps(parameters, sort_keys=True),
    )


def first_contacts(trial: Trial, hopper: HopperParameters) -> tuple[FloatArray, FloatArray]:
    """When and where each foot first touched in each landing: (L, n) s and (L, n, 2) m, or NaN."""
    shape = (len(trial.hops), hopper.n_legs)
    times, points = np.full(shape, np.nan), np.full((*shape, 2), np.nan)
    for i, hop in enumerate(trial.hops):
        for leg, k in enumerate(hop.first_contacts()):
            if k >= 0:
                times[i, leg] = trial.hop_start_s[i] + hop.event_time[k]
                points[i, leg] = rest_foot(hopper, hop.event_state[k], leg)[:2]
    return times, points
