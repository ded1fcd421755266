"""Types of arrays, and the one constant of nature that several rooms need."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

GRAVITY_M_S2 = 9.80665  # the standard acceleration of free fall (3rd CGPM, 1901)
