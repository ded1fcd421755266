"""Simulate a recording and its truth from two blocks of the configuration."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from hopdata.arrays import FloatArray, one_blas_thread
from hopdata.errors import require, require_choice
from hopdata.messages import Message
from hopdata.recording import Recording
from hopdata.scenes import STANDARD, blamed_scene, scene_class
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis import camera as cameras
from hopdata.synthesis import trial as trials
from hopdata.synthesis.hops import rest_foot
from hopdata.synthesis.integrators import INTEGRATORS
from hopdata.truth import Truth

# The functions of a scene, with all the arguments that they take.
OWN_FORM = {
    "field": "t, y, mode, params, dy",
    "guards": "t, y, dy, mode, params, h, hdot",
    "on_event": "t, y, mode, params, guard, direction",
}


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """The block ``simulation`` of the configuration: hops, scene and disturbances.

    Parameters
    ----------
    hops : int
        Number of hops.
    duration_s : float, optional
        Cut the recording at this time, s.
    name : str
        Name of the scene, the key ``scene`` of the block.
    scene : Scene
        Parameters of the scene, from the block of that name.
    kicks, operator
        See their classes.
    control : Control
        System that lands instead of the scene, from the apexes of its gait; at strength
        zero, the scene itself.
    legs_scatter_m : float
        Standard deviation of the length of each leg, drawn anew for every landing, m.
    integrator : str
        What integrates the hops, of `hopdata.synthesis.integrators.INTEGRATORS`.
    """

    hops: int = 1000
    duration_s: float | None = None
    name: str = STANDARD
    scene: Scene = field(default_factory=scene_class(STANDARD))
    kicks: trials.Kicks = field(default_factory=trials.Kicks)
    operator: trials.Operator = field(default_factory=trials.Operator)
    control: Control = field(default_factory=Control)
    legs_scatter_m: float = 0.0
    integrator: str = "driver"

    def __post_init__(self) -> None:
        self.scene.require_take_off(f"simulation.{self.name}")
        if self.name != STANDARD:
            self._require_own_form()
        known = " and ".join(self.scene.controls) or "none of them"
        wanted = f"0, since the scene {self.name} knows {known}"
        if self.scene.controls:
            wanted += " only"
        for strength, value in asdict(self.control).items():
            fits = value == 0 or strength in self.scene.controls
            require(fits, f"simulation.control.{strength}", wanted, value)
        fits = self.legs_scatter_m == 0 or self.scene.legs_can_scatter
        wanted = f"0, since the legs of the scene {self.name} have one length"
        require(fits, "simulation.legs_scatter_m", wanted, self.legs_scatter_m)
        require_choice("simulation.integrator", self.integrator, INTEGRATORS)
        resets = self.scene.resets_state or self.control.impulse != 0
        can_do = self.integrator != "printed" or not resets
        wanted = "driver where events reset the state, as the printed method cannot"
        require(can_do, "simulation.integrator", wanted, self.integrator)

    def _require_own_form(self) -> None:
        """Require functions in the integrator's own form, which the exact maps call."""
        system = self.scene.system()
        for kind, arguments in OWN_FORM.items():
            function = getattr(system, kind)
            fits = function is not None and function.form is None
            wanted = f"@{kind} with all of its arguments, ({arguments})"
            require(fits, "simulation.scene", wanted, f"another form in {self.name}")

    @classmethod
    def of(cls, values: Mapping[str, Any] | None) -> Simulation:
        """Build it from the block of the configuration; missing keys are default.

        Raises
        ------
        HopdataError
            If a key or the scene is unknown, or a value is out of range.
        """
        given = dict(values or {})
        name = given.pop("scene", STANDARD)
        scene = trials.from_mapping(scene_class(name), given.pop(name, None))
        return replace(trials.from_mapping(cls, given), name=name, scene=scene)

    def lengths(self, rng: np.random.Generator) -> Iterator[FloatArray]:
        """Yield how much longer than usual each leg is, (n,), m, hop by hop."""
        if self.legs_scatter_m == 0:
            return
        for _ in range(self.hops):
            yield self.legs_scatter_m * rng.standard_normal(self.scene.n_legs)

    def said(self) -> dict[str, Any]:
        """Return the block as plain data.

        It has a control, a scatter of the legs, the name of a scene that is not the
        standard one, or an integrator that is not the driver, only if there is one.
        """
        said = asdict(self)
        said[said.pop("name")] = said.pop("scene")
        if not self.control.active:
            del said["control"]
        if self.legs_scatter_m == 0:
            del said["legs_scatter_m"]
        if self.integrator == "driver":
            del said["integrator"]
        if self.name == STANDARD:
            return said
        return {"scene": self.name, **said}


@one_blas_thread()
def simulate_recording(
    simulation: Mapping[str, Any] | None = None,
    motion_capture: Mapping[str, Any] | None = None,
    *,
    seed: int | Sequence[int],
    name: str = "hopper",
) -> tuple[Recording, Truth]:
    """Simulate a scene and observe it.

    Parameters
    ----------
    simulation, motion_capture : mapping, optional
        Blocks of the configuration (fields of `Simulation` and `MotionCapture`);
        missing keys take their defaults.
    seed : int or sequence of int
        Seed of all random numbers. Kicks, floor, noise, gaps and legs have separate
        streams, so that changing one leaves the others unchanged.
    name : str
        Name of the recording.

    Raises
    ------
    HopdataError
        If a key is unknown or a value is out of range, or if the scene is that of
        another package, which fails.
    """
    scene = str((simulation or {}).get("scene", STANDARD))
    with blamed_scene(scene):
        return _simulated(simulation, motion_capture, seed, name)


def _simulated(
    simulation: Mapping[str, Any] | None,
    motion_capture: Mapping[str, Any] | None,
    seed: int | Sequence[int],
    name: str,
) -> tuple[Recording, Truth]:
    simulated = Simulation.of(simulation)
    camera = trials.from_mapping(cameras.MotionCapture, motion_capture)
    scene = simulated.scene
    control = simulated.control
    duration_s = simulated.duration_s
    streams = np.random.SeedSequence(seed).spawn(5)
    generators = map(np.random.default_rng, streams)
    kicks_rng, floor_rng, noise_rng, gaps_rng, legs_rng = generators
    trial = trials.run_trial(
        scene,
        hops=simulated.hops,
        rate_hz=camera.rate_hz,
        rng=kicks_rng,
        kicks=simulated.kicks,
        operator=simulated.operator,
        control=control if control.active else None,
        longer_m=simulated.lengths(legs_rng),
        integrator=simulated.integrator,
        duration_s=math.inf if duration_s is None else duration_s,
    )
    tracks = cameras.track_markers(
        trial, scene, camera.markers, delay_s=control.delay_s
    )
    floor = cameras.draw_floor(camera.floor, floor_rng)
    recording = observed(tracks, floor, camera, name, noise_rng, gaps_rng)
    recording = replace(recording, remarks=falls(trial))
    times, points = first_contacts(trial, scene)
    bodies = [i for i, role in enumerate(tracks.roles) if role == "body"]
    longer_m = None
    if simulated.legs_scatter_m > 0:
        longer_m = trial.longer_m[: len(trial.hops)]
    parameters = {
        "seed": seed,
        "simulation": simulated.said(),
        "motion_capture": camera.said(),
    }
    truth = Truth(
        contact_times=times,
        apex_times=trial.hop_start_s,
        complete=np.array([hop.all_stood() for hop in trial.hops]),
        foot_down=tracks.foot_down,
        body_height=tracks.positions[:, bodies, 2].mean(axis=1),
        contact_points=points,
        floor_at_contacts=floor.height(points),
        apex_states=np.array([hop.start_state for hop in trial.hops]),
        preloads_n=np.array([hop.preloads_n for hop in trial.hops]),
        noise_m=camera.coordinate_noise_m,
        parameters_json=json.dumps(parameters, sort_keys=True),
        longer_m=longer_m,
    )
    return recording, truth


def falls(trial: trials.Trial) -> tuple[str, ...]:
    """Return a remark on how often the body fell and was carried, if it fell."""
    n_falls = sum(hop.fell for hop in trial.hops)
    if n_falls == 0:
        return ()
    hops = len(trial.hops)
    values = {"falls": n_falls, "hops": hops, "carries": trial.n_carries}
    return (str(Message("recordings.fell", values)),)


def observed(
    tracks: cameras.MarkerTracks,
    floor: cameras.CurvedFloor,
    camera: cameras.MotionCapture,
    name: str,
    noise_rng: np.random.Generator,
    gaps_rng: np.random.Generator,
) -> Recording:
    """Return the motion-capture record of marker tracks."""
    frames, markers, _ = tracks.positions.shape
    hidden = camera.draw_gaps(frames, markers, gaps_rng)
    positions = camera.observe(tracks.positions, floor, hidden, noise_rng)
    return Recording(
        name,
        np.arange(frames) / camera.rate_hz,
        positions,
        tracks.names,
        tracks.roles,
        camera.rate_hz,
        source="simulation",
    )


def first_contacts(trial: trials.Trial, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Return time (L, n), s, and place (L, n, 2), m, of first contacts, or NaN."""
    shape = (len(trial.hops), scene.n_legs)
    times = np.full(shape, np.nan)
    points = np.full((*shape, 2), np.nan)
    for i, hop in enumerate(trial.hops):
        for leg, k in enumerate(hop.first_contacts()):
            if k >= 0:
                times[i, leg] = trial.hop_start_s[i] + hop.event_time[k]
                longer = trial.longer_m[i, leg]
                foot = rest_foot(scene, hop.event_state[k], leg, longer)
                points[i, leg] = foot[:2]
    return times, points
