"""States of a simulated body as they are about each landing, frame by frame.

From an apex on the robot itself is integrated, through the landing and beyond. Before it, where a
recording shows the robot without that apex's kick, it is flown back: a flight turned round in time
is a flight. (A control is led to the apexes of the hopper's gait; that is the gait's own flight.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hopdata.hybrid import System, solve_batch
from hopdata.scenes.body import N_STATES
from hopdata.scenes.scene import Control, Scene
from hopdata.synthesis.camera import fixed_markers
from hopdata.synthesis.hops import Hop, padded
from hopdata.synthesis.landings import NOT_YET, landing_system, landing_vectors
from hopdata.synthesis.trial import Trial

PHASES = 16  # of the frames: each landing has one of them
BACK_S = 0.14  # before the apex; of flight there are some 0.15 s
RTOL, ATOL = 1e-6, 1e-9
NO_HEIGHT_M = -1e3  # of a section that is never reached


@dataclass(frozen=True)
class Apexes:
    """Where L landings begin: states (L, 12) before and after the kick, preloads (L, n), N."""

    before: np.ndarray
    after: np.ndarray
    preloads_n: np.ndarray

    def __len__(self) -> int:
        return len(self.after)

    def some(self, rows: np.ndarray) -> Apexes:
        """Return some of them."""
        return Apexes(self.before[rows], self.after[rows], self.preloads_n[rows])


def apexes_of(trial: Trial) -> Apexes:
    """Return the apexes of a trial whose landings stood, and which flew there by themselves."""
    starts = np.asarray(trial.hop_start_s)
    ends = starts + [hop.end_time_s for hop in trial.hops]
    flown = np.isclose(ends[:-1], starts[1:], rtol=0.0, atol=1e-9)
    pairs = zip(trial.hops[:-1], trial.hops[1:], flown, strict=True)
    kept = [(old, new) for old, new, joined in pairs if joined and _stood(new)]
    return Apexes(
        np.array([old.end_state for old, _ in kept]),
        np.array([new.start_state for _, new in kept]),
        np.array([new.preloads_n for _, new in kept]),
    )


def joined(parts: list[Apexes]) -> Apexes:
    """Return the apexes of several trials."""
    names = Apexes.__dataclass_fields__
    return Apexes(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def true_states(
    scene: Scene,
    control: Control,
    apexes: Apexes,
    *,
    until_s: float,
    rate_hz: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (L, W) from the apexes, s, at random phases, and states (L, W, 12) then.

    NaN from the next apex on.
    """
    count = round((BACK_S + until_s) * rate_hz)
    back = round(BACK_S * rate_hz)
    phases = rng.uniform(0.0, 1.0 / rate_hz, PHASES)
    group = rng.integers(0, PHASES, len(apexes))
    times = (np.arange(count) - back) / rate_hz + phases[group][:, None]
    states = np.full((*times.shape, N_STATES), np.nan)
    for number in np.flatnonzero(np.bincount(group, minlength=PHASES)):
        rows = np.flatnonzero(group == number)
        states[rows] = states_at(scene, control, apexes.some(rows), times[rows[0]])
    return times, states


def tracks_of(states: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Return markers (L, W, B, 3), m, of states (L, W, 12), without noise."""
    flat = fixed_markers(states.reshape(-1, N_STATES), points_m)
    return flat.reshape(*states.shape[:2], *points_m.shape)


def states_at(scene: Scene, control: Control, apexes: Apexes, times_s: np.ndarray) -> np.ndarray:
    """Return states (L, W, 12) at times (W,) counted from the apex, s, in order."""
    vectors = landing_vectors(
        scene, control, apexes.preloads_n, point_m=np.zeros(3), height_m=NO_HEIGHT_M
    )
    own = scene.system(control)
    early = times_s < 0
    back = _turned_round(_flown(own, _turned_round(apexes.before), vectors, -times_s[early][::-1]))
    ahead = _flown(own, apexes.after, vectors, times_s[~early])
    return np.concatenate([back[:, ::-1], ahead], axis=1)


def _flown(own: System, states: np.ndarray, vectors: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    system = landing_system(own)
    unknown = np.full((len(states), system.n_states - own.n_states), NOT_YET)
    solution = solve_batch(
        system, (0.0, float(times_s[-1])), np.hstack([padded(states, own), unknown]),
        params=vectors,
        mode=[0] * system.n_modes, rtol=RTOL, atol=ATOL, t_eval=times_s, workers=1,
    )  # fmt: skip
    assert solution.y is not None
    return np.moveaxis(solution.y[:, :N_STATES], 1, 2)


def _turned_round(states: np.ndarray) -> np.ndarray:
    return states * np.repeat([1.0, -1.0], 6)


def _stood(hop: Hop) -> bool:
    return hop.all_stood() and not hop.fell
