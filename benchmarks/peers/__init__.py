"""Peers of the integrator: one module each, all of the same shape.

A module offers ``solvers(problem) -> list[Solver]``, empty for a scene that it does not have.
"""

from __future__ import annotations

from importlib import import_module

from peers.problems import Problem
from peers.solver import Solver

MODULES = {
    "hopdata": "hopdata_peer",
    "SciPy": "scipy_peer",
    "SUNDIALS": "sundials_peer",
    "heyoka": "heyoka_peer",
    "diffrax": "diffrax_peer",
    "MuJoCo": "mujoco_peer",
}


def solvers_of(problem: Problem) -> tuple[list[Solver], dict[str, str]]:
    """Return all solvers of a scene, and the peers that are absent, with the reason."""
    found: list[Solver] = []
    absent: dict[str, str] = {}
    for package, name in MODULES.items():
        try:
            module = import_module(f"peers.{name}")
        except (ImportError, OSError, AttributeError) as error:
            absent[package] = str(error)
            continue
        found += module.solvers(problem)
    return found, absent
