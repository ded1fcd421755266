"""hopdata: one call of `solve` from Python, and its share of a batch."""

from __future__ import annotations

from functools import partial
from inspect import signature
from typing import Any

import numpy as np

import hopdata.hybrid as hybrid
from hopdata.hybrid import System
from peers.problems import Problem
from peers.solver import FloatArray, LostEventError, Run, Solver

METHODS = ("auto", "dopri5", "dop853", "taylor")
BATCH = 200


def solvers(problem: Problem) -> list[Solver]:
    """Return each method that `solve` has, in a call of its own and in a batch."""
    forms = {"": problem.system} | {f", {name}": form for name, form in problem.forms.items()}
    ways: dict[str, tuple[Any, int]] = {"hopdata, call": (prepare, 1)}
    if hasattr(hybrid, "solve_batch"):
        ways["hopdata, batch"] = (prepare_batch, BATCH)
    return [
        Solver("hopdata", way, method + form, partial(prepared, problem, system, method), count)
        for form, system in forms.items()
        for method in methods_for(system)
        for way, (prepared, count) in ways.items()
    ]


def methods_for(system: System) -> tuple[str, ...]:
    """Return the methods that serve a system; Taylor's is for affine modes."""
    if "method" not in signature(hybrid.solve).parameters:
        return ("dopri5",)
    affine = getattr(system, "affine", None) is not None
    return tuple(method for method in METHODS if affine or method != "taylor")


def options(function: Any, method: str, tolerance: float) -> dict[str, Any]:
    """Return the keywords that a function takes."""
    chosen: dict[str, Any] = {"rtol": tolerance, "atol": tolerance}
    if "method" in signature(function).parameters:
        chosen["method"] = method
    return chosen


def prepare(problem: Problem, system: System, method: str, tolerance: float) -> Run:
    """Return one call."""
    span, y0, chosen = problem.t_span, problem.y0, options(hybrid.solve, method, tolerance)

    def run() -> FloatArray:
        solution = hybrid.solve(system, span, y0, params=problem.params, **chosen)
        if solution.status != 0:
            raise LostEventError(solution.message)
        return solution.y_end

    return run


def prepare_batch(problem: Problem, system: System, method: str, tolerance: float) -> Run:
    """Return a batch of the same trajectory, on one thread."""
    solve_batch: Any = hybrid.solve_batch  # type: ignore[attr-defined]
    states, span = np.tile(problem.start, (BATCH, 1)), problem.t_span
    chosen = options(solve_batch, method, tolerance)

    def run() -> FloatArray:
        batch = solve_batch(system, span, states, params=problem.params, workers=1, **chosen)
        return batch.y_end[-1]

    return run
