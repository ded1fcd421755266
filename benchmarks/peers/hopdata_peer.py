"""hopdata: one call of `solve` from Python, and its share of a batch."""

from __future__ import annotations

from functools import partial
from inspect import signature
from typing import Any

import numpy as np

import hopdata.hybrid as hybrid
from peers.problems import Problem
from peers.solver import FloatArray, LostEventError, Run, Solver

METHODS = ("auto", "dopri5", "dop853", "taylor")
BATCH = 200


def solvers(problem: Problem) -> list[Solver]:
    """Return each method that `solve` has, in a call of its own and in a batch."""
    methods = METHODS if "method" in signature(hybrid.solve).parameters else ("dopri5",)
    if getattr(problem.system, "affine", None) is None:
        methods = tuple(method for method in methods if method != "taylor")
    single = [
        Solver("hopdata", "hopdata, call", name, partial(prepare, problem, name))
        for name in methods
    ]
    if not hasattr(hybrid, "solve_batch"):
        return single
    return single + [
        Solver("hopdata", "hopdata, batch", name, partial(prepare_batch, problem, name), BATCH)
        for name in methods
    ]


def options(function: Any, method: str, tolerance: float) -> dict[str, Any]:
    """Return the keywords that a function takes."""
    chosen: dict[str, Any] = {"rtol": tolerance, "atol": tolerance}
    if "method" in signature(function).parameters:
        chosen["method"] = method
    return chosen


def prepare(problem: Problem, method: str, tolerance: float) -> Run:
    """Return one call."""
    system, span, y0, params = problem.system, problem.t_span, problem.y0, problem.params
    chosen = options(hybrid.solve, method, tolerance)

    def run() -> FloatArray:
        solution = hybrid.solve(system, span, y0, params=params, **chosen)
        if solution.status != 0:
            raise LostEventError(solution.message)
        return solution.y_end

    return run


def prepare_batch(problem: Problem, method: str, tolerance: float) -> Run:
    """Return a batch of the same trajectory, on one thread."""
    solve_batch: Any = hybrid.solve_batch  # type: ignore[attr-defined]
    states, params = np.tile(problem.start, (BATCH, 1)), np.array(problem.params)
    chosen = options(solve_batch, method, tolerance)

    def run() -> FloatArray:
        batch = solve_batch(
            problem.system, problem.t_span, states, params=params, workers=1, **chosen
        )
        return batch.y_end[-1]

    return run
