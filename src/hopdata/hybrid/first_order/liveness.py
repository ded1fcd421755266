"""How the active guards are crossed around one state, in all combinations of their locks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hopdata.hybrid.first_order.local import FloatArray, Instant, Linearisation, guards_at
from hopdata.hybrid.first_order.modes import Combination, mode_fields
from hopdata.hybrid.system import System


def draw_around(states: FloatArray, radii: FloatArray, n: int, seed: int) -> FloatArray:
    """Return states (m, n_states) and behind them n uniform draws from an ellipsoid around each."""
    rng = np.random.default_rng(seed)
    count, size = states.shape
    directions = rng.normal(size=(count, n, size))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    lengths = rng.random((count, n, 1)) ** (1 / size)
    drawn = states[:, None, :] + radii * lengths * directions
    return np.concatenate([states, drawn.reshape(-1, size)])


class Liveness:
    """The active guards in all modes at one state; the attributes are those of `EventSelection`."""

    def __init__(
        self,
        system: System,
        start: Instant,
        active: Sequence[int],
        scale: FloatArray,
        seed: int,
    ) -> None:
        self.system, self.scale, self.active = system, scale, list(active)
        self.modes = mode_fields(system, start, active, scale, seed)
        self.side = -start.mode[self.active]
        self.start = start
        passing = {c: self.side * v.guard_rates[self.active] for c, v in self.modes.items()}
        self.rates = np.min(list(passing.values()), axis=0)
        self.margins = np.min([self._margin(passing[c], v) for c, v in self.modes.items()], axis=0)
        self.kept = np.array([self._kept(passing, i) for i in range(len(self.active))])
        self.jump = max(self._jump(v.instant) for v in self.modes.values())
        self.wrong_way = max(self._wrong_way(c) for c in self.modes)

    def _margin(self, passing: FloatArray, view: Linearisation) -> FloatArray:
        size = view.guard_scales[self.active]
        return np.divide(passing, size, out=np.zeros_like(passing), where=size > 0)

    def _kept(self, passing: dict[Combination, FloatArray], i: int) -> float:
        """Return the smallest ratio of rates around the crossing of active guard number i."""
        ratios = []
        for before, rates in passing.items():
            after = tuple(sorted({*before, self.active[i]}))
            if after != before and after in passing and rates[i] != 0:
                ratios.append(passing[after][i] / rates[i])
        return float(min(ratios, default=0.0))

    def _jump(self, there: Instant) -> float:
        size = np.maximum(self.scale, np.abs(self.start.y))
        return float(np.max(np.abs(there.y - self.start.y) / size))

    def _wrong_way(self, crossed: Combination) -> float:
        """Return how far the handlers have moved a guard against its lock."""
        there = self.modes[crossed]
        shift = np.subtract(self._surfaces(there), self._surfaces(self.modes[()]))
        size = np.maximum(np.abs(there.gradients[self.active]) @ self.scale, np.finfo(float).tiny)
        has_crossed = np.isin(self.active, crossed)
        against = np.where(has_crossed, -1, 1) * self.side * shift / size
        locks = np.where(has_crossed, self.side, -self.side)
        kept = np.array_equal(there.instant.mode[self.active], locks)
        return float(max(0.0, against.max())) if kept else np.inf

    def _surfaces(self, view: Linearisation) -> FloatArray:
        return guards_at(self.system, view.instant, view.rate)[0][self.active]
