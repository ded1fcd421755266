"""Event-selected hybrid systems: stepping, event localisation and mode bookkeeping."""

from hopdata.hybrid.compiled.callbacks import Callback, field, guards, on_event
from hopdata.hybrid.solution import EventLog, Solution
from hopdata.hybrid.solve import solve
from hopdata.hybrid.system import System

__all__ = ["Callback", "EventLog", "Solution", "System", "field", "guards", "on_event", "solve"]
