"""The integration method as the dissertation prints it (chapter IV), in plain NumPy.

A reference beside `hopdata.hybrid.solve`, not a faster way: a classical solver runs until an event
function has changed sign between two points of its mesh (`integrate`); the events on that step are
then resolved on cubic Hermite splines, with a third-order step to its end (`resolve_contacts`).

Put right: slopes are refreshed after each crossing; locks are kept from step to step instead of
being read from signs again; a guard at zero has the lock that its rate leads to; one at or beyond
zero at the start of a step, though not crossed, is crossed there; the loop over regions ends at the
final time and begins from rest. Kept as limits: the step after an event has no error control, and
signs are compared on the mesh alone.
"""

from hopdata.hybrid.printed.classical import Mesh, PrintedOptions, Region, Stepping, region_of
from hopdata.hybrid.printed.contacts import resolve_contacts
from hopdata.hybrid.printed.supervisor import PrintedSolution, integrate, integrate_alternating

__all__ = [
    "Mesh",
    "PrintedOptions",
    "PrintedSolution",
    "Region",
    "Stepping",
    "integrate",
    "integrate_alternating",
    "region_of",
    "resolve_contacts",
]
