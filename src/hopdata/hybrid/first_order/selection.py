"""Is a system event-selected around a state? Liveness in every mode, and continuity.

Definitions 1.2.1 and 1.2.2 of the dissertation: near the state every active guard is approached at
a rate that is bounded away from zero, whichever of the others have been crossed, and the state does
not jump. Then every trajectory crosses each of them exactly once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan

import numpy as np
from numpy.typing import ArrayLike

from hopdata.arrays import FloatArray
from hopdata.hybrid.first_order import linearise as local
from hopdata.hybrid.first_order.linearise import Combination, Instant, Linearisation
from hopdata.hybrid.system import System

# Findings of a check, and the table that shows them.


@dataclass(frozen=True)
class Finding:
    """One condition: what was found, and what is needed.

    Parameters
    ----------
    condition : str
        What should hold.
    passed : bool
        Whether it does.
    value : float
        What was found; NaN if it could not be computed.
    needed : str
        What the value has to be.
    detail : str
        What the value is.
    """

    condition: str
    passed: bool
    value: float
    needed: str
    detail: str

    @classmethod
    def at_most(cls, condition: str, value: float, bound: float, detail: str) -> Finding:
        """Return a finding that passes if the value is not above a bound."""
        return cls(condition, bool(value <= bound), float(value), f"<= {bound:g}", detail)

    @classmethod
    def above(cls, condition: str, value: float, bound: float, detail: str) -> Finding:
        """Return a finding that passes if the value is above a bound."""
        return cls(condition, bool(value > bound), float(value), f"> {bound:g}", detail)

    def cells(self) -> tuple[str, ...]:
        """Return the row of a table."""
        value = "-" if isnan(self.value) else f"{self.value:.3g}"
        return ("yes" if self.passed else "NO", self.condition, value, self.needed, self.detail)

    @staticmethod
    def table(findings: Sequence[Finding]) -> str:
        """Return findings as aligned lines."""
        head = "", "condition", "found", "needed", "the number is"
        rows = [head, *(finding.cells() for finding in findings)]
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = ("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in rows)
        return "\n".join(line.rstrip() for line in lines)


# How the active guards are crossed around one state, in all combinations of their locks.


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
        self, system: System, start: Instant, active: Sequence[int], scale: FloatArray, seed: int
    ) -> None:
        self.system, self.scale, self.active = system, scale, list(active)
        self.modes = local.mode_fields(system, start, active, scale, seed)
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
        return local.guards_at(self.system, view.instant, view.rate)[0][self.active]


LIVE = 1e-6
UNCHANGED = 1e-12


@dataclass(frozen=True)
class EventSelection:
    """What `check_event_selected` found.

    Parameters
    ----------
    guards : tuple of str
        The active guards.
    n_samples, n_modes : int
        Number of states, and of combinations of locks at each.
    margins : (n_guards,) array
        For each guard the smallest rate at which it is crossed over samples and modes, in its own
        direction, over the sum |Dh_i f_i| + |dh/dt|: 1 if all terms pull together, negative if it
        runs back. Does not change with the units of state, guard or time.
    rates : (n_guards,) array
        The smallest rates themselves, in the guard's unit per second.
    kept : (n_guards,) array
        Smallest ratio of a guard's rate after its own crossing to that before.
    jump : float
        Largest change of a state coordinate by a handler, over its size or `scale`.
    wrong_way : float
        Largest step by which a handler moves the state, or a surface, back over a guard that has
        been crossed, or over one that has not, in units of the guard's scale.
    findings : tuple of Finding
        The conditions with their bounds.
    """

    guards: tuple[str, ...]
    n_samples: int
    n_modes: int
    margins: FloatArray
    rates: FloatArray
    kept: FloatArray
    jump: float
    wrong_way: float
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> bool:
        """Whether all conditions hold."""
        return all(finding.passed for finding in self.findings)

    def __str__(self) -> str:
        verdict = "event-selected" if self.passed else "not event-selected"
        where = f"{self.n_samples} states, {self.n_modes} modes, guards {', '.join(self.guards)}"
        return f"{verdict}: {where}\n{Finding.table(self.findings)}"


def check_event_selected(
    system: System,
    states: ArrayLike,
    *,
    params: ArrayLike = (),
    mode: Sequence[int],
    t: float = 0.0,
    guards: Sequence[int | str] | None = None,
    radius: float = 0.0,
    n_samples: int = 0,
    seed: int = 0,
    scale: ArrayLike | None = None,
    margin: float = LIVE,
) -> EventSelection:
    """Check on samples that a system is event-selected.

    Parameters
    ----------
    system : System
        Field, guards and handler.
    states : (n,) or (m, n) array_like
        States to look at.
    params, mode, t
        As for `solve`; `mode` is that before the crossings, with all locks set.
    guards : sequence of int or str, optional
        The active guards. By default those on whose surface the first state lies.
    radius, n_samples, seed
        Add so many states, drawn around each from a ball of this radius in units of `scale`.
    scale : (n,) array_like, optional
        Size of each coordinate. By default 1.
    margin : float
        Bound that the margins have to exceed.

    Returns
    -------
    EventSelection
        Over all 2^n combinations of locks up to n = 8 active guards, over 256 beyond.
    """
    sizes = local.state_scale(system, scale)
    given = np.atleast_2d(np.asarray(states, dtype=np.float64))
    places = draw_around(given, radius * sizes, n_samples, seed)
    starts = [local.instant(system, y, params=params, mode=mode, t=t) for y in places]
    active = local.active_guards(system, local.linearise(system, starts[0], sizes), guards, sizes)
    if not active:
        raise ValueError("guards: expected at least one, the state lies on no surface")
    views = [Liveness(system, start, active, sizes, seed) for start in starts]
    margins, rates, kept = (
        np.min([getattr(view, name) for view in views], axis=0)
        for name in ("margins", "rates", "kept")
    )
    jump, wrong_way = (max(getattr(view, name) for view in views) for name in ("jump", "wrong_way"))
    slowest = f"(it is {rates[int(np.argmin(margins))]:.3g} a second)"
    findings = (
        Finding.at_most(
            "trajectories are continuous", jump, UNCHANGED, "largest jump of a coordinate"
        ),
        Finding.above(
            "each guard is crossed", float(margins.min()), margin,
            f"smallest normalised rate of a guard in any mode {slowest}",
        ),
        Finding.at_most(
            "each guard is crossed only once", wrong_way, UNCHANGED,
            "largest step of a handler against a lock",
        ),
        Finding.above(
            "contact keeps penetration velocity", float(kept.min()), margin,
            "smallest ratio of a guard's rate after its crossing to that before",
        ),
    )  # fmt: skip
    return EventSelection(
        tuple(system.guard_names[k] for k in active),
        len(views),
        len(views[0].modes),
        *(margins, rates, kept, jump, wrong_way),
        findings,
    )
