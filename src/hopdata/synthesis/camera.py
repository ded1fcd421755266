"""Marker places from the body's motion and contacts, and what a camera sees of them."""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from hopdata.arrays import BoolArray, FloatArray
from hopdata.errors import require_choice
from hopdata.scenes.body import rotation_matrices
from hopdata.scenes.scene import Scene
from hopdata.synthesis.hops import rest_foot, rest_foot_climb, smooth_step
from hopdata.synthesis.trial import FloorOptions, GapOptions, MarkerOptions, Trial


@dataclass(frozen=True)
class CurvedFloor:
    """Height of the measured floor: a bowl that levels off, plus waves.

    Parameters
    ----------
    options : FloorOptions
        The bowl, and the amplitude of the waves.
    wave_vectors : (W, 2) array
        Wave vectors, rad/m.
    phases : (W,) array
        Phase of each wave at the origin, rad.
    """

    options: FloorOptions
    wave_vectors: FloatArray
    phases: FloatArray

    def height(self, xy: FloatArray) -> FloatArray:
        """Return the height, (...), m, at points (..., 2), m."""
        square = np.sum(xy**2, axis=-1) / self.options.bowl_radius_m**2
        waves = np.sin(xy @ self.wave_vectors.T + self.phases).sum(axis=-1)
        bowl = self.options.bowl_depth_m * square / (1.0 + square)
        return bowl + self.options.wave_amplitude_m * waves


def draw_floor(options: FloorOptions, rng: np.random.Generator) -> CurvedFloor:
    """Draw the directions, lengths and phases of a floor's waves."""
    angle = rng.uniform(0.0, 2.0 * np.pi, options.waves)
    length_m = options.wave_length_m * rng.uniform(1.0, 1.5, options.waves)
    number = 2.0 * np.pi / length_m
    vectors = np.column_stack([number * np.cos(angle), number * np.sin(angle)])
    phases = rng.uniform(0.0, 2.0 * np.pi, options.waves)
    return CurvedFloor(options, vectors, phases)


#: What `MotionCapture.noise_m` is the deviation of, with that of a coordinate relative
#: to it. A distance between two markers has the noise of both along the line that joins
#: them.
NOISE_OF = {"coordinate": 1.0, "distance": float(np.sqrt(0.5))}


@dataclass(frozen=True, kw_only=True)
class MotionCapture:
    """The block ``motion_capture`` of the configuration: how the scene is observed.

    Parameters
    ----------
    rate_hz : float
        Frame rate, Hz.
    noise_m : float
        Standard deviation of the noise, m; the default is the dissertation's 0.6 mm.
    noise_of : {"coordinate", "distance"}
        What has this deviation: each coordinate of each marker (distances between two
        markers then vary by 1.41 times as much), or the distance between two markers
        (each coordinate then varies by 0.71 times as much). Sec. 2.2.1 can be read
        either way.
    resolution_m : float
        Rounding step of coordinates, m; 0 for none. A power of two compresses well.
    floor, gaps, markers
        See their classes.
    """

    rate_hz: float = 100.0
    noise_m: float = 0.0006
    noise_of: str = "coordinate"
    resolution_m: float = 2.0**-15
    floor: FloorOptions = field(default_factory=FloorOptions)
    gaps: GapOptions = field(default_factory=GapOptions)
    markers: MarkerOptions = field(default_factory=MarkerOptions)

    def __post_init__(self) -> None:
        require_choice("motion_capture.noise_of", self.noise_of, NOISE_OF)

    @property
    def coordinate_noise_m(self) -> float:
        """Standard deviation of the noise on each coordinate of each marker, m."""
        return self.noise_m * NOISE_OF[self.noise_of]

    def said(self) -> dict[str, Any]:
        """Return the block as plain data, with `noise_of` only if it is not usual."""
        said = asdict(self)
        if self.noise_of == "coordinate":
            del said["noise_of"]
        return said

    def observe(
        self,
        positions: FloatArray,
        floor: CurvedFloor,
        hidden: BoolArray,
        rng: np.random.Generator,
    ) -> FloatArray:
        """Return the marker positions reported by the cameras.

        Parameters
        ----------
        positions : (N, M, 3) array
            True positions over a flat floor, m.
        floor : CurvedFloor
            The floor; its height at a marker's x and y is added to the marker's z.
        hidden : (N, M) bool array
            Markers not seen; their coordinates become NaN.
        rng : numpy Generator
            Source of the independent normal noise.

        Returns
        -------
        (N, M, 3) array, m
        """
        seen = positions.copy()
        seen[..., 2] += floor.height(positions[..., :2])
        seen += self.coordinate_noise_m * rng.standard_normal(positions.shape)
        if self.resolution_m > 0:
            seen = np.round(seen / self.resolution_m) * self.resolution_m
        seen[hidden] = np.nan
        return seen

    def draw_gaps(
        self, frames: int, markers: int, rng: np.random.Generator
    ) -> BoolArray:
        """Draw the markers hidden in each frame, (N, M).

        Drop-outs of each marker begin at random (Poisson) and last a geometrically
        distributed number of frames, at least one. Overlapping ones merge.
        """
        hidden = np.zeros((frames, markers), dtype=bool)
        expected = self.gaps.rate_per_min / 60.0 * frames / self.rate_hz
        end_probability = min(1.0, 1.0 / max(1.0, self.gaps.mean_s * self.rate_hz))
        for marker in range(markers):
            count = rng.poisson(expected)
            starts = rng.integers(0, max(frames, 1), count)
            lengths = rng.geometric(end_probability, count)
            for start, length in zip(starts, lengths, strict=True):
                hidden[start : start + length, marker] = True
        return hidden


ON_FLOOR = np.array([1.0, 1.0, 0.0])  # takes a place to the floor beneath it
#: Time after the apex over which the feet of a control with a delay come to run ahead.
#: Unit: s. Origin: chosen.
RUNNING_AHEAD_S = 0.1


@dataclass(frozen=True)
class MarkerTracks:
    """True marker positions over a flat floor, with names, roles and contacts.

    `positions` (N, M, 3) m, world frame; body markers first, then feet, then a boom's.
    `foot_down` (N, n): whether each foot is in contact.
    """

    positions: FloatArray
    names: tuple[str, ...]
    roles: tuple[str, ...]
    foot_down: BoolArray


def track_markers(
    trial: Trial, scene: Scene, options: MarkerOptions, *, delay_s: float = 0.0
) -> MarkerTracks:
    """Follow all markers of a trial at its frames.

    With a control's `delay_s`, contacts happen when the guard says so. The feet run
    ahead by this time on their way down, and so are on the floor at that instant.
    """
    down, feet = _follow_feet(trial, scene, options.retraction_s, delay_s)
    body = fixed_markers(trial.states, np.array(options.body_m))
    # One place of a boom in each frame, or none.
    ends = trial.boom.reshape(len(trial.boom), trial.boom.shape[1] // 3, 3)
    boom = in_world(trial.states, ends + options.boom_m)
    n_body = body.shape[1]
    n_feet = feet.shape[1]
    n_booms = boom.shape[1]
    return MarkerTracks(
        positions=np.concatenate([body, feet, boom], axis=1),
        names=(
            *(f"body{i + 1}" for i in range(n_body)),
            *(f"foot{i + 1}" for i in range(n_feet)),
            *("boom" for _ in range(n_booms)),
        ),
        roles=(*("body",) * n_body, *("foot",) * n_feet, *("boom",) * n_booms),
        foot_down=down,
    )


def fixed_markers(states: FloatArray, points_m: FloatArray) -> FloatArray:
    """Return world positions, (N, B, 3) m, of body-fixed points (B, 3)."""
    return in_world(states, points_m[None])


def in_world(states: FloatArray, points_m: FloatArray) -> FloatArray:
    """Return world positions, (N, B, 3) m, of points (N or 1, B, 3) in body axes."""
    turned = np.einsum("nij,nbj->nbi", rotation_matrices(states[:, 3:6]), points_m)
    return states[:, None, :3] + turned


def _follow_feet(
    trial: Trial, scene: Scene, retraction_s: float, delay_s: float
) -> tuple[BoolArray, FloatArray]:
    """Return contact (N, n) and position (N, n, 3) of every foot in every frame.

    A foot in contact is on the floor, below its rest place or where it touched down. A
    foot in flight is at its rest place plus its extension at lift-off, which stays
    fixed in the body and fades within `retraction_s`. A leg that will be longer in the
    next landing is so from lift-off. Place, speed and acceleration do not jump.
    """
    time = np.arange(len(trial.states)) / trial.rate_hz
    rotations = rotation_matrices(trial.states[:, 3:6])
    down = np.zeros((len(time), scene.n_legs), dtype=bool)
    feet = np.empty((len(time), scene.n_legs, 3))
    for leg in range(scene.n_legs):
        last = _last_event(trial, scene, leg, time)
        since, place, extension, down[:, leg], longer = last
        rest = rest_foot(scene, trial.states, leg, longer)
        drawn = extension * (1.0 - smooth_step(since / retraction_s))[:, None]
        flying = rest + np.einsum("nij,nj->ni", rotations, drawn)
        if delay_s != 0:
            climb = rest_foot_climb(scene, trial.states, leg, longer)
            flying[:, 2] += delay_s * (_running_ahead(trial, since, time) * climb)
        standing = place
        if scene.feet_slide:
            standing = rest * ON_FLOOR
        feet[:, leg] = np.where(down[:, [leg]], standing, flying)
    return down, feet


def _running_ahead(trial: Trial, since: FloatArray, time: FloatArray) -> FloatArray:
    """Return by what share, (N,), a foot runs ahead: faded in from apex to contact."""
    apex = np.searchsorted(trial.apex_s, time, side="right") - 1
    falling = time - trial.apex_s[apex]
    has_not_touched = since > falling
    return np.where(has_not_touched, smooth_step(falling / RUNNING_AHEAD_S), 0.0)


def _last_event(
    trial: Trial, scene: Scene, leg: int, time: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray, FloatArray]:
    """Find the last contact event of a leg before each of N frames.

    Returns the time since, s; the foot's place on the floor then, (N, 3), world, m; its
    offset from the rest place, (N, 3), body frame, m; whether it touched down (else it
    lifted off); and how much longer than usual the leg is from then on, (N,), m.
    """
    own = np.flatnonzero(trial.event_leg == leg)
    states = trial.event_state[own]
    touches = trial.event_down[own]
    longer, longer_then = _longer_at(trial, leg, trial.event_time[own], touches)
    place = rest_foot(scene, states, leg, longer) * ON_FLOOR
    if not scene.feet_slide:  # place of the touchdown before the lift-off
        place[~touches] = place[np.flatnonzero(~touches) - 1]
    rest = rest_foot(scene, states, leg, longer_then)
    extension = np.einsum("nji,nj->ni", rotation_matrices(states[:, 3:6]), place - rest)
    # Before the first event (index -1): in flight, at rest length.
    when = np.append(trial.event_time[own], -np.inf)
    places = np.vstack([place, np.zeros(3)])
    extensions = np.vstack([extension, np.zeros(3)])
    downs = np.append(touches, False)
    longers = np.append(longer_then, trial.longer_m[0, leg])
    last = np.searchsorted(when[:-1], time, side="right") - 1
    return (
        time - when[last],
        places[last],
        extensions[last],
        downs[last],
        longers[last],
    )


def _longer_at(
    trial: Trial, leg: int, when: FloatArray, touches: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return how much longer a leg is until each of E events, and from then on, (E,).

    A leg that has lifted off takes the length with which it will touch next.
    """
    hop = np.searchsorted(trial.apex_s, when, side="right") - 1
    upcoming = len(trial.apex_s) - 1
    next_hop = np.empty(len(hop), dtype=int)
    for event in range(len(hop) - 1, -1, -1):
        if touches[event]:
            upcoming = hop[event]
        next_hop[event] = upcoming
    of_leg = trial.longer_m[:, leg]
    return of_leg[hop], of_leg[next_hop]
