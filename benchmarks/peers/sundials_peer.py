"""SUNDIALS: CVODE, stopped at each root of the nearest guard and started again.

Two ways to it: scikit-sundae, whose callbacks are Python calls (here of compiled functions), and
the C library that scikit-sundae brings, with compiled callbacks and a compiled loop.
"""

from __future__ import annotations

from functools import partial

from sksundae.cvode import CVODE

from peers.compiled import Compiled, compiled
from peers.cvode_library import prepare_library
from peers.problems import Problem
from peers.solver import MOST_EVENTS, FloatArray, LostEventError, Run, Solver

METHODS = ("Adams", "BDF")


def solvers(problem: Problem) -> list[Solver]:
    """Return CVODE's two methods, through scikit-sundae and through C."""
    functions = compiled(problem)
    ways = {"CVODE, scikit-sundae": prepare_wrapped, "CVODE, C": prepare_library}
    return [
        Solver("SUNDIALS", way, method, partial(prepare, problem, functions, method))
        for way, prepare in ways.items()
        for method in METHODS
    ]


def prepare_wrapped(problem: Problem, functions: Compiled, method: str, tolerance: float) -> Run:
    """Return the loop over the events, by scikit-sundae."""
    fill, nearest = functions.fill, functions.nearest
    data = functions.data.copy()
    start, end = problem.t_span

    def rates(_: float, y: FloatArray, dy: FloatArray) -> None:
        fill(y, data, dy)

    def events(_: float, y: FloatArray, h: FloatArray) -> None:
        h[0] = nearest(y, data)

    events.terminal, events.direction = [True], [-1]  # type: ignore[attr-defined]
    solver = CVODE(
        rates, method=method, rtol=tolerance, atol=tolerance, eventsfn=events, num_events=1,
        max_num_steps=100_000,
    )  # fmt: skip

    def run() -> FloatArray:
        data[:] = functions.data
        now, y = start, problem.start
        for _ in range(MOST_EVENTS):
            solver.init_step(now, y)
            part = solver.step(end, tstop=end)
            now, y = part.t, part.y
            if part.status < 0:
                raise LostEventError(part.message)
            if now >= end:
                return y
            functions.flip(y, data)
        raise LostEventError(f"more than {MOST_EVENTS} events")

    return run
