"""What a camera shows of the landings of `bodies`: noise, drift, filters and faults."""

from dataclasses import dataclass

import numpy as np
from bodies import Body, Landings
from body_motion import filtered_markers, rotation

from hopdata.maps.truth.maps import marker_states


@dataclass(frozen=True)
class Seen:
    """How landings are seen.

    Attributes
    ----------
    noise_m
        Noise of the cameras, m. Errors of states, feet and instants follow from it as
        hopdata states them at 100 Hz.
    alike
        Correlation of the errors of consecutive landings.
    blur_s
        Width of a low-pass filter, s: 1 / (2 pi cut-off frequency); 0 for none.
    drift_rad
        Tilt of the cameras at the end of the session, rad.
    fault
        One of `FAULTS`.
    """

    noise_m: float = 0.0006
    alike: float = 0.0
    blur_s: float = 0.0
    drift_rad: float = 0.0
    fault: str = ""


#: Standard errors per metre of camera noise: of positions and velocities before and
#: after, of instants (s) and of feet.
PER_NOISE = {
    "before": (0.42, 8.3),
    "after": (0.67, 83.0),
    "instants": 1.25,
    "feet": 0.42,
}


@dataclass(frozen=True)
class Study:
    """What `judge` is given, for n landings of F feet.

    `x`, `y` (n, 18) marker states, `feet` (n, F, 3) at the pre section in the frame of
    `x`; the standard errors have the shapes of what they belong to.
    """

    x: np.ndarray
    y: np.ndarray
    instants: np.ndarray
    instants_se: np.ndarray
    feet: np.ndarray
    feet_se: np.ndarray
    time: np.ndarray
    blocks: np.ndarray


def study(
    body: Body, landings: Landings, rng: np.random.Generator, seen: Seen = Seen()
) -> Study:
    """Return what a recording of these landings shows."""
    n = len(landings)
    before = np.hstack([np.zeros((n, 3)), landings.inputs[:, :8]])
    exact = {
        "before": marker_states(before, body.markers),
        "after": marker_states(landings.outcomes, body.markers),
        "instants": landings.instants.copy(),
        "feet": feet_of(body, landings),
    }
    if seen.blur_s:
        exact |= _blurred(body, landings, seen.blur_s)
    errors = {
        "before": np.repeat(PER_NOISE["before"], 9) * seen.noise_m,
        "after": np.repeat(PER_NOISE["after"], 9) * seen.noise_m,
        "instants": PER_NOISE["instants"] * seen.noise_m,
        "feet": PER_NOISE["feet"] * seen.noise_m,
    }
    shown = {}
    for name, values in exact.items():
        noise = _noise(values.shape, seen.alike, rng)
        shown[name] = values + errors[name] * noise
    if seen.drift_rad:
        _tilt(shown, seen.drift_rad * landings.time)
    if seen.fault:
        FAULTS[seen.fault](shown, rng)
    return Study(
        x=shown["before"],
        y=shown["after"],
        instants=shown["instants"],
        instants_se=np.full(landings.instants.shape, errors["instants"]),
        feet=shown["feet"],
        feet_se=np.full(shown["feet"].shape, errors["feet"]),
        time=landings.time.copy(),
        blocks=landings.blocks.copy(),
    )


def _blurred(body: Body, landings: Landings, width_s: float) -> dict[str, np.ndarray]:
    """Return marker states that a Gaussian low-pass of this width has smoothed."""
    offsets = width_s * np.linspace(-3.0, 3.0, 25)
    weights = np.exp(-0.5 * (offsets / width_s) ** 2)
    kernel = np.column_stack([offsets, weights / weights.sum()])
    smoothed = {}
    for name, centres in (
        ("before", np.zeros(len(landings))),
        ("after", landings.ends),
    ):
        smoothed[name] = filtered_markers(
            landings.inputs,
            landings.wear,
            body.base,
            body.top_m,
            body.build,
            landings.instants,
            centres,
            body.markers + body.build.centre,
            kernel,
        )
    return smoothed


def feet_of(body: Body, landings: Landings) -> np.ndarray:
    """Return the feet (n, F, 3) at the pre section, in the frame of the marker states."""
    u = landings.inputs
    feet = body.base + u[:, 8:].reshape(len(u), -1, 3) - body.build.centre
    turns = np.array([rotation(0.0, pitch, roll) for pitch, roll in u[:, :2]])
    return np.einsum("nij,nfj->nfi", turns, feet)


def _noise(
    shape: tuple[int, ...], alike: float, rng: np.random.Generator
) -> np.ndarray:
    """Return normal errors whose consecutive rows correlate by `alike`."""
    noise = rng.standard_normal(shape)
    if alike:
        fresh = np.sqrt(1.0 - alike**2)
        for row in range(1, len(noise)):
            noise[row] = alike * noise[row - 1] + fresh * noise[row]
    return noise


def _tilt(shown: dict[str, np.ndarray], angles: np.ndarray) -> None:
    """Turn states and feet about the x axis."""
    turns = np.array([rotation(0.0, 0.0, angle) for angle in angles])
    for name in ("before", "after", "feet"):
        points = shown[name].reshape(len(angles), -1, 3)
        points = np.einsum("nij,nkj->nki", turns, points)
        shown[name] = points.reshape(shown[name].shape)


def _some(n: int, share: float, rng: np.random.Generator) -> np.ndarray:
    """Return the numbers of a share of n rows, in random order."""
    return rng.permutation(n)[: round(share * n)]


def swapped(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Exchange two body markers in 3 % of the landings, before or after."""
    n = len(shown["before"])
    for row in _some(n, 0.03, rng):
        side = shown[("before", "after")[rng.integers(2)]]
        points = side[row].reshape(2, 3, 3)
        side[row] = points[:, [1, 0, 2]].ravel()


def slipped(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Let the body slip in 2 % of the landings: it goes on by 1 m/s and turns."""
    n = len(shown["before"])
    for row in _some(n, 0.02, rng):
        points = shown["after"][row].reshape(2, 3, 3)
        push = np.append(rng.normal(0.0, 1.0, 2), rng.normal(0.0, 0.3))
        spin = rng.normal(0.0, 5.0, 3)
        arms = points[0] - points[0].mean(axis=0)
        points[1] += push + np.cross(spin, arms)


def bounced(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Let 2 % of the landings have instants and outcome of another one."""
    n = len(shown["before"])
    rows = _some(n, 0.02, rng)
    others = rng.integers(0, n, len(rows))
    for name in ("instants", "after"):
        shown[name][rows] = shown[name][others].copy()


def outlying(shown: dict[str, np.ndarray], rng: np.random.Generator) -> None:
    """Shift the contact of one foot by 30 to 80 ms in 3 % of the landings."""
    n, feet = shown["instants"].shape
    rows = _some(n, 0.03, rng)
    signs = rng.choice([-1.0, 1.0], len(rows))
    shifts = signs * rng.uniform(0.03, 0.08, len(rows))
    shown["instants"][rows, rng.integers(0, feet, len(rows))] += shifts


FAULTS = {
    "swapped markers": swapped,
    "slips": slipped,
    "double bounces": bounced,
    "outlying instants": outlying,
}
