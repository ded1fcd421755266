"""How the parts of the driver, and of methods, are compiled.

Division by zero gives infinity or NaN, which the driver looks for anyway, instead of an exception,
for which each division would be guarded by a branch.

`kernel` is called by other kernels. `kernel_in_loop` is for what is done once a step: a call costs
as much as several field evaluations, because the views of all arrays are handed over as single
numbers, so it is put into its callers. `kernel_apart` never is, wherever it is called from: for
what is long and done once an event, which else would be optimised in many copies, and for loops
over guards, which become vector instructions only in a function of their own. `ENTRY` are the
options of what is called from outside, by Python or by its address.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from numba import njit

ENTRY: dict[str, Any] = {"error_model": "numpy"}

try:
    from hopdata.hybrid.compiled.linking import Apart, Entry, Kernel, linked
except ImportError:  # of another Numba: it compiles the same, in five times as long
    kernel: Any = njit(error_model="numpy")
    kernel_apart: Any = kernel
    kernel_in_loop: Any = njit(error_model="numpy", forceinline=True)
else:
    ENTRY["pipeline_class"] = Entry
    kernel = partial(linked, Kernel)
    kernel_apart = partial(linked, Apart)
    kernel_in_loop = partial(linked, Kernel, forceinline=True)
