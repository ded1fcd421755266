"""A plan that is near the best there is: a coarse table of all sequences, then polishes.

The printed controller descends from one start, and stays in the dip that it starts in.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hopdata.code_cache import kept_njit
from hopdata.errors import ConfigError
from hopdata.steering.control.coarse_kernel import coarse_table, lowest_dips
from hopdata.steering.control.objectives import Horizon, Objective, ToPoint
from hopdata.steering.control.plan import Plan, checked_state
from hopdata.steering.control.polish_kernel import polish
from hopdata.steering.control.rollout_kernel import target_of
from hopdata.steering.control.tables import table_of
from hopdata.steering.models.interface import FrameChangeMap
from hopdata.steering.models.tabulated import TabulatedMap

FloatArray = NDArray[np.float64]

#: Swings of each hop in the table, by the number of hops: 10^4 sequences or so.
SWINGS_IN_TABLE = {1: 101, 2: 65, 3: 25, 4: 11, 5: 7, 6: 5}
SMOOTHINGS = np.array([0.02, 0.002, 1e-4])  # m or rad


@dataclass(frozen=True, kw_only=True)
class Search:
    """How many sequences are tried.

    Parameters
    ----------
    swings : int, optional
        Swings of each hop in the table, odd; by default about 10^4 sequences in all.
    starts : int
        Lowest dips of the table that are polished.
    """

    swings: int | None = None
    starts: int = 6

    def __post_init__(self) -> None:
        if self.swings is not None and (self.swings < 3 or self.swings % 2 == 0):
            raise ConfigError(f"swings: expected an odd number from 3 on, found {self.swings}")
        if self.starts < 1:
            raise ConfigError(f"starts: expected 1 at least, found {self.starts}")


@dataclass(frozen=True, kw_only=True)
class GlobalisedController:
    """Predictive control over a short horizon, by a search that does not depend on a start.

    Parameters
    ----------
    model : FrameChangeMap
        Frame changes; tabulated unless it is a `TabulatedMap`.
    objective : ToPoint or ToHeading
    horizon : Horizon
    search : Search
    """

    model: FrameChangeMap
    objective: Objective = field(default_factory=ToPoint)
    horizon: Horizon = field(default_factory=Horizon)
    search: Search = field(default_factory=Search)

    def __post_init__(self) -> None:
        object.__setattr__(self, "model", table_of(self.model, self.horizon.swing_limit_rad))

    def towards(self, objective: Objective) -> GlobalisedController:
        """Return the same controller with another objective."""
        return replace(self, objective=objective)

    def plan(
        self, pose: ArrayLike, boom_angle_rad: float, previous_swing_rad: float | None = None, /
    ) -> Plan:
        """Plan from a pose and a boom angle; the previous swing is not used."""
        del previous_swing_rad
        start, boom = checked_state(pose, boom_angle_rad)
        assert isinstance(self.model, TabulatedMap)
        hops = self.horizon.hops
        swings, poses = np.empty(hops), np.empty((hops + 1, 3))
        value = best_swings(
            self.model.coefficients,
            self.horizon.swing_limit_rad,
            start,
            boom,
            self.search.swings or SWINGS_IN_TABLE[hops],
            self.search.starts,
            target_of(self.objective),
            SMOOTHINGS,
            swings,
            poses,
        )
        return Plan(swings, poses, value)


@kept_njit(nogil=True, error_model="numpy")
def best_swings(coefficients, limit, pose, boom, n, most_starts, target, smoothings, swings, poses):  # type: ignore[no-untyped-def]
    """Fill `swings` (H,) and `poses` (H + 1, 3) with the best found; its objective."""
    horizon = swings.size
    values = np.empty(n**horizon)
    coarse_table(coefficients, limit, pose, boom, n, horizon, target, values)
    starts = np.empty(most_starts, dtype=np.int64)
    found = lowest_dips(values, n, horizon, starts)
    trial, path = np.empty(horizon), np.empty((horizon + 1, 3))
    best = np.inf
    for start in starts[:found]:
        place = start
        for k in range(horizon - 1, -1, -1):
            trial[k] = -limit + (place % n) * 2.0 * limit / (n - 1)
            place //= n
        value = polish(coefficients, limit, pose, boom, trial, target, smoothings, path)
        if value < best:
            best = value
            swings[:] = trial
            poses[:] = path
    return best
