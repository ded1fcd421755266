"""How the parts of the driver are compiled."""

from __future__ import annotations

from numba import njit

# Division by zero gives infinity or NaN, which the driver looks for anyway, instead of an
# exception, for which each division would be guarded by a branch.
kernel = njit(error_model="numpy")

# For what is done once a step: a call costs as much as several field evaluations, because the views
# of all arrays are handed over as single numbers.
kernel_in_loop = njit(error_model="numpy", forceinline=True)
