"""Integrate vector fields with guards, event by event.

    from hopdata.hybrid import System, solve

The modules of this folder are what a user calls, and what stands directly beneath it:
`system` and `arguments` check what is given, `solve`, `batch` and `ivp` run it, and
`solution` and `zeno` hold what comes back. `workspace` and `layout` are the memory of a
run. `derived` makes another system of a system: backward in time, or with parameters
as states. `filtering` estimates states from measurements, through events.

The rooms:

``driver``
    The loop that all integrations share: step, proof, landing, event.
``methods``
    One module for each kind of method, and the table of their names.
``numbers``
    Kinds of number for which a user's functions compile as they are: ranges, by which
    guards are proven, and dual numbers, by which derivatives are exact.
``compiled``
    From Python functions to machine code.
``sliding``
    Another system of a system: one that slides along surfaces (Filippov).
``lanes``
    Many systems at a time, in the lanes of the vector unit.
``gradients``
    The derivative of one number by many parameters, backward through a run.
``first_order``
    Saltation matrices, Bouligand derivatives, and checks whether a system is C1.
``printed``
    The dissertation's method, as printed and corrected, around any solver.

docs/integrator.md is the page to begin with, docs/integrator_step.md the way through
the driver. Nothing here imports the rest of hopdata but `arrays` (types of arrays),
`code_cache`, `errors`, `private_numba` and `seal`, which the package hopdata-hybrid
brings with it.
"""

from hopdata.hybrid.batch import BatchSolution, solve_batch
from hopdata.hybrid.compiled.callbacks import (
    Callback,
    affine,
    field,
    guard,
    guards,
    jacobian,
    on_event,
    rate_bound,
    together,
)
from hopdata.hybrid.compiled.declare import SlowCallbackWarning
from hopdata.hybrid.ivp import OdeResult, solve_ivp
from hopdata.hybrid.known_instants import Every, every
from hopdata.hybrid.methods.traced_pattern import find_sparsity
from hopdata.hybrid.solution import EventLog, Solution
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System

__all__ = [
    "BatchSolution",
    "Callback",
    "EventLog",
    "Every",
    "OdeResult",
    "SlowCallbackWarning",
    "Solution",
    "System",
    "affine",
    "every",
    "field",
    "find_sparsity",
    "guard",
    "guards",
    "jacobian",
    "on_event",
    "rate_bound",
    "solve",
    "solve_batch",
    "solve_ivp",
    "together",
]
