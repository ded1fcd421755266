"""Peers of the integrator: one module each, all of the same shape.

A module offers ``solvers(problem) -> list[Solver]``, empty for a scene that it does not have. Ours
is here: one call of `solve` from Python, and its share of a batch.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module

import numpy as np

from hopdata.hybrid import System, solve, solve_batch
from peers.problems import FloatArray, LostEventError, Problem, Run, Solver

MODULES = {
    "SciPy": "scipy_peer",
    "SUNDIALS": "sundials_peer",
    "heyoka": "heyoka_peer",
    "diffrax": "diffrax_peer",
    "MuJoCo": "mujoco_peer",
}


def solvers_of(problem: Problem) -> tuple[list[Solver], dict[str, str]]:
    """Return all solvers of a scene, and the peers that are absent, with the reason."""
    found = our_solvers(problem)
    absent: dict[str, str] = {}
    for package, name in MODULES.items():
        try:
            module = import_module(f"peers.{name}")
        except (ImportError, OSError, AttributeError) as error:
            absent[package] = str(error)
            continue
        found += module.solvers(problem)
    return found, absent


METHODS = ("auto", "dopri5", "dop853", "taylor")
BATCH = 200


def our_solvers(problem: Problem) -> list[Solver]:
    """Return each method that `solve` has, in a call of its own and in a batch."""
    forms = {"": problem.system} | {f", {name}": form for name, form in problem.forms.items()}
    ways = {"hopdata, call": (prepare, 1), "hopdata, batch": (prepare_batch, BATCH)}
    return [
        Solver("hopdata", way, method + form, partial(prepared, problem, system, method), count)
        for form, system in forms.items()
        for method in methods_for(system)
        for way, (prepared, count) in ways.items()
    ]


def methods_for(system: System) -> tuple[str, ...]:
    """Return the methods that serve a system; Taylor's is for affine modes."""
    return tuple(method for method in METHODS if system.affine is not None or method != "taylor")


def prepare(problem: Problem, system: System, method: str, tolerance: float) -> Run:
    """Return one call."""
    system.compile(method)
    span, y0, params = problem.t_span, problem.y0, problem.params

    def run() -> FloatArray:
        solution = solve(
            system, span, y0, params=params, rtol=tolerance, atol=tolerance, method=method
        )
        if solution.status != 0:
            raise LostEventError(solution.message)
        return solution.y_end

    return run


def prepare_batch(problem: Problem, system: System, method: str, tolerance: float) -> Run:
    """Return a batch of the same trajectory, on one thread."""
    system.compile(method)
    states, span, params = np.tile(problem.start, (BATCH, 1)), problem.t_span, problem.params

    def run() -> FloatArray:
        batch = solve_batch(
            system, span, states, params=params, rtol=tolerance, atol=tolerance, method=method,
            workers=1,
        )  # fmt: skip
        return batch.y_end[-1]

    return run
