"""Ranges of guards over many boxes, beside what samples of them find."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from hopdata.hybrid import guard
from hopdata.hybrid import layout as at
from hopdata.hybrid.compiled.kernel import call_guard
from hopdata.hybrid.compiled.memory import view
from hopdata.hybrid.driver.paths import (
    answer_next,
    forget_ranges,
    join_all_runs,
    run_once,
)
from hopdata.hybrid.numbers import answers
from hopdata.hybrid.numbers.guards import guards_for_ranges

N = 3  # states
N_PARAMS = 3
SAMPLES = 24
COMPARED, OUTSIDE, RATES_OUTSIDE, UNKNOWN, OPEN, PATHS = range(6)  # what is counted


class Problem(NamedTuple):
    """What the code for ranges reads of a problem."""

    branches: int
    guards: int
    rate_bound: int
    mode: object
    params: object


class Memory(NamedTuple):
    """What the code for ranges reads and writes of the memory."""

    states: object
    guards: object
    flags: object
    lists: object
    counts: object


class Box(NamedTuple):
    """Many pieces of paths, a row each: their start, their length, and rates."""

    t: np.ndarray
    y: np.ndarray
    span: np.ndarray
    least_rate: np.ndarray
    most_rate: np.ndarray


def boxes(rng, count, least=-12.0, most=0.0, wide=4.0):
    """Return random pieces, whose lengths are powers of 10."""
    slowest = rng.uniform(-1.5, 1.5, (count, N))
    spread = rng.uniform(0.0, 0.3, (count, N)) * rng.integers(0, 2, (count, 1))
    return Box(
        rng.uniform(-wide, wide, count),
        rng.uniform(-wide, wide, (count, N)),
        10.0 ** rng.uniform(least, most, count),
        slowest,
        slowest + spread,
    )


@njit
def memory_of(tables):
    """Return the memory, in which one guard is awake."""
    states, guards, flags, lists, counts = tables
    return Memory(view(states), view(guards), view(flags), view(lists), view(counts))


@njit
def evaluate(p, m, k, start, end, t_rate):
    """Write the ranges of guard k into rows H_LEAST to RATE_MOST; count the paths."""
    m.lists[at.AWAKE, 0] = k
    m.counts[at.N_AWAKE] = 1
    m.counts[at.NGEV] = 0
    answer_next(m, 0)
    run_once(p, m, start, end, t_rate)
    if not join_all_runs(p, m, start, end):
        forget_ranges(m)
    return m.counts[at.NGEV]


@njit
def is_open(m):
    """Return whether a path was open or lost, or the last one met a jump."""
    c = m.counts
    met = c[at.NGEV] > 1 or c[at.ANSWERS + answers.OPENED] > 0
    met = met or c[at.ANSWERS + answers.JUMPED] > 0
    return met or c[at.ANSWERS + answers.LOST] > 0


@njit
def enclose(states, b, box):
    """Write the ranges of a path of changing rate from the start of a box."""
    for i in range(N):
        start = box.y[b, i]
        grain = 4e-16 * (abs(start) + 2.0)
        lo = box.least_rate[b, i] - 1e-15
        hi = box.most_rate[b, i] + 1e-15
        states[at.LEAST, i] = start + min(0.0, lo * box.span[b]) - grain
        states[at.MOST, i] = start + max(0.0, hi * box.span[b]) + grain
        states[at.LEAST_SLOPE, i] = lo
        states[at.MOST_SLOPE, i] = hi


@njit
def place_on(states, b, box, part, row):
    """Write the state at a part of the path, whose slopes go from least to most."""
    s = part * box.span[b]
    for i in range(N):
        bend = (box.most_rate[b, i] - box.least_rate[b, i]) / box.span[b]
        states[row, i] = box.y[b, i] + s * (box.least_rate[b, i] + 0.5 * s * bend)
        states[at.SLOPE, i] = box.least_rate[b, i] + s * bend
    return box.t[b] + s


@njit
def sampled(scalar, p, m, k, b, box, parts, row):
    """Evaluate the plain guard on the path."""
    t = place_on(m.states, b, box, parts, at.SCRATCH)
    call_guard(
        scalar, t, m.states, at.SCRATCH, m.states, at.SLOPE, p.mode, p.params,
        k, m.guards, row, m.guards, at.RATE,
    )  # fmt: skip
    return m.guards[row, k]


@njit
def rounding(p, m, k, b, box, part):
    """Return a bound on the rounding of a sample: the width of its own range."""
    t = place_on(m.states, b, box, part, at.LEAST)
    place_on(m.states, b, box, part, at.MOST)
    evaluate(p, m, k, t, t, 1.0)
    return m.guards[at.H_MOST, k] - m.guards[at.H_LEAST, k]


@njit
def compared(branches, scalar, k, box, parts, tables, params, mode, found):
    """Count, over all boxes, what samples find outside of the ranges of guard k."""
    p = Problem(branches, 0, 1, view(mode), view(params))
    m = memory_of(tables)
    for b in range(len(box.t)):
        enclose(m.states, b, box)
        end = box.t[b] + box.span[b]
        found[b, PATHS] = evaluate(p, m, k, box.t[b], end, 1.0)
        lo = m.guards[at.H_LEAST, k]
        hi = m.guards[at.H_MOST, k]
        dlo = m.guards[at.RATE_LEAST, k]
        dhi = m.guards[at.RATE_MOST, k]
        found[b, UNKNOWN] = lo == -np.inf and hi == np.inf
        found[b, OPEN] = is_open(m)
        before = 0.0
        for j in range(len(parts)):
            h = sampled(scalar, p, m, k, b, box, parts[j], at.H)
            found[b, COMPARED] += 1
            is_inside = lo <= h <= hi or (lo == -np.inf and hi == np.inf)
            found[b, OUTSIDE] += 0 if is_inside else 1
            time = parts[j] * box.span[b]
            if j > 0 and box.span[b] > 1e-6 and found[b, OPEN] == 0:
                passed = (parts[j] - parts[j - 1]) * box.span[b]
                noise = 1e-11 * (1.0 + abs(h) + abs(before)) / passed
                rate = (h - before) / passed
                found[b, COMPARED] += 1
                is_inside = dlo - noise <= rate <= dhi + noise
                if np.isfinite(rate) and not is_inside:
                    blur = rounding(p, m, k, b, box, parts[j])
                    blur += rounding(p, m, k, b, box, parts[j - 1])
                    is_outside = (
                        rate < dlo - blur / passed or rate > dhi + blur / passed
                    )
                    found[b, RATES_OUTSIDE] += 1 if is_outside else 0
            before = h
        assert time >= 0.0
    return lo, hi, dlo, dhi


class Ranged:
    """A guard of many, with its code for ranges."""

    def __init__(self, function, n_guards, params=(0.3, -1.2, 2.0)):
        self.declared = guard(function)
        self.made = guards_for_ranges(self.declared)
        assert self.made.address > 0, self.made.reason
        assert self.declared.compiled
        self.mode = np.array([1, -1])
        self.params = np.array(params, dtype=float)
        self.tables = (
            np.zeros((at.W1, N)),
            np.zeros((at.GUARD_ROWS, n_guards)),
            np.zeros((at.FLAG_ROWS, n_guards), dtype=np.int64),
            np.zeros((at.LIST_ROWS, n_guards), dtype=np.int64),
            np.zeros(at.COUNT_SLOTS, dtype=np.int64),
        )

    def over(self, box, k, rng):
        """Return the counts of each box."""
        found = np.zeros((len(box.t), 6), dtype=np.int64)
        parts = np.sort(rng.uniform(0.0, 1.0, SAMPLES))
        parts[0] = 0.0
        parts[-1] = 1.0
        compared(
            self.made.address, self.declared.address, k, box, parts, self.tables,
            self.params, self.mode, found,
        )  # fmt: skip
        return found

    def at(self, k, lo, hi, rates=(0.0, 0.0), t=(0.0, 0.0), pace=1.0):
        """Return (lo, hi, dlo, dhi) of guard k where all states have one range."""
        states = self.tables[0]
        states[at.LEAST] = lo
        states[at.MOST] = hi
        states[at.LEAST_SLOPE], states[at.MOST_SLOPE] = rates
        paths = once(
            self.made.address, k, *t, pace, self.tables, self.params, self.mode
        )
        rows = [at.H_LEAST, at.H_MOST, at.RATE_LEAST, at.RATE_MOST]
        return *self.tables[1][rows, k].tolist(), paths

    @property
    def told(self):
        """The integers in the memory of answers."""
        first = int(at.ANSWERS)
        return self.tables[-1][first : first + answers.N_INTEGERS]

    @property
    def first(self):
        """What changes sign at the first open comparison or jump."""
        first = int(at.ANSWERS)
        last = first + answers.FIRST_MOST_RATE + 1
        return self.tables[-1][first + answers.FIRST_LEAST : last].view(np.float64)


@njit
def once(branches, k, start, end, pace, tables, params, mode):
    p = Problem(branches, 0, 1, view(mode), view(params))
    return evaluate(p, memory_of(tables), k, start, end, pace)
