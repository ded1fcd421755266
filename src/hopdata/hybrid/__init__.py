"""Event-selected hybrid systems: stepping, localisation of events, and modes."""

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
from hopdata.hybrid.methods.sparsity import find_sparsity
from hopdata.hybrid.solution import EventLog, Solution
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System

__all__ = [
    "BatchSolution",
    "Callback",
    "EventLog",
    "OdeResult",
    "SlowCallbackWarning",
    "Solution",
    "System",
    "affine",
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
