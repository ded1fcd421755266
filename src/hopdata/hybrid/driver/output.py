"""The trajectory's rows: samples at wanted times, or else one row for each step."""

from __future__ import annotations

from typing import NamedTuple

from hopdata.hybrid.compiled.kernel import kernel
from hopdata.hybrid.compiled.views import FloatTable, FloatVector
from hopdata.hybrid.driver.dense import interpolate, prepare_interpolant
from hopdata.hybrid.driver.layout import END, ROWS, SAMPLES, SCRATCH, SPAN, Memory, T, Y
from hopdata.hybrid.driver.problem import Problem


class Output(NamedTuple):
    """Room for the trajectory."""

    wanted: FloatVector  # times; the samples belong to them
    samples: FloatTable
    rows: FloatTable  # time and state of each step
    n_rows: int  # room for so many
    every_step: bool


@kernel
def put(m: Memory, source: int, table: FloatTable, row: int, first: int) -> None:
    """Copy row `source` of the states to a row of another table, from a column on."""
    for i in range(m.states.width):
        table[row, first + i] = m.states[source, i]


@kernel
def write_row(m: Memory, out: Output) -> None:
    """Write the present state as the row of a new step."""
    if out.every_step:
        out.rows[m.counts[ROWS], 0] = m.clock[T]
        put(m, Y, out.rows, m.counts[ROWS], 1)
        m.counts[ROWS] += 1


@kernel
def rewrite_row(m: Memory, out: Output) -> None:
    """Write the state after an event over the one before it."""
    if out.every_step and m.counts[ROWS] > 0:
        put(m, Y, out.rows, m.counts[ROWS] - 1, 1)
    last = m.counts[SAMPLES] - 1
    if last >= 0 and out.wanted[last] == m.clock[T]:
        put(m, Y, out.samples, last, 0)


@kernel
def sample_start(m: Memory, out: Output) -> None:
    """Write the initial state, if it is wanted."""
    if out.wanted.width > 0 and out.wanted[0] == m.clock[T]:
        put(m, Y, out.samples, 0, 0)
        m.counts[SAMPLES] = 1


@kernel
def sample_step(p: Problem, m: Memory, out: Output, t_new: float, dt: float) -> None:
    """Fill in the wanted times within the step of length `dt` that ends at `t_new`."""
    j, n = m.counts[SAMPLES], out.wanted.width
    if j == n or out.wanted[j] > t_new:
        return
    prepare_interpolant(p, m, dt)
    while j < n and out.wanted[j] < t_new:
        interpolate(p, m, (out.wanted[j] - m.clock[T]) / m.clock[SPAN], SCRATCH)
        put(m, SCRATCH, out.samples, j, 0)
        j += 1
    if j < n and out.wanted[j] == t_new:
        put(m, END, out.samples, j, 0)
        j += 1
    m.counts[SAMPLES] = j
